"""The lecture's formulas as peers, by brute force: what each loses in float64 and float32, without any accelerator.

Triangles: Cramer's rule. Spheres: the discriminant as schoolbooks print it, and the lecture's point-line distance.
Plain formulas promise nothing among equal distances; here the lowest index wins, as a loop over primitives gives.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from raytracer import lecture
from tests.benchmarks.peers import Answer, Built, Peer

CRAMER_64, CRAMER_32 = "lecture: Cramer, float64", "lecture: Cramer, float32"
# Every ray meets every triangle: about 0.2 microseconds per pair.
RAY_LIMIT = 4096
PAIRS_PER_BLOCK = 1 << 15


def make_cramer(name):
    """Cramer's rule in the precision that the name ends with."""
    dtype = np.dtype(name.split()[-1])
    return Peer(name, f"NumPy {np.__version__}", partial(build_cramer, dtype), RAY_LIMIT)


def build_cramer(dtype, positions, triangles):
    """Brute force over the mesh's triangles, all arithmetic in `dtype`."""
    corners = positions[triangles].astype(dtype)

    def prepare(origins, directions, reach):
        return origins.astype(dtype), directions.astype(dtype)

    def cast(rays):
        step = max(1, PAIRS_PER_BLOCK // max(1, len(corners)))
        starts = range(0, len(rays[0]), step)
        return [
            intersect_all(rays[0][start : start + step], rays[1][start : start + step], corners) for start in starts
        ]

    def read(found):
        t, primitive = (np.concatenate(column) for column in zip(*found, strict=True))
        return Answer(t.astype(np.float64), primitive)

    return Built(prepare, cast, read)


def intersect_all(origins, directions, corners):
    """Return the smallest t, (n,), and the first triangle with it, of rays (n, 3) against all triangles (t, 3, 3)."""
    intersect = lecture_t if corners.dtype == np.float64 else cramer_t
    distance = intersect(origins[:, None], directions[:, None], *np.moveaxis(corners, 1, 0)[:, None])  # (n, t)
    distance = np.where(np.isnan(distance), np.inf, distance)
    primitive = distance.argmin(axis=1)
    t = distance[np.arange(len(origins)), primitive]
    return t, np.where(np.isfinite(t), primitive, -1)


def lecture_t(origins, directions, a, b, c):
    """t by the lecture's own function; NaN for a miss."""
    return lecture.intersect_triangle(origins, directions, a, b, c).t


def determinant(first, second, third):
    """Sarrus' rule on three columns, each a tuple of planes, in their dtype and the lecture's order of operations."""
    (a, d, g), (b, e, h), (c, f, i) = first, second, third
    return (a * e * i + b * f * g + c * d * h) - (c * e * g + b * d * i + a * f * h)


def cramer_t(origins, directions, a, b, c):
    """`lecture.intersect_triangle` in the arrays' own dtype, which `lecture` would widen to float64."""
    edge_b, edge_c, heading, rhs = (
        tuple(np.moveaxis(vectors, -1, 0)) for vectors in (a - b, a - c, directions, a - origins)
    )
    with np.errstate(all="ignore"):
        whole = determinant(edge_b, edge_c, heading)
        beta = determinant(rhs, edge_c, heading) / whole
        gamma = determinant(edge_b, rhs, heading) / whole
        t = determinant(edge_b, edge_c, rhs) / whole
        hit = (whole != 0) & (beta >= 0) & (gamma >= 0) & (beta + gamma <= 1) & (t >= 0)
    return np.where(hit, t, np.nan)


def first_root(roots):
    """Return the smallest root that is not negative, (n,), infinity where there is none."""
    with np.errstate(invalid="ignore"):
        return np.where(roots >= 0, roots, np.inf).min(axis=-1)


def sphere_by_discriminant(dtype, origins, directions, centre, radius):
    """The schoolbook: D = b^2 - 4 a c, t = (-b -+ sqrt(D)) / (2 a), everything in `dtype`."""
    origins, directions, centre = (array.astype(dtype) for array in (origins, directions, centre))
    offset, radius = origins - centre, dtype(radius)
    a = (directions * directions).sum(axis=1)
    b = 2 * (offset * directions).sum(axis=1)
    c = (offset * offset).sum(axis=1) - radius * radius
    with np.errstate(all="ignore"):
        root = np.sqrt(b * b - 4 * a * c)
        return first_root(np.stack([(-b - root) / (2 * a), (-b + root) / (2 * a)], axis=-1))


def sphere_by_distance(origins, directions, centre, radius):
    """The lecture: the sphere is hit where its centre is within the radius of the line."""
    return first_root(lecture.intersect_sphere(origins, directions, centre, radius))


SPHERE_FORMULAS = {
    "lecture: point-line distance, float64": sphere_by_distance,
    "schoolbook discriminant, float64": partial(sphere_by_discriminant, np.float64),
    "schoolbook discriminant, float32": partial(sphere_by_discriminant, np.float32),
}
PEERS = dict.fromkeys((CRAMER_64, CRAMER_32), make_cramer)
