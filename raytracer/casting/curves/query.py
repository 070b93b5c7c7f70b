"""The curves of a scene among what rays meet: a tree of the segments' boxes, the closest of the hits, and both ways of
asking, closest and any.

Everything is decided by the depths that float64 computes, in the order of (t, segment), so that no result depends on
the tree or on what is cast together.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import largest_column
from raytracer.arrays.types import Floats, Indices
from raytracer.casting.bvh.hierarchy import Hierarchy
from raytracer.casting.bvh.stacks import Pairs
from raytracer.casting.bvh.traverse import OFFER_BATCH, Traversal
from raytracer.casting.bvh.tree import build_tree, make_frame, to_bounds
from raytracer.casting.bvh.tree_table import NO_TRIANGLES
from raytracer.casting.curves.meetings import Meetings, bound_errors, find_meetings, find_offsets
from raytracer.casting.curves.ray_space import SeenSegments, evaluate, find_passing, make_axes, see_segments
from raytracer.casting.curves.strands import Strands, bound_segments
from raytracer.casting.geometry import Ids
from raytracer.casting.primitives import Primitives
from raytracer.casting.query import NO_ID, Query
from raytracer.casting.rays import Hits, Rays
from raytracer.lecture import length

# Pairs of ray and segment that are looked at together: what they need stays within the cache.
BLOCK = 1 << 12


class CurveQuery(Query):
    """The state of a batch of n valid rays among segments; what other queries hold of triangles is not used.

    size : (n,) float64, the direction's length: depths in metres are t times that
    axes : (n, 3, 3) float64, the rays' frames
    last_t, last_segment : (n,) what the ray has met last among curves, or what it goes on behind: hits come after
        (last_t, last_segment)
    best_u, best_side : (n,) float64, where the best segment is met
    """

    narrows = False

    def __init__(
        self, primitives: Primitives, strands: Strands, rays: Rays, any_hit: bool, last_t: Floats, last_segment: Ids
    ) -> None:
        super().__init__(primitives, rays, any_hit)
        self.strands = strands
        largest = largest_column(np.abs(rays.directions))
        # Squares of the shortest directions would vanish.
        self.size = largest * length(rays.directions / largest[:, np.newaxis])
        self.axes = make_axes(rays.directions)
        self.last_t, self.last_segment = last_t, last_segment
        self.best_u, self.best_side = np.zeros((2, len(rays)))

    @np.errstate(over="ignore", invalid="ignore", under="ignore")
    def offer(self, ray: Indices, primitive_id: Ids) -> Indices:
        """Take in candidates; return rays whose `best` may have changed."""
        changed = [ray[:0]]
        for start in range(0, len(ray), BLOCK):
            block = slice(start, start + BLOCK)
            changed.append(self._offer_block(ray[block], primitive_id[block]))
        return np.concatenate(changed)

    def see(self, ray: Indices, segment: Ids) -> SeenSegments:
        """Return segments (k,) as rays (k,) see them."""
        keys = self.strands.keys.take(self.strands.rows.take(segment, axis=0), axis=0)  # (k, 4 keys, 4)
        origins, axes = self.rays.origins.take(ray, axis=0), self.axes.take(ray, axis=0)
        return see_segments(origins, axes, keys, self.strands.thick.take(segment))

    def _offer_block(self, ray: Indices, segment: Ids) -> Indices:
        seen = self.see(ray, segment)
        size = self.size.take(ray)
        near = find_passing(seen, self.t_min.take(ray) * size, self.best.take(ray) * size)
        ray, segment, size = ray.take(near), segment.take(near), size.take(near)
        met = find_meetings(seen.select(near))
        return self._keep(ray[met.segment], segment[met.segment], met.depth / size[met.segment], met)

    def _keep(self, ray: Indices, segment: Ids, t: Floats, met: Meetings) -> Indices:
        """Let the first of each ray's hits stand, by (t, segment)."""
        counts = (t >= self.t_min[ray]) & (t <= self.best[ray]) & (t < np.inf)
        counts &= (t > self.last_t[ray]) | ((t == self.last_t[ray]) & (segment > self.last_segment[ray]))
        rows = np.flatnonzero(counts)
        if self.any_hit:
            self.best[ray[rows]], self.best_id[ray[rows]] = -np.inf, segment[rows]
            return ray[rows]
        rows = rows[np.lexsort((segment[rows], t[rows], ray[rows]))]
        rows = rows[np.flatnonzero(np.diff(ray[rows], prepend=-1))]  # the first of each ray
        first, better = ray[rows], segment[rows] < self.best_id[ray[rows]]
        rows = rows[better | (t[rows] < self.best[first])]
        first = ray[rows]
        self.best[first], self.best_id[first] = t[rows], segment[rows]
        self.best_u[first], self.best_side[first] = met.u[rows], met.side[rows]
        return first

    def find_found(self) -> NDArray[np.intp]:
        """Return the rays that have met a segment."""
        return np.flatnonzero(self.best_id != NO_ID)

    @np.errstate(over="ignore", invalid="ignore", under="ignore")
    def put_closest(self, hits: Hits, rows: NDArray[np.intp], found: NDArray[np.intp]) -> None:
        """Set hits (all rays') `rows` to what the rays `found` have met, but for instance and primitive."""
        ray, segment = found, self.best_id[found]
        seen, u, side = self.see(ray, segment), self.best_u[found], self.best_side[found]
        hits.distance[rows] = self.best[found]
        # The quotient and the length round thrice.
        error = bound_errors(seen, u, side) / self.size[found]
        hits.distance_error[rows] = error + 4.0 * np.spacing(self.best[found])
        hits.barycentric[rows, 0] = u
        hits.barycentric[rows, 1] = np.where(seen.thick, 0.0, find_offsets(evaluate(seen, u)))


class CurveTraversal(Traversal):
    """Traverses a tree with one segment in a leaf, which has no other test than its box."""

    def _test_leaves(self, row: NDArray[np.int32], leaf: NDArray[np.intp]) -> None:
        item = self.items.take(leaf)
        self.candidates.append(Pairs(self.rows.rays_of(row), item, np.zeros(len(row), np.float32)))
        if self.candidates.count >= OFFER_BATCH:
            self._offer()


def build_curve_tree(strands: Strands) -> Hierarchy:
    """Return the tree over the boxes of k >= 1 segments."""
    boxes = bound_segments(strands)
    frame = make_frame(boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0))
    tree = build_tree(to_bounds(frame, boxes), frame, leaf_size=1)
    return Hierarchy(
        frame=frame,
        nodes=tree.nodes,
        triangles=NO_TRIANGLES,
        items=tree.leaves[:, :1].astype(np.int64),
        instances_begin=len(tree.leaves),
        instances=np.zeros(0, np.int64),
        roots=(0,),
        placed=None,
        trees={},
    )
