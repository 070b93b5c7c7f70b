"""What casts rays for shader programs, from the points where they are evaluated.

Only the rays of paths come with a Probe, and only where a program of the scene asks (`integrator.prepare`): to lights,
shadow rays and the world no program casts any, as in Cycles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats
from raytracer.casting.order import Order
from raytracer.casting.ray_visibility import (
    CastInside,
    CastRays,
    RayCaster,
    classify_shadows,
    find_closest,
    make_inside_cast,
)
from raytracer.casting.rays import Hits, Rays
from raytracer.sampling.sampler import Sampler
from raytracer.surfaces.surface import Surface

Objects = NDArray[np.int32]
# True (n,) where rays hit anything; given objects (n,), only what each hits of its own counts.
OcclusionTest = Callable[[Rays, Objects | None], Booleans]


@dataclass(frozen=True, slots=True)
class ProgramCaster:
    """The rays that programs cast.

    is_blocked : tells which rays are, by what shadow rays see
    inside : casts rays into the objects (n,) that they are of
    closest : casts rays into all that there is, hidden or not
    """

    is_blocked: OcclusionTest
    inside: CastInside
    closest: Callable[[Rays], Hits]


def make_program_caster(caster: RayCaster, cast: CastRays, order: Order | None = None) -> ProgramCaster:
    """Return what casts rays for programs; `cast` tells what shadow rays see."""
    inside = make_inside_cast(caster, order)

    def is_blocked(rays: Rays, objects: Objects | None) -> Booleans:
        return (cast(rays, classify_shadows(rays)) if objects is None else inside(rays, objects)).hit

    return ProgramCaster(is_blocked, inside, partial(find_closest, caster, order=order))


@dataclass(frozen=True, eq=False, slots=True)
class Probe:
    """n points of surfaces, what casts rays from there, and the points' own numbers.

    sampler : its first dimension is that of rays which tell what is open
    bevel : how many dimensions further those are which tell what is around
    rarest : (n,) float64, the least density of the bounces of the paths that led there
    """

    surface: Surface
    caster: ProgramCaster
    sampler: Sampler
    bevel: int
    rarest: Floats

    def select(self, rows: Any) -> Probe:
        """Return some of the points: index or boolean array."""
        return Probe(self.surface.select(rows), self.caster, self.sampler.select(rows), self.bevel, self.rarest[rows])
