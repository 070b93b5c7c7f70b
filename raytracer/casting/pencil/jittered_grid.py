"""Rays that leave one point, each somewhere in the square around the whole numbers of its cell: jittered pixels.

A ray keeps its own cell, so nothing is sorted; boxes of triangles grow by the jitter instead, to take in every cell
whose ray may be inside. Rays that a pixel filter with long tails has moved are quicker sorted (`strip_grid`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.casting.pencil.grids import FLOAT32_ROUNDOFF, Found, PixelGrid, evaluate
from raytracer.casting.pencil.patches import CONSTANT, EDGES, SLOPE_X, SLOPE_Y, TOLERANCE, Items

# What rays of a box filter of one pixel are beside their cells, and what a fit to them may be off: of n rays that are
# spread evenly the mean is known to .3 / sqrt(n).
MOST_JITTER = 0.5 + 2.0**-4


class JitteredGrid(PixelGrid):
    """As PixelGrid.

    xy : (places,) complex64, where rays are; NaN where there is none
    """

    def __init__(
        self,
        centre: Floats,
        matrix: Floats,
        step: Floats,
        wide: int,
        skipped: int,
        rounding: float,
        points: Floats,
        jitter: float,
    ) -> None:
        """points : (2, n) of all rays; jitter : cells, no ray is farther beside its cell"""
        super().__init__(centre, matrix, step, wide, skipped, rounding)
        self.jitter = jitter
        self.ray_error = rounding + FLOAT32_ROUNDOFF * self.size
        self.jitter += 2 * self.ray_error
        xy = points.astype(np.float32).T.copy().view(np.complex64)[:, 0]
        self.xy = self._spread_over_cells(xy, np.complex64(np.nan)).ravel()

    def _test_patches(
        self, items: Items, part: slice, cell: NDArray[np.int32], column: NDArray[np.int32], row: NDArray[np.int32]
    ) -> Found:
        """Pairs with the rays that have these cells."""
        cells = (row * np.int32(self.stride) + column)[:, np.newaxis] + cell
        rows, base, point = items.rows[:, part], items.base[:, part], self.xy.take(cells)
        x, y = point.real - base[0], point.imag - base[1]
        least = _find_least(rows, x, y)
        pair = np.flatnonzero(least >= -rows[TOLERANCE])
        item = pair - pair // len(cell) * len(cell)
        inside = least.ravel().take(pair) > rows[TOLERANCE].take(item)
        near = evaluate(rows, EDGES, item, x.ravel().take(pair), y.ravel().take(pair))
        return Found(cells.ravel().take(pair), item + part.start, inside, near)


def _find_least(rows: NDArray[np.float32], x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.float32]:
    """The least edge function of items (n,) at points (k, n) or (n,)."""
    least, term = x * rows[SLOPE_X], np.empty_like(x)
    least += np.multiply(y, rows[SLOPE_Y], out=term)
    least += rows[CONSTANT]
    value = np.empty_like(x)
    for edge in range(1, EDGES):
        np.multiply(x, rows[SLOPE_X + edge], out=value)
        value += np.multiply(y, rows[SLOPE_Y + edge], out=term)
        value += rows[CONSTANT + edge]
        np.minimum(least, value, out=least)
    return least
