"""Who sees what: Blender's ray visibility of objects and lights.

Rays are told apart by what they come from: the camera, diffuse or glossy reflection, transmission, or a surface that
looks for light (shadow rays); straight passages change nothing. A ray goes on behind an object that it cannot see as if
nothing were there.

References
----------
Blender, intern/cycles/kernel/integrator/path_state.h: path_state_ray_visibility.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from raytracer.arrays.types import Booleans, Floats, Masks
from raytracer.casting.geometry import Geometry
from raytracer.casting.primitives import Primitives
from raytracer.casting.rays import Hits, Rays
from raytracer.scene.fields import SEEN_BY
from raytracer.scene.scene import Scene

# A step past a hit is longer than this many roundings of its distance, where no bound on its error is known.
ROUNDINGS = 8.0


# Closest hits of n rays that belong to the (n,) classes of rays, as bits of SEEN_BY.
Cast = Callable[[Rays, Masks], Hits]


class RayCaster(Protocol):
    """What finds hits: a `Caster`, one that is watched, or one of some instances only."""

    @property
    def roundoff(self) -> float: ...

    def closest_hit(self, *arguments: Any, **keywords: Any) -> Hits: ...

    def any_hit(self, *arguments: Any, **keywords: Any) -> Booleans: ...


class SceneCaster(RayCaster, Protocol):
    """What finds hits in a whole scene."""

    @property
    def geometry(self) -> Geometry: ...

    @property
    def scene(self) -> Scene: ...

    @property
    def primitives(self) -> Primitives: ...


def classify_shadows(rays: Rays) -> Masks:
    """Return the class (n,) of shadow rays."""
    return np.full(len(rays), SEEN_BY["shadow"], dtype=np.uint8)


def make_cast(caster: RayCaster, visibility: Masks | None) -> Cast:
    """Return the function that casts rays of any class.

    visibility : of each instance and group of spheres, the classes that see it, as bits; None where all see all
    """

    def cast_all(rays: Rays, classes: Masks) -> Hits:
        return caster.closest_hit(rays.origins, rays.directions, rays.t_min, rays.t_max)

    def cast_some(rays: Rays, classes: Masks) -> Hits:
        assert visibility is not None
        hits = cast_all(rays, classes)
        rows = np.flatnonzero(_is_hidden(visibility, hits, classes))
        while len(rows):
            behind = rays.select(rows)
            behind = Rays(behind.origins, behind.directions, _step_past(caster, hits.select(rows)), behind.t_max)
            found = cast_all(behind, classes[rows])
            for name in Hits.__slots__:
                getattr(hits, name)[rows] = getattr(found, name)
            rows = rows[_is_hidden(visibility, found, classes[rows])]
        return hits

    return cast_all if visibility is None else cast_some


def _is_hidden(visibility: Masks, hits: Hits, classes: Masks) -> Booleans:
    """(n,) True where a ray has hit what its class does not see."""
    return hits.hit & ((visibility[hits.instance] & classes) == 0)


def _step_past(caster: RayCaster, hits: Hits) -> Floats:
    """Return the least t (n,) that lies behind the hits, by the bound on their distance."""
    unknown = ROUNDINGS * np.finfo(np.float64).eps * caster.roundoff * hits.distance
    error = np.where(np.isnan(hits.distance_error), unknown, hits.distance_error)
    return np.nextafter(hits.distance + error, np.inf)
