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
from raytracer.lecture import dot, length


def normalize(vectors: Floats) -> Floats:
    """v / |v| of (..., k) vectors; a vector of zeros stays zero. The largest component is divided out first, so that
    neither tiny nor huge vectors under- or overflow. Column by column, which takes a third of the time."""
    rows = vectors.reshape(-1, vectors.shape[-1])
    scale = largest_column(np.abs(rows))
    positive = scale > 0
    scale[~positive] = 1.0
    unit = np.empty(rows.shape)
    for column, out in zip(rows.T, unit.T, strict=True):
        np.divide(column, scale, out=out)
    size = length(unit)
    size[~positive] = 1.0
    for column in unit.T:
        column /= size
    return unit.reshape(vectors.shape)


def transform(matrix: Floats, vectors: Floats) -> Floats:
    """Return M v for each vector, (..., m); M : (m, k) float64, vectors : (..., k) float64.

    Sums have one order, the components'. NumPy's own product goes to BLAS, whose order of sums, and with it the last
    bit, differs between processors.
    """
    return np.stack([dot(vectors, row) for row in matrix], axis=-1)


def make_frame(normals: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors, each (n, 3), that form a right-handed frame (u, v, normal) with unit normals (n, 3)."""
    x, y, z = normals[:, 0], normals[:, 1], normals[:, 2]
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    u = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1)
    v = np.stack([b, sign + y * y * a, -y], axis=1)
    return u, v


def to_world(local: Floats, normals: Floats) -> Floats:
    """Return x u + y v + z n for local (n, 3) components in the frames of unit normals (n, 3)."""
    u, v = make_frame(normals)
    return local[:, 0:1] * u + local[:, 1:2] * v + local[:, 2:3] * normals


def reflect(outgoing: Floats, normals: Floats) -> Floats:
    """2 (o . n) n - o: the mirror image of unit directions o about unit normals n, both (n, 3) and leaving the
    surface."""
    return 2.0 * dot(outgoing, normals)[:, np.newaxis] * normals - outgoing
