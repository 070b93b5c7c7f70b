"""Rays that leave one point, on a grid over their image; how near a hit must be for each.

Coordinates x, y on the image count cells from its middle: h = A (p - centre), x = h_x / h_z, y = h_y / h_z; nearness is
1 / h_z (`pencil`). Three grids look alike to those who draw triangles on them:

    PixelGrid     rays at the whole numbers of a grid, row by row, as a script's pinhole camera casts them
    JitteredGrid  the same, each ray somewhere in the square around its whole numbers (`jittered_grid`)
    StripGrid     any rays (`strip_grid`), such as those of a renderer with a pixel filter, or several of each pixel

What is known of the rays' places is what makes a pair cheap. A *place* is where a ray's values are kept.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats
from raytracer.casting.pencil.patches import CONSTANT, EDGES, FUNCTIONS, SLOPE_X, SLOPE_Y, TOLERANCE, Items

FLOAT32_ROUNDOFF = 2.0**-24
# 1 / (t step) in float64, rounded to float32, is off by less than this share; and two such by less than twice.
RANGE_SLACK = 2.0**-20
LARGEST_LIMIT = 2.0**127
# Pairs tested together: what they need fits the cache.
PAIR_BLOCK = 1 << 15


class Found(NamedTuple):
    """Pairs of a ray, by place, and an item that may meet; whether they certainly do where the plane is in range."""

    place: NDArray[np.int32]
    item: NDArray[Any]
    inside: Booleans
    near: NDArray[np.float32]


class Plan(NamedTuple):
    """How a grid will test n items.

    order : in which it wants them; None for any
    base : (2, n), in that order, what local coordinates count from; reach : (n,) and are at most
    notes : the grid's own
    """

    order: NDArray[np.intp] | None
    base: NDArray[np.float32]
    reach: NDArray[np.float32]
    notes: Any


class Grid:
    """What all grids have.

    centre : (3,); matrix : (3, 3) float64, A
    wide, high : cells; low : (2, 1) float32, the first cell's coordinates
    tile : cells a side of the tiles whose least limit hides things, and into which large triangles are cut: those whose
        boxes have `large` cells a side or more
    ray_error : cells, how far a ray may lie beside its coordinates
    jitter : cells, how far those may lie beside the cell that has the ray
    step : (n,) float64, h_z of each ray's direction
    limit : (places,) float32, a hit that is less near cannot be the answer; infinite where there is no ray
    ceiling : (places,) float32, what is less near is certainly not before t_min; None where t_min is 0
    """

    inclusive: bool
    tile: int
    large: int

    def __init__(self, centre: Floats, matrix: Floats, step: Floats, wide: int, high: int) -> None:
        self.centre, self.matrix, self.step = centre, matrix, step
        self.wide, self.high = wide, high
        self.low = np.array([[-(wide // 2)], [-(high // 2)]], np.float32)
        self.ray_error = self.jitter = 0.0
        self.limit = np.zeros(0, np.float32)
        self.ceiling: NDArray[np.float32] | None = None

    @property
    def size(self) -> float:
        """No coordinate of a ray is larger, in cells."""
        return max(self.wide, self.high) / 2 + 1.0 + self.jitter

    def find_cells(self, low: NDArray[np.float32], high: NDArray[np.float32]) -> None:
        """Replace coordinates by the first and the last cell between them."""
        (np.ceil if self.inclusive else np.floor)(low, out=low)
        np.floor(high, out=high)

    def set_ranges(self, t_min: Floats, best: Floats) -> None:
        """Fill in `limit` and `ceiling` from the rays' ranges, (n,) each; `best` -inf where nothing can be hit."""
        with np.errstate(all="ignore"):
            self.limit = self.spread(limit_nearness(self.step, np.where(best < t_min, -np.inf, best)))
            if t_min.any():
                self.ceiling = self.spread(((1 - RANGE_SLACK) / (self.step * t_min)).astype(np.float32))

    def spread(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """(places,) of values (n,) of rays; infinite where there is no ray."""
        raise NotImplementedError

    def name_rays(self, place: NDArray[np.int32]) -> NDArray[np.intp]:
        """Rays of places."""
        raise NotImplementedError

    def limit_tiles(self) -> NDArray[np.float32]:
        """(tiles high, tiles wide) the least limit of the rays of each tile."""
        raise NotImplementedError

    def plan(self, first: NDArray[np.float32], last: NDArray[np.float32]) -> Plan:
        """Plan a test of triangles in boxes of cells, first and last (2, n), counted from the grid's first."""
        raise NotImplementedError

    def plan_tiles(self, column: NDArray[np.intp], row: NDArray[np.intp]) -> Plan:
        """Plan a test of triangles in one tile each."""
        raise NotImplementedError

    def test(self, items: Items, plan: Plan) -> list[Found]:
        """Pairs of items, in the plan's order, and rays that may meet."""
        raise NotImplementedError


def limit_nearness(step: Floats, best: Floats) -> NDArray[np.float32]:
    """(k,) a nearness below which no hit at t <= best is; infinite where best is below 0.

    At t = 0 nearness is infinite: the limit is a number that only a nearness without bound reaches.
    """
    limit = np.minimum((1 - RANGE_SLACK) / (step * best), LARGEST_LIMIT)
    return np.where(best < 0, np.inf, limit).astype(np.float32)


def evaluate(
    rows: NDArray[np.float32], function: int, item: NDArray[Any], x: NDArray[np.float32], y: NDArray[np.float32]
) -> NDArray[np.float32]:
    """One function of pairs (k,) of an item and a point."""
    value = rows[SLOPE_X + function].take(item)
    value *= x
    term = rows[SLOPE_Y + function].take(item)
    term *= y
    value += term
    value += rows[CONSTANT + function].take(item)
    return value


# Sides of patches, in cells, and which of them a box of so many cells takes; shapes are numbered side by side.
SIDES = (1, 2, 3, 4, 6, 8)
GUARD = SIDES[-1]
SIDE_OF = np.searchsorted(SIDES, np.arange(GUARD + 1)).astype(np.uint8)
LARGER_SIDE = np.maximum.outer(SIDES, SIDES).ravel().astype(np.float32)


class PixelGrid(Grid):
    """Ray k is in cell k + skipped, counted row by row, at its whole numbers within `ray_error`.

    Triangles are sorted by the shape of their boxes and tested shape by shape, each over a patch of cells from its
    first on. GUARD cells lie beside the grid, so that patches may reach over its end.
    """

    inclusive = True
    tile = large = GUARD

    def __init__(self, centre: Floats, matrix: Floats, step: Floats, wide: int, skipped: int, ray_error: float) -> None:
        super().__init__(centre, matrix, step, wide, -(-(skipped + len(step)) // wide))
        self.skipped, self.ray_error = skipped, ray_error
        self.stride = wide + GUARD

    def spread(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        return self._spread_over_cells(values, np.float32(np.inf)).ravel()

    def _spread_over_cells(self, values: NDArray[Any], nothing: Any) -> NDArray[Any]:
        """(high + GUARD, stride) of values (n,) of rays."""
        flat = np.full(self.high * self.wide, nothing, values.dtype)
        flat[self.skipped : self.skipped + len(values)] = values
        cells = np.full((self.high + GUARD, self.stride), nothing, values.dtype)
        cells[: self.high, : self.wide] = flat.reshape(self.high, self.wide)
        return cells

    def name_rays(self, place: NDArray[np.int32]) -> NDArray[np.intp]:
        ray = place - place // np.int32(self.stride) * np.int32(GUARD) - np.int32(self.skipped)
        return ray.astype(np.intp)

    def limit_tiles(self) -> NDArray[np.float32]:
        high, wide = -(-self.high // self.tile), -(-self.wide // self.tile)
        cells = self.limit[: (self.high + GUARD) * self.stride].reshape(-1, self.stride)
        cells = cells[: high * self.tile, : wide * self.tile]
        rows = cells.reshape(high, self.tile, wide * self.tile).min(axis=1)
        return rows.reshape(high, wide, self.tile).min(axis=2)

    def plan(self, first: NDArray[np.float32], last: NDArray[np.float32]) -> Plan:
        sides = SIDE_OF.take((last - first).astype(np.intp) + 1)
        shape = sides[0] * np.uint8(len(SIDES)) + sides[1]
        order = np.argsort(shape, kind="stable")
        reach = LARGER_SIDE.take(shape.take(order)) + np.float32(self.jitter)
        return Plan(order, first.take(order, axis=1) + self.low, reach, np.bincount(shape, minlength=len(SIDES) ** 2))

    def plan_tiles(self, column: NDArray[np.intp], row: NDArray[np.intp]) -> Plan:
        count = np.zeros(len(SIDES) ** 2, np.intp)
        count[-1] = len(column)
        return Plan(
            np.arange(len(column)), np.zeros((2, 0), np.float32), np.full(len(column), np.float32(self.tile)), count
        )

    def test(self, items: Items, plan: Plan) -> list[Found]:
        column, row = (items.base - self.low).astype(np.int32)
        cell = row * np.int32(self.stride) + column
        found, stop = [], 0
        for shape in np.flatnonzero(plan.notes):
            wide, high = SIDES[shape // len(SIDES)], SIDES[shape % len(SIDES)]
            start, stop = stop, stop + int(plan.notes[shape])
            size = max(256, PAIR_BLOCK // (wide * high))
            row, column = np.divmod(np.arange(wide * high, dtype=np.int32), np.int32(wide))
            for begin in range(start, stop, size):
                part = slice(begin, min(begin + size, stop))
                found.append(self._test_patches(items, part, cell[part], column, row))
        return found

    def _test_patches(
        self, items: Items, part: slice, cell: NDArray[np.int32], column: NDArray[np.int32], row: NDArray[np.int32]
    ) -> Found:
        """All functions of all pairs are one product of matrices, (cells, 3) and (3, items)."""
        rows = items.rows[:, part]
        factors = np.stack([np.ones_like(column), column, row], axis=1).astype(np.float32)
        value = np.matmul(factors, rows[:TOLERANCE].reshape(3, FUNCTIONS, -1).transpose(1, 0, 2))  # (4, cells, items)
        least = np.minimum(value[0], value[1], out=value[0])
        np.minimum(least, value[2], out=least)
        pair = np.flatnonzero(least >= -rows[TOLERANCE])
        step = pair // least.shape[1]
        item = pair - step * least.shape[1]
        place = (row * np.int32(self.stride) + column).take(step)
        place += cell.take(item)
        inside = least.ravel().take(pair) > rows[TOLERANCE].take(item)
        return Found(place, item + part.start, inside, value[EDGES].ravel().take(pair))
