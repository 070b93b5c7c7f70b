"""Unit vectors and orthonormal frames, as arrays of rows.

What the lecture leaves to linear algebra: lengths of one, and two axes at right angles to a third.

References
----------
T. Duff et al., "Building an Orthonormal Basis, Revisited", Journal of Computer Graphics Techniques 6(1), 2017.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.rows import largest_column
from raytracer.arrays.types import Floats
from raytracer.lecture import cross, dot


def normalize(vectors: Floats) -> Floats:
    """v / |v| of (..., k) vectors; a vector of zeros stays zero. The largest component is divided out first, so that
    neither tiny nor huge vectors under- or overflow."""
    rows = vectors.reshape(-1, vectors.shape[-1])
    scale = largest_column(np.abs(rows))
    usual = scale > 0
    if not usual.all():
        scale[~usual] = 1.0
    unit = rows / scale[:, np.newaxis]
    size = np.sqrt(dot(unit, unit))
    if not usual.all():
        size[~usual] = 1.0
    unit /= size[:, np.newaxis]
    return unit.reshape(vectors.shape)


def _join_components(x: Floats, y: Floats, z: Floats) -> Floats:
    """Return vectors (3,) or (n, 3) of components () or (n,), component by component in memory."""
    vectors = np.empty((3, *x.shape))
    vectors[0], vectors[1], vectors[2] = x, y, z
    return vectors.T


def transform(matrix: Floats, vectors: Floats) -> Floats:
    """Return M v for each vector, (..., m); M : (m, k) float64, vectors : (..., k) float64.

    Sums have one order, the components'. NumPy's own product goes to BLAS, whose order of sums, and with it the last
    bit, differs between processors.
    """
    return np.moveaxis(np.stack([dot(vectors, row) for row in matrix]), 0, -1)


def make_frame(normals: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors, each (n, 3), that form a right-handed frame (u, v, normal) with unit normals (n, 3)."""
    u, v = _find_frame(*normals.T)
    return _join_components(*u), _join_components(*v)


def make_slanted_frame(normals: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors, each (n, 3), at right angles to unit normals (n, 3) and to each other: those of Cycles
    (util/math_float3.h, make_orthonormals), none of which lies along an axis where the normal does."""
    x, y, z = normals.T
    even = (x == y) & (x == z)
    first = np.stack([z - y, np.where(even, x + z, x - z), np.where(even, -y - x, y - x)], axis=1)
    first = normalize(first)
    return first, cross(normals, first)


_Components = tuple[Floats, Floats, Floats]


def _find_frame(x: Floats, y: Floats, z: Floats) -> tuple[_Components, _Components]:
    """Return the components of both vectors of `make_frame` for those (n,) of normals."""
    sign: Floats = np.copysign(1.0, z)
    a: Floats = -1.0 / (sign + z)
    b = x * y * a
    return (1.0 + sign * x * x * a, sign * b, -sign * x), (b, sign + y * y * a, -y)


def to_world(local: Floats, normals: Floats) -> Floats:
    """Return x u + y v + z n for local (n, 3) components in the frames of unit normals (n, 3)."""
    x, y, z = local.T
    world = np.empty((3, *z.shape))
    for total, u, v, normal in zip(world, *_find_frame(*normals.T), normals.T, strict=True):
        np.multiply(x, u, out=total)
        total += y * v
        total += z * normal
    return world.T


def reflect(outgoing: Floats, normals: Floats) -> Floats:
    """2 (o . n) n - o: the mirror image of unit directions o about unit normals n, both (n, 3) and leaving the
    surface."""
    return 2.0 * dot(outgoing, normals)[:, np.newaxis] * normals - outgoing
