"""Grids of voxels: their values at points of index space, where the point (i, j, k) is that of voxel (i, j, k).

Around a grid lies 0, so that values fade out within the last voxel (two with cubic interpolation).

References
----------
Blender, intern/cycles/kernel/util/texture_3d.h: B-splines for cubic interpolation.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from raytracer.arrays.types import Floats, Indices
from raytracer.scene.media import Grid


def sample_grid(grid: Grid, points: Floats) -> Floats:
    """Return the values (n,) or (n, 3) of a grid at points (n, 3) of its index space."""
    values = np.zeros((len(points), *grid.values.shape[3:]))
    near = np.flatnonzero((np.abs(points - _find_middle(grid)) < _find_reach(grid)).all(axis=1))
    if len(near):
        taps = {"closest": _closest_taps, "linear": _linear_taps, "cubic": _cubic_taps}[grid.interpolation]
        values[near] = _sum_taps(grid, *taps(points[near]))
    return values


def _find_middle(grid: Grid) -> Floats:
    return (np.array(grid.values.shape[:3]) - 1.0) / 2.0


def _find_reach(grid: Grid) -> Floats:
    """Return how far from its middle a grid may have values other than 0: two voxels beyond its outermost points."""
    return _find_middle(grid) + 2.0


# What interpolation takes of each axis: the first of the voxels, and their weights (taps, n, 3).
Taps = tuple[Floats, Floats]


def _closest_taps(points: Floats) -> Taps:
    return np.floor(points + 0.5), np.ones((1, *points.shape))


def _linear_taps(points: Floats) -> Taps:
    first = np.floor(points)
    rest = points - first
    return first, np.stack([1.0 - rest, rest])


def _cubic_taps(points: Floats) -> Taps:
    """The four weights of a uniform cubic B-spline."""
    whole = np.floor(points)
    t = points - whole
    u = 1.0 - t
    weights = np.stack([u**3, 3 * t**3 - 6 * t**2 + 4, 3 * u**3 - 6 * u**2 + 4, t**3]) / 6.0
    return whole - 1.0, weights


def _sum_taps(grid: Grid, first: Floats, weights: Floats) -> Floats:
    """Return the sums over all voxels of their weights' products; those beyond the border count nothing."""
    shape = grid.values.shape[:3]
    flat = grid.values.reshape(-1, *grid.values.shape[3:])
    start = first.astype(np.int64)
    total = np.zeros((len(start), *flat.shape[1:]))
    places = [_find_places(start, weights, axis, shape[axis]) for axis in range(3)]
    for i, j, k in product(range(len(weights)), repeat=3):
        (x, a), (y, b), (z, c) = places[0][i], places[1][j], places[2][k]
        weight = a * b * c
        found = flat.take((x * shape[1] + y) * shape[2] + z, axis=0)
        total += weight * found if found.ndim == 1 else weight[:, np.newaxis] * found
    return total


def _find_places(start: Indices, weights: Floats, axis: int, count: int) -> list[tuple[Indices, Floats]]:
    """Return for each tap of an axis the voxel's number (n,), within the grid, and its weight (n,)."""
    found = []
    for tap, of_tap in enumerate(weights):
        place = start[:, axis] + tap
        within = (place >= 0) & (place < count)
        found.append((np.where(within, place, 0), np.where(within, of_tap[:, axis], 0.0)))
    return found
