"""Densities over all directions: a grid of latitudes and longitudes, piecewise constant, sampled row by row.

Cell (i, j) of a grid of h x w lies between the longitudes pi - 2 pi j / w and pi - 2 pi (j + 1) / w and the latitudes
pi (i / h - 1/2) and pi ((i + 1) / h - 1/2): the pixels of an equirectangular picture, as Blender lays it round +z.

References
----------
M. Pharr, W. Jakob, G. Humphreys, "Physically Based Rendering", 3rd edition, 13.6.7: piecewise constant 2D densities.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import join_columns, split_columns
from raytracer.arrays.types import Floats


def find_equirectangular(directions: Floats) -> tuple[Floats, Floats]:
    """Return where unit directions (n, 3) lie on an equirectangular picture: u and v (n,) from 0 to 1, v up."""
    x, y, z = split_columns(directions)
    u = 0.5 - np.arctan2(y, x) / (2.0 * np.pi)
    v = 0.5 + np.arctan2(z, np.hypot(x, y)) / np.pi
    return u, v


def place_equirectangular(u: Floats, v: Floats) -> Floats:
    """Return the unit directions (..., 3) at u and v: the inverse of `find_equirectangular`."""
    longitude, latitude = (0.5 - u) * 2.0 * np.pi, (v - 0.5) * np.pi
    across = np.cos(latitude)
    parts = (across * np.cos(longitude), across * np.sin(longitude), np.sin(latitude))
    return np.moveaxis(np.stack(np.broadcast_arrays(*parts)), 0, -1)


def measure_cells(height: int, width: int) -> Floats:
    """Return the solid angles (h, 1) of a grid's cells: 2 pi / w (sin(upper latitude) - sin(lower latitude))."""
    edges = np.sin((np.arange(height + 1) / height - 0.5) * np.pi)
    return (2.0 * np.pi / width * np.diff(edges))[:, np.newaxis]


@dataclass(frozen=True, eq=False)
class DirectionMap:
    """A density over directions.

    density : (h, w) float64, per solid angle; integrates to 1
    rows : (h,) float64, cumulative share of each row
    cells : (h w,) float64, i + the cumulative share within row i
    """

    density: Floats
    rows: Floats
    cells: Floats


def make_direction_map(values: Floats) -> DirectionMap | None:
    """Return the density proportional to `values` (h, w), 0 or more; None where all are 0."""
    height, width = values.shape
    weights = values * measure_cells(height, width)
    of_rows = weights.sum(axis=1)
    total = of_rows.sum()
    if not total > 0:
        return None
    within = np.cumsum(weights, axis=1)
    last = within[:, -1:]
    shares = np.divide(within, last, out=np.ones_like(within), where=last > 0)
    numbers = np.arange(height)[:, np.newaxis]
    return DirectionMap(values / total, np.cumsum(of_rows) / total, (shares + numbers).ravel())


def sample_map(grid: DirectionMap, pair: Floats) -> Floats:
    """Return unit directions (n, 3) with the grid's density, for uniform numbers (n, 2)."""
    height, width = grid.density.shape
    row, up = _invert(grid.rows, pair[:, 0], np.zeros(len(pair), np.int64), height)
    cell, along = _invert(grid.cells, row + pair[:, 1], row * width, width)
    low, high = (np.sin(((row + step) / height - 0.5) * np.pi) for step in (0, 1))
    z = low + up * (high - low)  # even over the sphere between the two latitudes
    longitude = (0.5 - (cell - row * width + along) / width) * 2.0 * np.pi
    across = np.sqrt(np.maximum(1.0 - z * z, 0.0))
    return join_columns(across * np.cos(longitude), across * np.sin(longitude), z)


def _invert(cumulative: Floats, at: Floats, first: NDArray[np.int64], count: int) -> tuple[NDArray[np.int64], Floats]:
    """Return which of the entries first .. first + count - 1 of a cumulative sum holds `at` (n,), and where in it."""
    entry = np.clip(np.searchsorted(cumulative, at, side="right"), first, first + count - 1)
    start = np.where(entry > first, cumulative[entry - 1], np.floor(at))
    width = cumulative[entry] - start
    rest = np.divide(at - start, width, out=np.zeros_like(at), where=width > 0)
    return entry, np.clip(rest, 0.0, np.nextafter(1.0, 0.0))


def map_density(grid: DirectionMap, directions: Floats) -> Floats:
    """Return the density (n,) per solid angle at unit directions (n, 3)."""
    height, width = grid.density.shape
    u, v = find_equirectangular(directions)
    row = np.clip((v * height).astype(np.int64), 0, height - 1)
    column = np.clip((u * width).astype(np.int64), 0, width - 1)
    return grid.density[row, column]
