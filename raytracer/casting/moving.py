"""A scene of which a few instances move from call to call: what stays keeps its caster, what moves has one of its own.

A caster over all triangles is as good, but has to be packed anew for each position of what moves. Hits of both are
compared exactly, so that no result depends on how the scene is shared out.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Booleans
from raytracer.casting.caster import Caster, build
from raytracer.casting.geometry import Geometry, world_corners
from raytracer.casting.passed import bound_distances
from raytracer.casting.rays import Hits, Rays
from raytracer.casting.subset_caster import take_part
from raytracer.predicates import exact
from raytracer.scene.scene import Scene

# What moves may have this share of the triangles at most: with more, packing all anew costs no more.
MOST_MOVING = 0.25


class MovingCaster:
    """Casts into a scene of meshes, certified; numbers what it hits as the scene does.

    moving : (instances,) bool, those with a caster of their own
    """

    def __init__(self, scene: Scene, geometry: Geometry, moving: Booleans, last: MovingCaster | None = None) -> None:
        """Take the caster of what stays from `last`, where the same instances move."""
        self.geometry, self.moving = geometry, moving
        self._still: Caster
        self._moved: Caster
        if last is not None and np.array_equal(last.moving, moving):
            self._still = last._still
        else:
            self._still, last = build(take_part(scene, ~moving)), None
        self._moved = build(take_part(scene, moving), last=last._moved if last else None)

    def closest_hit(self, rays: Rays) -> Hits:
        """Return the closest hit of each ray, as `Caster.closest_hit` does."""
        hits, others = (
            self._renumber(caster.closest_hit(rays.origins, rays.directions, rays.t_min, rays.t_max), present)
            for caster, present in ((self._still, ~self.moving), (self._moved, self.moving))
        )
        closer = np.flatnonzero(others.hit)
        closer = closer[self._are_closer(rays.select(closer), others.select(closer), hits.select(closer))]
        hits.put(closer, others.select(closer))
        return hits

    def any_hit(self, rays: Rays) -> Booleans:
        """Return (n,) bool, as `Caster.any_hit` does."""
        found = self._moved.any_hit(rays.origins, rays.directions, rays.t_min, rays.t_max)
        rest = np.flatnonzero(~found)
        some = rays.select(rest)
        found[rest] = self._still.any_hit(some.origins, some.directions, some.t_min, some.t_max)
        return found

    def _renumber(self, hits: Hits, present: Booleans) -> Hits:
        rows = np.flatnonzero(hits.hit)
        hits.instance[rows] = np.flatnonzero(present)[hits.instance[rows]]
        return hits

    def _are_closer(self, rays: Rays, ours: Hits, others: Hits) -> Booleans:
        """Return (k,) True where our hits come before the others, misses among them, in the order (t, instance)."""
        (low, high), (other_low, other_high) = bound_distances(ours), bound_distances(others)
        closer = ~others.hit | (high < other_low)
        for ray in np.flatnonzero(others.hit & (high >= other_low) & (low <= other_high)):
            closer[ray] = self._is_closer(rays, ours, others, ray)
        return closer

    def _is_closer(self, rays: Rays, ours: Hits, others: Hits, ray: int) -> bool:
        """Decide one of those in integers."""
        instance, primitive = (
            np.array([getattr(ours, name)[ray], getattr(others, name)[ray]]) for name in ("instance", "primitive")
        )
        decision = exact.closest_candidate(
            rays.origins[ray].tolist(),
            rays.directions[ray].tolist(),
            max(float(rays.t_min[ray]), 0.0),
            float(rays.t_max[ray]),
            np.stack(world_corners(self.geometry, instance, primitive), axis=1),
            np.zeros((0, 4)),
            instance.tolist(),
        )
        return decision.chosen == 0


def follow_moving(
    scene: Scene, geometry: Geometry, changed: Booleans, last: MovingCaster | None
) -> MovingCaster | None:
    """Return the caster of a scene some of whose instances changed, or None where that is not worth it.

    changed : (instances,) bool, since `last`, or since a caster of the whole scene
    """
    moving = changed if last is None else changed | last.moving
    triangles = geometry.mesh_count[geometry.instance_mesh]
    if triangles[moving].sum() > MOST_MOVING * triangles.sum():
        return None
    return MovingCaster(scene, geometry, moving, last)
