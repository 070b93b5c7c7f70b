"""Rays, what they hit, and the surface at the hit: plain records of arrays, n rays each.

The lecture's ray is p = o + t d with t >= 0 ("Ray-Object Intersection"); a hit is the smallest t for which the point
lies on an object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytracer.arrays.checks import as_array, as_rows
from raytracer.arrays.rows import Mode, find_mode, take_rows
from raytracer.arrays.types import Booleans, Floats, Integers, Numbers, Pairs, Vectors
from raytracer.casting.order import Departure, join_departures

Record = TypeVar("Record")


def select_rows(record: Record, rows: Any) -> Record:
    """Return the record with every array, and every record in it, cut down to `rows`; None stays None."""
    if isinstance(rows, np.ndarray) and rows.dtype == np.bool_:
        rows = rows.nonzero()[0]  # once for all arrays
    kind: Any = type(record)
    values = [getattr(record, name) for name in _list_names(kind)]
    mode = find_mode(rows, len(values[0]))
    return kind(*[_select(value, rows, mode) for value in values])


@cache
def _list_names(kind: type) -> tuple[str, ...]:
    """Return the names of a record's fields."""
    return tuple(item.name for item in fields(kind))


def _select(value: Any, rows: Any, mode: Mode) -> Any:
    if isinstance(value, np.ndarray):
        return take_rows(value, rows, mode)
    return None if value is None else value.select(rows)


@dataclass(frozen=True, eq=False, slots=True)
class Rays:
    """Rays o + t d, t_min <= t <= t_max (both inclusive).

    origins : (n, 3) float64, metres, world
    directions : (n, 3) float64, any length; t counts in units of that length
    t_min, t_max : (n,) float64; a t_min below 0 counts as 0
    after : what the rays have met before, misses where nothing: they go on behind it, in the order of `order`; or None
    departure : the places that the rays start from, where other surfaces may be; or None
    """

    origins: Vectors
    directions: Vectors
    t_min: Numbers
    t_max: Numbers
    after: Hits | None = None
    departure: Departure | None = None

    def __len__(self) -> int:
        return len(self.origins)

    def select(self, rows: Any) -> Rays:
        """Return some of the rays: index or boolean array."""
        return select_rows(self, rows)

    def find_fresh(self) -> Booleans:
        """(n,) True where the ray has met nothing before, and starts from no place."""
        fresh = np.ones(len(self), dtype=np.bool_)
        if self.after is not None:
            fresh &= ~self.after.hit
        if self.departure is not None:
            fresh &= self.departure.reach < 0
        return fresh

    def valid(self) -> Booleans:
        """(n,) True where the ray is finite, its direction not zero and its range not NaN."""
        ox, oy, oz = np.abs(np.ascontiguousarray(self.origins.T))
        dx, dy, dz = np.abs(np.ascontiguousarray(self.directions.T))
        # A maximum of columns passes NaN on; a reduction over three columns would be slower by far.
        length = np.maximum(np.maximum(dx, dy), dz)
        largest = np.maximum(np.maximum(np.maximum(ox, oy), oz), length)
        return (largest < np.inf) & (length > 0) & ~np.isnan(self.t_min) & ~np.isnan(self.t_max)


def make_rays(origins: ArrayLike, directions: ArrayLike, t_min: ArrayLike = 0.0, t_max: ArrayLike = np.inf) -> Rays:
    """Check and broadcast user input into Rays: (n, 3) or (3,) vectors, (n,) or scalar ranges.

    Raises
    ------
    ValueError
        If shapes do not fit. NaN and infinity are not errors: such rays are flagged by `Rays.valid` and miss.
    """
    origin_rows, direction_rows = as_rows(origins, "origins"), as_rows(directions, "directions")
    if len(origin_rows) != len(direction_rows) and len(origin_rows) == 1:
        origin_rows = np.repeat(origin_rows, len(direction_rows), axis=0)
    if len(origin_rows) != len(direction_rows) and len(direction_rows) == 1:
        direction_rows = np.repeat(direction_rows, len(origin_rows), axis=0)
    count = len(origin_rows)
    if len(direction_rows) != count:
        raise ValueError(f"directions: expected as many rows as origins, {count}, got {len(direction_rows)}")
    return Rays(origin_rows, direction_rows, _as_range(t_min, count, "t_min"), _as_range(t_max, count, "t_max"))


def _as_range(value: ArrayLike, count: int, field: str) -> Floats:
    """Return one number, or one per ray, as (n,)."""
    numbers = as_array(value, np.float64, ("n",) if np.ndim(value) else (), field)
    if numbers.shape not in ((), (1,), (count,)):
        raise ValueError(f"{field}: expected a number or an array ({count},), got shape {numbers.shape}")
    return np.ascontiguousarray(np.broadcast_to(numbers, (count,)))


def check_after(after: Hits | None, count: int) -> Hits | None:
    """Return what `count` rays have met before, or raise ValueError where that is of other rays."""
    if after is not None and (not isinstance(after, Hits) or len(after) != count):
        got = f"of {len(after)}" if isinstance(after, Hits) else type(after).__name__
        raise ValueError(f"after: expected the Hits of these {count} rays, got {got}")
    return after


def join_rays(parts: Sequence[Rays]) -> Rays:
    """Return the rays of several records as one, in order."""
    if not parts:
        return Rays(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0))
    if len(parts) == 1:
        return parts[0]
    origins, directions, t_min, t_max = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("origins", "directions", "t_min", "t_max")
    )
    departure = join_departures([part.departure for part in parts], [len(part) for part in parts])
    return Rays(origins, directions, t_min, t_max, _join_after(parts), departure)


def _join_after(parts: Sequence[Rays]) -> Hits | None:
    if all(part.after is None for part in parts):
        return None
    hits = [part.after or make_misses(np.ones(len(part), dtype=np.bool_)) for part in parts]
    names = [item.name for item in fields(Hits) if item.name != "tied"]
    return Hits(*(np.concatenate([getattr(part, name) for part in hits]) for name in names))


@dataclass(frozen=True, eq=False, slots=True)
class Hits:
    """The closest hit of each ray; a miss is data: distance inf, indices -1.

    distance : (n,) float64, t of o + t d, in units of the direction's length; inf = miss
    distance_error : (n,) float64, certified bound on |distance - exact t|; 0 for a miss, NaN where the caster's
        precision certifies nothing
    instance : (n,) int32, index into the scene's instances (or meshes, where the scene has no instances); groups of
        spheres follow after the last one, then groups of curves; -1 = miss
    primitive : (n,) int32, triangle of the mesh, sphere of the group or segment of the curves; -1 = miss
    barycentric : (n, 2) float64, weights of the triangle's corners 1 and 2; of a strand the place along the segment,
        0 to 1, and, if it is flat, across it, -1 to 1; 0 for spheres and misses
    valid : (n,) bool, False for NaN, infinite or zero-direction rays, which miss
    tied : (n,) bool, False where nothing else lies at the same distance beyond doubt; None where nobody asks
    """

    distance: Numbers
    distance_error: Numbers
    instance: Integers
    primitive: Integers
    barycentric: Pairs
    valid: Booleans
    tied: Booleans | None = None

    def __len__(self) -> int:
        return len(self.distance)

    def select(self, rows: Any) -> Hits:
        """Return some of the hits: index or boolean array."""
        return select_rows(self, rows)

    @property
    def hit(self) -> Booleans:
        """(n,) bool, True where the ray hit something."""
        return self.primitive >= 0

    def put(self, rows: Any, other: Hits) -> None:
        """Overwrite some of the hits: index, slice or boolean array."""
        for item in fields(self):
            target = getattr(self, item.name)
            if target is not None:
                target[rows] = getattr(other, item.name)

    def forget(self, rows: Any) -> Hits:
        """Return the hits, some of them misses."""
        kept = replace(self, instance=self.instance.copy(), primitive=self.primitive.copy(), tied=None)
        kept.instance[rows] = kept.primitive[rows] = -1
        return kept


def make_misses(valid: Booleans, tied: bool = False) -> Hits:
    """Return the hits of rays, `valid` (n,) or not, that hit nothing; tied : whether anybody asks for that."""
    count = len(valid)
    return Hits(
        distance=np.full(count, np.inf),
        distance_error=np.zeros(count),
        instance=np.full(count, -1, np.int32),
        primitive=np.full(count, -1, np.int32),
        barycentric=np.zeros((count, 2)),
        valid=valid,
        tied=np.zeros(count, dtype=np.bool_) if tied else None,
    )


def find_main_axis(directions: Floats) -> NDArray[np.int8]:
    """Return the axis (n,) of each direction's largest component; the last of equals."""
    x, y, z = np.abs(np.ascontiguousarray(directions.T))
    axis = (y >= x).view(np.int8)
    np.copyto(axis, 2, where=z >= np.maximum(x, y))
    return axis
