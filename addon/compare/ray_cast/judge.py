"""Which primitives does a ray hit first? Decided in integers, so that neither side of a comparison has the last word.

Only triangles that float64 cannot rule out with certainty reach the exact test. The truth is the closed-set one: a ray
through an edge hits both triangles, so several primitives may be first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats, Indices
from raytracer.casting.geometry import Geometry, instance_corners, world_corners
from raytracer.predicates import exact

Primitive = tuple[int, int]  # (instance, triangle)


# Consecutive triangles of a mesh, mostly neighbours, that share one box.
BLOCK = 128


# A slab test in float64 rounds a handful of times; boxes grow by far more than that, relative to their coordinates.
UNIT = 2.0**-53


BOX_MARGIN = 1024 * UNIT


# An edge function below this may have lost terms to underflow.
UNDERFLOW = 2.0**-900


class Judge:
    """Decides the first hits of single rays on the triangles of a scene; spheres are not considered.

    instance, first, end : (b,) the triangles of each block; lower, upper : (b, 3) its box, world space
    """

    def __init__(self, geometry: Geometry) -> None:
        self.geometry = geometry
        counts = geometry.mesh_count[geometry.instance_mesh]
        blocks = -(-counts // BLOCK)
        self.instance = np.repeat(np.arange(len(counts)), blocks)
        self.first = BLOCK * (np.arange(len(self.instance)) - np.repeat(np.cumsum(blocks) - blocks, blocks))
        self.end = np.minimum(self.first + BLOCK, counts[self.instance])
        boxes = [measure_blocks(instance_corners(geometry, instance)) for instance in np.flatnonzero(counts)]
        self.lower, self.upper = np.concatenate(boxes, axis=1) if boxes else np.zeros((2, 0, 3))

    def find_first(self, origin: Floats, direction: Floats) -> frozenset[Primitive]:
        """Return all (instance, triangle) that the ray hits at its smallest t >= 0; empty = it hits nothing."""
        reached = np.flatnonzero(reach_boxes(self.lower, self.upper, origin, direction))
        if not len(reached):
            return frozenset()
        instance = np.repeat(self.instance[reached], (self.end - self.first)[reached])
        triangle = np.concatenate([np.arange(self.first[block], self.end[block]) for block in reached])
        corners = np.stack(world_corners(self.geometry, instance, triangle), axis=1)  # (k, 3 corners, 3)
        possible = find_possible(corners, origin, direction)
        first = possible[find_first_exactly(corners[possible], origin, direction)]
        return frozenset(zip(instance[first].tolist(), triangle[first].tolist(), strict=True))


def measure_blocks(corners: Floats) -> Floats:
    """Return the boxes, (2, b, 3) lower and upper, of consecutive blocks of triangles (t, 3, 3), rounded outwards."""
    starts = np.arange(0, len(corners), BLOCK)
    lower = np.minimum.reduceat(corners.min(axis=1), starts, axis=0)
    upper = np.maximum.reduceat(corners.max(axis=1), starts, axis=0)
    margin = BOX_MARGIN * np.maximum(np.abs(lower), np.abs(upper))
    return np.stack([lower - margin, upper + margin])


def reach_boxes(lower: Floats, upper: Floats, origin: Floats, direction: Floats) -> NDArray[np.bool_]:
    """Return (b,) False where the ray certainly passes a box."""
    margin = BOX_MARGIN * np.abs(origin)
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (lower - margin - origin) / direction, (upper + margin - origin) / direction
    near = np.fmin(one, other).max(axis=1, initial=0.0)
    far = np.fmax(one, other).min(axis=1)
    # A ray that lies in the plane of a slab gives 0 / 0: no bound from that axis (NaN compares as reached).
    return ~(near > far * (1 + BOX_MARGIN))


def find_possible(corners: Floats, origin: Floats, direction: Floats) -> Indices:
    """Return the triangles (t, 3, 3) that the line may hit: no two edge functions certainly differ in sign.

    The edge function of corners p and q relative to the origin is E = d . (p x q); each of its terms carries less than
    8 roundings, so it is off by less than 16 u times the sum of its terms' absolute values.
    """
    relative = corners - origin
    signs = []
    for one, other in ((1, 2), (2, 0), (0, 1)):
        p, q = relative[:, one], relative[:, other]
        edge = np.cross(p, q) @ direction
        shifted = (np.roll(np.abs(p), -k, axis=1) * np.roll(np.abs(q), -j, axis=1) for k, j in ((1, 2), (2, 1)))
        error = 16 * UNIT * (sum(shifted) @ np.abs(direction)) + UNDERFLOW
        signs.append(np.where(np.abs(edge) > error, np.sign(edge), 0))
    return np.flatnonzero(~((np.max(signs, axis=0) > 0) & (np.min(signs, axis=0) < 0)))


def find_first_exactly(corners: Floats, origin: Floats, direction: Floats) -> Indices:
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
    return np.array(first, dtype=np.intp)
