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
from raytracer.casting.framed import FramedRays, times_power
from raytracer.casting.geometry import Ids
from raytracer.casting.query import Query
from raytracer.predicates.double_double import cross as cross_pairs
from raytracer.predicates.double_double import two_difference
from raytracer.predicates.filtered import cross
from raytracer.predicates.rounding import UNIT_ROUNDOFF

# Rows of 64 bytes: normal, corner, bound, share of the query's bound; origin, direction, nothing, start of range.
PLANE_COLUMNS = LINE_COLUMNS = 8
# Normals that are off by so many u are computed in pairs where their triangle is of the size of the scene, or by as
# many more as it is smaller: nearer to its plane than that a ray may start.
MOST_WIDENED = 1.0
# What a normal is off by, in u s^2 in float64, in u^2 s^2 in pairs, `make_planes`.
ROUNDINGS, PAIRS_ROUNDINGS = 9.0, 25.0
# Normals below this may have lost terms that underflow; what underflows elsewhere is off by much less than this.
SMALLEST_NORMAL, LEAST_BOUND = 2.0**-900, 2.0**-1000
# Pairs measured at a time: what they need fits the cache.
PAIR_BLOCK = 2048
# Candidates offered at a time.
OFFER_PAIRS = 1 << 14


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
    planes = np.zeros((corners.shape[2], PLANE_COLUMNS))
    with np.errstate(all="ignore"):
        planes[:, 3:6] = times_power(corners[0].T, exponent)
        sides = times_power(corners[1:] - corners[0], exponent)
        normal, extent = cross(*sides), np.abs(sides).max(axis=(0, 1))
        size = np.abs(normal).max(axis=0)
        error = ROUNDINGS * extent * extent / size
        wide = np.flatnonzero((error * extent > MOST_WIDENED) & (size > SMALLEST_NORMAL))
        if len(wide):
            normal[:, wide] = cross_sides(corners.take(wide, axis=2), exponent)
            size[wide] = np.abs(normal[:, wide]).max(axis=0)
            error[wide] = PAIRS_ROUNDINGS * UNIT_ROUNDOFF * extent[wide] ** 2 / size[wide]
        error[~(size > SMALLEST_NORMAL)] = np.inf
        planes[:, :3] = (normal / size).T
        planes[:, 6] = UNIT_ROUNDOFF * (error + 8)
        planes[:, 7] = 1 + 4 * (24 * extent * extent / size + 16) / (error + 8)
    return planes


def cross_sides(corners: Floats, exponent: int) -> Floats:
    """N of world corners (3, 3, k) in units of 2^-exponent, computed in pairs and rounded."""
    b, c = (two_difference(corner, corners[0]) for corner in corners[1:])
    return cross_pairs(*((times_power(high, exponent), times_power(low, exponent)) for high, low in (b, c)))[0]


def make_lines(place: Floats, direction: Floats, start: Floats | float) -> Floats:
    """(n, 8) rows of rays o + t d, t >= start, (3, n) planes and (n,), see `FramedRays`, |d| <= 1."""
    lines = np.empty((place.shape[1], LINE_COLUMNS))
    lines[:, :3], lines[:, 3:6], lines[:, 6], lines[:, 7] = place.T, direction.T, LEAST_BOUND, start
    return lines


def meet_planes(planes: Floats, lines: Floats) -> tuple[Floats, Floats]:
    """t = T / D with T = w . N, w = a - o, D = d . N of rows (8, k) as planes, and a bound on its error; infinite or
    NaN where there is none.

    w is off by u |w|, so T by |w|_1 e, where |.|_1 sums components, and by LEAST_BOUND where anything underflows; D by
    3 e, as |d| <= 1; and the quotient by (e_T + |t| e_D) / (|D| - e_D) + u |t|. As e >= 8 u, a fourth e pays for the
    quotient and for adding the bound to it.
    """
    normal, error = planes[:3], planes[6]
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
    triangle: Ids
    low: Floats
    certain: Booleans

    def select(self, index: Indices) -> Measured:
        return Measured(self.ray.take(index), self.triangle.take(index), self.low.take(index), self.certain.take(index))


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

    def set_rays(self, rows: slice, rays: FramedRays) -> None:
        """Let `rows` of the query's rays be `rays`.

        Their `unit` is a power of two. What it takes out of the range of float64 is below any bound, infinite, or NaN,
        which is never certain; a NaN as the farthest distance is replaced by infinity, with which traversal can work.
        """
        query, unit = self.query, rays.unit
        self.lines[rows] = make_lines(rays.place, rays.direction, query.t_min[rows] * unit)
        np.multiply(query.rays.t_max[rows], unit, out=self.t_max[rows])
        np.multiply(query.best[rows], unit, out=self.best[rows])
        if self.begun is not None:
            np.multiply(query.surely_begun[rows], unit, out=self.begun[rows])
        np.copyto(self.best[rows], np.inf, where=np.isnan(self.best[rows]))

    def take_in(self, ray: Indices, triangle: Indices, inside: Booleans) -> Indices:
        """Measure candidates, of which `inside` says where the line certainly meets the triangle's inner; return the
        rays whose `best` may have changed."""
        if not self.query.narrows:
            self.pool.append(Measured(ray, triangle, np.zeros(len(ray)), np.zeros(len(ray), bool)))
            return ray[:0]
        parts = []
        for start in range(0, len(ray), PAIR_BLOCK):
            part = slice(start, start + PAIR_BLOCK)
            parts.append(self._measure(ray[part], triangle[part], inside[part]))
        if not parts:
            return ray
        low_high = [np.concatenate(column) for column in zip(*parts, strict=True)]
        measured, high = Measured(*low_high[:4]), low_high[4]
        certain = np.flatnonzero(measured.certain)
        changed = measured.ray.take(certain)
        if self.query.any_hit:
            self.query.settle(changed, measured.triangle.take(certain))
            self.best[changed] = -np.inf
            measured = measured.select(np.flatnonzero(self.best.take(measured.ray) > -np.inf))
        else:
            np.minimum.at(self.best, changed, high.take(certain))
        self.pool.append(measured)
        return changed

    def _measure(self, ray: Indices, triangle: Indices, inside: Booleans) -> tuple:
        """The columns of Measured and the upper end of the interval, of those that may be in range."""
        planes = np.ascontiguousarray(self.planes.take(triangle, axis=0).T)
        lines = np.ascontiguousarray(self.lines.take(ray, axis=0).T)
        t, bound = meet_planes(planes, lines)
        # What the query would leave in doubt is left to it: hits found in doubt are measured otherwise.
        slack = bound if self.query.any_hit else bound * planes[7]
        inside = inside & (t - slack >= (lines[7] if self.begun is None else self.begun.take(ray)))
        inside &= t + slack <= self.t_max.take(ray)
        low, high = t - bound, np.add(t, bound, out=t)
        # NaN is neither before nor behind.
        possible = np.flatnonzero(~((high < lines[7]) | (low > self.best.take(ray))))
        ray, low, high = ray.take(possible), low.take(possible), high.take(possible)
        return ray, triangle.take(possible), low, inside.take(possible), high

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
            self.query.settle(clear.ray, clear.triangle)
            left = left.select(np.flatnonzero(~(left.certain & alone)))
        for start in range(0, len(left.ray), OFFER_PAIRS):
            part = slice(start, start + OFFER_PAIRS)
            self.query.offer(left.ray[part], left.triangle[part])
