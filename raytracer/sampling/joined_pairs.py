"""Pairs of coordinates that are good together: which point of its sequence each takes for a sample's number.

What lies in a pixel's shadow is a matter of where in the pixel and of where on the light: of two pairs at once. Pairs
that are shuffled at random ("padded") are good each by itself, and together no better than random points. Here pair p
takes for the sample i the point A_p i of Sobol's first two dimensions, where the bits of i are a vector modulo 2 and
A_p a matrix, upper triangular with ones on its diagonal. So every pair stays a (0,2)-sequence, aligned runs of 2^k
samples its nets; and A_p is chosen so that two pairs together are about as even in four dimensions as points can be.

The pairs are, in this order: none (A = 1), and those of MIXING. Their first 12 columns were searched for, column by
column from random ones, for the least sum over m = 1 to 12 of

    m sum_k G_k 2^(-0.7 |k|),    |k| = k_1 + k_2 + k_3 + k_4,

of any two pairs: what 2^m points leave, once they are Owen-scrambled, of the variance of a function whose part of the
digits k falls so with |k|. G_k is its share, 1 for random points and 0 where the points are a net as to those digits.
The other columns, of samples beyond 4096, are random.

References
----------
A. B. Owen, "Monte Carlo Variance of Scrambled Net Quadrature", 1997: the gains G_k.
L. Paulin, D. Coeurjolly, J.-C. Iehl, N. Bonneel, A. Keller, V. Ostromoukhov, "Cascaded Sobol' Sampling", 2021: pairs
that are good by themselves and together.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Words

# Of each pair but the first, the 32 columns of A: what each bit of the sample's number adds to that of the point.
# fmt: off
MIXING = (
    (
        0x1, 0x2, 0x5, 0xB, 0x10, 0x21, 0x67, 0xB6,
        0x12B, 0x27F, 0x491, 0xA6F, 0x173C, 0x3BB4, 0x63D3, 0xEDAD,
        0x1EC99, 0x38FFB, 0x5DCD3, 0xB9D5A, 0x18201E, 0x3B5C88, 0x6597B6, 0x984EB5,
        0x12F45E6, 0x39B98D2, 0x60C31C7, 0xBCE5CF4, 0x1A13FFE7, 0x33A58CFD, 0x72C02214, 0x97D48A12,
    ),
    (
        0x1, 0x3, 0x6, 0x8, 0x11, 0x22, 0x64, 0x92,
        0x135, 0x38B, 0x532, 0x87F, 0x1181, 0x2E4A, 0x536A, 0x9226,
        0x11736, 0x313CF, 0x73D13, 0xF1F7F, 0x1B1852, 0x344D6F, 0x42AE2A, 0xCC3743,
        0x1FB7107, 0x2CAD57A, 0x7DBE976, 0xB9FBBC5, 0x1A767779, 0x37A532EA, 0x6765611F, 0xD335869C,
    ),
    (
        0x1, 0x2, 0x7, 0xC, 0x10, 0x31, 0x56, 0xC9,
        0x18C, 0x378, 0x7E5, 0x92A, 0x1285, 0x33F0, 0x40F5, 0xEA75,
        0x18743, 0x22057, 0x43CFA, 0x84904, 0x130B17, 0x3C2565, 0x4F7BFE, 0xCCC049,
        0x107B37E, 0x38E6439, 0x5DB11A2, 0xA9C3FB0, 0x170C6A5B, 0x32E923C4, 0x75EA537B, 0x99004A75,
    ),
    (
        0x1, 0x2, 0x5, 0xB, 0x17, 0x2E, 0x72, 0xEA,
        0x199, 0x3DF, 0x75E, 0xB23, 0x184E, 0x277A, 0x68FA, 0xA5A6,
        0x17FF1, 0x2025A, 0x6A659, 0x8AE0E, 0x175139, 0x34F422, 0x51CD6B, 0xB41153,
        0x1FF6665, 0x31A3FC3, 0x7FB9696, 0xF741761, 0x1D7185DD, 0x22A99A55, 0x6D4CC0BF, 0xA082E653,
    ),
)
# fmt: on

# Bits of the numbers that are looked up at a time; a number has three such parts.
LOOKED_UP = 12


def make_tables(columns: tuple[int, ...]) -> NDArray[np.uint32]:
    """Return (3, 2^LOOKED_UP) uint32, what each of the three parts of a number adds, for 32 columns of A."""
    part = np.arange(1 << LOOKED_UP, dtype=np.uint32)
    tables = np.zeros((3, len(part)), np.uint32)
    for bit, column in enumerate(columns):
        table, shift = divmod(bit, LOOKED_UP)
        tables[table] ^= np.where(part >> np.uint32(shift) & np.uint32(1), np.uint32(column), np.uint32(0))
    return tables


def look_up(tables: NDArray[np.uint32], sample: Words) -> Words:
    """Return what numbers () or (n,) come to, by the tables of `make_tables`; a new array."""
    if not sample.size or sample.max() < 1 << LOOKED_UP:
        return tables[0].take(sample, mode="wrap")  # which does not ask again
    mask = np.uint32((1 << LOOKED_UP) - 1)
    low, middle, high = (tables[k].take(sample >> np.uint32(k * LOOKED_UP) & mask) for k in range(3))
    return low ^ middle ^ high
