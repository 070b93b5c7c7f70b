"""Where rays meet the planes of triangles, in float64 with a bound: what settles most candidates without `query`.

A triangle's plane is stored once, in a frame of size one: normal, corner, bound. An accelerator that knows of a pair
(ray, triangle) whether the line certainly passes inside the triangle learns here between which distances the ray meets
the plane. What is certainly out of range is dropped, what is certainly in range narrows the ray's range; a ray's only
candidate, if certain, is settled, and all others are offered to `query`, which decides exactly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.casting.framed import largest_row
from raytracer.casting.geometry import Ids
from raytracer.casting.primitives import name_rows
from raytracer.casting.query import Query
from raytracer.predicates.filtered import cross
from raytracer.predicates.rounding import UNIT_ROUNDOFF

# Rows of 64 bytes: normal, corner, bound, bound per move; origin, direction, share of the bound, start of range.
PLANE_COLUMNS = LINE_COLUMNS = 8
# Rays with directions longer than this, or shorter than its inverse, are left to `query`: what is certain here may be
# in doubt there, where products of lengths leave the range of pairs of float64, and is then measured in integers.
LONGEST = 2.0**100
# Corners that may be moved by more than this are not measured: nothing is known of their lines.
MOST_MOVED = 2.0**-20
# Pairs measured at a time: what they need fits the cache.
PAIR_BLOCK = 2048
# Candidates offered at a time.
OFFER_PAIRS = 1 << 14


def make_planes(corners: Floats, moved: bool = False) -> Floats:
    """(t, 8) normal N scaled to a largest component of 1, corner a, a bound e on the roundings that N brings, and f,
    of corners (3, 3, t) in the frame.

    moved : whether corners may be moved, by up to MOST_MOVED, as instances' are (`dense.instances`); else f is 0

    A corner in the frame is off by u, so a side of at most s by u (2 + s); a component of N, two products of sides and
    their difference, by 8 u s (1 + s), of which 9 covers the second order. Scaling adds u; `meet_planes` adds up to
    5 u |N| where it multiplies by N.

    A corner that is moved by w moves a side by 2 w and a component of N by 8 w s + 8 w^2, so by at most 6 f w with
    f = 9/6 (s + MOST_MOVED).
    """
    side_b, side_c = corners[1] - corners[0], corners[2] - corners[0]
    normal = cross(side_b, side_c)
    planes = np.zeros((corners.shape[2], PLANE_COLUMNS))
    with np.errstate(all="ignore"):
        size = np.abs(normal).max(axis=0)
        extent = np.maximum(np.abs(side_b).max(axis=0), np.abs(side_c).max(axis=0))
        planes[:, :3] = (normal / size).T
        planes[:, 3:6] = corners[0].T
        planes[:, 6] = UNIT_ROUNDOFF * (9 * extent * (1 + extent) / size + 7)
        if moved:
            planes[:, 7] = 1.5 * (extent + MOST_MOVED) / size
    return planes


def make_lines(origin: Floats, direction: Floats, start: Floats | float, moved: Floats | float = 0.0) -> Floats:
    """(n, 8) rows of rays o + t d, t >= start, (3, n) planes and (n,) in the frame, |d| <= 1: the seventh number is
    4 u (1 + |o|) + 6 w, see `meet_planes`, where the line, and corners, may be `moved` by w."""
    lines = np.empty((origin.shape[1], LINE_COLUMNS))
    lines[:, :3], lines[:, 3:6], lines[:, 7] = origin.T, direction.T, start
    sizes = np.abs(origin)
    farthest = np.maximum(np.maximum(sizes[0], sizes[1]), sizes[2])
    np.multiply(1 + farthest, 4 * UNIT_ROUNDOFF, out=lines[:, 6])
    lines[:, 6] += 6 * moved
    return lines


def meet_planes(planes: Floats, lines: Floats) -> tuple[Floats, Floats]:
    """t = T / D with T = w . N, w = a - o, D = d . N of rows (8, k) as planes, and a bound on its error; infinite or
    NaN where there is none.

    w is off by u (1 + |o|) + u |w|, so T by |w|_1 e + 4 u (1 + |o|), where |.|_1 sums components and |o| is the
    largest; D by 3 e, as |d| <= 1; and the quotient by (e_T + |t| e_D) / (|D| - e_D) + u |t|. As e >= 7 u, a fourth e
    pays for the quotient and for adding the bound to it.

    In the frame of an instance (`dense.instances`) corners and, where the plane is met, the line may be moved by w in
    all: T by 3 w |N|, which 6 w covers as long as e < 1, for with more there is no room; and N by f 6 w, which counts
    as e does.
    """
    normal, error = planes[:3], planes[6] + planes[7] * lines[6]
    way = planes[3:6] - lines[:3]
    product = lines[3:6] * normal
    denominator = product[0] + product[1]
    denominator += product[2]
    np.multiply(way, normal, out=product)
    t = product[0] + product[1]
    t += product[2]
    t /= denominator
    np.abs(way, out=way)
    bound = np.abs(t)
    bound *= 4
    for steps in way:
        bound += steps
    bound *= error
    bound += lines[6]
    room = np.abs(denominator, out=denominator)
    room -= 3 * error
    # No room: negative, zero or NaN, and so is the quotient, which the maximum passes on as infinity or NaN.
    bound /= room
    np.copyto(bound, np.inf, where=~(room > 0))
    return t, bound


class Measured(NamedTuple):
    """Candidates with the interval of their distance, in the frame, and whether they are certainly hit in range."""

    ray: Indices
    primitive_id: Ids
    low: Floats
    certain: Booleans

    def select(self, index: Indices) -> Measured:
        return Measured(
            self.ray.take(index), self.primitive_id.take(index), self.low.take(index), self.certain.take(index)
        )


class Lanes(NamedTuple):
    """k rays in the frames of instances that they enter.

    ray : (k,) of the query; lines : (k, 8), see `make_lines`
    unit : (k,) float64, a power of two: t in the frame is `unit` times that of the ray's line in `PlaneDecisions`
    id_shift : (k,) int64, add to a row of planes to get the primitive id
    """

    ray: Indices
    lines: Floats
    unit: Floats
    id_shift: Ids


class PlaneDecisions:
    """Takes in candidates of a query's rays and settles or offers them; all, to one that no hit narrows.

    best, t_max : (n,) as `Query.best` and the rays' range, in the frame
    begun : (n,) `Query.surely_begun` in the frame; None where that is the range's begin
    """

    def __init__(self, query: Query, planes: Floats) -> None:
        count = len(query.rays)
        self.query, self.planes = query, planes
        self.lines = np.empty((count, LINE_COLUMNS))
        self.best, self.t_max = np.empty(count), np.empty(count)
        self.begun = None if query.passed is None else np.empty(count)
        self.pool: list[Measured] = []

    def set_rays(self, rows: slice, origin: Floats, direction: Floats, unit: Floats) -> None:
        """Let `rows` of the rays be o + t d, (3, k) planes in the frame, where t counts `unit` times the rays' own t.

        `unit` is a power of two. What it takes out of the range of float64 is below any bound, infinite, or NaN, which
        is never certain; a NaN as the farthest distance is replaced by infinity, with which traversal can work.
        """
        query = self.query
        self.lines[rows] = make_lines(origin, direction, query.t_min[rows] * unit)
        length = largest_row(np.abs(query.rays.directions[rows].T))
        if len(length) and not (length.min() > 1 / LONGEST and length.max() < LONGEST):
            self.lines[rows, 6] += np.where((length > 1 / LONGEST) & (length < LONGEST), 0.0, np.inf)
        np.multiply(query.rays.t_max[rows], unit, out=self.t_max[rows])
        np.multiply(query.best[rows], unit, out=self.best[rows])
        if self.begun is not None:
            np.multiply(query.surely_begun[rows], unit, out=self.begun[rows])
        np.copyto(self.best[rows], np.inf, where=np.isnan(self.best[rows]))

    def take_in(self, ray: Indices, row: Indices, inside: Booleans) -> Indices:
        """Measure candidates, given by rows of `planes`, of which `inside` says where the line certainly meets the
        triangle's inner; return the rays whose `best` may have changed."""
        if not self.query.narrows:
            self.pool.append(Measured(ray, self._name(row), np.zeros(len(ray)), np.zeros(len(ray), bool)))
            return ray[:0]
        return self._take_in([self._measure(ray[part], row[part], inside[part]) for part in _cut(len(ray))])

    def take_in_lanes(self, lanes: Lanes, planes: Floats, lane: Indices, row: Indices, inside: Booleans) -> Indices:
        """As `take_in`, of candidates in the frames of instances."""
        parts = _cut(len(lane))
        return self._take_in([self._measure_lanes(lanes, planes, lane[p], row[p], inside[p]) for p in parts])

    def _name(self, row: Indices) -> Ids:
        return name_rows(self.query.primitives, row)

    def _measure(self, ray: Indices, row: Indices, inside: Booleans) -> tuple:
        lines = np.ascontiguousarray(self.lines.take(ray, axis=0).T)
        t, bound = meet_planes(np.ascontiguousarray(self.planes.take(row, axis=0).T), lines)
        return self._judge(ray, self._name(row), inside, lines[7], t - bound, t + bound)

    def _measure_lanes(self, lanes: Lanes, planes: Floats, lane: Indices, row: Indices, inside: Booleans) -> tuple:
        lines = np.ascontiguousarray(lanes.lines.take(lane, axis=0).T)
        t, bound = meet_planes(np.ascontiguousarray(planes.take(row, axis=0).T), lines)
        shrink = 1 / lanes.unit.take(lane)
        ray, named = lanes.ray.take(lane), row + lanes.id_shift.take(lane)
        return self._judge(ray, named, inside, lines[7] * shrink, (t - bound) * shrink, (t + bound) * shrink)

    def _judge(
        self, ray: Indices, primitive_id: Ids, inside: Booleans, start: Floats, low: Floats, high: Floats
    ) -> tuple:
        """The columns of Measured and the upper end of the interval, of those that may be in range."""
        # NaN is neither before nor behind.
        possible = np.flatnonzero(~((high < start) | (low > self.best.take(ray))))
        ray, low, high = ray.take(possible), low.take(possible), high.take(possible)
        begun = start.take(possible) if self.begun is None else self.begun.take(ray)
        certain = inside.take(possible) & (low >= begun) & (high <= self.t_max.take(ray))
        return ray, primitive_id.take(possible), low, certain, high

    def _take_in(self, parts: list[tuple]) -> Indices:
        """Pool what `_judge` left, and lower `best`."""
        if not parts:
            return np.zeros(0, np.intp)
        low_high = [np.concatenate(column) for column in zip(*parts, strict=True)]
        measured, high = Measured(*low_high[:4]), low_high[4]
        certain = np.flatnonzero(measured.certain)
        changed = measured.ray.take(certain)
        if self.query.any_hit:
            self.query.settle(changed, measured.primitive_id.take(certain))
            self.best[changed] = -np.inf
            measured = measured.select(np.flatnonzero(self.best.take(measured.ray) > -np.inf))
        else:
            np.minimum.at(self.best, changed, high.take(certain))
        self.pool.append(measured)
        return changed

    def finish(self, settles: bool = True) -> None:
        """Settle certain candidates that are their rays' only ones, unless there are others that are not here
        (`settles` False), and offer the rest."""
        if not self.pool:
            return
        left = Measured(*(np.concatenate(column) for column in zip(*self.pool, strict=True)))
        if self.query.narrows:
            left = left.select(np.flatnonzero(~(left.low > self.best.take(left.ray))))
        if not self.query.any_hit and settles:
            alone = np.bincount(left.ray, minlength=len(self.best)).take(left.ray) == 1
            clear = left.select(np.flatnonzero(left.certain & alone))
            self.query.settle(clear.ray, clear.primitive_id)
            left = left.select(np.flatnonzero(~(left.certain & alone)))
        for start in range(0, len(left.ray), OFFER_PAIRS):
            part = slice(start, start + OFFER_PAIRS)
            self.query.offer(left.ray[part], left.primitive_id[part])


def _cut(count: int) -> list[slice]:
    return [slice(start, start + PAIR_BLOCK) for start in range(0, count, PAIR_BLOCK)]
