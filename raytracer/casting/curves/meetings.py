"""Which of the roots are hits, and how far off the distance can be.

A root counts where the ray passes within the radius; on ribbons, if it is more than CLEARANCE radii away from the ray's
origin, so that rays that leave a ribbon do not meet it again, turned towards them; on round segments, if the ray comes
from outside. With R from the centre line to the point, the outward normal is N = R (|P'|^2 - R . P'') / r - r' P':

    d . N <= 0   where   s h (|P'|^2 + x x'' + y y'' - s h z'') <= r z' r'.

References
----------
Blender, intern/cycles/kernel/geom/curve_intersect.h: ribbon_intersect (the clearance), curve_intersect_iterative (that
only the outside is seen; its normal leaves out P'').
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats
from raytracer.casting.curves.ray_space import POSITION_ERROR, Points, SeenSegments, evaluate, find_bends
from raytracer.casting.curves.roots import find_slopes, find_values, isolate_roots, refine_roots
from raytracer.predicates.rounding import UNIT_ROUNDOFF, gamma

CLEARANCE = 2.0
# How far beyond the first estimate of u's error its bound is widened, until signs at its ends are beyond doubt.
WIDENINGS = (2.0, 32.0, 1024.0)


class Meetings(NamedTuple):
    """m points where rays meet segments.

    segment : (m,) number of the segment among those seen
    u : (m,) float64; side : (m,) as in Brackets; depth : (m,) float64, metres along the ray
    """

    segment: NDArray[np.intp]
    u: Floats
    side: Floats
    depth: Floats


def find_meetings(seen: SeenSegments) -> Meetings:
    """Return all points where rays meet segments, at any depth, before the origin too."""
    brackets = isolate_roots(seen)
    found = seen.select(brackets.segment)
    u = refine_roots(found, brackets)
    points = evaluate(found, u)
    depth = points.z + brackets.side * points.height
    counts = points.square <= points.radius * points.radius
    counts &= np.where(found.thick, _face_outward(found, points, u, brackets.side), depth > CLEARANCE * points.radius)
    rows = np.flatnonzero(counts)
    return Meetings(brackets.segment[rows], u[rows], brackets.side[rows], depth[rows])


def _face_outward(seen: SeenSegments, points: Points, u: Floats, side: Floats) -> Booleans:
    """Return (m,) True where rays come from outside of round segments."""
    x, y, z = find_bends(seen, u)
    lift = side * points.height
    width = points.slope_x**2 + points.slope_y**2 + points.slope_z**2 + points.x * x + points.y * y - lift * z
    return lift * width <= points.radius * points.slope_z * points.slope_radius


def find_offsets(points: Points) -> Floats:
    """Return (k,) where ribbons are met across their width, from -1 to 1: (P' x d) . (q - P) / (|P' x d| r) with the
    opposite of the ray's direction d."""
    size = np.hypot(points.slope_x, points.slope_y) * points.radius
    turned = points.x * points.slope_y - points.y * points.slope_x
    return np.clip(np.divide(turned, size, out=np.zeros_like(size), where=size > 0), -1.0, 1.0)


def bound_errors(seen: SeenSegments, u: Floats, side: Floats) -> Floats:
    """Return bounds (k,) on the error of depths, metres, that are computed at u.

    The exact root lies between u - w and u + w where the equation's signs there differ by more than its own error,
    which is what moving the keys by POSITION_ERROR R changes. From it the depth is off by |z'| w, and by what h
    changes. Where no such w is found, as where the ray touches, the whole segment's depth is the bound.
    """
    points = evaluate(seen, u)
    with np.errstate(all="ignore"):
        first = np.abs(find_values(points, side)) + _bound_values(seen, points, side)
        first /= np.abs(find_slopes(seen, points, u, side))
    bound = np.ptp(seen.bezier[2], axis=0) + np.abs(seen.bezier[3]).max(axis=0) + POSITION_ERROR * seen.reach
    open_ = np.isfinite(first)
    for factor in WIDENINGS:
        width = factor * np.where(open_, first, 0.0) + 2.0 * UNIT_ROUNDOFF
        surely = open_ & _differ_surely(seen, u, width, side)
        np.minimum(bound, _bound_depths(seen, points, side, width), out=bound, where=surely)
        open_ &= ~surely
        if not open_.any():
            break
    return bound


def _bound_values(seen: SeenSegments, points: Points, side: Floats) -> Floats:
    """Return bounds (k,) on the error of g - s z' h: keys moved by e change X by e, its derivative by 8 e, and h^2 by
    2 (|X| + r) e."""
    moved = POSITION_ERROR * seen.reach
    x, slope = np.hypot(points.x, points.y), np.hypot(points.slope_x, points.slope_y)
    foot = moved * (slope + 8.0 * x) + gamma(8) * x * slope
    height = _bound_heights(points, moved, 0.0)
    lift = np.abs(points.slope_z) * height + 8.0 * moved * (points.height + height)
    return foot + np.abs(side) * (lift + gamma(8) * np.abs(points.slope_z) * points.height)


def _bound_heights(points: Points, moved: Floats, square: Floats | float) -> Floats:
    """Return bounds (k,) on the error of h = sqrt(r^2 - X^2), besides what `square` adds to that of its square.

    |sqrt(a) - sqrt(b)| is below |a - b| / sqrt(a), and below sqrt(|a - b|).
    """
    x = np.hypot(points.x, points.y)
    change = 2.0 * (x + points.radius) * moved + moved**2 + gamma(8) * (x**2 + points.radius**2) + square
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.fmin(change / points.height, np.sqrt(change))


def _differ_surely(seen: SeenSegments, u: Floats, width: Floats, side: Floats) -> Booleans:
    """Return (k,) True where the equation's signs at u - width and u + width are different beyond doubt."""
    signs = []
    for place in (u - width, u + width):
        points = evaluate(seen, place)
        value, error = find_values(points, side), _bound_values(seen, points, side)
        signs.append(np.where(np.abs(value) > error, np.sign(value), np.nan))
    return signs[0] * signs[1] < 0


def _bound_depths(seen: SeenSegments, points: Points, side: Floats, width: Floats) -> Floats:
    """Return bounds (k,) on the error of depths where the exact root lies within `width` of u.

    (h^2)' = 2 (r r' - g), whose parts are bounded by the hulls of the derivatives.
    """
    slope_x, slope_y, slope_z, slope_radius = np.abs(seen.slopes).max(axis=1)
    slope, moved = np.hypot(slope_x, slope_y), POSITION_ERROR * seen.reach
    x = np.hypot(points.x, points.y) + width * slope
    square = 2.0 * width * ((points.radius + width * slope_radius) * slope_radius + x * slope)
    height = np.abs(side) * _bound_heights(points, moved, square)
    return slope_z * width + height + moved + gamma(4) * np.abs(points.z)
