"""Who sees what: Blender's ray visibility of objects and lights.

Rays are told apart by what they come from: the camera, diffuse or glossy reflection, transmission, or a surface that
looks for light (shadow rays); straight passages change nothing. A ray goes on behind an object that it cannot see as if
nothing were there: what lies at the same place, made earlier or later, comes next.

References
----------
Blender, intern/cycles/kernel/integrator/path_state.h: path_state_ray_visibility.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Integers, Masks
from raytracer.casting.geometry import Geometry
from raytracer.casting.order import Order
from raytracer.casting.primitives import Primitives
from raytracer.casting.rays import Hits, Rays
from raytracer.scene.fields import SEEN_BY
from raytracer.scene.scene import Scene

# Closest hits of n rays that belong to the (n,) classes of rays, as bits of SEEN_BY.
CastRays = Callable[[Rays, Masks], Hits]
# Closest hits of n shadow rays that belong to the (n,) classes, with objects of sets of the (n,) bits alone.
CastLinked = Callable[[Rays, Masks, NDArray[np.int64]], Hits]
# Closest hits of n rays with the (n,) instances or groups of spheres that they are inside.
CastInside = Callable[[Rays, Integers], Hits]


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


def make_cast(caster: RayCaster, visibility: Masks | None, order: Order | None = None) -> CastRays:
    """Return the function that casts rays of any class.

    visibility : of each instance and group of spheres, the classes that see it, as bits; None where all see all
    order : of surfaces at one place, or None where nothing passes any
    """

    def cast_all(rays: Rays, classes: Masks) -> Hits:
        return find_closest(caster, rays, order)

    def cast_some(rays: Rays, classes: Masks) -> Hits:
        assert visibility is not None
        hits = cast_all(rays, classes)
        rows = np.flatnonzero(_is_hidden(visibility, hits, classes))
        while len(rows):
            behind = replace(rays.select(rows), after=hits.select(rows))
            found = cast_all(behind, classes[rows])
            hits.put(rows, found)
            rows = rows[_is_hidden(visibility, found, classes[rows])]
        return hits

    return cast_all if visibility is None else cast_some


def make_linked_cast(cast: CastRays, shadow_set: NDArray[np.int64]) -> CastLinked:
    """Return the function that casts shadow rays which some sets of objects block, and the others let pass.

    shadow_set : (instances + groups,) int64, the set that each belongs to
    """

    def cast_linked(rays: Rays, classes: Masks, blockers: NDArray[np.int64]) -> Hits:
        hits = cast(rays, classes)
        rows = np.flatnonzero(hits.hit & ((blockers >> shadow_set[hits.instance]) & 1 == 0))
        while len(rows):
            found = cast(replace(rays.select(rows), after=hits.select(rows)), classes[rows])
            hits.put(rows, found)
            rows = rows[found.hit & ((blockers[rows] >> shadow_set[found.instance]) & 1 == 0)]
        return hits

    return cast_linked


def make_inside_cast(caster: RayCaster, order: Order | None = None) -> CastInside:
    """Return the function that casts rays into their own object, as if there were no other.

    All is cast into: rays below a surface are short, and rarely meet anything else first.
    """

    def cast_inside(rays: Rays, inside: Integers) -> Hits:
        hits = find_closest(caster, rays, order)
        rows = np.flatnonzero(hits.hit & (hits.instance != inside))
        while len(rows):
            found = find_closest(caster, replace(rays.select(rows), after=hits.select(rows)), order)
            hits.put(rows, found)
            rows = rows[found.hit & (found.instance != inside[rows])]
        return hits

    return cast_inside


def find_closest(caster: RayCaster, rays: Rays, order: Order | None = None) -> Hits:
    """Return the closest hits of rays, beyond what they have left behind."""
    behind = {"after": rays.after, "order": order, "departure": rays.departure}
    given = {name: value for name, value in behind.items() if value is not None}
    return caster.closest_hit(rays.origins, rays.directions, rays.t_min, rays.t_max, **given)


def find_any(caster: RayCaster, rays: Rays, order: Order | None = None) -> Booleans:
    """Return (n,) True where rays meet anything, beyond what they have left behind."""
    given = {} if rays.departure is None else {"order": order, "departure": rays.departure}
    return caster.any_hit(rays.origins, rays.directions, rays.t_min, rays.t_max, **given)


def _is_hidden(visibility: Masks, hits: Hits, classes: Masks) -> Booleans:
    """(n,) True where a ray has hit what its class does not see."""
    return hits.hit & ((visibility[hits.instance] & classes) == 0)
