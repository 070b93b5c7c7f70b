"""Which primitives does a ray hit first? Decided in integers, so that neither side of a comparison has the last word.

Only triangles that float64 cannot rule out with certainty reach the exact test. The truth is the closed-set one: a ray
through an edge hits both triangles, so several primitives may be first. Imports NumPy and `raytracer`.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from raytracer import exact, predicates
from raytracer.accelerate.geometry import Geometry, instance_corners

Floats = NDArray[np.float64]
Primitive = tuple[int, int]  # (instance, triangle)

# World-space triangles of so many instances are kept for the next ray.
KEPT_INSTANCES = 64
# A slab test in float64 rounds a handful of times; boxes grow by far more than that, relative to their coordinates.
BOX_MARGIN = predicates.gamma(1024)


class Judge:
    """Decides the first hits of single rays on the triangles of a scene; spheres are not considered."""

    def __init__(self, geometry: Geometry) -> None:
        self.corners = lru_cache(KEPT_INSTANCES)(lambda instance: instance_corners(geometry, instance))
        self.lower, self.upper = _measure_boxes(geometry)

    def find_first(self, origin: Floats, direction: Floats) -> frozenset[Primitive]:
        """Return all (instance, triangle) that the ray hits at its smallest t >= 0; empty = it hits nothing."""
        candidates = [
            (int(instance), int(triangle))
            for instance in np.flatnonzero(self._reach_boxes(origin, direction))
            for triangle in find_possible(self.corners(int(instance)), origin, direction)
        ]
        if not candidates:
            return frozenset()
        triangles = np.stack([self.corners(instance)[triangle] for instance, triangle in candidates])
        return frozenset(candidates[index] for index in find_first_exactly(triangles, origin, direction))

    def _reach_boxes(self, origin: Floats, direction: Floats) -> NDArray[np.bool_]:
        """(i,) False where the ray certainly passes the instance's box."""
        with np.errstate(divide="ignore", invalid="ignore"):
            one, other = (self.lower - origin) / direction, (self.upper - origin) / direction
        near = np.fmin(one, other).max(axis=1, initial=0.0)
        far = np.fmax(one, other).min(axis=1)
        # A ray that lies in the plane of a slab gives 0 / 0: no bound from that axis (NaN compares as reached).
        return ~(near > far * (1 + BOX_MARGIN))


def _measure_boxes(geometry: Geometry) -> tuple[Floats, Floats]:
    """World-space boxes of all instances, (i, 3) each; an instance without triangles gets an empty one."""
    lower = np.full((len(geometry.instance_mesh), 3), np.inf)
    upper = -lower
    for instance in range(len(lower)):
        corners = instance_corners(geometry, instance).reshape(-1, 3)
        if len(corners):
            lower[instance], upper[instance] = corners.min(axis=0), corners.max(axis=0)
    margin = BOX_MARGIN * np.maximum(np.abs(lower), np.abs(upper))
    return lower - margin, upper + margin


def find_possible(corners: Floats, origin: Floats, direction: Floats) -> NDArray[np.intp]:
    """Return the triangles (t, 3, 3) that the line may hit: no two edge functions certainly differ in sign."""
    heading = np.broadcast_to(direction[:, None], (3, len(corners)))
    a, b, c = (np.ascontiguousarray((corners[:, corner] - origin).T) for corner in range(3))
    edges = np.stack(predicates.edge_functions(heading, a, b, c))
    errors = np.stack([predicates.edge_error(heading, *pair) for pair in ((b, c), (c, a), (a, b))])
    missed = (edges > errors).any(axis=0) & (edges < -errors).any(axis=0)
    return np.flatnonzero(~missed)


def find_first_exactly(corners: Floats, origin: Floats, direction: Floats) -> list[int]:
    """Return the indices of the triangles (k, 3, 3) that the ray hits at the smallest t >= 0, in exact arithmetic."""
    points, _ = exact.to_integers([*origin, *corners.ravel().tolist()])
    heading, _ = exact.to_integers(direction.tolist())
    vectors = [tuple(points[place : place + 3]) for place in range(0, len(points), 3)]
    first: list[int] = []
    nearest: exact.Root | None = None
    for index in range(len(corners)):
        hit = exact.intersect_triangle(vectors[0], tuple(heading), vectors[1 + 3 * index : 4 + 3 * index])  # type: ignore[arg-type]
        if hit is None or hit.t.rational < 0:
            continue
        order = -1 if nearest is None else exact.compare(hit.t, nearest)
        if order < 0:
            first, nearest = [index], hit.t
        elif order == 0:
            first.append(index)
    return first
