"""The curves of a scene beside its triangles and spheres: the closer of both is hit, at equal t the latter.

Each side is asked for what it alone knows: a ray that goes on behind a segment starts afresh among triangles, beyond
that segment's t, and one that goes on behind a triangle meets the segments from its t on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.casting.bvh.hierarchy import Hierarchy
from raytracer.casting.curves.query import CurveQuery, CurveTraversal, build_curve_tree
from raytracer.casting.curves.strands import Strands
from raytracer.casting.geometry import Geometry, Ids, Kind, join_id, split_id
from raytracer.casting.primitives import Primitives
from raytracer.casting.rays import Hits, Rays

# Rays per batch: their state and the candidates they bring stay within a few tens of megabytes.
BATCH_RAYS = 1 << 16
# Less than any segment: all that is met at a t comes after it.
BEFORE_ALL = -1


class CurveCaster:
    """Casts into the segments of a scene's curves; its tree is built when the first rays ask for it."""

    def __init__(self, primitives: Primitives, strands: Strands) -> None:
        self.primitives = primitives
        self.strands = strands

    @property
    def geometry(self) -> Geometry:
        return self.primitives.geometry

    @cached_property
    def tree(self) -> Hierarchy:
        """The tree over all segments, of which there must be some."""
        return build_curve_tree(self.strands)

    def leave_curves(self, rays: Rays) -> Rays:
        """Return rays as they go on among what is no curve: behind a segment they start afresh, beyond its t."""
        if rays.after is None:
            return rays
        behind = np.flatnonzero(rays.after.hit & self.geometry.belongs_to_kind(rays.after.instance, Kind.CURVE))
        if not len(behind):
            return rays
        t_min = rays.t_min.copy()
        t_min[behind] = np.maximum(t_min[behind], np.nextafter(rays.after.distance[behind], np.inf))
        return replace(rays, after=rays.after.forget(behind), t_min=t_min)

    def put_closest(self, rays: Rays, hits: Hits) -> None:
        """Put the segments that are met before what the rays hit, or where they hit nothing, into `hits`."""
        begun = self._find_beginnings(rays)
        t_max = np.minimum(rays.t_max, np.nextafter(hits.distance, -np.inf))
        for index, query in self._run(replace(rays, t_max=t_max), hits.valid, begun, any_hit=False):
            found = query.find_found()
            rows = index[found]
            query.put_closest(hits, rows, found)
            ids = query.best_id[found] + self.geometry.kind_range(Kind.CURVE)[0]
            hits.instance[rows], hits.primitive[rows] = split_id(self.geometry, ids)
            if hits.tied is not None:
                hits.tied[rows] = False

    def put_any(self, rays: Rays, valid: Booleans, found: Booleans) -> None:
        """Set `found` (n,) where a ray meets a segment."""
        for index, query in self._run(rays, valid & ~found, self._find_beginnings(rays), any_hit=True):
            found[index[query.find_found()]] = True

    def _find_beginnings(self, rays: Rays) -> tuple[Floats, Ids]:
        """Return (t, segment) that the hits of rays come after, both (n,)."""
        t, segment = np.full(len(rays), -np.inf), np.full(len(rays), BEFORE_ALL, np.int64)
        if rays.after is not None:
            rows = np.flatnonzero(rays.after.hit)
            after = rays.after.select(rows)
            t[rows] = after.distance
            curve = np.flatnonzero(self.geometry.belongs_to_kind(after.instance, Kind.CURVE))
            ids = join_id(self.geometry, after.instance[curve], after.primitive[curve])
            segment[rows[curve]] = self.geometry.find_rows(ids, Kind.CURVE)
        return t, segment

    def _run(
        self, rays: Rays, asked: Booleans, begun: tuple[Floats, Ids], any_hit: bool
    ) -> Iterator[tuple[Indices, CurveQuery]]:
        """Yield the finished queries of the rays that are `asked` for, in batches, with the rays' places."""
        place: NDArray[np.intp] = np.flatnonzero(asked) if len(self.strands) else np.zeros(0, np.intp)
        for start in range(0, len(place), BATCH_RAYS):
            index = place[start : start + BATCH_RAYS]
            some = replace(rays, after=None, departure=None).select(index)
            query = CurveQuery(self.primitives, self.strands, some, any_hit, begun[0][index], begun[1][index])
            CurveTraversal(self.tree, query).run()
            yield index, query
