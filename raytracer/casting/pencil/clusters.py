"""The triangles of a scene as any pencil's rasterization takes them: shared vertices, clusters of neighbours, boxes.

A vertex belongs to six triangles on average and is projected once. Triangles are ordered along a curve through space
(G. M. Morton, "A computer oriented geodetic data base", 1966) and cut into clusters of equal size: a cluster's box is
looked at before its triangles are. Nothing here depends on the rays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats, Integers
from raytracer.casting.geometry import Geometry, transform_points
from raytracer.casting.primitives import Primitives

CLUSTER = 64
# Bits of each coordinate in a place on the curve.
CURVE_BITS = 10


@dataclass(frozen=True, eq=False)
class Clusters:
    """c clusters of triangles, and the v vertices that they use.

    vertices : (3, v) float64 planes, world, in the order of their first use
    corners : (c, 3, CLUSTER) int32, vertices of each triangle
    primitive_id : (c, CLUSTER) int32; -1 where the last cluster is filled up
    centre, half : (c, 3) float64, boxes; `half` is not less than half the size for all its rounding
    """

    vertices: Floats
    corners: Integers
    primitive_id: Integers
    centre: Floats
    half: Floats


def make_clusters(primitives: Primitives) -> Clusters:
    """Cluster all triangles; each instance must be flattened."""
    points, triangles = _gather_vertices(primitives.geometry, primitives.dtype)
    order = np.argsort(place_on_curve(points, triangles))
    missing = -len(order) % CLUSTER
    primitive_id = np.concatenate([order, np.full(missing, -1)]).astype(np.int32).reshape(-1, CLUSTER)
    rows = triangles.take(np.concatenate([order, np.repeat(order[-1:], missing)]), axis=0)
    vertices, rows = _number_by_first_use(points, rows)
    corners = np.ascontiguousarray(rows.reshape(-1, CLUSTER, 3).transpose(0, 2, 1))
    box = vertices[:, corners.reshape(-1, 3 * CLUSTER)]
    low, high = box.min(axis=2).T, box.max(axis=2).T
    # The middle is off by two roundings, half the size by one.
    half = (high - low) / 2 * (1 + 2.0**-50) + 2.0**-50 * (np.abs(low) + np.abs(high))
    return Clusters(vertices, corners, primitive_id, (low + high) / 2, half)


def _gather_vertices(geometry: Geometry, dtype: np.dtype) -> tuple[Floats, Integers]:
    """World vertices (v, 3), rounded as the precision's corners are, and triangles (t, 3) in the order of ids."""
    points, triangles, first = [np.zeros((0, 3))], [np.zeros((0, 3), np.int32)], 0
    for mesh, matrix in zip(geometry.instance_mesh, geometry.world_from_object, strict=True):
        start = geometry.mesh_first[mesh]
        rows = geometry.triangles[start : start + geometry.mesh_count[mesh]]
        if not len(rows):
            continue
        low, high = int(rows.min()), int(rows.max())
        placed = transform_points(matrix, geometry.positions[low : high + 1])
        points.append(placed.astype(dtype).astype(np.float64))
        triangles.append(rows + np.int32(first - low))
        first += len(placed)
    return np.concatenate(points), np.concatenate(triangles)


def place_on_curve(points: Floats, triangles: Integers) -> NDArray[np.int64]:
    """(t,) places of the triangles' middles on Morton's curve."""
    # An eighth of each corner, so that no sum and no difference of the largest numbers overflows.
    a, b, c = (points.take(triangles[:, corner], axis=0) / 8.0 for corner in range(3))
    middle = a + b + c
    low = middle.min(axis=0, initial=np.inf)
    size = float((middle.max(axis=0, initial=-np.inf) - low).max(initial=0.0))
    cells = ((middle - low) / (size or 1.0) * (2**CURVE_BITS - 1)).astype(np.int64)
    return _spread_bits(cells[:, 0]) | _spread_bits(cells[:, 1]) << 1 | _spread_bits(cells[:, 2]) << 2


def _spread_bits(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers of CURVE_BITS bits with two zeros between any two of them."""
    for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
        numbers = (numbers | numbers << shift) & mask
    return numbers


def _number_by_first_use(points: Floats, rows: Integers) -> tuple[Floats, Integers]:
    """Vertices as planes (3, v), in the order in which triangles use them first, and the rows that then name them."""
    flat = rows.ravel()
    first = np.zeros(len(points), np.int64)
    first[flat[::-1]] = np.arange(len(flat) - 1, -1, -1)  # the last assignment stays: the first use
    used = flat[first.take(flat) == np.arange(len(flat))]
    number = np.zeros(len(points), np.int32)
    number[used] = np.arange(len(used))
    return np.ascontiguousarray(points.take(used, axis=0).T), number.take(rows)
