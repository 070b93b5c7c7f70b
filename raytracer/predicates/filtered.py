"""The decisions of ray casting in float64, each with a bound on its rounding error.

With the triangle's corners relative to the ray origin, P = a - o, Q = b - o, R = c - o, this is the lecture's 3x3
system ("Barycentric ray-triangle intersection") solved by Cramer's rule, its determinants arranged so that triangles
that share an edge share a number:

    edge functions   E(p, q) = d . (p x q),   E_a = E(Q, R),  E_b = E(R, P),  E_c = E(P, Q)
    normal           N = (b - a) x (c - a),   D = d . N = E_a + E_b + E_c,   T = (a - o) . N
    intersection     t = T / D,   barycentric weights (E_a, E_b, E_c) / D

The ray's line meets the closed triangle iff D != 0 and no two edge functions have opposite signs.

Edge functions are evaluated after a shear that turns the ray into the z axis (S. Woop, C. Benthin and I. Wald,
"Watertight ray/triangle intersection", 2013): with z the direction's largest axis, s = d_x / d_z, r = d_y / d_z,

    p' = (p_x - s p_z, p_y - r p_z),   E(p, q) = d_z (p'_x q'_y - p'_y q'_x)

Each corner is projected once, whatever triangle it belongs to, and E(p, q) = -E(q, p) bit for bit, so even a ray aimed
at a vertex slips through plain float64 only if products of the projected numbers tie. (Taken as d . (p x q) directly,
2% of rays aimed at vertices slipped through: around a vertex all signs are rounding noise.)

Error bounds, u = 2^-53, gamma(n) = n u / (1 - n u) (Higham, *Accuracy and Stability of Numerical Algorithms*, 2002,
section 3.1); a "permanent" is an expression with every term's absolute value:

    p'_x    2 roundings on p_x, 4 on s p_z:                error <= gamma(4) m,  m = |p_x| + |s p_z|
    E/d_z   two projections, a product, a difference:      error <= gamma(10) perm,  a computed perm is low by gamma(6)
    D       difference 1, product 2 more, difference, product, two sums:             error <= gamma(7) perm
    T       the same and the difference a - o:                                       error <= gamma(8) perm

The bounds use the next larger round numbers. Underflow is covered by absolute terms or by refusing small permanents;
overflow shows as infinity or NaN, and a comparison with NaN is never certain. What is not certain here is looked at
again in `refine`, and then in `exact`.

Vectors are planes: (3, n) arrays, one contiguous row per component.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from raytracer.arrays.types import Booleans, Floats
from raytracer.predicates.rounding import UNIT_ROUNDOFF, gamma

EDGE_BOUND = 16 * UNIT_ROUNDOFF


DENOMINATOR_BOUND = 8 * UNIT_ROUNDOFF


NUMERATOR_BOUND = 9 * UNIT_ROUNDOFF


# What underflow can add: an operation is off by at most 2^-1075, and is then multiplied by at most one number of size
# m or kept; the factor 2^5 counts the operations.
UNDERFLOW = 2.0**-1070


# A permanent below this may have lost terms to underflow (smallest normal 2^-1022, three factors, margin 2^60 / u).
SMALLEST_PERMANENT = 2.0**-900


def cross(p: Floats, q: Floats) -> Floats:
    """p x q of planes (3, n)."""
    product = np.empty_like(p)
    np.subtract(p[1] * q[2], p[2] * q[1], out=product[0])
    np.subtract(p[2] * q[0], p[0] * q[2], out=product[1])
    np.subtract(p[0] * q[1], p[1] * q[0], out=product[2])
    return product


def dot(p: Floats, q: Floats) -> Floats:
    """(p0 q0 + p1 q1) + p2 q2 of planes (3, n)."""
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


def cross_permanent(p: Floats, q: Floats) -> Floats:
    """The cross product with every term's absolute value, of planes that are absolute values already."""
    product = np.empty_like(p)
    np.add(p[1] * q[2], p[2] * q[1], out=product[0])
    np.add(p[2] * q[0], p[0] * q[2], out=product[1])
    np.add(p[0] * q[1], p[1] * q[0], out=product[2])
    return product


def shear(relative: Floats, slope: Floats) -> Floats:
    """Project corners relative to the origin, (3, n) with z the main axis, along rays of slopes (2, n): (2, n)."""
    projected = slope * relative[2]
    return np.subtract(relative[:2], projected, out=projected)


def edge_function(p: Floats, q: Floats) -> Floats:
    """E(p, q) / d_z = p_x q_y - p_y q_x of sheared corners (2, n).

    Twice the signed area of the projected triangle o p q: positive where the ray passes the edge p -> q on its left.
    """
    return np.subtract(p[0] * q[1], p[1] * q[0])


def edge_functions(p: Floats, q: Floats, r: Floats) -> tuple[Floats, Floats, Floats]:
    """E_a, E_b, E_c of the sheared corners a, b, c; a corner's weight is its E over their sum."""
    return edge_function(q, r), edge_function(r, p), edge_function(p, q)


def edge_error(p: Floats, q: Floats, slope: Floats) -> Floats:
    """Bound on |computed - exact| of `edge_function` for corners relative to the origin, (3, n) planes, and slopes."""
    steep = np.abs(slope)
    m, k = np.abs(p[:2]) + steep * np.abs(p[2]), np.abs(q[:2]) + steep * np.abs(q[2])
    return EDGE_BOUND * (m[0] * k[1] + m[1] * k[0]) + UNDERFLOW * (1 + m[0] + m[1] + k[0] + k[1])


def edge_error_of_ray(slope: Floats, reach: Floats) -> Floats:
    """One bound for all triangles whose corners are within `reach` of the origin in every component, (n,).

    m <= (1 + |slope|) reach in `edge_error`, slopes at most 1.
    """
    steep = 1 + np.abs(slope)
    return EDGE_BOUND * (1 + 4 * UNIT_ROUNDOFF) * 2 * steep[0] * steep[1] * reach * reach + UNDERFLOW * (1 + 8 * reach)


def plane_distance(direction: Floats, relative: Floats, side_b: Floats, side_c: Floats) -> Floats:
    """t = T / D as `intersect_plane_certified`, without bounds; NaN where D = 0."""
    normal = cross(side_b, side_c)
    denominator = dot(direction, normal)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        t = dot(relative, normal) / denominator
    return np.where(denominator != 0, t, np.nan)


class PlaneHit(NamedTuple):
    """Where rays meet the planes of triangles: t = T / D, each with its error bound, all (n,)."""

    t: Floats
    t_error: Floats
    denominator: Floats
    denominator_error: Floats


def intersect_plane_certified(direction: Floats, relative: Floats, side_b: Floats, side_c: Floats) -> PlaneHit:
    """t = T / D of `relative` = a - o, `side_b` = b - a, `side_c` = c - a (each rounded once), with bounds.

    |t - T/D| <= (e_T + |t| e_D) / (|D| - e_D) + u |t|, infinite where |D| <= e_D. The quotient's own roundings are
    covered by evaluating with 1 + 8 u. The lecture's line-plane formula with normal N; its twin is
    `lecture.intersect_plane`.
    """
    normal = cross(side_b, side_c)
    normal_permanent = cross_permanent(np.abs(side_b), np.abs(side_c))
    denominator, numerator = dot(direction, normal), dot(relative, normal)
    denominator_permanent = dot(np.abs(direction), normal_permanent)
    numerator_permanent = dot(np.abs(relative), normal_permanent)
    safe = denominator_permanent > SMALLEST_PERMANENT
    denominator_error = np.where(safe, DENOMINATOR_BOUND * denominator_permanent, np.inf)
    # A numerator that underflows to nothing belongs to t = 0 within SMALLEST_PERMANENT / |D|, which is added.
    numerator_error = NUMERATOR_BOUND * numerator_permanent + SMALLEST_PERMANENT
    on_plane = np.flatnonzero(numerator == 0)
    if len(on_plane):
        nothing = _is_nothing(relative[:, on_plane], side_b[:, on_plane], side_c[:, on_plane])
        numerator_error[on_plane[nothing]] = 0.0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        t = numerator / denominator
        room = np.abs(denominator) - denominator_error
        error = (numerator_error + np.abs(t) * denominator_error) / room + UNIT_ROUNDOFF * np.abs(t)
        error = np.where(room > 0, error * (1 + 8 * UNIT_ROUNDOFF), np.inf)
    return PlaneHit(t, error, denominator, denominator_error)


def _is_nothing(relative: Floats, side_b: Floats, side_c: Floats) -> Booleans:
    """(n,) True where every product in (a - o) . N has a factor 0: the origin is in the triangle's axis plane."""
    flat_b, flat_c, following, preceding = side_b == 0, side_c == 0, [1, 2, 0], [2, 0, 1]
    flat = (flat_b[following] | flat_c[preceding]) & (flat_b[preceding] | flat_c[following])
    return np.asarray((flat | (relative == 0)).all(axis=0))


class SphereRoots(NamedTuple):
    """Where rays' lines meet spheres: both roots of |o + t d - c|^2 = r^2, ascending, with bounds, all (n,).

    discriminant : r^2 |d|^2 - |(c - o) x d|^2, negative beyond its error: the line passes the sphere
    """

    near: Floats
    far: Floats
    error: Floats
    discriminant: Floats
    discriminant_error: Floats


def intersect_sphere_certified(direction: Floats, to_centre: Floats, radius: Floats) -> SphereRoots:
    """Ray and sphere by the distance of the centre to the line, with error bounds.

    With L = c - o (rounded once), A = d . d, b = L . d, X = L x d: the lecture's distance of the centre to the line
    is |X| / |d| ("Distance between point to a line"), so the line meets the sphere iff r^2 A >= |X|^2 (Haines et al.,
    "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems, 2019). Roots t = (b -+ s) / A with
    s = sqrt(r^2 A - |X|^2); the root that would cancel is taken from the product of the roots, C / A with
    C = |L|^2 - r^2 = (|L| - r) (|L| + r).

    Bounds: X_k has 3 roundings, |error| <= gamma(3) Y_k with Y_k its permanent, so X_k^2 is off by at most
    2 gamma(3) |X_k| Y_k + (gamma(3) Y_k)^2; squares, sums and r^2 A bring at most gamma(6) of their own size.
    s is off by e_disc / s, b by gamma(4) sum |L_k d_k|, and the quotient by gamma(6) of itself.
    """
    magnitude, lengths = np.abs(direction), np.abs(to_centre)
    quadratic, half_linear = dot(direction, direction), dot(to_centre, direction)
    offset = cross(to_centre, direction)
    offset_error = gamma(3) * cross_permanent(lengths, magnitude)
    closest, reached = dot(offset, offset), radius * radius * quadratic
    discriminant = reached - closest
    discriminant_error = (
        2 * dot(np.abs(offset), offset_error) + dot(offset_error, offset_error) + gamma(6) * (closest + reached)
    ) * (1 + gamma(12)) + SMALLEST_PERMANENT
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        root = np.sqrt(np.maximum(discriminant, 0.0))
        length = np.sqrt(dot(to_centre, to_centre))
        constant = (length - radius) * (length + radius)
        stable = half_linear + np.copysign(root, half_linear)
        one, other = stable / quadratic, constant / stable
        root_error = np.where(discriminant > discriminant_error, discriminant_error / root, np.inf)
        slope_error = gamma(4) * dot(lengths, magnitude)
        size = (np.abs(half_linear) + root) / quadratic
        # Both roots lie within this of (b -+ s) / A; the cancelling one is also bounded through C.
        error = ((slope_error + root_error) / quadratic + gamma(6) * size) * (1 + gamma(12))
        constant_error = gamma(8) * (length * length + radius * radius)
        other_error = (constant_error + np.abs(other) * (slope_error + root_error)) / np.abs(stable)
        other_error = (other_error + gamma(6) * np.abs(other)) * (1 + gamma(12))
    error = np.fmax(error, other_error)
    other = np.where(stable == 0, 0.0, other)
    return SphereRoots(np.fmin(one, other), np.fmax(one, other), error, discriminant, discriminant_error)
