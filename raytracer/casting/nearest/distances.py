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
def measure_triangles(points: Floats, corners: Floats) -> Measured:
    """Return the distances of points (k, 3) from triangles, planes (3 corners, 3, k)."""
    a, b, c = relative = corners - points.T  # (3, k) each
    weights = _find_foot(a, b, c)
    offset, squared = _weigh(weights, relative)
    np.nan_to_num(squared, copy=False, nan=np.inf)
    for first, second in ((0, 1), (1, 2), (2, 0)):
        along = relative[second] - relative[first]
        step = -dot_rows(relative[first], along) / dot_rows(along, along)
        on_edge = np.zeros_like(weights)
        on_edge[second] = np.fmin(np.fmax(step, 0.0), 1.0)  # an edge without length: 0
        on_edge[first] = 1.0 - on_edge[second]
        other, length = _weigh(on_edge, relative)
        closer = length < squared
        for best, better in ((offset, other), (weights, on_edge), (squared, length)):
            np.copyto(best, better, where=closer)
    distance = np.sqrt(squared)
    error = ROUNDING * np.sqrt(np.maximum(np.maximum(dot_rows(a, a), dot_rows(b, b)), dot_rows(c, c))) + UNDERFLOW
    low = np.maximum(_bound_below(a, b, c, offset) - error, 0.0)
    return Measured(distance, low, distance + error, offset.T, np.ascontiguousarray(weights[1:].T))


def _weigh(weights: Floats, corners: Floats) -> tuple[Floats, Floats]:
    """Return the mean (3, k) of corners with weights (3, k), and its squared length (k,)."""
    mean = weights[0] * corners[0] + weights[1] * corners[1] + weights[2] * corners[2]
    return mean, dot_rows(mean, mean)


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


def _bound_below(a: Floats, b: Floats, c: Floats, offset: Floats) -> Floats:
    """Return (k,) the largest of the lower bounds that planes give, not less than 0."""
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
