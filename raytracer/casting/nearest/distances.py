"""The distance of a point from a triangle or a sphere, with certified bounds.

The closest point of a triangle lies in its inside, where the foot of the perpendicular does, or on an edge; each is
computed as a weighted mean of corners, and the closest of the four is taken. Whatever rounding did to its weights, such
a point is one of the triangle: the true distance D is at most its distance. From below D is bounded by planes: all of
the triangle lies on the far side of a plane whose normal n points at it,

    D >= min_i n . (v_i - p) / |n|     for any n,

for n towards the closest point, and for both normals of the triangle. So the interval holds D however badly shaped the
triangle is, and is wide only where the point found is bad.

Rounding: corners relative to the point are off by u of themselves; a weighted mean of them by 7 more, a length by 4;
a product n . v by 4 |n| |v| each way: ROUNDING of the farthest corner covers each.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.predicates.rounding import gamma

ROUNDING = 2 * gamma(16)
# Squares of lengths below it underflow: such lengths may be off by all of themselves.
UNDERFLOW = 2.0**-500


class Measured(NamedTuple):
    """Of k points and shapes.

    distance : (k,) metres; low, high : (k,) certified bounds of the exact distance
    offset : (k, 3) from the point to the closest point of the shape
    weights : (k, 2) barycentric weights of corners 1 and 2; 0 for spheres
    """

    distance: Floats
    low: Floats
    high: Floats
    offset: Floats
    weights: Floats


def dot_rows(one: Floats, other: Floats) -> Floats:
    """(k,) of planes (3, k)."""
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


@np.errstate(divide="ignore", invalid="ignore")
def measure_triangles(points: Floats, corners: tuple[Floats, Floats, Floats]) -> Measured:
    """Return the distances of points (k, 3) from triangles with corners (k, 3) each."""
    a, b, c = (np.ascontiguousarray((corner - points).T) for corner in corners)  # (3, k), relative to the point
    found = [_find_foot(a, b, c)]
    for first, second, places in ((a, b, (0, 1)), (b, c, (1, 2)), (c, a, (2, 0))):
        along = second - first
        step = np.nan_to_num(np.clip(-dot_rows(first, along) / dot_rows(along, along), 0.0, 1.0))
        weights = np.zeros((3, len(points)))
        weights[places[0]], weights[places[1]] = 1.0 - step, step
        found.append(weights)
    offsets = [weights[0] * a + weights[1] * b + weights[2] * c for weights in found]
    squared = np.stack([dot_rows(offset, offset) for offset in offsets])
    squared[0][np.isnan(squared[0])] = np.inf
    best = squared.argmin(axis=0)
    offset, weights = np.choose(best, offsets), np.choose(best, found)
    distance = np.sqrt(dot_rows(offset, offset))
    size = np.sqrt(np.maximum(np.maximum(dot_rows(a, a), dot_rows(b, b)), dot_rows(c, c)))
    low = _bound_below((a, b, c), offset)
    error = ROUNDING * size + UNDERFLOW
    return Measured(
        distance, np.maximum(low - error, 0.0), distance + error, offset.T, np.ascontiguousarray(weights[1:].T)
    )


def _cross_rows(one: Floats, other: Floats) -> Floats:
    return np.stack(
        [
            one[1] * other[2] - one[2] * other[1],
            one[2] * other[0] - one[0] * other[2],
            one[0] * other[1] - one[1] * other[0],
        ]
    )


def _find_foot(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return the weights (3, k) of the foot of the perpendicular from 0; NaN where it is outside of the triangle."""
    normal = _cross_rows(b - a, c - a)
    areas = np.stack([dot_rows(normal, _cross_rows(p, q)) for p, q in ((b, c), (c, a), (a, b))])
    weights = areas / areas.sum(axis=0)
    weights[:, ~(weights >= 0).all(axis=0)] = np.nan
    return weights


def _bound_below(corners: tuple[Floats, Floats, Floats], offset: Floats) -> Floats:
    """Return (k,) the largest of the lower bounds that planes give, not less than 0."""
    a, b, c = corners
    low = np.zeros(offset.shape[1])
    normal = _cross_rows(b - a, c - a)
    for direction in (offset, normal, -normal):
        reach = np.minimum(np.minimum(dot_rows(direction, a), dot_rows(direction, b)), dot_rows(direction, c))
        low = np.fmax(low, reach / np.sqrt(dot_rows(direction, direction)))
    return low


def measure_spheres(points: Floats, centres: Floats, radii: Floats) -> Measured:
    """Return the distances of points (k, 3) from the surfaces of spheres, centres (k, 3) and radii (k,)."""
    outward = points - centres
    away = np.sqrt(dot_rows(outward.T, outward.T))
    unit = np.where(away[:, np.newaxis] > 0, outward / np.where(away > 0, away, 1.0)[:, np.newaxis], (0.0, 0.0, 1.0))
    distance, error = np.abs(away - radii), ROUNDING * (away + radii) + UNDERFLOW
    offset = (radii - away)[:, np.newaxis] * unit
    return Measured(distance, np.maximum(distance - error, 0.0), distance + error, offset, np.zeros((len(points), 2)))
