"""Rays that leave surfaces: where they start, outside the proven error of the point, and what they leave behind.

Neither do they hit the surface that they leave (self-intersection), nor do they pass a wall behind it.

References
----------
M. Pharr, W. Jakob, G. Humphreys, "Physically Based Rendering", 4th edition, section 6.8, "Managing Rounding Error".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import find_sign, take_rows
from raytracer.arrays.types import Floats, Numbers, Vectors
from raytracer.casting.order import STOPPING, Departure, no_departure
from raytracer.casting.rays import Rays, select_rows
from raytracer.lecture import dot
from raytracer.predicates.rounding import gamma
from raytracer.surfaces.places import LEFT_BEHIND, turn_layers
from raytracer.surfaces.surface import Surface


@dataclass(frozen=True, eq=False, slots=True)
class LeavingPoints:
    """What rays that leave n points of a surface need to know of it; fields as of Surface."""

    position: Vectors
    position_error: Numbers
    geometric_normal: Vectors
    layer: NDArray[np.int64] | None = None
    approach: Vectors | None = None

    def __len__(self) -> int:
        return len(self.position)

    def select(self, rows: Any) -> LeavingPoints:
        """Return some of the points: index or boolean array, or slice."""
        return select_rows(self, rows)


def leave(surface: Surface, rows: Any) -> LeavingPoints:
    """Return what rays that leave some points of a surface need to know of it: index or boolean array, or slice."""
    names = ("position", "position_error", "geometric_normal", "layer", "approach")
    return LeavingPoints(*(getattr(surface, name) for name in names)).select(rows)


def spawn_origin(surface: Surface | LeavingPoints, direction: Floats) -> Floats:
    """Return where rays that leave the surface start: (n, 3), outside the error bound, on the side they leave to.

    The position moves along the geometric normal by its error bound, then each coordinate by one unit in the last
    place, away from the surface, to cover the rounding of that sum. The step follows the size of the coordinates and
    of the primitive: below 1e-9 m at 1e6 m, so that a wall of 1e-4 m stays closed there.

    Parameters
    ----------
    surface : n points
    direction : (n, 3) float64, of the leaving rays
    """
    normal = surface.geometric_normal
    side = normal * find_sign(dot(normal, direction) >= 0)[:, np.newaxis]
    moved = surface.position + surface.position_error[:, np.newaxis] * side
    return step_towards(moved, side)


def step_towards(points: Floats, side: Floats) -> Floats:
    """Return points (n, 3) with each coordinate moved by one unit in the last place to where `side` (n, 3) points.

    Numbers of one sign are ordered as their bits are: one more is the next one away from zero. That takes a fourth of
    the time of `nextafter`, which is left for zeros and what is not finite.
    """
    bits, moves = points.view(np.int64), side != 0
    step = bits ^ side.view(np.int64)
    step >>= 63  # -1 where the signs differ, else 0
    step |= 1
    if not moves.all():
        step *= moves
    step += bits
    stepped = step.view(np.float64)
    odd = ~(np.isfinite(points) & (points != 0)) & moves
    if odd.any():
        stepped[odd] = np.nextafter(points[odd], np.copysign(np.inf, side[odd]))
    return stepped


def depart(
    surface: Surface | LeavingPoints, direction: Floats, reach: Floats | float = np.inf, target: Floats | None = None
) -> Rays:
    """Return rays that leave n points of a surface.

    A ray starts outside the error bound of its point (`spawn_origin`). Where other surfaces may lie at the same place
    it starts as far on the other side, so that none of them is lost, and carries the Departure by which those that it
    shall not meet are told.

    Parameters
    ----------
    direction : (n, 3) float64
    reach : t_max of the rays
    target : (n, 3) float64, points that the rays are to go through at t = 1; None: they go along `direction`
    """
    origins, departure = spawn_origin(surface, direction), None
    rows = np.zeros(0, np.intp) if surface.layer is None else np.flatnonzero(surface.layer)
    if len(rows):
        origins[rows] = _start_behind(surface.select(rows), take_rows(direction, rows))
    if target is not None:
        direction = target - origins
    if len(rows):
        departure = no_departure(len(surface))
        own = _describe_departure(surface.select(rows), take_rows(origins, rows), take_rows(direction, rows))
        departure.key[rows], departure.approach[rows], departure.reach[rows] = own.key, own.approach, own.reach
    return Rays(origins, direction, np.zeros(len(surface)), np.full(len(surface), reach), None, departure)


def _start_behind(surface: Surface | LeavingPoints, direction: Floats) -> Floats:
    """Return points (n, 3) outside the error bound, on the side that rays leave from."""
    normal = surface.geometric_normal
    return spawn_origin(surface, np.where(dot(normal, direction)[:, np.newaxis] >= 0, -normal, normal))


def _describe_departure(surface: Surface | LeavingPoints, origins: Floats, direction: Floats) -> Departure:
    """Return the Departure of rays that start behind all that lies at their place.

    They leave the place where they are as far beyond the surface as they start before it: at t = 2 depth / |d . n|, to
    three roundings. Rays along the surface stay in it for ever, and carry no light.
    """
    assert surface.layer is not None
    assert surface.approach is not None
    cosine = dot(surface.geometric_normal, direction)
    depth = np.abs(dot(surface.position - origins, surface.geometric_normal))
    # Besides, the points are rounded: a depth of all their coordinates' last places is between them and the surface.
    depth += gamma(4) * np.abs(surface.position).sum(axis=1)
    with np.errstate(divide="ignore"):
        reach = np.where(cosine == 0, 0.0, 2 * depth / np.abs(cosine))
    key = np.where(surface.layer >= STOPPING, LEFT_BEHIND, turn_layers(surface.layer, cosine <= 0))
    return Departure(key, surface.approach, reach)
