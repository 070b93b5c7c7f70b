"""Where rays meet the planes of triangles, in float64 with a bound: what settles most candidates without `query`.

A triangle's plane is stored once, in the unit of a frame, in which the scene's size is one: normal, corner, bound.
Corners and origins are not moved to the frame's middle: so none of them is rounded, and next to a plane, where rays
leave it, their difference is as exact as they are near. An accelerator that knows of a pair
(ray, triangle) whether the line certainly passes inside the triangle learns here between which distances the ray meets
the plane. What is certainly out of range is dropped, what is certainly in range narrows the ray's range; a ray's only
candidate, if certain, is settled, and all others are offered to `query`, which decides exactly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.casting.framed import FramedRays, largest_row, times_power
from raytracer.casting.geometry import Ids
from raytracer.casting.primitives import name_rows
from raytracer.casting.query import Query
from raytracer.predicates.double_double import cross as cross_pairs
from raytracer.predicates.double_double import two_difference
from raytracer.predicates.filtered import cross
from raytracer.predicates.rounding import UNIT_ROUNDOFF

# Rows of 64 bytes: normal, corner, bound, share of the query's bound or bound per move; origin, direction, bound, start
# of range.
PLANE_COLUMNS = LINE_COLUMNS = 8
# Normals that are off by so many u are computed in pairs where their triangle is of the size of the scene, or by as
# many more as it is smaller: nearer to its plane than that a ray may start.
MOST_WIDENED = 1.0
# What a normal is off by, in u s^2 in float64, in u^2 s^2 in pairs, `make_planes`.
ROUNDINGS, PAIRS_ROUNDINGS = 9.0, 25.0
# Normals below this may have lost terms that underflow; what underflows elsewhere is off by much less than this.
SMALLEST_NORMAL, LEAST_BOUND = 2.0**-900, 2.0**-1000
# Rays with directions longer than this, or shorter than its inverse, are left to `query`: what is certain here may be
# in doubt there, where products of lengths leave the range of pairs of float64, and is then measured in integers.
LONGEST = 2.0**100
# So are scenes that are larger than this power of two, or smaller than its inverse.
LARGEST_SIZE = 200
# Corners that may be moved by more than this are not measured: nothing is known of their lines.
MOST_MOVED = 2.0**-20
# Pairs measured at a time: what they need fits the cache.
PAIR_BLOCK = 2048
# Candidates offered at a time: of triangles, and of others, which need more.
OFFER_PAIRS, OFFER_BLOCK = 1 << 14, 1 << 13


def make_planes(corners: Floats, exponent: int) -> Floats:
    """(t, 8) normal N scaled to a largest component of 1, corner a, a bound e on the roundings that N brings, and how
    many times as wide the query's own bound may be, of world corners (3, 3, t), in units of 2^-exponent.

    A side is off by u of itself; a component of N, two products of sides of at most s and their difference, by 8 u s^2,
    of which 9 covers the second order. Where that counts, N is computed in pairs: the products are off by 8 u^2 s^2
    each, the difference by as much, and u is added when it is rounded. Scaling adds u; `meet_planes` adds up to
    5 u |N| where it multiplies by N.

    `filtered.intersect_plane_certified`, with sides and normals of float64, is off by at most e_q = u (24 s^2 + 16)
    where e stands here, and its bound holds as much again. With D above 6 e_q, for else it is not certain, its room is
    half of D at least: its interval lies within t +- (1 + 4 e_q / e) times the bound.
    """
    with np.errstate(all="ignore"):
        normal, extent = _cross_sides(corners, exponent)
        size = np.abs(normal).max(axis=0)
        error = ROUNDINGS * extent * extent / size
        wide = np.flatnonzero((error * extent > MOST_WIDENED) & (size > SMALLEST_NORMAL))
        if len(wide):
            normal[:, wide] = cross_sides(corners.take(wide, axis=2), exponent)
            size[wide] = np.abs(normal[:, wide]).max(axis=0)
            error[wide] = PAIRS_ROUNDINGS * UNIT_ROUNDOFF * extent[wide] ** 2 / size[wide]
        share = 1 + 4 * (24 * extent * extent / size + 16) / (error + 8)
        return _pack_planes(corners, exponent, normal / size, np.where(size > SMALLEST_NORMAL, error, np.inf), share)


def make_moved_planes(corners: Floats, exponent: int) -> Floats:
    """As `make_planes`, of object corners that may be moved by up to MOST_MOVED, as those of instances are
    (`dense.instances`), with f in the place of the last number.

    A corner that is moved by w moves a side by 2 w and a component of N by 8 w s + 8 w^2, so by at most 6 f w with
    f = 9/6 (s + MOST_MOVED). Beside that pairs would gain nothing: w is 32 u at least.
    """
    with np.errstate(all="ignore"):
        normal, extent = _cross_sides(corners, exponent)
        size = np.abs(normal).max(axis=0)
        error = np.where(size > SMALLEST_NORMAL, ROUNDINGS * extent * extent / size, np.inf)
        return _pack_planes(corners, exponent, normal / size, error, 1.5 * (extent + MOST_MOVED) / size)


def _cross_sides(corners: Floats, exponent: int) -> tuple[Floats, Floats]:
    """N (3, t) in float64, and s (t,), the largest component of the sides at the first corner."""
    sides = times_power(corners[1:] - corners[0], exponent)
    return cross(*sides), np.abs(sides).max(axis=(0, 1))


def _pack_planes(corners: Floats, exponent: int, normal: Floats, error: Floats, last: Floats) -> Floats:
    planes = np.empty((corners.shape[2], PLANE_COLUMNS))
    planes[:, :3], planes[:, 3:6] = normal.T, times_power(corners[0].T, exponent)
    known = abs(exponent) < LARGEST_SIZE
    planes[:, 6], planes[:, 7] = UNIT_ROUNDOFF * (error + 8) if known else np.inf, last
    return planes


def cross_sides(corners: Floats, exponent: int) -> Floats:
    """N of world corners (3, 3, k) in units of 2^-exponent, computed in pairs and rounded."""
    b, c = (two_difference(corner, corners[0]) for corner in corners[1:])
    return cross_pairs(*((times_power(high, exponent), times_power(low, exponent)) for high, low in (b, c)))[0]


def make_lines(place: Floats, direction: Floats, start: Floats | float, moved: Floats | float = 0.0) -> Floats:
    """(n, 8) rows of rays o + t d, t >= start, (3, n) planes and (n,), see `FramedRays`, |d| <= 1: the seventh number
    is LEAST_BOUND + 6 w, see `meet_planes`, where the line, and corners, may be `moved` by w."""
    lines = np.empty((place.shape[1], LINE_COLUMNS))
    lines[:, :3], lines[:, 3:6], lines[:, 6], lines[:, 7] = place.T, direction.T, LEAST_BOUND + 6 * moved, start
    return lines


def meet_planes(planes: Floats, lines: Floats) -> tuple[Floats, Floats]:
    """t = T / D with T = w . N, w = a - o, D = d . N of rows (8, k) as planes, and a bound on its error; infinite or
    NaN where there is none.

    w is off by u |w|, so T by |w|_1 e, where |.|_1 sums components, and by LEAST_BOUND where anything underflows; D by
    3 e, as |d| <= 1; and the quotient by (e_T + |t| e_D) / (|D| - e_D) + u |t|. As e >= 8 u, a fourth e pays for the
    quotient and for adding the bound to it.
    """
    return _meet(planes, lines, planes[6])


def meet_moved_planes(planes: Floats, lines: Floats) -> tuple[Floats, Floats]:
    """As `meet_planes`, of `make_moved_planes`.

    In the frame of an instance (`dense.instances`) corners and, where the plane is met, the line may be moved by w in
    all: T by 3 w |N|, which 6 w covers as long as e < 1, for with more there is no room; and N by f 6 w, which counts
    as e does.
    """
    return _meet(planes, lines, planes[6] + planes[7] * lines[6])


def _meet(planes: Floats, lines: Floats, error: Floats) -> tuple[Floats, Floats]:
    normal = planes[:3]
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
    share : (k,) how many times as wide as the one here the query's own bound may be
    """

    ray: Indices
    lines: Floats
    unit: Floats
    id_shift: Ids
    share: Floats


class Meetings(NamedTuple):
    """k candidates and where their rays meet their planes, in the world's frame.

    inside : (k,) bool, the line certainly meets the triangle's inner; start : (k,) of the ray's range
    t, bound : (k,) see `meet_planes`; share : (k,) how many times as wide the query's own bound may be
    """

    ray: Indices
    primitive_id: Ids
    inside: Booleans
    start: Floats
    t: Floats
    bound: Floats
    share: Floats


class PlaneDecisions:
    """Takes in candidates of a query's rays and settles or offers them; all, to one that no hit narrows.

    best, t_max : (n,) as `Query.best` and the rays' range, in the frame
    begun : (n,) `Query.surely_begun` in the frame; None where that is the range's begin
    unit : (n,) see `FramedRays`; None where there are only triangles
    usual : between which units directions have a usual length, `LONGEST`
    """

    def __init__(self, query: Query, planes: Floats, exponent: int = 0) -> None:
        count = len(query.rays)
        self.query, self.planes = query, planes
        self.lines = np.empty((count, LINE_COLUMNS))
        self.best, self.t_max = np.empty(count), np.empty(count)
        self.begun = None if query.passed is None else np.empty(count)
        self.unit = np.empty(count) if len(query.primitives.geometry.radii) else None
        self.pool: list[Measured] = []
        scale = float(np.ldexp(1.0, exponent)) if abs(exponent) < LARGEST_SIZE else np.nan
        self.usual = 2 / LONGEST * scale, LONGEST * scale

    def set_rays(self, rows: slice | Indices, rays: FramedRays) -> None:
        """Let `rows` of the query's rays be `rays`.

        Their `unit` is a power of two. What it takes out of the range of float64 is below any bound, infinite, or NaN,
        which is never certain; a NaN as the farthest distance is replaced by infinity, with which traversal can work.
        """
        query, unit = self.query, rays.unit
        self.lines[rows] = make_lines(rays.place, rays.direction, query.t_min[rows] * unit)
        length = largest_row(np.abs(query.rays.directions[rows].T))
        if len(length) and not (length.min() > 1 / LONGEST and length.max() < LONGEST):
            self.lines[rows, 6] += np.where((length > 1 / LONGEST) & (length < LONGEST), 0.0, np.inf)
        if self.unit is not None:
            self.unit[rows] = unit
        self.t_max[rows] = query.rays.t_max[rows] * unit
        best = query.best[rows] * unit
        np.copyto(best, np.inf, where=np.isnan(best))
        self.best[rows] = best
        if self.begun is not None:
            self.begun[rows] = query.surely_begun[rows] * unit

    def are_usual(self, rays: FramedRays) -> Booleans:
        """(k,) False for rays that are left to `query`, as `LONGEST` says."""
        return (rays.unit > self.usual[0]) & (rays.unit < self.usual[1])

    def settle(self, ray: Indices, row: Indices) -> None:
        """Settle triangles, by rows of `planes`, of which it is certain that their rays hit these first."""
        self.query.settle(ray, self._name(row))

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

    def offer(self, ray: Indices, primitive_id: Ids) -> Indices:
        """Offer the query candidates that are no triangles; return the rays whose `best` may have changed."""
        assert self.unit is not None
        changed = [self.query.offer(ray[part], primitive_id[part]) for part in _cut(len(ray), OFFER_BLOCK)]
        rays = np.concatenate([ray[:0], *changed])
        # What is NaN out of the range of float64 lowers nothing.
        self.best[rays] = np.fmin(self.best.take(rays), self.query.best.take(rays) * self.unit.take(rays))
        return rays

    def _name(self, row: Indices) -> Ids:
        return name_rows(self.query.primitives, row)

    def _measure(self, ray: Indices, row: Indices, inside: Booleans) -> tuple:
        lines = np.ascontiguousarray(self.lines.take(ray, axis=0).T)
        planes = np.ascontiguousarray(self.planes.take(row, axis=0).T)
        t, bound = meet_planes(planes, lines)
        return self._judge(Meetings(ray, self._name(row), inside, lines[7], t, bound, planes[7]))

    def _measure_lanes(self, lanes: Lanes, planes: Floats, lane: Indices, row: Indices, inside: Booleans) -> tuple:
        lines = np.ascontiguousarray(lanes.lines.take(lane, axis=0).T)
        t, bound = meet_moved_planes(np.ascontiguousarray(planes.take(row, axis=0).T), lines)
        shrink = 1 / lanes.unit.take(lane)
        ray, named = lanes.ray.take(lane), row + lanes.id_shift.take(lane)
        start, share = lines[7] * shrink, lanes.share.take(lane)
        return self._judge(Meetings(ray, named, inside, start, t * shrink, bound * shrink, share))

    def _judge(self, pairs: Meetings) -> tuple:
        """The columns of Measured and the upper end of the interval, of those that may be in range."""
        ray, t, bound = pairs.ray, pairs.t, pairs.bound
        # What the query would leave in doubt is left to it: hits found in doubt are measured otherwise.
        slack = bound if self.query.any_hit else bound * pairs.share
        inside = pairs.inside & (t - slack >= (pairs.start if self.begun is None else self.begun.take(ray)))
        inside &= t + slack <= self.t_max.take(ray)
        low, high = t - bound, t + bound
        # NaN is neither before nor behind.
        possible = np.flatnonzero(~((high < pairs.start) | (low > self.best.take(ray))))
        ray, low, high = ray.take(possible), low.take(possible), high.take(possible)
        return ray, pairs.primitive_id.take(possible), low, inside.take(possible), high

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

    def finish(self) -> None:
        """Settle certain candidates that are their rays' only ones, also among what was offered, and offer the rest: in
        plain precisions all, where there are spheres."""
        if not self.pool:
            return
        left = Measured(*(np.concatenate(column) for column in zip(*self.pool, strict=True)))
        if self.query.narrows:
            left = left.select(np.flatnonzero(~(left.low > self.best.take(left.ray))))
        if not self.query.any_hit and (self.query.certified or self.unit is None):
            count = np.bincount(left.ray, minlength=len(self.best))
            for offered in self.query.pool:
                count[offered.ray] += 1
            alone = count.take(left.ray) == 1
            clear = left.select(np.flatnonzero(left.certain & alone))
            self.query.settle(clear.ray, clear.primitive_id)
            left = left.select(np.flatnonzero(~(left.certain & alone)))
        for start in range(0, len(left.ray), OFFER_PAIRS):
            part = slice(start, start + OFFER_PAIRS)
            self.query.offer(left.ray[part], left.primitive_id[part])


def _cut(count: int, size: int = PAIR_BLOCK) -> list[slice]:
    return [slice(start, start + size) for start in range(0, count, size)]
