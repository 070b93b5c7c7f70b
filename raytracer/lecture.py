"""The mathematics of the lecture ("Computer Graphics, Lecture 21") as batch functions, in order, under its headings.

Every function takes vectors of shape (..., 3) (or (..., 2) for the circle) and numbers of shape (...), which broadcast
against each other; single vectors and plain numbers work too. Everything is computed in float64, one ufunc per
component, so that a batch equals its elements one at a time, bit for bit. Where there is no answer (a parallel line, a
miss, a degenerate triangle) the answer is NaN, and no warning is raised. Squared lengths must stay within float64's
range: components between about 1e-75 and 1e75 are safe everywhere, as are zeros.

These functions round like any float64 code: they are not watertight along edges. The certified decisions of
`predicates` and `casting` are tested against the same formulas in exact arithmetic.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from functools import wraps
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def _as_floats(*values: ArrayLike) -> list[Floats]:
    return [np.asarray(value, dtype=np.float64) for value in values]


Function = TypeVar("Function", bound=Callable[..., Any])


def _expect_nan(function: Function) -> Function:
    """Decorate: no warnings for division by zero, infinity or NaN; where they occur the answer is NaN by contract.

    NumPy 1's errstate takes 8 us a call, three times a dot product of ten rows; what it calls itself, 0.2.
    """
    get, set_ = getattr(np, "geterrobj", None), getattr(np, "seterrobj", None)
    if get is None or set_ is None:
        return np.errstate(all="ignore")(function)

    @wraps(function)
    def quiet(*values: Any, **named: Any) -> Any:
        buffer_size, mask, callback = get()
        set_([buffer_size, 0, callback])  # no bit set: ignore all
        try:
            return function(*values, **named)
        finally:
            set_([buffer_size, mask, callback])

    return cast(Function, quiet)


@_expect_nan
def dot(u: ArrayLike, v: ArrayLike) -> Floats:
    """u . v over the last axis: (..., k), (..., k) -> (...).

    Examples
    --------
    >>> float(dot((1, 2, 1), (3, 1, 5)))
    10.0
    """
    return _sum_products(np.asarray(u, np.float64), np.asarray(v, np.float64))


def _sum_products(u: Floats, v: Floats) -> Floats:
    """Return the sum of u_i v_i over the last axis, from the first to the last."""
    total = u[..., 0] * v[..., 0]
    for axis in range(1, max(u.shape[-1], v.shape[-1])):
        total += u[..., axis] * v[..., axis]
    return total


@_expect_nan
def cross(u: ArrayLike, v: ArrayLike) -> Floats:
    """u x v: (..., 3), (..., 3) -> (..., 3); cross(u, v) is -cross(v, u) bit for bit.

    Examples
    --------
    The lecture's, for the distance of a point to a line:

    >>> cross((-2, 3, 0), (3, -3, 3)).tolist()
    [9.0, 6.0, -3.0]
    """
    u, v = _as_floats(u, v)
    (ux, uy, uz), (vx, vy, vz) = np.moveaxis(u, -1, 0), np.moveaxis(v, -1, 0)
    return np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], axis=-1)


@_expect_nan
def length(v: ArrayLike) -> Floats:
    """|v| = sqrt(v . v): (..., k) -> (...).

    Examples
    --------
    >>> float(length((3, 4)))
    5.0
    """
    v = np.asarray(v, np.float64)
    return np.sqrt(_sum_products(v, v))


# Parametric equation of a line --------------------------------------------------------------------------------------


@_expect_nan
def point_on_line(origin: ArrayLike, direction: ArrayLike, t: ArrayLike) -> Floats:
    """Return the points p = v + t d of a line.

    Parameters
    ----------
    origin : (..., 3) float64, v, a point of the line
    direction : (..., 3) float64, d, of any length
    t : (...) float64, in units of the direction's length

    Returns
    -------
    (..., 3) float64

    Examples
    --------
    The lecture's line through (1, -1, 4) in the direction <3, 5, -1>: x = 1 + 3t, y = -1 + 5t, z = 4 - t.

    >>> point_on_line((1, -1, 4), (3, 5, -1), t=2).tolist()
    [7.0, 9.0, 2.0]
    """
    origin, direction, t = _as_floats(origin, direction, t)
    return origin + t[..., np.newaxis] * direction


@_expect_nan
def line_through(p: ArrayLike, q: ArrayLike) -> tuple[Floats, Floats]:
    """Return origin p and direction q - p of the line x = x1 + t (x2 - x1), which is at p for t = 0 and at q for t = 1.

    p and q are (..., 3) float64, and so are the results; p = q gives a zero direction, which meets nothing.

    Examples
    --------
    >>> origin, direction = line_through((1, 2, 3), (4, 3, 8))
    >>> direction.tolist()
    [3.0, 1.0, 5.0]
    """
    p, q = np.broadcast_arrays(*_as_floats(p, q))
    return p.copy(), q - p


@_expect_nan
def intersect_plane(origin: ArrayLike, direction: ArrayLike, normal: ArrayLike, offset: ArrayLike) -> Floats:
    """Return t where the line meets the plane n . x = k: putting v + t d for x gives t = (k - n . v) / (n . d).

    Parameters
    ----------
    origin, direction : (..., 3) float64, the line v + t d
    normal : (..., 3) float64, n, of any length
    offset : (...) float64, k

    Returns
    -------
    (...) float64, t, also negative; the point is ``point_on_line(origin, direction, t)``. NaN where the line is
    parallel to the plane, even if it lies in it: then no single t is the answer.

    Examples
    --------
    The lecture's plane x + 2y + z = 6 and its line from (1, 2, 3) to (4, 3, 8): 8 + 10 t = 6.

    >>> t = intersect_plane((1, 2, 3), (3, 1, 5), normal=(1, 2, 1), offset=6)
    >>> float(t)
    -0.2
    >>> point_on_line((1, 2, 3), (3, 1, 5), t).round(12).tolist()
    [0.4, 1.8, 2.0]
    """
    origin, direction, normal, offset = _as_floats(origin, direction, normal, offset)
    slope = dot(normal, direction)
    return np.where(slope != 0, (offset - dot(normal, origin)) / slope, np.nan)[()]


# Barycentric coordinates --------------------------------------------------------------------------------------------


@_expect_nan
def barycentric(point: ArrayLike, a: ArrayLike, b: ArrayLike, c: ArrayLike) -> Floats:
    """Return the weights of p = alpha a + beta b + gamma c with alpha = 1 - beta - gamma.

    Each weight is the area of the triangle that p makes with the opposite side, over the whole area; with
    N = (b - a) x (c - a) for instance beta = ((p - a) x (c - a)) . N / (N . N).

    Parameters
    ----------
    point : (..., 3) float64, p; a point beside the triangle's plane counts as its projection onto the plane
    a, b, c : (..., 3) float64, corners

    Returns
    -------
    (..., 3) float64, alpha, beta, gamma; NaN where the triangle has no area.

    Notes
    -----
    The lecture calls the third weight lambda, later gamma. Here alpha comes from its own area, not from
    1 - beta - gamma, so that it is exactly 0 where the arithmetic is exact, as the other two are.

    Examples
    --------
    In the lecture's triangle the weights are the coordinates:

    >>> barycentric((0.5, 0.25, 0.25), a=(1, 0, 0), b=(0, 1, 0), c=(0, 0, 1)).tolist()
    [0.5, 0.25, 0.25]
    """
    point, a, b, c = _as_floats(point, a, b, c)
    normal = cross(b - a, c - a)
    areas = [
        dot(cross(c - b, point - b), normal),
        dot(cross(point - a, c - a), normal),
        dot(cross(b - a, point - a), normal),
    ]
    whole = dot(normal, normal)[..., np.newaxis]
    return np.where(whole > 0, np.stack(areas, axis=-1) / whole, np.nan)


class Region(IntEnum):
    """Where a point lies relative to a triangle, see `classify_barycentric`."""

    OUTSIDE = 0
    INSIDE = 1
    EDGE = 2
    VERTEX = 3


def classify_barycentric(weights: ArrayLike, tolerance: ArrayLike = 0.0) -> NDArray[np.int8]:
    """Say where the point with these weights lies: inside, on an edge, on a vertex or outside of the triangle.

    Inside, all weights are above 0 (and, as they sum to 1, below 1). On an edge one is zero, on a vertex two are.

    Parameters
    ----------
    weights : (..., 3) float64, alpha, beta, gamma
    tolerance : (...) float64, weights of at most this size count as zero. The default takes the weights as exact.
        For weights from `barycentric` a bound on their rounding error is meant: gamma(11) = 11 u / (1 - 11 u),
        u = 2^-53, times the formula's sum with every term made positive, over N . N.

    Returns
    -------
    (...) int8, members of `Region`; NaN weights (no triangle) are OUTSIDE.

    Notes
    -----
    The lecture's "if one component is zero, P is on an edge" holds between the corners only: (0, 2, -1) has a zero but
    lies beyond the edge, on its line, and is OUTSIDE. Its strict inequalities describe the open interior; the ray
    tracer takes triangles as closed sets, so that edges and vertices are hit as well.

    Examples
    --------
    >>> regions = classify_barycentric([(0.5, 0.25, 0.25), (0.5, 0.5, 0), (1, 0, 0), (1.5, -0.25, -0.25)])
    >>> [Region(region).name for region in regions]
    ['INSIDE', 'EDGE', 'VERTEX', 'OUTSIDE']
    """
    weights, tolerance = _as_floats(weights, tolerance)
    tolerance = tolerance[..., np.newaxis]
    zeros = (np.abs(weights) <= tolerance).sum(axis=-1)
    closed = (weights >= -tolerance).all(axis=-1) & (zeros < 3)
    return np.where(closed, Region.INSIDE + zeros, Region.OUTSIDE).astype(np.int8)[()]


# Ray-object intersection: 2D ray-circle intersection ----------------------------------------------------------------


class Quadratic(NamedTuple):
    """Coefficients of a t^2 + b t + c = 0, each (...) float64."""

    a: Floats
    b: Floats
    c: Floats


@_expect_nan
def circle_quadratic(origin: ArrayLike, direction: ArrayLike, radius: ArrayLike) -> Quadratic:
    """Put P + t d into x^2 + y^2 - R^2 = 0: (d . d) t^2 + 2 (P . d) t + (P . P - R^2) = 0; see `intersect_circle`.

    Examples
    --------
    The lecture's t^2 - 6 t + 9 = 0, for a direction five times as long:

    >>> [float(value) for value in circle_quadratic((-3, 1), (4, -3), radius=1)]
    [25.0, -30.0, 9.0]
    """
    origin, direction, radius = _as_floats(origin, direction, radius)
    return Quadratic(dot(direction, direction), 2 * dot(origin, direction), dot(origin, origin) - radius * radius)


@_expect_nan
def intersect_circle(origin: ArrayLike, direction: ArrayLike, radius: ArrayLike) -> Floats:
    """Return the two t at which the line meets the circle of this radius around (0, 0).

    The discriminant D = b^2 - 4 a c tells the cases: D < 0 no intersection, D = 0 the line is tangent and the root is
    double, D > 0 two real roots.

    Parameters
    ----------
    origin, direction : (..., 2) float64, the line P + t d
    radius : (...) float64, R, not negative

    Returns
    -------
    (..., 2) float64, the roots in ascending order: two equal ones for a tangent, NaN for no intersection (or a zero
    direction). Negative roots lie behind the ray's origin.

    Notes
    -----
    b^2 - 4 a c cancels for a distant origin. By Lagrange's identity (P . d)^2 + (P x d)^2 = |P|^2 |d|^2 it equals
    4 (R^2 |d|^2 - (P x d)^2), which is what is computed. Of the two roots (-b -+ sqrt(D)) / (2 a) the one that cancels
    is taken from the roots' product c / a.
    The lecture's direction (.8, -.6) is not exact in binary: the float64 line cuts the circle by D = 1.1e-15, so that
    its roots are 3 -+ 1.6e-8. The same line along (4, -3) is tangent in float64, too.

    Examples
    --------
    The lecture's ray from (-3, 1) and the unit circle, along a direction that float64 holds exactly: tangent.

    >>> intersect_circle((-3, 1), (4, -3), radius=1).tolist()
    [0.6, 0.6]
    >>> intersect_circle((-3, 0), (1, 0), radius=1).tolist()
    [2.0, 4.0]
    >>> intersect_circle((-3, 2), (1, 0), radius=1).tolist()
    [nan, nan]
    """
    origin, direction, radius = _as_floats(origin, direction, radius)
    a, b, c = circle_quadratic(origin, direction, radius)
    moment = origin[..., 0] * direction[..., 1] - origin[..., 1] * direction[..., 0]
    quarter = np.where(radius >= 0, radius * radius * a - moment * moment, np.nan)
    return _solve_quadratic(a, b / 2, c, quarter)


@_expect_nan
def _solve_quadratic(a: Floats, half_b: Floats, c: Floats, quarter: Floats) -> Floats:
    """Return the roots (..., 2) of a t^2 + 2 half_b t + c = 0, ascending, given quarter = half_b^2 - a c = D / 4.

    NaN where D < 0 or a = 0.
    """
    # a times the root of larger size, where nothing cancels; the other root follows from their product c / a.
    larger = -(half_b + np.copysign(np.sqrt(quarter), half_b))
    outer = larger / a
    inner = np.where(quarter == 0, outer, c / larger)
    real = (quarter >= 0) & (a > 0)
    roots = [np.where(real, root, np.nan) for root in (np.minimum(outer, inner), np.maximum(outer, inner))]
    return np.stack(roots, axis=-1)


# Barycentric ray-triangle intersection, Cramer's rule ---------------------------------------------------------------


class TrianglePoint(NamedTuple):
    """The point p + t d = a + beta (b - a) + gamma (c - a), each (...) float64; all NaN for a miss."""

    t: Floats
    beta: Floats
    gamma: Floats


@_expect_nan
def intersect_triangle(
    origin: ArrayLike, direction: ArrayLike, a: ArrayLike, b: ArrayLike, c: ArrayLike
) -> TrianglePoint:
    """Return where the ray p + t d, t >= 0, meets the triangle a, b, c: the lecture's 3x3 system, by Cramer's rule.

    [a - b   a - c   d] (beta, gamma, t) = a - p

    Parameters
    ----------
    origin, direction : (..., 3) float64, p and d
    a, b, c : (..., 3) float64, corners, in either winding

    Returns
    -------
    t, beta, gamma : (...) float64. All NaN for a miss, for a ray parallel to the triangle's plane (even if it lies in
    it) and for a triangle without area.

    Notes
    -----
    The triangle is a closed set: edges and vertices are hit, where the lecture's strict inequalities (see
    `classify_barycentric`) would let rays through between two triangles. In float64 a ray aimed at an edge may still
    round to a miss of both neighbours; the certified caster does not have that flaw.

    Examples
    --------
    >>> hit = intersect_triangle((0, 0, 0), (1, 1, 2), a=(1, 0, 0), b=(0, 1, 0), c=(0, 0, 1))
    >>> float(hit.t), float(hit.beta), float(hit.gamma)
    (0.25, 0.25, 0.5)
    """
    origin, direction, a, b, c = _as_floats(origin, direction, a, b, c)
    columns = np.broadcast_arrays(a - b, a - c, direction, a - origin)
    beta, gamma, t = np.moveaxis(solve_cramer(np.stack(columns[:3], axis=-1), columns[3]), -1, 0)
    hit = (beta >= 0) & (gamma >= 0) & (beta + gamma <= 1) & (t >= 0)
    return TrianglePoint(*(np.where(hit, value, np.nan)[()] for value in (t, beta, gamma)))


@_expect_nan
def determinant(matrix: ArrayLike) -> Floats:
    """Return D of (..., 3, 3) as the lecture writes it: three products down the diagonals minus three up (Sarrus).

    Examples
    --------
    >>> float(determinant([[2, 1, 1], [1, -1, -1], [1, 2, 1]]))
    3.0
    """
    (matrix,) = _as_floats(matrix)
    (a, b, c), (d, e, f), (g, h, i) = np.moveaxis(matrix, (-2, -1), (0, 1))
    return (a * e * i + b * f * g + c * d * h) - (c * e * g + b * d * i + a * f * h)


@_expect_nan
def solve_cramer(matrix: ArrayLike, rhs: ArrayLike) -> Floats:
    """Solve three linear equations by Cramer's rule: x = Dx / D, y = Dy / D, z = Dz / D.

    Dx is the determinant of the matrix with its first column replaced by the right-hand side, and so on.

    Parameters
    ----------
    matrix : (..., 3, 3) float64, one equation per row
    rhs : (..., 3) float64

    Returns
    -------
    (..., 3) float64, NaN where D = 0.

    Examples
    --------
    The lecture's 2x + y + z = 3, x - y - z = 0, x + 2y + z = 0:

    >>> solve_cramer([[2, 1, 1], [1, -1, -1], [1, 2, 1]], (3, 0, 0)).tolist()
    [1.0, -2.0, 3.0]
    """
    matrix, rhs = _as_floats(matrix, rhs)
    columns = np.broadcast_arrays(*np.moveaxis(matrix, -1, 0), rhs)
    replaced = [[*columns[:axis], rhs, *columns[axis + 1 : 3]] for axis in range(3)]
    numerators = [determinant(np.stack(np.broadcast_arrays(*swapped), axis=-1)) for swapped in replaced]
    whole = determinant(matrix)[..., np.newaxis]
    return np.where(whole != 0, np.stack(numerators, axis=-1) / whole, np.nan)


# Distance between point to a line, ray intersect sphere -------------------------------------------------------------


@_expect_nan
def distance_point_line(point: ArrayLike, origin: ArrayLike, direction: ArrayLike) -> Floats:
    """Return the distance h = |u x v| / |v| of a point from the line o + t v, u = point - o.

    |u x v| is the area of the parallelogram that u and v span: its base |v| times its height h.

    Parameters
    ----------
    point : (..., 3) float64
    origin, direction : (..., 3) float64, the line; v of any length

    Returns
    -------
    (...) float64, metres if the inputs are; NaN where the direction is zero.

    Notes
    -----
    The lecture prints h = |u x v| / |v|^2. That contradicts its own derivation, |u x v| = |v| h, and its own example,
    sqrt(14/3), which divides by |v|; the square is a misprint.

    Examples
    --------
    The lecture's (1, 4, -2) and the line through (3, 1, -2) and (6, -2, 1): sqrt(14 / 3).

    >>> round(float(distance_point_line((1, 4, -2), *line_through((3, 1, -2), (6, -2, 1)))) ** 2, 12)
    4.666666666667
    """
    point, origin, direction = _as_floats(point, origin, direction)
    base = length(direction)
    return np.where(base > 0, length(cross(point - origin, direction)) / base, np.nan)[()]


@_expect_nan
def intersect_sphere(origin: ArrayLike, direction: ArrayLike, centre: ArrayLike, radius: ArrayLike) -> Floats:
    """Return the two t at which the line meets the sphere: it does where its distance h to the centre is at most r.

    From the point of the line that is closest to the centre, at t = (c - o) . d / |d|^2, it is sqrt(r^2 - h^2) to the
    surface on either side.

    Parameters
    ----------
    origin, direction : (..., 3) float64, the line o + t d
    centre : (..., 3) float64
    radius : (...) float64, r, not negative

    Returns
    -------
    (..., 2) float64, the roots in ascending order: two equal ones for a tangent, NaN for a miss (or a zero direction).
    Negative roots lie behind the ray's origin.

    Notes
    -----
    The lecture says "if d < r ray hits the sphere" (its d is the h of here); the tangent d = r, which it leaves out,
    counts as touching. The discriminant is |d|^2 (r - h)(r + h) instead of the schoolbook b^2 - 4 a c, which loses all
    digits for a distant sphere; see the first reference.

    References
    ----------
    E. Haines, J. Guenther, T. Akenine-Moeller, "Precision Improvements for Ray/Sphere Intersection",
    Ray Tracing Gems, chapter 7, 2019.

    Examples
    --------
    >>> intersect_sphere((-3, 0, 0), (1, 0, 0), centre=(0, 0, 0), radius=1).tolist()
    [2.0, 4.0]
    """
    origin, direction, centre, radius = _as_floats(origin, direction, centre, radius)
    h = distance_point_line(centre, origin, direction)
    offset = origin - centre
    a = dot(direction, direction)
    c = dot(offset, offset) - radius * radius
    quarter = np.where(h <= radius, a * ((radius - h) * (radius + h)), np.nan)
    return _solve_quadratic(a, dot(offset, direction), c, quarter)
