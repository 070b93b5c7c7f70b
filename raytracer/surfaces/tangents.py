"""Tangents of meshes: at each corner the direction in which u grows, for normal maps.

Tangents of triangles are averaged over all corners that share position, normal and uv, weighed by angle, so that maps
that other programs have baked for the same convention fit.

References
----------
M. S. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited", 2008: the convention known as MikkTSpace.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import normalize
from raytracer.lecture import cross, dot
from raytracer.scene.shapes import Mesh


def make_tangents(mesh: Mesh, uvs: Floats, closed: bool = False) -> Floats:
    """Return (t, 3, 4) float64: the tangent of each corner in object space, unit, and the sign of the bitangent,
    sign (normal x tangent).

    Parameters
    ----------
    uvs : (v, 2) or (t, 3, 2)
    closed : True where u goes round, so that 0 and 1 are the same
    """
    corners, uv = mesh.positions[mesh.triangles], _at_corners(mesh, uvs)  # (t, 3, 3), (t, 3, 2)
    normals = _corner_normals(mesh, corners)
    edges, steps = corners[:, 1:] - corners[:, :1], uv[:, 1:] - uv[:, :1]
    if closed:
        steps[..., 0] -= np.rint(steps[..., 0])
    # p = p0 + u T + v B: T is (dv2 e1 - dv1 e2) over the signed area of the uvs.
    area = steps[:, 0, 0] * steps[:, 1, 1] - steps[:, 1, 0] * steps[:, 0, 1]
    along = steps[:, 1, 1:2] * edges[:, 0] - steps[:, 0, 1:2] * edges[:, 1]
    sign = np.where(area > 0, 1.0, -1.0)  # (t,)
    tangent = normalize(along * sign[:, np.newaxis])
    flat = _lay_flat(np.repeat(tangent[:, np.newaxis], 3, axis=1), normals) * _angles(corners, normals)[..., np.newaxis]
    shared = np.concatenate([corners, normals, uv, np.repeat(sign, 3).reshape(-1, 3, 1)], axis=2).reshape(-1, 9)
    total = normalize(_sum_shared(shared, np.where((area != 0)[:, np.newaxis, np.newaxis], flat, 0.0).reshape(-1, 3)))
    total[(total == 0).all(axis=1)] = (1.0, 0.0, 0.0)
    return np.concatenate([total, np.repeat(sign, 3)[:, np.newaxis]], axis=1).reshape(-1, 3, 4)


def _at_corners(mesh: Mesh, values: Floats) -> Floats:
    return values if values.ndim == 3 else values[mesh.triangles]


def _corner_normals(mesh: Mesh, corners: Floats) -> Floats:
    """Return (t, 3, 3) unit normals."""
    if mesh.normals is not None:
        return normalize(_at_corners(mesh, mesh.normals))
    flat = normalize(cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    return np.repeat(flat[:, np.newaxis], 3, axis=1)


def _lay_flat(vectors: Floats, normals: Floats) -> Floats:
    """Project vectors (..., 3) to the planes of unit normals; unit."""
    return normalize(vectors - dot(vectors, normals)[..., np.newaxis] * normals)


def _angles(corners: Floats, normals: Floats) -> Floats:
    """Return (t, 3) the angle of each corner, seen along its normal."""
    following = _lay_flat(np.roll(corners, -1, axis=1) - corners, normals)
    before = _lay_flat(np.roll(corners, 1, axis=1) - corners, normals)
    return np.arccos(np.clip(dot(following, before), -1.0, 1.0))


def _sum_shared(keys: Floats, values: Floats) -> Floats:
    """Return, for each row of `values` (c, 3), the sum of all rows with the same key (c, k)."""
    rows = np.ascontiguousarray(keys + 0.0).view(np.dtype((np.void, keys.dtype.itemsize * keys.shape[1])))
    _, group = np.unique(rows.ravel(), return_inverse=True)
    group = group.ravel()
    sums = np.stack([np.bincount(group, weights=values[:, axis]) for axis in range(3)], axis=1)
    return sums.astype(np.float64)[group]
