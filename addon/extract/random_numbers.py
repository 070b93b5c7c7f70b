"""The random numbers of objects, 0 to 1: of instances Blender's own, of others a hash of their name, as in Cycles."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from raytracer.textures.noise import hash_words

# Blender's random numbers of instances and of names are whole, 0 to this.
LARGEST_WORD = 2**32 - 1


def fill_random(random: list[float], name_words: Sequence[int]) -> None:
    """Give objects that are no instances, NaN so far, Cycles' number of their names (blender/object.cpp).

    name_words : `pack_name` of each object's name
    """
    rows = [row for row, number in enumerate(random) if math.isnan(number)]
    words = [name_words[row] for row in rows]
    hashed = hash_words(np.array(words, dtype=np.uint32), 0) / LARGEST_WORD  # all at once: NumPy's calls cost
    for row, number in zip(rows, hashed.tolist(), strict=True):
        random[row] = number


def read_random(word: int) -> float:
    """Return an instance's random number, as Cycles divides it (scene/object.cpp): of 32 bits without a sign, which
    Python gets with one."""
    return (word % 2**32) / LARGEST_WORD


def pack_name(name: str) -> int:
    """Return the 32 bits that Cycles makes of a name before it mixes them (util/hash.h: hash_string)."""
    word = 0
    for byte in name.encode():
        word = (word * 37 + byte) % 2**32
    return word
