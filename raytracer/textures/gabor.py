"""Gabor noise in two and three dimensions: short waves of one frequency, scattered over the cells of a lattice.

Each cell holds eight, each a wave under a bell, exp(-pi r^2) (1 + cos(pi r^2)) / 2 exp(2 pi i f w . x), added or
subtracted as a coin falls, so that the mean is 0. Points are (n, k) float64.

References
----------
A. Lagae et al., "Procedural Noise using Sparse Gabor Convolution", ACM Transactions on Graphics 28(3), 2009: eq. 6, 8.
V. Tavernier et al., "Making Gabor Noise Fast and Normalized", Eurographics 2019: as many waves in each cell.
T. Tricard et al., "Procedural Phasor Noise", ACM Transactions on Graphics 38(4), 2019: phase and intensity.
Blender, intern/cycles/kernel/svm/gabor.h: the window, the hashes, the scale.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.lecture import dot
from raytracer.textures.noise import hash_numbers

IMPULSES = 8
# The integral of the squared bell times squared sine, for high frequencies (Lagae, eq. 9), by dimensions; the window is
# left out. Blender's scale also has a factor 1/2 for the coin.
VARIANCE = {2: 0.25, 3: 1.0 / (4.0 * np.sqrt(2.0))}
# The range from -1 to 1 holds so many standard deviations on each side.
DEVIATIONS = 6.0


class Waves(NamedTuple):
    """How waves run.

    frequency : (n,); isotropy : (n,) 0 where all run alike, 1 where every way
    direction : (n,) an angle in the plane, or (n, 3) unit vectors in space
    """

    frequency: Floats
    isotropy: Floats
    direction: Floats


def sum_waves(points: Floats, waves: Waves) -> tuple[Floats, Floats]:
    """Return the sine and the cosine part (n,) of the waves at points (n, k), over what is scaled to be their range."""
    cell = np.floor(points)
    phasor = np.zeros((2, len(points)))
    for offset in product((-1.0, 0.0, 1.0), repeat=points.shape[1]):
        other = cell + offset[::-1]
        for number in range(IMPULSES):
            _add_wave(phasor, points - other, other, number, waves)
    scale = DEVIATIONS * np.sqrt(IMPULSES * 0.5 * VARIANCE[points.shape[1]])
    return phasor[1] / scale, phasor[0] / scale


def _add_wave(phasor: Floats, local: Floats, cell: Floats, number: int, waves: Waves) -> None:
    """Add one of a cell's waves to the cosine and sine (2, n) of points, which are local (n, k) to their cells."""
    turn, center, coin = (np.column_stack([cell, np.full(len(cell), 3.0 * number + k)]) for k in range(3))
    offset = local - _hash_place(center)
    near = np.flatnonzero(dot(offset, offset) < 1.0)
    if len(near) == 0:
        return
    offset, square = offset[near], dot(offset[near], offset[near])
    sign = np.where(hash_numbers(*coin[near].T) < 0.5, -1.0, 1.0)
    envelope = sign * np.exp(-np.pi * square) * (0.5 + 0.5 * np.cos(np.pi * square))
    along = _turn(turn[near], Waves(*(field[near] for field in waves)))
    angle = 2.0 * np.pi * waves.frequency[near] * dot(offset, along)
    phasor[0, near] += envelope * np.cos(angle)
    phasor[1, near] += envelope * np.sin(angle)


def _hash_place(seed: Floats) -> Floats:
    """Return a place (n, k) within the cell of seeds (n, k + 1)."""
    orders = ((0, 1, 2), (2, 0, 1)) if seed.shape[1] == 3 else ((0, 1, 2, 3), (2, 0, 3, 1), (3, 2, 1, 0))
    return np.stack([hash_numbers(*seed[:, order].T) for order in orders], axis=1)


def _turn(seed: Floats, waves: Waves) -> Floats:
    """Return the directions (n, k) of waves, turned at random where they are isotropic: by as much as half a turn."""
    if seed.shape[1] == 3:
        angle = waves.direction + (hash_numbers(*seed.T) - 0.5) * np.pi * waves.isotropy
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)
    x, y, z = waves.direction.T
    across = np.hypot(x, y)
    cosine = np.divide(x, across, out=np.ones_like(x), where=across > 0)
    random = np.pi * waves.isotropy * [hash_numbers(*seed[:, order].T) for order in ((0, 1, 2, 3), (2, 0, 3, 1))]
    inclination = np.arccos(np.clip(z, -1.0, 1.0)) + random[0]
    azimuth = np.where(y < 0, -1.0, 1.0) * np.arccos(np.clip(cosine, -1.0, 1.0)) + random[1]
    sine = np.sin(inclination)
    turned = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(inclination)], axis=1)
    return np.where(waves.isotropy[:, np.newaxis] == 0, waves.direction, turned)
