"""Second opinions in pairs of float64 (`double_double`), where a plain float64 does not suffice.

The sign of an edge function that float64 left in doubt, and the distance of a decided hit to within about half a unit
in the last place, with its certified bound. What is still in doubt here goes to `exact`.
Imports `predicates` and `double_double`.

Vectors are planes: (3, n) arrays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer import double_double as dd
from raytracer import predicates
from raytracer.predicates import UNIT_ROUNDOFF

Floats = NDArray[np.float64]

# A term of T: difference exact, product 8, difference 4, product 8, two sums 4 each, in units of u^2; D and E have the
# same.
_DETERMINANT_BOUND = 32 * 2.0**-106
# Half an ulp of t is at most u |t|; the two roundings of the correction are added in `_finish`.
_HALF_ULP = UNIT_ROUNDOFF


def _in_range(permanent: Floats, *vectors: Floats) -> NDArray[np.bool_]:
    """True where `double_double` is free of overflow and underflow."""
    largest = np.max([np.abs(vector).max(axis=0) for vector in vectors], axis=0)
    return (largest < dd.LARGEST) & (permanent > dd.SMALLEST_PERMANENT)


def _half_ulp(t: Floats) -> Floats:
    """Half the spacing of floats at t: exactly 2^(e - 53) for 2^(e - 1) <= |t| < 2^e."""
    return np.ldexp(1.0, np.frexp(t)[1] - 54)


def edge_sign(origin: Floats, direction: Floats, p: Floats, q: Floats) -> NDArray[np.int8]:
    """Sign of E(p, q) = d . ((p - o) x (q - o)) of corners p and q, 0 where it remains in doubt, (n,)."""
    edge = dd.dot(dd.exact(direction), dd.cross(dd.two_difference(p, origin), dd.two_difference(q, origin)))[0]
    sizes = predicates.cross_permanent(np.abs(p - origin), np.abs(q - origin))
    permanent = predicates.dot(np.abs(direction), sizes)
    certain = (np.abs(edge) > _DETERMINANT_BOUND * permanent) & _in_range(permanent, origin, direction, p, q)
    return np.where(certain, np.sign(edge), 0).astype(np.int8)


def triangle_distance(origin: Floats, direction: Floats, a: Floats, b: Floats, c: Floats) -> tuple[Floats, Floats]:
    """Return t = T / D and a bound on its error, (n,) each; the bound is infinite outside `_in_range`.

    First t from the determinants' high parts, then one correction (T - t D) / D in pairs: what remains is the
    determinants' own error, (e_T + |t| e_D) / |D|, and the rounding of the last sum, half an ulp.
    """
    relative = dd.two_difference(a, origin)
    normal = dd.cross(dd.two_difference(b, a), dd.two_difference(c, a))
    denominator = dd.dot(dd.exact(direction), normal)
    numerator = dd.dot(relative, normal)
    sizes = predicates.cross_permanent(np.abs(b - a), np.abs(c - a))
    denominator_permanent = predicates.dot(np.abs(direction), sizes)
    numerator_permanent = predicates.dot(np.abs(a - origin), sizes)
    with np.errstate(all="ignore"):
        t = numerator[0] / denominator[0]
        residual = dd.subtract(numerator, dd.multiply(dd.exact(t), denominator))
        correction = (residual[0] + residual[1]) / denominator[0]
        refined = t + correction
        determinants = _DETERMINANT_BOUND * (numerator_permanent + 2 * np.abs(t) * denominator_permanent)
        error = _half_ulp(refined) + (determinants / np.abs(denominator[0]) + 8 * UNIT_ROUNDOFF * np.abs(correction))
    smallest = np.minimum(numerator_permanent, denominator_permanent)
    usable = _in_range(smallest, origin, direction, a, b, c) & np.isfinite(error)
    return refined, np.where(usable, error * (1 + 8 * UNIT_ROUNDOFF), np.inf)


def sphere_distance(
    origin: Floats, direction: Floats, centre: Floats, radius: Floats, t: Floats
) -> tuple[Floats, Floats]:
    """Return the root of f(t) = |o + t d - c|^2 - r^2 near `t` and a bound on its error, (n,) each.

    One Newton step with the residual in pairs. f'' = 2 A is constant, so with h the step -f / f' the root t* obeys
    |t* - (t + h)| <= A h^2 / (|f'| / 2) whenever the step is less than a quarter of |f'| / (2 A); elsewhere (nearly
    tangent) the bound is infinite.
    """
    to_centre = dd.two_difference(origin, centre)
    along = dd.two_product(np.broadcast_to(t, direction.shape), direction)
    point = dd.add(along, to_centre)  # o + t d - c
    value = dd.subtract(dd.dot(point, point), dd.two_product(radius, radius))
    sizes = np.abs(along[0]) + np.abs(to_centre[0])
    value_permanent = predicates.dot(sizes, sizes) + radius * radius
    quadratic = predicates.dot(direction, direction)
    with np.errstate(all="ignore"):
        half_slope = predicates.dot(point[0], direction)
        slope_error = predicates.gamma(8) * predicates.dot(sizes, np.abs(direction))
        slope = np.abs(half_slope) - slope_error
        step = -(value[0] + value[1]) / (2 * half_slope)
        refined = t + step
        newton = quadratic * step * step / slope
        slope_share = np.abs(step) * (slope_error / slope + 8 * UNIT_ROUNDOFF)
        residual = 64 * 2.0**-106 * value_permanent / slope
        error = _half_ulp(refined) + (newton + slope_share + residual) * (1 + 16 * UNIT_ROUNDOFF)
        converging = (slope > 0) & (4 * quadratic * np.abs(step) < slope)
    usable = converging & _in_range(value_permanent, origin, direction, centre) & np.isfinite(error)
    return refined, np.where(usable, error, np.inf)
