"""Cryptomatte: for each pixel, which things are seen in it and what share of it each covers.

A thing is known by a hash of its name, as a float. A pixel holds a table of slots, (hash, coverage) in turn: 0, 0 where
there is none. What finds no slot is added to the last, and what covers most comes first.

References
----------
J. Friedman, A. C. Jones, "Fully automatic ID mattes with support for motion blur and transparency", SIGGRAPH 2015
talks, and the Cryptomatte specification 1.2. A. Appleby, MurmurHash3_x86_32.
Blender, intern/cycles/kernel/film/cryptomatte_passes.h (slots), util/murmurhash.cpp (hash to float).
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Floats, Indices

WORD = 2**32 - 1


def hash_name(name: str) -> int:
    """Return MurmurHash3_x86_32 of a name's UTF-8, with the seed 0.

    Examples
    --------
    >>> f"{hash_name('hello'):08x}"
    '248bfa47'
    """
    data, value = name.encode(), 0
    for start in range(0, len(data), 4):
        part = data[start : start + 4]
        word = int.from_bytes(part, "little") * 0xCC9E2D51 & WORD
        word = _rotate(word, 15) * 0x1B873593 & WORD
        value ^= word
        if len(part) == 4:
            value = (_rotate(value, 13) * 5 + 0xE6546B64) & WORD
    value ^= len(data)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35), (16, 1)):
        value = (value ^ value >> shift) * factor & WORD
    return value


def _rotate(word: int, count: int) -> int:
    return (word << count | word >> 32 - count) & WORD


def hash_to_float(value: int) -> float:
    """Return the float32 of a hash's bits, with the exponent kept from 1 to 254: neither 0, infinite nor NaN."""
    exponent = min(max(value >> 23 & 255, 1), 254)
    bits = value & 0x807FFFFF | exponent << 23
    return float(np.uint32(bits).view(np.float32))


def add_coverage(table: Floats, rows: Indices, identity: Floats, share: Floats) -> None:
    """Add to tables (p, 2 slots) the shares (k,) of `rows`, none twice, that things of an `identity` (k,) cover."""
    left = np.flatnonzero(share > 0)
    last = table.shape[1] - 2
    for slot in range(0, table.shape[1], 2):
        if not len(left):
            return
        row = rows[left]
        found = (table[row, slot + 1] == 0) | (table[row, slot] == identity[left]) | (slot == last)
        fresh = found & (table[row, slot + 1] == 0)
        table[row[fresh], slot] = identity[left[fresh]]
        table[row[found], slot + 1] += share[left[found]]
        left = left[~found]


def add_tables(table: Floats, rows: Indices, added: Floats) -> None:
    """Add tables (k, 2 slots) to those of `rows`, none twice."""
    for slot in range(0, added.shape[1], 2):
        add_coverage(table, rows, added[:, slot], added[:, slot + 1])


def sort_slots(table: Floats) -> Floats:
    """Return tables (n, 2 slots) with what covers most first."""
    slots = table.reshape(len(table), -1, 2)
    order = np.argsort(-slots[:, :, 1], axis=1, kind="stable")
    return np.take_along_axis(slots, order[:, :, np.newaxis], axis=1).reshape(table.shape)
