"""Triangles on the image as linear functions over small patches of cells, with what float32 may get wrong.

With x, y counted from a base cell near by, so that numbers are small, a triangle with image points P, Q, R has

    E(P, Q) = P_x Q_y - P_y Q_x + x (P_y - Q_y) + y (Q_x - P_x)

and E_a, E_b, E_c likewise: positive inside, for one of the two orientations. Their sum S is twice the area, and the
nearness where a ray meets the triangle's plane is w = w_min + (E_a (w_a - w_min) + ...) / S. An *item* is one triangle
over one patch: four functions c + x c_x + y c_y, and bounds.

Small triangles (`set_up_small`) are float32 throughout. v = 2^-24; B bounds the local coordinates of corners and rays;
a corner's image point is off by alpha, a ray's by rho. Rounded again when the base is taken off, they are off by
delta = alpha + v B and rho + v B. E is linear in each of its points, with factors of at most 2 B a coordinate:

    corners      2 points, 2 coordinates, 2 B each                              8 B delta
    ray          (rho + v B) (|c_x| + |c_y|) <= 4 B (rho + v B)
    c            two products of B^2 and their difference                       4 v B^2
    x c_x        c_x rounds, the product rounds, 2 B^2 each; y c_y likewise     8 v B^2
    two sums     of 4 B^2 and of 6 B^2                                         10 v B^2
    strips       tol is added to c first, which rounds as c does                 2 v B^2

    error of E  <=  tol  =  8 B alpha + 4 B rho + 36 v B^2          (in any order, with fused products or without)

S, a sum of three c, is off by 12 B delta + 22 v B^2 < 2 tol. Where |S| <= 2 tol even its sign is unknown: of a ray
inside, no |E| is larger than |S| then, and tolerances are taken four times as wide.
With d = max w - min w, nearness is off by 3 tol d / S for the E, 2 tol d / S for S, and where it is evaluated by eight
roundings of three terms of at most 6 B^2 d / S each, 144 v B^2 d / S < 5 tol d / S:

    error of w  <=  10 tol d / (S - 2 tol) + 8 v max w,      and always  min w <= w <= max w

Large triangles and those that cross the plane of the point (`span_large`, `set_up_tiles`) are float64 until the base
is taken off (E. Catmull's and J. Blinn's homogeneous coordinates; M. Olano and T. Greer, "Triangle scan conversion
using 2D homogeneous coordinates", 1997): see there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.predicates import filtered
from raytracer.predicates.rounding import gamma

FLOAT32_ROUNDOFF = 2.0**-24
# Of an item's functions, the number of edges comes before nearness.
EDGES, FUNCTIONS = 3, 4
# Rows of items: the functions' constants, slopes along x and along y; then bounds.
CONSTANT, SLOPE_X, SLOPE_Y, TOLERANCE, NEAR_ERROR, LEAST, MOST, ROWS = 0, 4, 8, 12, 13, 14, 15, 16
# What is left of second order, and the roundings of the bounds themselves.
MARGIN = 1 + 2.0**-10
# Factors of the bounds above.
CORNER_SHARE, RAY_SHARE, ROUNDING_SHARE, NEAR_SHARE = 8.0, 4.0, 36.0, 10.0
# The edge opposite corner i runs from corner FIRST[i] to corner SECOND[i].
FIRST, SECOND = (1, 2, 0), (2, 0, 1)
# A corner is before or behind the plane of the point if its h_z is beyond this share of |A_z| |p - c|, |.| summed.
BEFORE = 2.0**-22
LEAST_AREA = np.float32(2.0**-100)


class Items(NamedTuple):
    """n triangles over patches of cells.

    rows : (16, n) float32; base : (2, n) float32, the point that x and y count from
    """

    rows: NDArray[np.float32]
    base: NDArray[np.float32]


class Image(NamedTuple):
    """How exact the image is.

    ray_error : rho, cells; corner_error : alpha over the corner's largest coordinate, and its least value
    """

    ray_error: float
    corner_share: float
    corner_error: float


def judge_image(matrix: Floats, ray_error: float) -> Image:
    """How exact image points of vertices are, rounded to float32.

    h_i is off by gamma(5) |A_i| |p - c|, and h_z >= BEFORE |A_z| |p - c|: with K = max |A_x, A_y| / max |A_z|,
    x = h_x / h_z is off by less than 2^-28 (K + |x|), and v |x| when it is rounded.
    """
    largest = np.abs(matrix).max(axis=1)
    share = (gamma(5) + gamma(3)) / BEFORE
    return Image(ray_error, FLOAT32_ROUNDOFF + share, share * float(largest[:2].max() / largest[2]))


def set_up_small(
    corners: NDArray[np.float32],
    base: NDArray[np.float32],
    reach: NDArray[np.float32],
    image: Image,
    rows: NDArray[np.float32],
) -> None:
    """Fill in the (16, n) rows of triangles.

    corners : (3, 3, n) image points and nearness x, y, w of three corners; base : (2, n)
    reach : (n,) local coordinates of rays are at most this
    """
    x, y, w = corners[0] - base[0], corners[1] - base[1], corners[2]
    constant, slope_x, slope_y = (rows[first : first + EDGES] for first in (CONSTANT, SLOPE_X, SLOPE_Y))
    term = np.empty_like(x[0])
    for edge, (p, q) in enumerate(zip(FIRST, SECOND, strict=True)):
        np.multiply(x[p], y[q], out=constant[edge])
        constant[edge] -= np.multiply(y[p], x[q], out=term)
        np.subtract(y[p], y[q], out=slope_x[edge])
        np.subtract(x[q], x[p], out=slope_y[edge])
    area = constant[0] + constant[1]
    area += constant[2]
    edges = rows[:TOLERANCE].reshape(3, FUNCTIONS, -1)[:, :EDGES]  # nearness, the fourth, is filled in below
    edges *= np.copysign(np.float32(1), area)
    np.abs(area, out=area)
    _bound_edges(rows[TOLERANCE], x, y, base, reach, area, image)
    _set_up_nearness(rows, w, area)


def _bound_edges(
    tolerance: NDArray, x: NDArray, y: NDArray, base: NDArray, reach: NDArray, area: NDArray, image: Image
) -> None:
    """Fill in the tolerance of E, see above; x and y (3, n) are used up."""
    np.maximum(np.abs(x, out=x), np.abs(y, out=y), out=x)
    size = np.maximum(np.maximum(x[0], x[1]), x[2])
    np.maximum(size, reach, out=size)
    # Corners and rays: alpha <= corner_share (|base| + B) + corner_error.
    np.maximum(np.abs(base[0]), np.abs(base[1]), out=tolerance)
    tolerance += size
    tolerance *= np.float32(CORNER_SHARE * MARGIN * image.corner_share)
    tolerance += np.float32(MARGIN * (CORNER_SHARE * image.corner_error + RAY_SHARE * image.ray_error))
    tolerance += size * np.float32(ROUNDING_SHARE * MARGIN * FLOAT32_ROUNDOFF)
    tolerance *= size
    flat = np.flatnonzero(area <= 2 * tolerance)
    tolerance[flat] *= 4


def _set_up_nearness(rows: NDArray[np.float32], w: NDArray[np.float32], area: NDArray[np.float32]) -> None:
    """Fill in the function of nearness and its bounds."""
    least, most, error = rows[LEAST], rows[MOST], rows[NEAR_ERROR]
    np.minimum(np.minimum(w[0], w[1]), w[2], out=least)
    np.maximum(np.maximum(w[0], w[1]), w[2], out=most)
    room = area - 2 * rows[TOLERANCE]
    np.maximum(room, LEAST_AREA, out=room)
    np.subtract(most, least, out=error)
    error *= rows[TOLERANCE]
    error *= np.float32(NEAR_SHARE * MARGIN)
    error /= room
    error += most * np.float32(8 * FLOAT32_ROUNDOFF)
    share = w - least
    share /= np.maximum(area, LEAST_AREA, out=area)
    for first in (CONSTANT, SLOPE_X, SLOPE_Y):
        near = rows[first + EDGES]
        np.multiply(rows[first], share[0], out=near)
        for edge in (1, 2):
            near += rows[first + edge] * share[edge]
    rows[CONSTANT + EDGES] += least
    least *= np.float32(1 - 4 * FLOAT32_ROUNDOFF)
    most *= np.float32(1 + 4 * FLOAT32_ROUNDOFF)


class Large(NamedTuple):
    """k triangles as functions of the whole image, float64.

    functions : (4, 3, k) edges, then nearness; each is f . (x, y, 1)
    edge_error : (k,) what float64 leaves of E, for every ray; near_error : of nearness
    least, most : (k,) nearness of the corners
    """

    functions: Floats
    edge_error: Floats
    near_error: Floats
    least: Floats
    most: Floats


@np.errstate(all="ignore")
def span_large(matrix: Floats, relative: Floats, size: float) -> Large:
    """Functions of triangles wherever they lie.

    With corners h = A (p - c) the edge functions of image point (x, y) are E_i = n_i . (x, y, 1), nearness is
    g . (x, y, 1) with g = (n_a + n_b + n_c) / D, as in `projection`; S >= |h|, so n is off by gamma(30) S^2, D by
    gamma(200) S^3. Edges are scaled to |n_x| + |n_y| + |n_z| / size = 1: about cells from the edge. Where the sign of D
    is unknown, so is all.

    relative : (3 coordinates, 3 corners, k) float64, p - c; size : no |x| or |y| of a ray is larger
    """
    mapped = np.einsum("ij,jck->ick", matrix, relative)
    scale = np.abs(matrix).max() * np.abs(relative).sum(axis=0).max(axis=0)
    a, b, c = (mapped[:, corner] for corner in range(3))
    normals = np.stack([filtered.cross(b, c), filtered.cross(c, a), filtered.cross(a, b)])  # (3 edges, 3, k)
    normal_error = gamma(30) * scale * scale
    determinant = filtered.dot(a, normals[0])
    determinant_error = gamma(200) * scale**3
    room = np.abs(determinant) - determinant_error
    gradient = normals.sum(axis=0) / determinant
    extent = np.abs(normals[:, 0]) + np.abs(normals[:, 1]) + np.abs(normals[:, 2]) / size
    functions = np.concatenate([normals * (np.sign(determinant) / extent)[:, np.newaxis], gradient[np.newaxis]])
    # Over |x| + |y| + 1 <= 2 size + 1; the scaled functions round a few times more, by what they are.
    spread = 2 * size + 1
    edge_error = spread * (normal_error / extent.min(axis=0) + gamma(8) * (1 + size))
    steepness = np.abs(gradient).sum(axis=0)
    near_error = spread * (3 * normal_error / room + steepness * (determinant_error / room + gamma(8)))
    depth = mapped[2]
    before = (depth > BEFORE * np.abs(matrix[2]).max() * np.abs(relative).sum(axis=0)).all(axis=0)
    least = np.where(before, (1 - 2.0**-20) / depth.max(axis=0), 0.0)
    most = np.where(before, (1 + 2.0**-20) / depth.min(axis=0), np.inf)
    unknown = ~((room > 0) & np.isfinite(functions).all(axis=(0, 1)))
    functions[:, :, unknown], edge_error[unknown], near_error[unknown] = 0.0, np.inf, np.inf
    return Large(functions, edge_error, near_error, least, most)


def set_up_tiles(large: Large, item: NDArray[np.intp], base: Floats, reach: float, ray_error: float) -> NDArray:
    """Return the (16, m) float32 rows of large triangles over tiles.

    Of c + x c_x + y c_y with |x|, |y| <= reach a term rounds five times at most: c, c_x, the product, two sums.

    item : (m,) rows of `large`; base : (2, m) first cells' coordinates
    """
    slope_x, slope_y, constant = (large.functions[:, axis].take(item, axis=1) for axis in range(3))  # (4, m)
    constant += slope_x * base[0]
    constant += slope_y * base[1]
    steep = np.abs(slope_x) + np.abs(slope_y)
    error = 5 * MARGIN * FLOAT32_ROUNDOFF * (np.abs(constant) + reach * steep) + ray_error * steep
    rows = np.empty((ROWS, len(item)), np.float32)
    rows[CONSTANT:SLOPE_X], rows[SLOPE_X:SLOPE_Y], rows[SLOPE_Y:TOLERANCE] = constant, slope_x, slope_y
    rows[TOLERANCE] = MARGIN * (error[:EDGES].max(axis=0) + large.edge_error.take(item))
    rows[NEAR_ERROR] = MARGIN * (error[EDGES] + large.near_error.take(item))
    rows[LEAST], rows[MOST] = large.least.take(item), large.most.take(item)
    return rows


def may_reach(rows: NDArray[np.float32], low: float, high: float) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """(m,) False where a patch [low, high]^2 lies outside an edge; and the most nearness over it."""
    most = rows[CONSTANT:SLOPE_X].copy()
    for first in (SLOPE_X, SLOPE_Y):
        slope = rows[first : first + FUNCTIONS]
        most += np.maximum(slope * np.float32(low), slope * np.float32(high))
    inside = np.minimum(np.minimum(most[0], most[1]), most[2]) >= -rows[TOLERANCE]
    return inside, np.fmin(most[EDGES] + rows[NEAR_ERROR], rows[MOST])
