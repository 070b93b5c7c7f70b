"""The primitives of a scene as a view sees them: boxes on its image, and rows for the float32 test of `projection`.

Of a triangle with projected corners h (`pencil`), the edge functions of image point (x, y) are E_i = n_i . (x, y, 1)
and the nearness where the ray meets its plane is q = g . (x, y, 1), with

    n_a = h_b x h_c,  n_b = h_c x h_a,  n_c = h_a x h_b,  D = h_a . n_a
    g = (n_a + n_b + n_c) / D, or where rays are parallel -(n_a z_a + n_b z_b + n_c z_c) / D

Up to the sign of D these are the lecture's determinants, and they hold also for triangles that cross the plane of the
point. With S >= |h| of all corners float64 is off by gamma(6) S in h, gamma(30) S^2 in n and gamma(200) S^3 in D; what
that does to E and q is added to the tolerance of float32.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats
from raytracer.casting.geometry import Ids
from raytracer.casting.pencil.pencil import View
from raytracer.casting.primitives import Primitives, find_rows, name_rows
from raytracer.predicates.rounding import UNIT_ROUNDOFF, gamma

# E of float32 numbers has 5 roundings, 5 * 2^-24 (|n_x| + |n_y| + |n_z|) for |x|, |y| <= 1: less than 2^-20 with the
# largest component of n scaled to 1; the ray's own place is known to 2^-22 (`pencil`).
TOLERANCE = 2.0**-19
# A corner is before or behind the plane of the point if its h_z is beyond this share of S.
BEFORE = 2.0**-24
# Boxes are widened by more than the roundings of image points, 2^-24 of the ray's and 2^-22 of its place.
PAD = 2.0**-20
# Triangles projected at a time: what they need fits the cache.
PROJECT_BLOCK = 8192
# Columns of `Projection.image`, and what it is for items that may be anywhere.
IMAGE_COLUMNS = 6
LOW, HIGH, LEAST, MOST = 0, 2, 4, 5
WHOLE_IMAGE = np.array([-np.inf, -np.inf, np.inf, np.inf, -np.inf, np.inf])[:, np.newaxis]
# Columns of a row: n of the three edges, g, tolerance of E and of q, the least and the largest nearness of any corner.
ROW_COLUMNS = 16
GRADIENT, EDGE_TOLERANCE, NEAR_TOLERANCE, ROW_LEAST, ROW_MOST = 9, 12, 13, 14, 15
# Gradients beyond this leave float32's range when multiplied out.
LARGEST_GRADIENT = 2.0**60


class Projection(NamedTuple):
    """The primitives of a scene as a view sees them; those that it cannot see are left out. k of them:

    primitive_id : (k,)
    image : (k, 6) float32, see LOW, HIGH, LEAST, MOST: box on the image, widened, and bounds on the corners' nearness;
        infinite where the primitive crosses the plane of the point. LEAST is -inf where nothing but the box and MOST is
        known (spheres, what is too near to an arriving pencil's point)
    """

    primitive_id: Ids
    image: NDArray[np.float32]


@np.errstate(all="ignore")
def project(view: View, primitives: Primitives) -> Projection:
    """Project all flattened triangles and all spheres."""
    blocks = [(np.zeros(0, np.int64), np.zeros((0, IMAGE_COLUMNS), np.float32))]
    for start in range(0, len(primitives.corners), PROJECT_BLOCK):
        index, image = _project_triangles(view, primitives.corners[start : start + PROJECT_BLOCK])
        blocks.append((name_rows(primitives, index + start), image))
    if len(primitives.geometry.radii):
        blocks.append(_project_spheres(view, primitives))
    return Projection(*(np.concatenate(column) for column in zip(*blocks, strict=True)))


def _map_corners(view: View, corners: Floats) -> tuple[Floats, Floats, Floats]:
    """Corners (c, 3, b) relative to the point, their h (3, c, b), and S (b,), at least their size, 1 where parallel."""
    relative = corners - view.centre[:, np.newaxis]
    x, y, z = relative[:, 0], relative[:, 1], relative[:, 2]
    mapped = np.empty((3, *x.shape))
    for row, out in zip(view.matrix, mapped, strict=True):
        np.add(row[0] * x + row[1] * y, row[2] * z, out=out)
    sizes = np.abs(x) + np.abs(y) + np.abs(z)
    return relative, mapped, np.abs(view.matrix).max() * sizes.max(axis=0) + (1.0 if view.pencil.parallel else 0.0)


def _bound_image(view: View, mapped: Floats, size: Floats) -> tuple[Floats, Booleans]:
    """The columns of `Projection.image` as planes (6, b), of items whose corners are `mapped`, and which are seen.

    Float32 rounds what lies on the image by less than PAD; beyond it, that does not matter.
    """
    x, y, z = mapped
    image = np.empty((IMAGE_COLUMNS, len(size)))
    if view.pencil.parallel:
        nearness, slack, behind, straddles = -z, PAD * (1.0 + np.abs(z).max(axis=0)), np.zeros(len(size), bool), None
    else:
        nearest, farthest = z.min(axis=0), z.max(axis=0)
        nearness, behind = 1.0 / z, farthest < -BEFORE * size
        slack = PAD * np.abs(nearness).max(axis=0)
        straddles = np.flatnonzero(~(nearest > BEFORE * size) & ~behind)
        behind[straddles] = _is_beside(mapped[:, :, straddles], size[straddles])
        x, y = x * nearness, y * nearness
    for axis, coordinate in enumerate((x, y)):
        image[LOW + axis] = coordinate.min(axis=0) - PAD
        image[HIGH + axis] = coordinate.max(axis=0) + PAD
    image[LEAST], image[MOST] = nearness.min(axis=0) - slack, nearness.max(axis=0) + slack
    if straddles is not None:
        image[LOW:HIGH, straddles], image[HIGH:LEAST, straddles] = -np.inf, np.inf
        image[LEAST, straddles], image[MOST, straddles] = 0.0, np.inf
    seen = ~behind & (image[LOW:HIGH] <= 1.0).all(axis=0) & (image[HIGH:LEAST] >= -1.0).all(axis=0)
    return image, seen


def _is_beside(mapped: Floats, size: Floats) -> Booleans:
    """(b,) True for items wholly beyond one side |x| = z or |y| = z of the pyramid of rays."""
    x, y, z = mapped
    beside = np.zeros(len(size), bool)
    for side in (x, -x, y, -y):
        beside |= (side - z).min(axis=0) > 4 * PAD * size
    return beside


def _project_triangles(view: View, corners: NDArray) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Which of the triangles (b, 9) are seen, and their rows of `Projection.image`."""
    planes = np.ascontiguousarray(corners.T, np.float64).reshape(3, 3, -1)
    relative, mapped, size = _map_corners(view, planes)
    image, seen = _bound_image(view, mapped, size)
    if view.blurred:
        # |p - c| <= |A^-1| h, twice for the roundings of both.
        radius = 2.0 * view.blurred * np.abs(np.linalg.inv(view.matrix)).sum(axis=1).max()
        near = (relative.min(axis=0) <= radius).all(axis=0) & (relative.max(axis=0) >= -radius).all(axis=0)
        image[:, near] = WHOLE_IMAGE
        seen |= near
    index = np.flatnonzero(seen)
    return index, image[:, index].T.astype(np.float32)


def _project_spheres(view: View, primitives: Primitives) -> tuple[Ids, NDArray[np.float32]]:
    """Spheres as the corners of their boxes, a few roundings wider: no point of one is nearer than any corner."""
    geometry = primitives.geometry
    reach = geometry.radii * (1 + 4 * UNIT_ROUNDOFF) + 4 * UNIT_ROUNDOFF * np.abs(geometry.centres).max(axis=1)
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    corners = geometry.centres.T + signs[:, :, np.newaxis] * reach
    _, mapped, size = _map_corners(view, corners)
    image, seen = _bound_image(view, mapped, size)
    image[LEAST] = -np.inf
    around = (np.abs(geometry.centres - view.centre) <= 2 * reach[:, np.newaxis]).all(axis=1)
    image[:, around] = WHOLE_IMAGE
    index = np.flatnonzero(seen | around)
    return geometry.sphere_id + index, image[:, index].T.astype(np.float32)


@np.errstate(all="ignore")
def make_rows(view: View, primitives: Primitives, primitive_id: Ids, image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (k, 16) rows of primitives of a Projection; where nothing is known, all tolerances are infinite."""
    rows = np.zeros((ROW_COLUMNS, len(image)))
    shut = np.flatnonzero(image[:, LEAST] > -np.inf)
    if len(shut):
        corners = primitives.corners.take(find_rows(primitives, primitive_id[shut]), axis=0)
        rows[:, shut] = _make_row_planes(view, np.ascontiguousarray(corners.T, np.float64).reshape(3, 3, -1))
    rows[ROW_LEAST:] = image[:, LEAST:].T
    unknown = np.flatnonzero((image[:, LEAST] == -np.inf) | ~np.isfinite(rows[:NEAR_TOLERANCE]).all(axis=0))
    rows[:EDGE_TOLERANCE, unknown], rows[EDGE_TOLERANCE:ROW_LEAST, unknown] = 0.0, np.inf
    return rows.T.astype(np.float32)


def _make_row_planes(view: View, corners: Floats) -> Floats:
    """The first 14 columns of the rows of triangles with corners (3, 3, b), as planes (16, b)."""
    _, mapped, size = _map_corners(view, corners)
    depth = mapped[2].copy()
    if view.pencil.parallel:
        mapped[2] = 1.0
    a, b, c = (mapped[:, k] for k in range(3))
    normals = [_cross(b, c), _cross(c, a), _cross(a, b)]
    normal_error = gamma(30) * size * size
    determinant = (a * normals[0]).sum(axis=0)
    determinant_error = gamma(200) * size**3
    sign = np.sign(determinant)
    room = np.abs(determinant) - determinant_error
    if view.pencil.parallel:
        gradient = -(normals[0] * depth[0] + normals[1] * depth[1] + normals[2] * depth[2]) / determinant
        gradient_error = gamma(150) * size**3 / room
    else:
        gradient = (normals[0] + normals[1] + normals[2]) / determinant
        gradient_error = 3 * normal_error / room
    steepness = np.abs(gradient).sum(axis=0)
    rows = np.empty((ROW_COLUMNS, len(size)))
    largest = np.zeros(len(size))
    for edge, normal in enumerate(normals):
        extent = np.abs(normal).max(axis=0)
        rows[3 * edge : 3 * edge + 3] = normal * (sign / extent)
        largest = np.maximum(largest, 1.0 / extent)
    rows[GRADIENT:EDGE_TOLERANCE] = gradient
    rows[EDGE_TOLERANCE] = TOLERANCE + 4 * normal_error * largest
    rows[NEAR_TOLERANCE] = TOLERANCE * steepness + 4 * (gradient_error + steepness * (determinant_error / room))
    flat = ~((steepness < LARGEST_GRADIENT) & (room > 0))
    rows[GRADIENT:EDGE_TOLERANCE, flat], rows[NEAR_TOLERANCE, flat] = 0.0, np.inf
    rows[EDGE_TOLERANCE, ~(room > 0)] = np.inf
    return rows


def _cross(p: Floats, q: Floats) -> Floats:
    return np.stack([p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]])
