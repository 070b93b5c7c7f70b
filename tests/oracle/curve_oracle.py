"""Where a ray meets a segment of a curve, in exact rational arithmetic: slow, and written from the definitions alone.

With w = P(u) - o, all polynomials in u have rational coefficients when multiplied by d . d:

    foot     G = (d . d) (w . P') - (w . d) (P' . d)      a ribbon's edge to edge line through P meets the ray
    offset   A = (d . d) (w . w) - (w . d)^2              (d . d) times the squared distance from the ray
    tube     F = (P' . d)^2 (A - (d . d) r^2) + G^2       the circle around P, at right angles to P', meets the ray

Roots are isolated by Sturm's theorem and halved to WIDTH.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from math import isqrt
from typing import NamedTuple

Polynomial = list[Fraction]
Vector = list[Fraction]

WIDTH = Fraction(1, 2**90)


class Meeting(NamedTuple):
    """A point where a ray meets a segment.

    u : to WIDTH; t : of o + t d, to rounding of a float
    margin : (r^2 - X^2) / r^2, 0 where the ray only touches the edge
    """

    u: Fraction
    t: float
    margin: float


def add(*parts: Polynomial) -> Polynomial:
    size = max(map(len, parts))
    return [sum((part[k] for part in parts if k < len(part)), Fraction(0)) for k in range(size)]


def scale(factor: Fraction | int, part: Polynomial) -> Polynomial:
    return [factor * value for value in part]


def multiply(a: Polynomial, b: Polynomial) -> Polynomial:
    product = [Fraction(0)] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            product[i + j] += x * y
    return product


def differentiate(part: Polynomial) -> Polynomial:
    return [k * value for k, value in enumerate(part)][1:] or [Fraction(0)]


def evaluate(part: Polynomial, u: Fraction) -> Fraction:
    value = Fraction(0)
    for coefficient in reversed(part):
        value = value * u + coefficient
    return value


def interpolate(keys: list[Fraction]) -> Polynomial:
    """Return the uniform Catmull-Rom spline between keys 1 and 2."""
    p0, p1, p2, p3 = keys
    cubic = [2 * p1, p2 - p0, 2 * p0 - 5 * p1 + 4 * p2 - p3, 3 * p1 - p0 - 3 * p2 + p3]
    return scale(Fraction(1, 2), cubic)


def trim(part: Polynomial) -> Polynomial:
    while part and part[-1] == 0:
        part = part[:-1]
    return part


def make_sturm_chain(part: Polynomial) -> list[Polynomial]:
    """Return the chain of a polynomial without its multiple roots, each of which it keeps once."""
    chain = _make_chain(part)
    if len(chain[-1]) > 1:
        quotient, dividend = [], list(chain[0])
        while len(dividend) >= len(chain[-1]):
            quotient.append(dividend[-1] / chain[-1][-1])
            for k in range(1, len(chain[-1]) + 1):
                dividend[-k] -= quotient[-1] * chain[-1][-k]
            dividend = dividend[:-1]
        chain = _make_chain(quotient[::-1])
    return chain


def _make_chain(part: Polynomial) -> list[Polynomial]:
    chain = [trim(part), trim(differentiate(part))]
    while chain[-1]:
        dividend, divisor = list(chain[-2]), chain[-1]
        while len(dividend) >= len(divisor):
            factor = dividend[-1] / divisor[-1]
            for k in range(1, len(divisor) + 1):
                dividend[-k] -= factor * divisor[-k]
            dividend = dividend[:-1]
        rest = trim(dividend)
        # A positive factor changes no sign and keeps the numbers short.
        chain.append(scale(-1 / abs(rest[-1]), rest) if rest else [])
    return chain[:-1]


def count_changes(chain: list[Polynomial], u: Fraction) -> int:
    signs = [value > 0 for value in (evaluate(part, u) for part in chain) if value != 0]
    return sum(a != b for a, b in pairwise(signs))


def find_roots(part: Polynomial) -> list[Fraction]:
    """Return the different roots in [0, 1], each to WIDTH; none of a polynomial that is 0."""
    if not trim(part):
        return []
    roots = [Fraction(0)] if part[0] == 0 else []
    chain = make_sturm_chain(part)
    part = chain[0]
    waiting = [(Fraction(0), Fraction(1))]
    while waiting:
        low, high = waiting.pop()
        count = count_changes(chain, low) - count_changes(chain, high)
        if not count:
            continue
        if count == 1 and high - low <= WIDTH:
            roots.append((low + high) / 2)
            continue
        middle = (low + high) / 2
        if count == 1 and evaluate(part, low) * evaluate(part, high) < 0:  # no double root: one sign is enough
            roots.append(bisect(part, low, high))
            continue
        waiting += [(low, middle), (middle, high)]
    return roots


def bisect(part: Polynomial, low: Fraction, high: Fraction) -> Fraction:
    negative = evaluate(part, low) < 0
    while high - low > WIDTH:
        middle = (low + high) / 2
        low, high = (middle, high) if (evaluate(part, middle) < 0) == negative else (low, middle)
    return (low + high) / 2


def dot(a: list[Polynomial], b: list[Polynomial]) -> Polynomial:
    return add(*(multiply(x, y) for x, y in zip(a, b, strict=True)))


def find_meetings(origin: list[float], direction: list[float], keys: list[list[float]], thick: bool) -> list[Meeting]:
    """Return where a ray meets a segment of keys (4, 4), x, y, z and radius, sorted by t; before its origin too."""
    o, d = [Fraction(x) for x in origin], [[Fraction(x)] for x in direction]
    columns = [[Fraction(key[c]) for key in keys] for c in range(4)]
    curve = [interpolate(column) for column in columns]
    w = [add(part, [-x]) for part, x in zip(curve[:3], o, strict=True)]
    slope, radius = [differentiate(part) for part in curve[:3]], curve[3]
    length = dot(d, d)[0]
    foot = add(scale(length, dot(w, slope)), scale(-1, multiply(dot(w, d), dot(slope, d))))
    offset = add(scale(length, dot(w, w)), scale(-1, multiply(dot(w, d), dot(w, d))))
    inside = add(scale(length, multiply(radius, radius)), scale(-1, offset))  # (d . d) h^2
    climb = dot(slope, d)
    tube = add(multiply(multiply(climb, climb), scale(-1, inside)), multiply(foot, foot))
    meetings = []
    for u in find_roots(tube if thick else foot):
        r, height = evaluate(radius, u), evaluate(inside, u) / length
        if r <= 0 or height < 0:
            continue
        depth = evaluate(dot(w, d), u) / length
        if not thick:
            t = depth
            if not (t > 0 and t * t * length > 4 * r * r):
                continue
        else:
            t = _find_side(evaluate(foot, u), evaluate(climb, u), depth, height, length)
            if t is None or not _faces_outward(t, u, o, d, curve):
                continue
        meetings.append(Meeting(u, float(t), float(height / (r * r))))
    return sorted(meetings, key=lambda meeting: meeting.t)


def _find_side(foot: Fraction, climb: Fraction, depth: Fraction, height: Fraction, length: Fraction) -> Fraction:
    """Return the t of a root of F: depth + G / ((d . d) (P' . d)), whose square is the height's; to 2^-200 where the
    disc stands along the ray."""
    if climb != 0:
        lift = foot / (length * climb)
        if lift != 0 and abs(lift * lift * length - height) <= height * Fraction(1, 2**40):
            return depth + lift
    return depth - take_root(height / length)


def take_root(value: Fraction) -> Fraction:
    """Return the square root to 2^-200."""
    return Fraction(isqrt(int(value * 2**400)), 2**200)


def _faces_outward(t: Fraction, u: Fraction, o: Vector, d: list[Polynomial], curve: list[Polynomial]) -> bool:
    """Return whether d . N <= 0 for N = R (|P'|^2 - R . P'') / r - r' P', at right angles to the surface P + R that
    R . P' = 0 and |R| = r make."""
    r, slope_r = evaluate(curve[3], u), evaluate(differentiate(curve[3]), u)
    slope = [evaluate(differentiate(part), u) for part in curve[:3]]
    offset = [a + t * b[0] - evaluate(part, u) for a, b, part in zip(o, d, curve, strict=False)]
    bend = [evaluate(differentiate(differentiate(part)), u) for part in curve[:3]]
    width = sum(x * x for x in slope) - sum(x * y for x, y in zip(offset, bend, strict=True))
    normal = [x * width / r - slope_r * y for x, y in zip(offset, slope, strict=True)]
    return sum(x * y[0] for x, y in zip(normal, d, strict=True)) <= 0
