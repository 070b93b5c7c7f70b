"""What comes after what along a ray: the exact order of hits, and of surfaces that lie at one place.

Hits are in order of (t, key), both compared exactly. The *key* tells surfaces at one t apart; without an Order it is
the primitive id. A ray that has met a surface can ask for what comes after it (`Rays.after`): everything at a larger t,
and at the same t what has a larger key. So each surface at one place is met once, where a ray that started behind the
bound on the distance would lose all but one of them.

A ray that leaves a surface into a new direction starts at a point that rounding has moved, so that other surfaces at
the same place lie before or behind it by chance. Where there may be some, it starts before all of them instead, and the
keys decide which it meets (`Departure`): what comes after the surface that it leaves, seen along the ray. Of surfaces
that nothing passes, it meets those that it would cross; not those on whose side it stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import take_rows
from raytracer.arrays.types import Booleans, Floats, Integers

SortKeys = NDArray[np.int64]
# Keys from here on belong to surfaces that nothing passes; primitive ids are smaller.
STOPPING = 1 << 60


class Order(Protocol):
    """The order of surfaces at one place, as rays of directions (k, 3) meet primitives (k,) of instances (k,)."""

    def find_keys(self, directions: Floats, instance: Integers, primitive: Integers) -> SortKeys:
        """Return (k,) keys; STOPPING or more for surfaces that nothing passes."""

    def find_crossed(self, directions: Floats, approach: Floats, instance: Integers, primitive: Integers) -> Booleans:
        """Return (k,) True where a ray leads to the other side of a primitive than `approach` (k, 3) is on."""


@dataclass(frozen=True, eq=False, slots=True)
class Departure:
    """The places that n rays start from.

    key : (n,) int64, of the surface that the ray leaves, as it is met along the ray
    approach : (n, 3) float64, from there towards where the path came from to the place
    reach : (n,) float64, t to which surfaces lie at that place; negative where a ray starts from none
    """

    key: SortKeys
    approach: Floats
    reach: Floats

    def select(self, rows: Any) -> Departure:
        """Return some of the places: index or boolean array."""
        return Departure(*(take_rows(getattr(self, item.name), rows) for item in fields(self)))


def no_departure(count: int) -> Departure:
    """Return the Departure of rays that start from no place."""
    return Departure(np.zeros(count, np.int64), np.zeros((count, 3)), np.full(count, -1.0))


def join_departures(parts: Sequence[Departure | None], counts: Sequence[int]) -> Departure | None:
    """Return the departures of several records of so many rays as one; None if none has any."""
    if all(part is None for part in parts):
        return None
    filled = [part or no_departure(count) for part, count in zip(parts, counts, strict=True)]
    return Departure(*(np.concatenate([getattr(part, item.name) for part in filled]) for item in fields(Departure)))
