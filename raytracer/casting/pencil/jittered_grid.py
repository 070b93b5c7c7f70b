"""Rays that leave one point, each somewhere near the whole numbers of its cell of a grid: a renderer's pixels.

A ray keeps its own cell, so nothing is sorted; boxes of triangles grow by the jitter instead, to take in every cell
whose ray may be inside. Pixel filters with long tails would grow them for the sake of few: rays beyond MOST_JITTER are
*strays*, and also wait in the cell in which they truly lie.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.casting.pencil.grids import FLOAT32_ROUNDOFF, GUARD, Found, PixelGrid, Plan, evaluate
from raytracer.casting.pencil.patches import CONSTANT, EDGES, SLOPE_X, SLOPE_Y, TOLERANCE, Items

# Of Blackman-Harris over 1.5 pixels, 2.5% of the rays lie farther beside their pixel's centre.
MOST_JITTER = 1.0
# With more strays than this share, sorting is quicker.
MOST_STRAYS = 0.25
# Cells whose strays are tested together.
STRAY_BLOCK = 1 << 13


class JitteredGrid(PixelGrid):
    """As PixelGrid; places of strays follow those of cells, by cells.

    xy : (places,) complex64, where rays are; NaN where there is none
    stray : (s,) the rays; number, begin : (cells,) int32, how many wait in each cell, and their first place
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
        off: Floats,
    ) -> None:
        """points : (2, n) of all rays; off : (2, n), beside their cells"""
        super().__init__(centre, matrix, step, wide, skipped, rounding)
        beside = np.maximum(np.abs(off[0]), np.abs(off[1]))
        stray = np.flatnonzero(beside > MOST_JITTER)
        self.is_worthwhile = len(stray) <= MOST_STRAYS * len(beside)
        self.jitter = float(min(MOST_JITTER, beside.max()))
        self.spill = float(beside.max()) - self.jitter
        self.ray_error = rounding + FLOAT32_ROUNDOFF * self.size
        self.jitter += 2 * self.ray_error
        cell = self._seat_strays(points.take(stray, axis=1))
        order = np.argsort(cell, kind="stable")
        self.stray = stray.take(order)
        xy = points.astype(np.float32).T.copy().view(np.complex64)[:, 0]
        strays = xy.take(self.stray)
        xy[stray] = np.nan
        self.xy = np.concatenate([self._spread_over_cells(xy, np.complex64(np.nan)).ravel(), strays])

    def _seat_strays(self, points: Floats) -> NDArray[np.int32]:
        """The cells in which strays (2, s) lie, or the nearest ones of the grid; counts them."""
        last = np.array([[self.wide - 1.0], [self.high - 1.0]])
        column, row = np.clip(np.rint(points - self.low), 0, last).astype(np.int32)
        cell = row * np.int32(self.stride) + column
        self.number = np.bincount(cell, minlength=(self.high + GUARD) * self.stride).astype(np.int32)
        self.begin = (len(self.number) + np.cumsum(self.number) - self.number).astype(np.int32)
        self.is_visited = self.number > 0
        self.tile_of_stray = np.sort(cell) // self.stride // self.tile, np.sort(cell) % self.stride // self.tile
        return cell

    def spread(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        strays = values.take(self.stray)
        values = values.copy()
        values[self.stray] = np.inf
        return np.concatenate([super().spread(values), strays])

    def name_rays(self, place: NDArray[np.int32]) -> NDArray[np.intp]:
        ray = super().name_rays(place)
        stray = np.flatnonzero(place >= len(self.number))
        ray[stray] = self.stray.take(place.take(stray) - len(self.number))
        return ray

    def limit_tiles(self) -> NDArray[np.float32]:
        tiles = super().limit_tiles()
        np.minimum.at(tiles, self.tile_of_stray, self.limit[len(self.number) :])
        return tiles

    def test(self, items: Items, plan: Plan) -> list[Found]:
        self.waiting: list[tuple[NDArray[np.int32], NDArray[np.intp]]] = []
        found = super().test(items, plan)
        if self.waiting:
            cell, item = (np.concatenate(column) for column in zip(*self.waiting, strict=True))
            for start in range(0, len(cell), STRAY_BLOCK):
                part = slice(start, start + STRAY_BLOCK)
                found.append(self._test_strays(items, cell[part], item[part]))
        return found

    def _test_patches(
        self, items: Items, part: slice, cell: NDArray[np.int32], column: NDArray[np.int32], row: NDArray[np.int32]
    ) -> Found:
        """Pairs with the rays that have these cells; those with strays wait, to be tested together."""
        cells = (row * np.int32(self.stride) + column)[:, np.newaxis] + cell
        if len(self.stray):
            visited = np.flatnonzero(self.is_visited.take(cells))
            self.waiting.append((cells.ravel().take(visited), visited % len(cell) + part.start))
        rows, base, point = items.rows[:, part], items.base[:, part], self.xy.take(cells)
        x, y = point.real - base[0], point.imag - base[1]
        least = _find_least(rows, x, y)
        pair = np.flatnonzero(least >= -rows[TOLERANCE])
        item = pair - pair // len(cell) * len(cell)
        inside = least.ravel().take(pair) > rows[TOLERANCE].take(item)
        near = evaluate(rows, EDGES, item, x.ravel().take(pair), y.ravel().take(pair))
        return Found(cells.ravel().take(pair), item + part.start, inside, near)

    def _test_strays(self, items: Items, cell: NDArray[np.int32], item: NDArray[np.intp]) -> Found:
        """Pairs with the strays of cells (k,)."""
        count = self.number.take(cell)
        shift: NDArray[np.int32] = self.begin.take(cell) + count - np.cumsum(count, dtype=np.int32)
        place: NDArray[np.int32] = np.repeat(shift, count) + np.arange(int(count.sum()), dtype=np.int32)
        item = np.repeat(item, count)
        rows, point = items.rows.take(item, axis=1), self.xy.take(place)
        x, y = point.real - items.base[0].take(item), point.imag - items.base[1].take(item)
        least = _find_least(rows, x, y)
        pair = np.flatnonzero(least >= -rows[TOLERANCE])
        inside = least.take(pair) > rows[TOLERANCE].take(pair)
        near = evaluate(rows, EDGES, pair, x.take(pair), y.take(pair))
        return Found(place.take(pair), item.take(pair), inside, near)


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
