"""Finds the triangles that rays from one point may hit, by drawing clusters of triangles on a grid of the rays.

Clusters go front to back, in a few parts. Between the parts a pyramid over the least nearness that rays still ask for
tells which clusters are hidden (N. Greene, M. Kass and G. Miller, "Hierarchical Z-buffer visibility", 1993). The
triangles of a part are set up together, as linear functions near their boxes (`patches`), and tested as the grid wants
it (`grids`), so that hardly any pair is gathered. Large ones are cut into tiles first.

What lies outside by more than its derived tolerance is dropped; what lies inside by more is certainly hit and hides
what is less near. Pairs in doubt are offered to the query at once: waiting, they would keep tiles open. So no result
depends on this module, only its price.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Integers
from raytracer.casting.measure import lie_out_in_float64
from raytracer.casting.pencil.cluster_culling import are_hidden, cull_clusters, list_sides, project_vertices
from raytracer.casting.pencil.clusters import CLUSTER, Clusters
from raytracer.casting.pencil.grids import PAIR_BLOCK, RANGE_SLACK, Found, Grid, Plan, limit_nearness
from raytracer.casting.pencil.patches import (
    LEAST,
    MOST,
    NEAR_ERROR,
    ROWS,
    Items,
    judge_image,
    may_reach,
    set_up_small,
    set_up_tiles,
    span_large,
)
from raytracer.casting.query import Query

# Triangles of the first part, at least, and how many parts follow each other at most.
SMALLEST_PART, PARTS = 8192, 3
# Triangles boxed and sorted together, and set up together: what they need fits the cache.
DRAW_BLOCK, SET_UP_BLOCK = 1 << 16, 1 << 14
# Tiles of large triangles set up together.
TILE_BLOCK = 8192


class Kept(NamedTuple):
    """Pairs, by place, that certainly are hits, with nearness at most `most`."""

    place: NDArray[np.int32]
    primitive_id: Integers
    most: NDArray[np.float32]


@np.errstate(all="ignore")
def offer_drawn(grid: Grid, clusters: Clusters, query: Query) -> None:
    """Settle or offer all triangles that the rays of a grid, those of the query, may hit."""
    grid.set_ranges(query.t_min, query.best)
    Drawing(grid, clusters, query).run()


class Drawing:
    """One grid of rays and the clusters that are drawn on it."""

    def __init__(self, grid: Grid, clusters: Clusters, query: Query) -> None:
        self.grid, self.clusters, self.query = grid, clusters, query
        self.image = judge_image(grid.matrix, grid.ray_error)
        # Boxes of image points, rounded, grow by what these and rays are off; beyond the grid that does not matter.
        self.pad = np.float32(
            grid.jitter + 2 * (self.image.corner_share * grid.size + self.image.corner_error + grid.ray_error)
        )
        self.asked = np.zeros(len(grid.limit), bool)
        self.kept: list[Kept] = []
        self.doubtful: list[tuple[NDArray[np.int32], Integers]] = []

    def run(self) -> None:
        self.points = project_vertices(self.grid, self.clusters.vertices)
        index, box = cull_clusters(self.grid, self.clusters)
        start, size = 0, max(SMALLEST_PART // CLUSTER, -(-len(index) // PARTS))
        while start < len(index):
            part = slice(start, start + size)
            chosen = index[part]
            if start:
                chosen = chosen[~are_hidden(self.grid.limit_tiles(), box[:, part], self.grid.tile)]
            for first in range(0, len(chosen), DRAW_BLOCK // CLUSTER):
                self._draw(chosen[first : first + DRAW_BLOCK // CLUSTER])
            self._offer_doubtful()
            start += size
        self._offer()

    def _draw(self, chosen: NDArray[np.intp]) -> None:
        """Draw the triangles of clusters."""
        corner = self.clusters.corners.take(chosen, axis=0).transpose(1, 0, 2).reshape(-1)
        corners = self.points.take(corner, axis=1).reshape(3, 3, -1)  # (x y w, corner, triangle)
        primitive_id = self.clusters.primitive_id.take(chosen, axis=0).ravel()
        low, high = np.empty((2, len(primitive_id)), np.float32), np.empty((2, len(primitive_id)), np.float32)
        for axis in (0, 1):
            one, two, three = corners[axis]
            np.minimum(np.minimum(one, two), three, out=low[axis])
            np.maximum(np.maximum(one, two), three, out=high[axis])
        real = primitive_id >= 0
        large = np.flatnonzero(np.isnan(low[0]) & real)
        low -= self.pad
        high += self.pad
        self.grid.find_cells(low, high)
        # By the whole box, not by what of it is on the grid: local coordinates shall be small.
        widest = np.maximum(high[0] - low[0], high[1] - low[1])
        first, last, seen = self._clip(low, high)
        seen &= real
        small = np.flatnonzero(seen & (widest < self.grid.large))
        large = np.concatenate([large, np.flatnonzero(seen & (widest >= self.grid.large))])
        if len(large):
            self._draw_large(self._gather_relative(chosen, large), first, last, large, primitive_id.take(large))
        self._draw_small(corners, first, last, small, primitive_id)

    def _clip(self, low: NDArray, high: NDArray) -> tuple[NDArray, NDArray, Booleans]:
        """Boxes within the grid, counted from its low corner, and which reach it; all of it where they are NaN."""
        low, high = low - self.grid.low, high - self.grid.low
        last = np.array([[self.grid.wide - 1], [self.grid.high - 1]], np.float32)
        seen = ((low <= last) & (high >= 0)).all(axis=0)
        # NaN becomes 0 in the first, the last cell in the other.
        return np.fmin(np.fmax(low, 0), last), np.fmin(np.maximum(high, 0), last), seen

    def _draw_small(
        self, corners: NDArray, first: NDArray, last: NDArray, small: NDArray[np.intp], primitive_id: Integers
    ) -> None:
        """Sort boxes by size; set up and test those of one size together."""
        first, last = first.take(small, axis=1), last.take(small, axis=1)
        plan = self.grid.plan(first, last)
        small, base = small if plan.order is None else small.take(plan.order), plan.base
        some_corners = corners.reshape(9, -1).take(small, axis=1).reshape(3, 3, -1)
        rows = np.empty((ROWS, len(small)), np.float32)
        for start in range(0, len(small), SET_UP_BLOCK):
            part = slice(start, start + SET_UP_BLOCK)
            set_up_small(some_corners[:, :, part], base[:, part], plan.reach[part], self.image, rows[:, part])
        self._test(Items(rows, base), plan, primitive_id.take(small))

    def _gather_relative(self, chosen: NDArray[np.intp], index: NDArray[np.intp]) -> Floats:
        """(3 coordinates, 3 corners, k) of some of the triangles of clusters, relative to the point."""
        cluster, slot = chosen.take(index // CLUSTER), index % CLUSTER
        corner = self.clusters.corners[cluster, :, slot].T
        return self.clusters.vertices.take(corner.ravel(), axis=1).reshape(3, 3, -1) - self.grid.centre[:, None, None]

    def _draw_large(
        self, relative: Floats, first: NDArray, last: NDArray, index: NDArray[np.intp], primitive_id: Integers
    ) -> None:
        """Cut boxes into tiles, nearest triangles first."""
        seen = np.flatnonzero(~self._are_beside(relative))
        large = span_large(self.grid.matrix, relative.take(seen, axis=2), self.grid.size)
        order = np.argsort(-large.most, kind="stable")
        some = index.take(seen.take(order))
        low = (first.take(some, axis=1) / self.grid.tile).astype(np.intp)
        count = (last.take(some, axis=1) / self.grid.tile).astype(np.intp) - low + 1
        ids = primitive_id.take(seen)
        tile = float(self.grid.tile)
        for item, column, row in _cut_into_tiles(low, count):
            base = np.stack([column, row]) * tile + self.grid.low
            rows = set_up_tiles(large, order.take(item), base, tile + self.grid.jitter, self.grid.ray_error)
            reaches, most = may_reach(rows, -self.grid.jitter, tile + self.grid.jitter)
            keep = np.flatnonzero(reaches & (most >= self.grid.limit_tiles()[row, column]))
            plan = self.grid.plan_tiles(column.take(keep), row.take(keep))
            items = Items(rows.take(keep, axis=1), base.take(keep, axis=1).astype(np.float32))
            self._test(items, plan, ids.take(order.take(item.take(keep))))

    def _are_beside(self, relative: Floats) -> Booleans:
        """(k,) True for triangles wholly beyond one side of the pyramid of rays, or behind their point."""
        sides = list_sides(self.grid)
        height = np.einsum("sj,jck->sck", sides, relative).max(axis=1)
        size = np.abs(sides).max(axis=1)[:, np.newaxis] * np.abs(relative).sum(axis=0).max(axis=0)
        return np.asarray((height < -(2.0**-44) * size).any(axis=0))

    def _test(self, items: Items, plan: Plan, primitive_id: Integers) -> None:
        """Test items with the rays of their cells."""
        found = self.grid.test(items, plan)
        if found:
            self._keep(_join(found), items.rows, primitive_id)

    def _keep(self, found: Found, rows: NDArray[np.float32], primitive_id: Integers) -> None:
        """Keep pairs that may be hits; let certain ones hide what is behind them; offer the others at once."""
        grid = self.grid
        limit = grid.limit.take(found.place)
        error, least, most = (rows[row].take(found.item) for row in (NEAR_ERROR, LEAST, MOST))
        np.fmin(found.near + error, most, out=most)
        np.fmax(found.near - error, least, out=least)
        certain = found.inside & (least > limit * np.float32(1 + 4 * RANGE_SLACK)) & (least > 0)
        possible = (most >= limit) & (limit < np.inf)  # no ray, or one that asks for nothing
        if grid.ceiling is not None:
            ceiling = grid.ceiling.take(found.place)
            certain &= most < ceiling
            possible &= ~(least > ceiling * np.float32(1 + 4 * RANGE_SLACK))
        sure, doubtful = np.flatnonzero(certain & possible), np.flatnonzero(possible & ~certain)
        ids = primitive_id.take(found.item)
        place = found.place.take(sure)
        if self.query.any_hit:
            grid.limit[place] = np.inf
            self.query.settle(grid.name_rays(place), ids.take(sure).astype(np.int64))
        else:
            np.maximum.at(grid.limit, place, least.take(sure))
            self.kept.append(Kept(place, ids.take(sure), most.take(sure)))
        if len(doubtful):
            self.doubtful.append((found.place.take(doubtful), ids.take(doubtful)))

    def _offer_doubtful(self) -> None:
        """Offer pairs in doubt; what the query then knows of their rays hides what is behind."""
        if not self.doubtful:
            return
        grid, query = self.grid, self.query
        place, ids = (np.concatenate(column) for column in zip(*self.doubtful, strict=True))
        self.doubtful = []
        ray, ids = grid.name_rays(place).astype(np.intp), ids.astype(np.int64)
        if query.any_hit:
            left = np.flatnonzero(grid.limit.take(place) < np.inf)
            place, ray, ids = place.take(left), ray.take(left), ids.take(left)
            if query.certified:
                # Nearly all are triangles that their rays leave.
                left = np.flatnonzero(~lie_out_in_float64(query.primitives, query.rays, query.t_min, ray, ids))
                place, ray, ids = place.take(left), ray.take(left), ids.take(left)
            query.offer(ray, ids)
            grid.limit[place[query.best.take(ray) == -np.inf]] = np.inf
            return
        self.asked[place] = True
        query.offer(ray, ids)
        limit = limit_nearness(grid.step.take(ray), query.best.take(ray))
        grid.limit[place] = np.maximum(grid.limit.take(place), limit)

    def _offer(self) -> None:
        """Settle what is certain and alone; offer the rest of what is still near enough."""
        if not self.kept:
            return
        place, ids, most = (np.concatenate(column) for column in zip(*self.kept, strict=True))
        near = np.flatnonzero(most >= self.grid.limit.take(place))
        place, ids = place.take(near), ids.take(near).astype(np.int64)
        alone = np.bincount(place, minlength=len(self.asked)).take(place) == 1
        alone &= ~self.asked.take(place)
        ray = self.grid.name_rays(place).astype(np.intp)
        clear, rest = np.flatnonzero(alone), np.flatnonzero(~alone)
        self.query.settle(ray.take(clear), ids.take(clear))
        for start in range(0, len(rest), PAIR_BLOCK):
            some = rest[start : start + PAIR_BLOCK]
            self.query.offer(ray.take(some), ids.take(some))


def _join(parts: list[Found]) -> Found:
    return parts[0] if len(parts) == 1 else Found(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _cut_into_tiles(low: NDArray, count: NDArray) -> Iterator[tuple[NDArray, NDArray, NDArray]]:
    """Yield tiles of boxes, in blocks: the box, the tile's column and its row.

    low, count : (2, k) first tile of each box and how many there are, along x and along y
    """
    total = np.cumsum(count[0] * count[1])
    for start in range(0, int(total[-1]) if len(total) else 0, TILE_BLOCK):
        number = np.arange(start, min(start + TILE_BLOCK, total[-1]))
        item = np.searchsorted(total, number, side="right")
        number -= (total - count[0] * count[1]).take(item)
        row, column = np.divmod(number, count[0].take(item))
        yield item, low[0].take(item) + column, low[1].take(item) + row
