"""The decisions of ray casting in float64, each with a bound on its rounding error.

With the triangle's corners relative to the ray origin, P = a - o, Q = b - o, R = c - o, this is the lecture's 3x3
system ("Barycentric ray-triangle intersection") solved by Cramer's rule, its determinants arranged so that triangles
that share an edge share a number:

    edge functions   E_a = d . (Q x R),  E_b = d . (R x P),  E_c = d . (P x Q)
    normal           N = (b - a) x (c - a),   D = d . N = E_a + E_b + E_c,   T = (a - o) . N
    intersection     t = T / D,   barycentric weights (E_a, E_b, E_c) / D

The ray's line meets the closed triangle iff D != 0 and no two edge functions have opposite signs. The formula of E is
written in products and differences of components, so E(p, q) = -E(q, p) bit for bit: a ray cannot slip between two
triangles.

Error bounds (u = 2^-53, gamma(n) = n u / (1 - n u), Higham, *Accuracy and Stability of Numerical Algorithms*, 2002,
section 3.1). A term d_k P_i Q_j of E carries 2 rounded differences, 2 products and at most 1 + 2 sums, 7 roundings;
a term of D carries the same 7, one of T 8. So |computed - exact| <= gamma(7) perm for E and D, gamma(8) perm for T,
where perm is the same expression with every term's absolute value. The computed perm is itself low by at most
gamma(8), which the next integer absorbs: 8 u perm and 9 u perm.

Underflow adds at most a few times 2^-1074 to a term and is caught by `SMALLEST_PERMANENT`; overflow shows as infinity
or NaN, and a comparison with NaN is never certain. What is not certain here goes to `exact.py`.

Vectors are planes: (3, n) arrays, one contiguous row per component. Imports nothing of the project.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]

UNIT_ROUNDOFF = 2.0**-53

EDGE_BOUND = 8 * UNIT_ROUNDOFF
NUMERATOR_BOUND = 9 * UNIT_ROUNDOFF

# A permanent below this may have lost terms to underflow (smallest normal 2^-1022, three factors, margin 2^60 / u).
SMALLEST_PERMANENT = 2.0**-900


def gamma(n: int, unit_roundoff: float = UNIT_ROUNDOFF) -> float:
    """Return n u / (1 - n u), the relative error of n roundings in sequence (Higham 2002, lemma 3.1)."""
    return n * unit_roundoff / (1 - n * unit_roundoff)


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
    return np.stack([p[1] * q[2] + p[2] * q[1], p[2] * q[0] + p[0] * q[2], p[0] * q[1] + p[1] * q[0]])


def edge_function(direction: Floats, p: Floats, q: Floats) -> Floats:
    """E(p, q) = d . (p x q): six times the signed volume of the tetrahedron o, o + d, o + p, o + q.

    Positive where the ray passes the directed edge p -> q on its left (seen against the direction). Planes (3, n).
    """
    return dot(direction, cross(p, q))


def edge_functions(direction: Floats, p: Floats, q: Floats, r: Floats) -> tuple[Floats, Floats, Floats]:
    """E_a, E_b, E_c of the corners relative to the origin; the weight of a corner is its E over their sum."""
    return edge_function(direction, q, r), edge_function(direction, r, p), edge_function(direction, p, q)


def edge_error(direction: Floats, p: Floats, q: Floats) -> Floats:
    """Bound on |computed - exact| of `edge_function`; infinite where underflow could invalidate it."""
    permanent = dot(np.abs(direction), cross_permanent(np.abs(p), np.abs(q)))
    return np.where(permanent > SMALLEST_PERMANENT, EDGE_BOUND * permanent, np.inf)


def edge_error_of_ray(direction: Floats, reach: Floats) -> Floats:
    """One bound for all triangles whose corners are within `reach` of the origin in every component.

    perm = sum |d_k| (|P_i Q_j| + |P_j Q_i|) <= 2 (|d_0| + |d_1| + |d_2|) reach^2; the extra roundings of this formula
    are absorbed by one more unit in the bound. (n,).
    """
    size = np.abs(direction).sum(axis=0)
    permanent = 2 * size * reach * reach
    return np.where(permanent > SMALLEST_PERMANENT, (EDGE_BOUND + UNIT_ROUNDOFF) * permanent, np.inf)


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
    denominator_error = np.where(safe, EDGE_BOUND * denominator_permanent, np.inf)
    # A numerator that underflows to nothing belongs to t = 0 within SMALLEST_PERMANENT / |D|, which is added.
    numerator_error = NUMERATOR_BOUND * numerator_permanent + SMALLEST_PERMANENT
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        t = numerator / denominator
        room = np.abs(denominator) - denominator_error
        error = (numerator_error + np.abs(t) * denominator_error) / room + UNIT_ROUNDOFF * np.abs(t)
        error = np.where(room > 0, error * (1 + 8 * UNIT_ROUNDOFF), np.inf)
    return PlaneHit(t, error, denominator, denominator_error)


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
