"""Ray portals: parts of surfaces that rays enter to go on elsewhere, from another place into another direction.

A passage through a portal is no bounce: the ray keeps its kind, as if it had gone straight through a transparent
surface. Light samples do not follow it, so that what it meets behind a portal counts in full.

References
----------
Cycles, kernel/closure/bsdf_ray_portal.h, and integrator/shade_surface.h: integrate_surface_ray_portal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from raytracer.arrays.rows import take_rows
from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.lecture import length

# Metres within which a portal leads to the point where it is entered (Cycles' number): such rays leave the surface.
SAME_PLACE = 1e-9**0.5


@dataclass(frozen=True, eq=False, slots=True)
class Portals:
    """Portals at some points of a batch.

    hit : (m,) int64, ascending, the point in its batch
    weight : (m, 3) float64, share of the light that comes from where they lead to
    position : (m, 3) float64, metres, world, where rays come out; NaN where they leave the point itself
    direction : (m, 3) float64, unit, into which they do
    """

    hit: Indices
    weight: Floats
    position: Floats
    direction: Floats

    def select(self, rows: Any) -> Portals:
        """Return some of the portals: index or boolean array."""
        weight, position, direction = (
            take_rows(values, rows) for values in (self.weight, self.position, self.direction)
        )
        return Portals(self.hit[rows], weight, position, direction)

    def __len__(self) -> int:
        return len(self.hit)


def find_exits(position: Floats, entrance: Floats) -> Floats:
    """Return where rays come out (n, 3): NaN where portals lead to the points where they are entered."""
    here = length(position - entrance) <= SAME_PLACE
    return np.where(here[:, np.newaxis], np.nan, position)


def join_portals(parts: Sequence[Portals]) -> Portals:
    """Return the portals of several records as one."""
    return Portals(*(np.concatenate([getattr(part, item.name) for part in parts]) for item in fields(Portals)))


def close_portals(portals: tuple[Portals, ...], rows: Booleans) -> tuple[Portals, ...]:
    """Return what is left of portals where those of some points (n,) of the batch are closed."""
    return tuple(part.select(np.flatnonzero(~rows[part.hit])) for part in portals)
