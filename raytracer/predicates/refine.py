"""Second opinions in pairs of float64 (`double_double`), where a plain float64 does not suffice.

The sign of an edge function that float64 left in doubt, and the distance of a decided hit to within about half a unit
in the last place, with its certified bound. What is still in doubt here goes to `exact`.

Vectors are planes: (3, n) arrays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.predicates import double_double as dd
from raytracer.predicates import filtered
from raytracer.predicates.rounding import UNIT_ROUNDOFF, gamma

# A term of T: difference exact, product 8, difference 4, product 8, two sums 4 each, in units of u^2; D and E have the
# same.
_DETERMINANT_BOUND = 32 * 2.0**-106


# Exponent of the lowest bit of a float64; products whose bits all lie above it do not underflow.
_LOWEST_BIT = -1074


# Zero is a multiple of everything: more than any sum of three exponents needs.
_UNIT_OF_ZERO = 1 << 12

_SMALLEST_NORMAL = 2.0**-1022
# The bits of a float64 that hold its exponent.
_EXPONENT_BITS = 0x7FF << 52
# What the lower halves of split factors leave to rounding, `correct_distance`.
_HALVES_BOUND = 3 * 2.0**-26 * UNIT_ROUNDOFF


# A bound wider than this many unit roundoffs of the distance, each between half an ulp and one, is worth a computation
# in pairs.
_WIDE = 3


def _in_range(permanent: Floats, *vectors: Floats) -> NDArray[np.bool_]:
    """True where `double_double` is free of overflow and underflow."""
    largest = np.max([np.abs(vector).max(axis=0) for vector in vectors], axis=0)
    return (largest < dd.LARGEST) & (permanent > dd.SMALLEST_PERMANENT)


def _half_ulp(t: Floats) -> Floats:
    """Half the spacing of floats at t; the least float where that is none.

    Of a normal number, u times the power of two at or below it: what its bits without those of the mantissa say, in a
    tenth of the time that `np.spacing` takes.
    """
    size = np.abs(t)
    if not (size.size and size.min() > _SMALLEST_NORMAL / UNIT_ROUNDOFF and size.max() < np.inf):
        return np.maximum(np.spacing(size) / 2, np.finfo(np.float64).smallest_subnormal)
    bits = size.view(np.int64)
    bits &= _EXPONENT_BITS
    size *= UNIT_ROUNDOFF
    return size


def _unit(*vectors: Floats) -> NDArray[np.int32]:
    """(n,) exponents g for which every component is an integer times 2^g: that of the lowest bit in use."""
    mantissa, exponent = np.frexp(np.concatenate(vectors))
    digits = np.ldexp(mantissa, 53).astype(np.int64)
    lowest = np.frexp((digits & -digits).astype(np.float64))[1] - 54 + exponent
    return np.min(lowest, axis=0, where=digits != 0, initial=_UNIT_OF_ZERO)


def edge_sign(origin: Floats, direction: Floats, p: Floats, q: Floats) -> tuple[NDArray[np.int8], NDArray[np.bool_]]:
    """Sign of E(p, q) = d . ((p - o) x (q - o)) of corners p and q, and whether it is certain, (n,) each.

    With positions that are multiples of 2^g and a direction of multiples of 2^h, E is a multiple of 2^(2 g + h): it is
    zero if it is certainly smaller than that.
    """
    edge = dd.dot(dd.exact(direction), dd.cross(dd.two_difference(p, origin), dd.two_difference(q, origin)))[0]
    sizes = filtered.cross_permanent(np.abs(p - origin), np.abs(q - origin))
    permanent = filtered.dot(np.abs(direction), sizes)
    error, size = _DETERMINANT_BOUND * permanent, np.abs(edge)
    usable = _in_range(permanent, origin, direction, p, q)
    # |E| <= size (1 + u) + error, and a float x is less than 2^frexp(x).
    limit = np.frexp((size + error) * (1 + 4 * UNIT_ROUNDOFF))[1]
    zero = usable & (limit <= 2 * _unit(origin, p, q) + _unit(direction))
    certain = usable & (size > error)
    return np.where(certain, np.sign(edge), 0).astype(np.int8), certain | zero


def passes_through(origin: Floats, direction: Floats, point: Floats) -> NDArray[np.bool_]:
    """True where the line o + t d passes exactly through a point, as far as pairs tell, (n,).

    (p - o) x d = 0, that is d_i P_j = d_j P_i for all i, j. Products of two floats are exact in pairs, and a pair is
    unique; where P = p - o is no float, or products could underflow, the answer is False.
    """
    relative, remainder = dd.two_difference(point, origin)
    largest = np.maximum(np.abs(direction).max(axis=0), np.abs(relative).max(axis=0))
    in_range = largest < dd.LARGEST
    relative, direction = np.where(in_range, relative, 0.0), np.where(in_range, direction, 0.0)
    following, preceding = [1, 2, 0], [2, 0, 1]
    one = dd.two_product(direction[following], relative[preceding])
    other = dd.two_product(direction[preceding], relative[following])
    parallel = ((one[0] == other[0]) & (one[1] == other[1]) & (remainder == 0)).all(axis=0)
    return np.asarray(parallel & in_range & (_unit(relative) + _unit(direction) >= _LOWEST_BIT))


def is_wide(distance: Floats, error: Floats) -> NDArray[np.bool_]:
    """True where the bound of `correct_distance` is wider than a few ulps: triangles that are large beside their
    distance, or seen nearly edge-on; `divide_determinants` does better there."""
    return ~(error <= _WIDE * UNIT_ROUNDOFF * np.abs(distance))


@np.errstate(all="ignore")
def correct_distance(origin: Floats, direction: Floats, a: Floats, b: Floats, c: Floats) -> tuple[Floats, Floats]:
    """t0 = T / D in float64 and one correction by the residual: with w = a - o - t0 d, t - t0 = (N . w) / D exactly.

    w is hardly longer than the triangle, so the roundings of N count in proportion to |w| only, not to the distance
    (iterative refinement: Higham 2002, chapter 12). a - o is exact as a pair (s, e). Of t0 only the upper 26 bits are
    kept, and d is split into halves (g, h) of 26 bits: t0 g and t0 h are exact, |t0 h| <= 2^-26 |t0 d|. So
    w = (s - t0 g) + (e - t0 h) is off by 2 u |w| + 2 u (u |s| + 2^-26 |t0 d|) to first order, and
    |t0 d| <= |s| + |w|. N has gamma(4), the sums of N . w gamma(3): with the permanent Q of N,

        error of N . w  <=  gamma(10) Q . |w| + 3 u 2^-26 Q . |s| + underflow.
    """
    start, rest = dd.two_difference(a, origin)
    side_b, side_c = b - a, c - a
    normal = filtered.cross(side_b, side_c)
    sizes = filtered.cross_permanent(np.abs(side_b, out=side_b), np.abs(side_c, out=side_c))
    denominator = filtered.dot(direction, normal)
    t = dd.split(filtered.dot(start, normal) / denominator)[0]
    residual = _find_residual(start, rest, direction, t)
    correction = filtered.dot(normal, residual) / denominator
    refined = t + correction
    size, denominator_error = np.abs(denominator), filtered.dot(np.abs(direction), sizes)
    denominator_error *= filtered.DENOMINATOR_BOUND
    room = size - denominator_error
    lengths = np.abs(residual, out=residual)
    underflow = filtered.UNDERFLOW * (1 + (sizes + lengths).sum(axis=0))
    share = np.abs(correction, out=correction)
    size *= 4 * UNIT_ROUNDOFF
    share *= np.add(denominator_error, size, out=size)
    lengths *= gamma(10)
    lengths += np.multiply(_HALVES_BOUND, np.abs(start, out=start), out=start)
    error = filtered.dot(sizes, lengths)
    error += underflow
    error += share
    error /= room
    error = np.add(_half_ulp(refined), error, out=error)
    error *= 1 + 16 * UNIT_ROUNDOFF
    unusable = np.flatnonzero(~((denominator_error > filtered.SMALLEST_PERMANENT) & (room > 0)))
    error[unusable] = np.inf
    return refined, error


def _find_residual(start: Floats, rest: Floats, direction: Floats, t: Floats) -> Floats:
    """w = (s - t g) + (e - t h) of a start s + e and a direction split into g + h, as `correct_distance` needs it."""
    upper, lower = dd.split(direction)
    upper *= t
    lower *= t
    np.subtract(start, upper, out=upper)
    upper += np.subtract(rest, lower, out=lower)
    return upper


def divide_determinants(origin: Floats, direction: Floats, a: Floats, b: Floats, c: Floats) -> tuple[Floats, Floats]:
    """Return t = T / D and a bound on its error, (n,) each; the bound is infinite outside `_in_range`.

    First t from the determinants' high parts, then one correction (T - t D) / D in pairs: what remains is the
    determinants' own error, (e_T + |t| e_D) / |D|, and the rounding of the last sum, half an ulp.
    """
    relative = dd.two_difference(a, origin)
    normal = dd.cross(dd.two_difference(b, a), dd.two_difference(c, a))
    denominator = dd.dot(dd.exact(direction), normal)
    numerator = dd.dot(relative, normal)
    sizes = filtered.cross_permanent(np.abs(b - a), np.abs(c - a))
    denominator_permanent = filtered.dot(np.abs(direction), sizes)
    numerator_permanent = filtered.dot(np.abs(a - origin), sizes)
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
    value_permanent = filtered.dot(sizes, sizes) + radius * radius
    quadratic = filtered.dot(direction, direction)
    with np.errstate(all="ignore"):
        half_slope = filtered.dot(point[0], direction)
        slope_error = gamma(8) * filtered.dot(sizes, np.abs(direction))
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
