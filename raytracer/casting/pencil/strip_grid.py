"""Rays that leave one point, sorted along strips of their image; triangles meet runs of them.

The image is cut into strips, and the rays of a strip are sorted by columns of cells: those between two columns follow
each other, a *run*. What lies in a triangle's box is in one run of each strip that it touches, so boxes need not grow
by what a pixel filter moves rays, and all samples of a pixel are met at once. Runs of one length are tested together:
none has to be filled up, and what is known of a triangle is gathered once for its run.

Coordinates count from the middle of a box of w x h cells. A run's rays are no farther from it than w / 2 along x and
h / 2 + STRIP along y, for a strip begins and ends less than its height beyond the box: that is the B of `patches`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.casting.pencil.grids import FLOAT32_ROUNDOFF, PAIR_BLOCK, Found, Grid, Plan, evaluate
from raytracer.casting.pencil.patches import CONSTANT, EDGES, SLOPE_X, SLOPE_Y, TOLERANCE, Items
from raytracer.casting.pencil.pencil import View

# Cells a side of a square that has one ray on average; cells a strip is high.
FINENESS, STRIP = 2, 4
# A tile is as wide and high, cells.
TILE = 4 * STRIP
# Columns and strips are numbered in 16 bits, which are sorted several times faster than 32.
MOST_CELLS, MOST_TILES_A_SIDE = 1 << 21, (1 << 16) // TILE
# Longer runs are cut.
LONGEST = 16


class Runs(NamedTuple):
    """r runs of an item and the rays from a place on, by length; number : (LONGEST + 1,) how many of each length."""

    item: NDArray[np.intp]
    place: NDArray[np.intp]
    number: NDArray[np.intp]


class StripGrid(Grid):
    """n rays of a view; a place is a ray's rank, by strips and along them.

    ray : (n,) intp, rays by places; x, y : (n,) float32 by places
    first : (strips * wide + 1,) int32, the first place of each cell of a strip, strip by strip
    """

    inclusive = False
    tile = TILE
    # Camera rays are alike from 32 to 48, 5% slower with 24; shadow rays in a room are slower with 48.
    large = 32

    def __init__(self, view: View) -> None:
        image = view.image
        across, up = _count_tiles(image.shape[1], view)
        wide, high = across * self.tile, up * self.tile
        # A little smaller than the grid, so that no ray lies beyond its last cell.
        half = np.array([wide, high]) / 2 * (1 - 2.0**-18)
        super().__init__(view.centre, np.diag([*half, 1.0]) @ view.matrix, view.step, wide, high)
        # Image points are float32 in [-1, 1], off by 2^-28 of the rectangle before; the product rounds once more.
        self.ray_error = float(half.max()) * (FLOAT32_ROUNDOFF / 2 + 2.0**-27 + FLOAT32_ROUNDOFF) * (1 + 2.0**-20)
        points = image * half.astype(np.float32)[:, np.newaxis]
        self.ray = self._sort(points)
        self.x, self.y = (coordinate.take(self.ray) for coordinate in points)

    def _sort(self, points: NDArray[np.float32]) -> NDArray[np.intp]:
        """The order of points (2, n) by strips and columns. Cells are rounded as those of boxes are (`find_cells`): a
        ray within a box is in a cell that the box touches."""
        column, row = (np.floor(points) - self.low).astype(np.int32)
        strip = row // STRIP
        cell = strip * self.wide + column
        self.first = np.zeros(self.high // STRIP * self.wide + 1, np.int32)
        np.cumsum(np.bincount(cell, minlength=len(self.first) - 1), out=self.first[1:])
        order = np.argsort(column.astype(np.uint16), kind="stable")
        return order.take(np.argsort(strip.astype(np.uint16).take(order), kind="stable"))

    def spread(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        return values.take(self.ray)

    def name_rays(self, place: NDArray[np.int32]) -> NDArray[np.intp]:
        return self.ray.take(place)

    def limit_tiles(self) -> NDArray[np.float32]:
        start = self.first[:: self.tile]
        least = np.minimum.reduceat(np.append(self.limit, np.float32(np.inf)), start[:-1])
        least[start[1:] == start[:-1]] = np.inf
        return least.reshape(self.high // self.tile, self.tile // STRIP, -1).min(axis=1)

    def plan(self, first: NDArray[np.float32], last: NDArray[np.float32]) -> Plan:
        half = (last - first + 1) / 2
        reach = np.maximum(half[0], half[1] + STRIP)
        return Plan(None, first + half + self.low, reach, self._plan_runs(first, last))

    def plan_tiles(self, column: NDArray[np.intp], row: NDArray[np.intp]) -> Plan:
        first = (np.stack([column, row]) * self.tile).astype(np.float32)
        reach = np.full(len(column), np.float32(self.tile))
        return Plan(None, first + self.low, reach, self._plan_runs(first, first + np.float32(self.tile - 1)))

    def _plan_runs(self, first: NDArray[np.float32], last: NDArray[np.float32]) -> Runs:
        """Runs of rays in boxes of cells, first and last (2, n), strip after strip of each."""
        begin, end = first.astype(np.int32), last.astype(np.int32)
        strip = begin[1] // STRIP
        more = end[1] // STRIP - strip
        cell, across = strip * self.wide + begin[0], end[0] - begin[0] + 1
        item, parts = np.arange(len(more)), []
        while len(item):
            start = self.first.take(cell)
            parts.append((item, start, self.first.take(cell + across) - start))
            left = np.flatnonzero(more)
            item, across, more = item.take(left), across.take(left), more.take(left) - 1
            cell = cell.take(left) + self.wide
        if not parts:
            parts.append((item, cell, cell))
        item, place, length = _cut_long(*(np.concatenate(column) for column in zip(*parts, strict=True)))
        length = length.astype(np.uint8)
        order = np.argsort(length, kind="stable")
        return Runs(item.take(order), place.take(order).astype(np.intp), np.bincount(length, minlength=LONGEST + 1))

    def test(self, items: Items, plan: Plan) -> list[Found]:
        runs: Runs = plan.notes
        found, stop = [], int(runs.number[0])
        for length in np.flatnonzero(runs.number[1:]) + 1:
            start, stop = stop, stop + int(runs.number[length])
            size, lane = PAIR_BLOCK // length, np.arange(length)[:, np.newaxis]
            for begin in range(start, stop, size):
                part = slice(begin, min(begin + size, stop))
                found.append(self._cross(items, runs.item[part], runs.place[part] + lane))
        if not found:
            return []
        place, item, least = (np.concatenate(column) for column in zip(*found, strict=True))
        x, y = self.x.take(place), self.y.take(place)
        x -= items.base[0].take(item)
        y -= items.base[1].take(item)
        inside = least > 2 * items.rows[TOLERANCE].take(item)
        return [Found(place, item, inside, evaluate(items.rows, EDGES, item, x, y))]

    def _cross(
        self, items: Items, item: NDArray[np.intp], place: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float32]]:
        """Pairs of items (k,) and rays (length, k) that may meet: place, item, least edge function and tolerance."""
        x, y = self.x.take(place), self.y.take(place)
        x -= items.base[0].take(item)
        y -= items.base[1].take(item)
        least = find_least(items.rows, item, x, y)
        pair = np.flatnonzero(least >= 0)
        column = pair - pair // len(item) * len(item)
        return place.ravel().take(pair), item.take(column), least.ravel().take(pair)


def _cut_long(item: NDArray, place: NDArray, length: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Cut runs that are longer than LONGEST."""
    long = np.flatnonzero(length > LONGEST)
    if not len(long):
        return item, place, length
    parts = (length.take(long) - 1) // LONGEST  # beside the first
    run = long.repeat(parts)
    begun = (np.arange(1, len(run) + 1) - np.repeat(np.cumsum(parts) - parts, parts)) * LONGEST
    rest = np.minimum(length.take(run) - begun, LONGEST)
    return (
        np.concatenate([item, item.take(run)]),
        np.concatenate([place, place.take(run) + begun]),
        np.concatenate([np.minimum(length, LONGEST), rest]),
    )


def find_least(
    rows: NDArray[np.float32], item: NDArray[np.intp], x: NDArray[np.float32], y: NDArray[np.float32]
) -> NDArray[np.float32]:
    """The least edge function of items (k,) at points (length, k), and the tolerance of each.

    E + tolerance >= 0 is what is asked, so that nothing need be compared with the tolerance of each pair.
    """
    tolerance = rows[TOLERANCE].take(item)
    least, value, term = np.empty_like(x), np.empty_like(x), np.empty_like(x)
    for edge in range(EDGES):
        out = value if edge else least
        np.multiply(x, rows[SLOPE_X + edge].take(item), out=out)
        out += np.multiply(y, rows[SLOPE_Y + edge].take(item), out=term)
        constant = rows[CONSTANT + edge].take(item)
        constant += tolerance
        out += constant
        if edge:
            np.minimum(least, value, out=least)
    return least


def _count_tiles(count: int, view: View) -> tuple[int, int]:
    """Columns and rows of tiles, square cells of which FINENESS x FINENESS have about one ray."""
    width, height = (1.0 / np.linalg.norm(np.cross(row, view.matrix[2])) for row in view.matrix[:2])
    most = max(1.0, min(count * FINENESS**2, MOST_CELLS) / TILE**2)
    wide = int(np.clip(np.sqrt(most * width / height), 1, min(most, MOST_TILES_A_SIDE)))
    return wide, min(max(1, int(most) // wide), MOST_TILES_A_SIDE)
