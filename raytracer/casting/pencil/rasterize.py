"""Candidates of rays that share a point or a direction, found in the plane that they are projected to.

Triangles are projected once per view (`projection`), sorted front to back and laid over the rays' grid (`screen`).
Pairs of ray and triangle are looked at in float32: three edge functions and the nearness, each linear in the image
point. What lies outside by more than its derived tolerance is dropped; what lies inside by more is certainly hit, and
hides whatever is less near. The rest, little more than one candidate a ray, goes to `query`, which decides. So no
result depends on this module, only its price.

Big triangles are first laid over tiles of 8 x 8 cells (as in hierarchical z-buffers: N. Greene, M. Kass and G. Miller,
"Hierarchical Z-buffer visibility", 1993): tiles outside an edge or behind a triangle that covers them are left out.
Small ones are laid over rows of cells, and their boxes tried first, which spares most of the rows of `projection`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans
from raytracer.casting.geometry import Ids
from raytracer.casting.pencil.pencil import View
from raytracer.casting.pencil.projection import (
    EDGE_TOLERANCE,
    GRADIENT,
    HIGH,
    LOW,
    MOST,
    NEAR_TOLERANCE,
    PAD,
    ROW_COLUMNS,
    ROW_LEAST,
    ROW_MOST,
    Projection,
    make_rows,
)
from raytracer.casting.pencil.screen import TILE, TILE_BITS, Screen
from raytracer.casting.query import Query

# Pairs looked at at a time: what they need fits the cache.
PAIR_BLOCK = 8192
# Triangles laid over the grid at a time, at least and in how many parts at most; hidden ones are dropped between.
SMALLEST_PART, MOST_PARTS = 4096, 12
# Boxes of up to this many cells a side are laid over the rays at once, others over tiles first; a multiple of TILE.
SMALL_CELLS = 16


class Pairs(NamedTuple):
    """Rays, by place in the screen's order, and primitives that may meet, nearness at most `most`, or certainly do."""

    place: NDArray[np.int32]
    primitive_id: Ids
    most: NDArray[np.float32]
    certain: Booleans


@np.errstate(all="ignore")
def offer_projected(view: View, projection: Projection, query: Query, rows: slice) -> None:
    """Offer a query, whose rays are the view's `rows`, all primitives of a projection that they may hit."""
    Laying(view, projection, query, rows).run()


class Laying:
    """One batch of rays and the primitives that are laid over it."""

    def __init__(self, view: View, projection: Projection, query: Query, rows: slice) -> None:
        self.view = view
        self.query = query
        self.screen = Screen(view, rows, query.t_min, query.best)
        # Seen from where rays end, the nearest hit is their last: nothing hides what they meet first.
        self.hides = not view.pencil.arriving or query.any_hit
        visible = self._find_visible(projection.image)
        self.primitive_id = projection.primitive_id.take(visible)
        self.image = projection.image.take(visible, axis=0)
        self.kept: list[Pairs] = []

    def _find_visible(self, image: NDArray[np.float32]) -> NDArray[np.intp]:
        """Primitives over this batch's part of the image, front to back."""
        low, high = self.screen.low, self.screen.high
        over = (image[:, HIGH] >= low[0]) & (image[:, LOW] <= high[0])
        over &= (image[:, HIGH + 1] >= low[1]) & (image[:, LOW + 1] <= high[1])
        index = np.flatnonzero(over)
        most = image[index, MOST]
        if self.view.pencil.parallel and len(index):
            most = most - most.min()
        # The upper half of a non-negative float sorts as the float does, as far as order matters here.
        return index.take(np.argsort(~(most.view(np.uint32) >> 15).astype(np.uint16), kind="stable"))

    def run(self) -> None:
        """Lay primitives over the grid, front to back, then offer the pairs that are left."""
        first = np.stack([self.screen.find_cells(self.image[:, LOW + axis], axis) for axis in (0, 1)])
        last = np.stack([self.screen.find_cells(self.image[:, HIGH + axis], axis) for axis in (0, 1)])
        big = (last - first >= SMALL_CELLS).any(axis=0)
        for is_big, lay in ((True, self._lay_big), (False, self._lay_small)):
            chosen = np.flatnonzero(big == is_big)
            for part in _split(len(chosen)):
                lay(chosen[part], first, last)
        self._offer()

    def _lay_big(self, chosen: NDArray[np.intp], first: NDArray[np.int32], last: NDArray[np.int32]) -> None:
        """Pairs of triangle and tile, then of triangle and ray."""
        screen = self.screen
        table = self._make_rows(chosen)
        low = first.take(chosen, axis=1) >> TILE_BITS
        wide, tall = (last.take(chosen, axis=1) >> TILE_BITS) - low + 1
        for run in _group_runs(wide * tall):
            item, step = _expand((wide * tall)[run])
            item += run.start
            tile_x, tile_y = low[0][item] + step % wide[item], low[1][item] + step // wide[item]
            item, tile = self._test_tiles(table, item, tile_x, tile_y)
            start = tile * (TILE * TILE)
            self._lay_runs(table, chosen, item, screen.first[start], screen.first[start + TILE * TILE])
        if self.hides:
            screen.refresh_tiles()

    def _test_tiles(
        self, table: NDArray[np.float32], item: NDArray, tile_x: NDArray, tile_y: NDArray
    ) -> tuple[NDArray, NDArray]:
        """Keep the pairs whose triangle may reach into the tile, before what covers the tile."""
        screen = self.screen
        half = np.float32(TILE / 2) / screen.scale
        x = screen.low[0] + (tile_x * 2 + 1).astype(np.float32) * half[0]
        y = screen.low[1] + (tile_y * 2 + 1).astype(np.float32) * half[1]
        half = half * np.float32(1 + PAD) + np.float32(PAD)
        rows = np.ascontiguousarray(table.take(item, axis=0).T)
        inside = np.full(len(item), np.inf, np.float32)
        reach = np.zeros(len(item), bool)
        for edge in range(0, GRADIENT, 3):
            value = rows[edge] * x + rows[edge + 1] * y + rows[edge + 2]
            spread = np.abs(rows[edge]) * half[0] + np.abs(rows[edge + 1]) * half[1] + rows[EDGE_TOLERANCE]
            reach |= value + spread < 0
            np.minimum(inside, value - spread, out=inside)
        tile = tile_y * screen.tiles_x + tile_x
        keep = ~reach
        if self.hides:
            centre = rows[GRADIENT] * x + rows[GRADIENT + 1] * y + rows[GRADIENT + 2]
            spread = np.abs(rows[GRADIENT]) * half[0] + np.abs(rows[GRADIENT + 1]) * half[1] + rows[NEAR_TOLERANCE]
            most = np.minimum(centre + spread, rows[ROW_MOST])
            least = np.maximum(centre - spread, rows[ROW_LEAST])
            covers = (inside > 0) & (least > screen.tile_sure.take(tile)) & (most < screen.tile_ceiling.take(tile))
            np.maximum.at(screen.tile_limit, tile[covers], least[covers])
            keep &= most >= screen.tile_limit.take(tile)
        index = np.flatnonzero(keep)
        return item[index], tile[index]

    def _lay_small(self, chosen: NDArray[np.intp], first: NDArray[np.int32], last: NDArray[np.int32]) -> None:
        """Rows of cells of each triangle's box, cut where a tile ends, then pairs of triangle and ray."""
        screen = self.screen
        (x0, y0), (x1, y1) = first.take(chosen, axis=1), last.take(chosen, axis=1)
        if self.hides:
            index = np.flatnonzero(self._may_be_seen(chosen, x0, y0, x1, y1))
            chosen, x0, y0, x1, y1 = chosen[index], x0[index], y0[index], x1[index], y1[index]
        tall, pieces = y1 - y0 + 1, (x1 >> TILE_BITS) - (x0 >> TILE_BITS) + 1
        item, step = _expand(tall * pieces)
        pieces = pieces.take(item)
        y, piece = y0.take(item) + step // pieces, step % pieces
        tile_x = (x0.take(item) >> TILE_BITS) + piece
        begin = np.maximum(x0.take(item), tile_x * TILE)
        end = np.minimum(x1.take(item), tile_x * TILE + TILE - 1)
        start, stop = (
            screen.first.take(screen.number_cells(begin, y)),
            screen.first.take(screen.number_cells(end, y) + 1),
        )
        filled = np.flatnonzero(stop > start)
        item, place = self._find_inside(chosen, item[filled], start[filled], stop[filled])
        used = np.zeros(len(chosen), bool)
        used[item] = True
        chosen, item = chosen[used], (np.cumsum(used, dtype=np.int32) - 1).take(item)
        table = self._make_rows(chosen)
        for part in _blocks(len(item)):
            self._test_pairs(table, chosen, item[part], place[part])
        if self.hides:
            screen.refresh_tiles()

    def _find_inside(
        self, chosen: NDArray, item: NDArray, start: NDArray, stop: NDArray
    ) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Pairs of primitives and the rays start..stop that lie in their boxes: items, and places of rays."""
        screen, count = self.screen, stop - start
        image = self.image.take(chosen, axis=0)
        found = [(np.zeros(0, np.int32), np.zeros(0, np.int32))]
        for run in _group_runs(count):
            pair, place = _expand(count[run], start[run])
            owner = item[run].take(pair)
            box = image.take(owner, axis=0)
            x, y = screen.x.take(place), screen.y.take(place)
            inside = (x >= box[:, LOW]) & (x <= box[:, HIGH]) & (y >= box[:, LOW + 1]) & (y <= box[:, HIGH + 1])
            index = np.flatnonzero(inside & (box[:, MOST] >= screen.limit.take(place)))
            found.append((owner.take(index), place.take(index)))
        owner, place = (np.concatenate(column) for column in zip(*found, strict=True))
        return owner, place

    def _may_be_seen(self, chosen: NDArray, x0: NDArray, y0: NDArray, x1: NDArray, y1: NDArray) -> Booleans:
        """False where all tiles that a small box touches are full of nearer hits."""
        screen = self.screen
        limit = np.full(len(chosen), np.inf, np.float32)
        inner = range(TILE, SMALL_CELLS, TILE)
        for x in (x0, *(np.minimum(x0 + step, x1) for step in inner), x1):
            for y in (y0, *(np.minimum(y0 + step, y1) for step in inner), y1):
                np.minimum(
                    limit, screen.tile_limit.take((y >> TILE_BITS) * screen.tiles_x + (x >> TILE_BITS)), out=limit
                )
        return self.image[chosen, MOST] >= limit

    def _lay_runs(
        self, table: NDArray[np.float32], chosen: NDArray, item: NDArray, start: NDArray, stop: NDArray
    ) -> None:
        """Look at the pairs of row `item` of the table and the rays start..stop of the screen's order."""
        count = stop - start
        for run in _group_runs(count):
            pair, place = _expand(count[run], start[run])
            self._test_pairs(table, chosen, item[run].take(pair), place)

    def _test_pairs(self, table: NDArray[np.float32], chosen: NDArray, item: NDArray, place: NDArray[np.int32]) -> None:
        """Keep the pairs that may be hits; let certain ones hide what is behind them."""
        screen = self.screen
        rows = np.ascontiguousarray(table.take(item, axis=0).T)
        x, y = screen.x.take(place), screen.y.take(place)
        edges = [rows[k] * x + rows[k + 1] * y + rows[k + 2] for k in range(0, GRADIENT, 3)]
        inside = np.minimum(np.minimum(edges[0], edges[1]), edges[2])
        near = rows[GRADIENT] * x + rows[GRADIENT + 1] * y + rows[GRADIENT + 2]
        most = np.minimum(near + rows[NEAR_TOLERANCE], rows[ROW_MOST])
        limit = screen.limit.take(place)
        index = np.flatnonzero((inside >= -rows[EDGE_TOLERANCE]) & (most >= limit))
        place, item, most = place[index], item[index], most[index]
        ids = self.primitive_id.take(chosen.take(item))
        certain = np.zeros(len(index), bool)
        if self.hides:
            least = np.maximum(near[index] - rows[NEAR_TOLERANCE][index], rows[ROW_LEAST][index])
            certain = inside[index] > rows[EDGE_TOLERANCE][index]
            certain &= (least > limit[index] + screen.margin.take(place)) & (most < screen.ceiling.take(place))
            sure = np.flatnonzero(certain)
            if self.query.any_hit:
                screen.limit[place[sure]] = np.inf
                self.query.settle(screen.ray.take(place[sure]), ids[sure])
            else:
                np.maximum.at(screen.limit, place[sure], least[sure])
        self.kept.append(Pairs(place, ids, most, certain))

    def _offer(self) -> None:
        """Offer what is still near enough; a ray's only candidate that is certain needs no further look."""
        if not self.kept:
            return
        place, ids, most, certain = (np.concatenate(column) for column in zip(*self.kept, strict=True))
        index = np.flatnonzero(most >= self.screen.limit.take(place))
        place, ids = place[index], ids[index]
        certain = certain[index] & (np.bincount(place, minlength=len(self.screen.ray)).take(place) == 1)
        ray, clear, rest = self.screen.ray.take(place), np.flatnonzero(certain), np.flatnonzero(~certain)
        self.query.settle(ray[clear], ids[clear])
        for part in _blocks(len(rest)):
            self.query.offer(ray[rest[part]], ids[rest[part]])

    def _make_rows(self, chosen: NDArray[np.intp]) -> NDArray[np.float32]:
        """(k, 16) float32 rows of triangles of the projection."""
        table = np.empty((len(chosen), ROW_COLUMNS), np.float32)
        for part in _blocks(len(chosen)):
            some = chosen[part]
            table[part] = make_rows(
                self.view, self.query.primitives, self.primitive_id.take(some), self.image.take(some, axis=0)
            )
        return table


def _expand(count: NDArray, start: NDArray | None = None) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """For counts (k,): the index of each of their sum of elements, and its number, from `start` (k,) or 0 upwards."""
    item = np.repeat(np.arange(len(count), dtype=np.int32), count)
    shift = count - np.cumsum(count) if start is None else start + count - np.cumsum(count)
    number = shift.astype(np.int32).take(item)
    number += np.arange(len(item), dtype=np.int32)
    return item, number


def _group_runs(count: NDArray) -> Iterator[slice]:
    """Group counts (k,) in order, each group with as many as make a block of pairs; a larger one alone."""
    total = np.cumsum(count)
    begin = 0
    while begin < len(count):
        done = int(total[begin - 1]) if begin else 0
        end = max(begin + 1, int(np.searchsorted(total, done + PAIR_BLOCK, side="right")))
        yield slice(begin, end)
        begin = end


def _blocks(count: int) -> Iterator[slice]:
    for start in range(0, count, PAIR_BLOCK):
        yield slice(start, start + PAIR_BLOCK)


def _split(count: int) -> Iterator[slice]:
    """Parts of a sorted list, the first ones small: they hide most of what follows."""
    size = max(SMALLEST_PART, -(-count // MOST_PARTS))
    for start in range(0, count, size):
        yield slice(start, start + size)
