"""Pointiness: how much the surface of a mesh sticks out at each vertex, from the angles of its edges.

References
----------
Blender, intern/cycles/blender/mesh.cpp, attr_create_pointiness.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.vectors import normalize
from raytracer.lecture import dot

from .meshes import read_array

# Vertices are at one place whose distance, squared, is less than the first, and the sums of whose coordinates differ by
# no more than the second.
EPSILON = float(np.finfo(np.float32).eps)
SUM_TOLERANCE = 3.0 * EPSILON


def read_pointiness(mesh: Any) -> NDArray[np.float32]:
    """Return (v, 1) from 0 in a pit to 1 on a needle, 1/2 on what is flat.

    The angle between the normal and the mean direction of the edges, over pi; then the mean of a vertex and those that
    edges join to it. Vertices at one place count as one.
    """
    positions = read_array(mesh.vertices, "co", np.float32, 3)
    normals = read_array(mesh.vertex_normals, "vector", np.float32, 3).astype(np.float64)
    first, place = np.unique(find_first_doubles(positions), return_inverse=True)
    normals = sum_rows(normals, place, len(first))
    return measure_pointiness(positions[first].astype(np.float64), normals, find_edges(mesh, place))[place]


def find_first_doubles(positions: NDArray[np.float32]) -> NDArray[np.intp]:
    """Return (v,) one vertex, the same for all that are at one place.

    In the order of the sums of coordinates each points to the next at its place; the last of such a chain counts.
    """
    sums = positions.sum(axis=1, dtype=np.float32)
    order = np.lexsort((-np.arange(len(sums)), sums))
    ordered, sums = positions[order], sums[order]
    following = np.arange(len(order))
    waiting = following[:-1]
    step = 1
    while len(waiting):
        waiting = waiting[waiting + step < len(order)]
        waiting = waiting[sums[waiting + step] - sums[waiting] <= SUM_TOLERANCE]
        offset = ordered[waiting + step] - ordered[waiting]
        doubled = dot(offset, offset) < EPSILON
        following[waiting[doubled]] = waiting[doubled] + step
        waiting, step = waiting[~doubled], step + 1
    while (following != following[following]).any():
        following = following[following]
    found = np.empty_like(following)
    found[order] = order[following]
    return found


def find_edges(mesh: Any, vertex: NDArray[Any]) -> NDArray[Any]:
    """Return (e, 2) which of the places that vertices (v,) are at are joined, each pair once."""
    edges: NDArray[np.intc] = np.empty(2 * len(mesh.edges), dtype=np.intc)
    mesh.edges.foreach_get("vertices", edges)
    return np.unique(np.sort(vertex[edges.reshape(-1, 2)], axis=1), axis=0)


def measure_pointiness(
    positions: NDArray[np.float64], normals: NDArray[np.float64], edges: NDArray[Any]
) -> NDArray[np.float32]:
    """Return (p, 1) of places (p, 3) with normals (p, 3) of any length and edges (e, 2)."""
    count, (first, second) = len(positions), edges.T
    direction = normalize(positions[second] - positions[first])
    ends, joined = np.concatenate([first, second]), np.concatenate([second, first])
    degree = np.bincount(ends, minlength=count)
    mean = sum_rows(np.concatenate([direction, -direction]), ends, count) / np.maximum(degree, 1)[:, np.newaxis]
    angle = np.arccos(np.clip(dot(normalize(normals), mean), -1.0, 1.0)) / np.pi
    raw = np.where(degree > 0, angle, 0.0)
    blurred = (raw + np.bincount(ends, raw[joined], minlength=count)) / (degree + 1)
    return blurred[:, np.newaxis].astype(np.float32)


def sum_rows(values: NDArray[np.float64], rows: NDArray[Any], count: int) -> NDArray[np.float64]:
    """Return (count, 3) the sums of values (n, 3) that belong to rows (n,)."""
    return np.stack([np.bincount(rows, column, minlength=count) for column in values.T], axis=1)
