"""Rays that programs cast from the points where they are evaluated: how much of what is around is open.

Only the rays of paths come with a Probe, and only where a program of the scene asks (`integrator.prepare`): to lights,
shadow rays and the world nothing is in the way, as in Cycles.

References
----------
Blender, intern/cycles/kernel/svm/ao.h: what the rays are, and where there are none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats
from raytracer.arrays.vectors import to_world
from raytracer.casting.order import Order
from raytracer.casting.ray_visibility import CastRays, RayCaster, classify_shadows, find_closest
from raytracer.casting.rays import Rays
from raytracer.sampling.sampler import Sampler
from raytracer.sampling.warps import sample_cosine_hemisphere
from raytracer.surfaces.surface import Surface, depart

Objects = NDArray[np.int32]
# True (n,) where rays hit anything; given objects (n,), only what each hits of its own counts.
OcclusionTest = Callable[[Rays, Objects | None], Booleans]


def make_occlusion_test(caster: RayCaster, cast: CastRays, order: Order | None = None) -> OcclusionTest:
    """Return the function that tells which rays are blocked; `cast` tells what shadow rays see."""

    def block(rays: Rays, objects: Objects | None) -> Booleans:
        if objects is None:
            return cast(rays, classify_shadows(rays)).hit
        return _block_own(caster, order, rays, objects)

    return block


def _block_own(caster: RayCaster, order: Order | None, rays: Rays, objects: Objects) -> Booleans:
    """Return (n,) True where a ray hits its own object, behind whatever others."""
    blocked, rows = np.zeros(len(rays), dtype=np.bool_), np.arange(len(rays))
    while len(rows):
        hits = find_closest(caster, rays, order)
        own = hits.instance == objects[rows]
        blocked[rows] = hits.hit & own
        others = np.flatnonzero(hits.hit & ~own)
        rays, rows = replace(rays.select(others), after=hits.select(others)), rows[others]
    return blocked


@dataclass(frozen=True, eq=False, slots=True)
class Probe:
    """n points of surfaces, what tells whether their rays are blocked, and their own numbers."""

    surface: Surface
    test: OcclusionTest
    sampler: Sampler

    def select(self, rows: Any) -> Probe:
        """Return some of the points: index or boolean array."""
        return Probe(self.surface.select(rows), self.test, self.sampler.select(rows))

    def find_open(self, normal: Floats, reach: Floats, count: int, own: bool) -> Floats:
        """Return the share (n,) of `count` rays, with density cos / pi around a normal, that nothing blocks.

        Each sample of a pixel has the next `count` points of one sequence, so that they fill it together.

        normal : (n, 3) unit; reach : (n,) metres, 0 or less is open; own : only the point's own object counts
        """
        rows = np.flatnonzero((reach > 0) & normal.any(axis=1))
        surface, numbers = self.surface.select(rows), self.sampler.select(rows)
        first = np.asarray(numbers.own.sample, dtype=np.uint32) * np.uint32(count)
        blocked = np.zeros(len(rows))
        for number in range(count if len(rows) else 0):
            sample = np.broadcast_to(first + np.uint32(number), len(rows))
            part = replace(numbers, own=replace(numbers.own, sample=sample))
            directions = to_world(sample_cosine_hemisphere(part.uniform_pair()), normal[rows])
            rays = depart(surface, directions, reach[rows])
            blocked += self.test(rays, surface.instance if own else None)
        open_ = np.ones(len(reach))
        open_[rows] -= blocked / count
        return open_
