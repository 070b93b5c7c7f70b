"""Streams of random numbers beside the sampler's, for what needs more of them than it has dimensions.

A stream is a 64-bit word, and its numbers are those of a generator that begins there: the same words give the same
numbers, in whatever batch they stand.

References
----------
G. L. Steele, D. Lea, C. H. Flood, "Fast Splittable Pseudorandom Number Generators", OOPSLA 2014: SplitMix64.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats

Noise = NDArray[np.uint64]


def draw(noise: Noise, number: int) -> Floats:
    """Return uniform numbers (n,) in [0, 1), the `number`-th of each stream: SplitMix64 of Steele, Lea and Flood."""
    word = noise + np.uint64((number + 1) * 0x9E3779B97F4A7C15 % 2**64)
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    word ^= word >> np.uint64(31)
    return (word >> np.uint64(11)) * 2.0**-53


def start_noise(pair: Floats, number: int = 0) -> Noise:
    """Return streams (n,) of random numbers that begin with uniform pairs (n, 2); another one for each number."""
    words = (pair * 2.0**32).astype(np.uint64)
    seed = (words[:, 0] << np.uint64(32)) | words[:, 1]
    return (draw(seed, 2**20 + number) * 2.0**53).astype(np.uint64) << np.uint64(11)


def hash_columns(*columns: Floats) -> Noise:
    """Return streams (n,) for numbers (n,) that are random themselves: the sums of their bits."""
    parts = [np.ascontiguousarray(column).view(np.uint64) for column in columns]
    total = parts[0].copy()
    for number, part in enumerate(parts[1:], start=1):
        total = total * np.uint64(0x9E3779B97F4A7C15) + part * np.uint64(2 * number + 1)
    return total
