"""Exact numbers for the oracle: distances of triangles are Fractions, those of spheres Surds a + s sqrt(q)."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import total_ordering
from math import isqrt


def sign(value):
    return (value > 0) - (value < 0)


def _sign_of_surd(a, s, q):
    """Sign of a + s sqrt(q), q >= 0, s in (-1, 0, 1)."""
    if s == 0 or q == 0 or sign(a) == s:
        return sign(a) if s == 0 or q == 0 else s
    return sign(a) * sign(a * a - q) if a else s


@total_ordering
@dataclass(frozen=True, eq=False)
class Surd:
    """The exact number a + s sqrt(q), s = +-1: a root of a sphere. Compares exactly with any real number."""

    a: Fraction
    s: int
    q: Fraction

    def _sign_of_difference(self, other):
        if not isinstance(other, Surd):
            return _sign_of_surd(self.a - Fraction(other), self.s, self.q)
        # x + y with x = (a - a') + s sqrt(q), y = -s' sqrt(q'): unless their signs agree, |x| against |y| decides,
        # where x^2 - y^2 = (a - a')^2 + q - q' + 2 (a - a') s sqrt(q).
        a = self.a - other.a
        sign_x, sign_y = _sign_of_surd(a, self.s, self.q), -other.s * sign(other.q)
        if sign_x * sign_y >= 0:
            return sign_x or sign_y
        larger = _sign_of_surd(a * a + self.q - other.q, sign(a) * self.s, 4 * a * a * self.q)
        return sign_x * larger

    def __eq__(self, other):
        return self._sign_of_difference(other) == 0

    def __lt__(self, other):
        return self._sign_of_difference(other) < 0

    __hash__ = None

    def enclose(self, bits):
        """Return fractions low <= self <= high, the root taken to `bits` binary digits."""
        scaled = (self.q.numerator << (2 * bits)) * self.q.denominator
        root, unit = isqrt(scaled), self.q.denominator << bits
        ends = sorted(self.a + self.s * Fraction(step, unit) for step in (root, root + (root * root != scaled)))
        return ends[0], ends[1]


def round_to_float(exact):
    """Return the float64 nearest to a Fraction or Surd (ties to even); infinity beyond the largest."""
    if isinstance(exact, Surd):
        bits = 128
        while True:  # ends: a rational root is enclosed exactly, an irrational one is no tie
            low, high = (round_to_float(end) for end in exact.enclose(bits))
            if low == high:
                return low
            bits *= 2
    try:
        return exact.numerator / exact.denominator
    except OverflowError:
        return float("inf") * sign(exact)


def exact_distance_error(distance, exact):
    """Return |distance - exact| as a Fraction; for a Surd an upper bound that is wrong by less than 2^-1000."""
    if isinstance(exact, Surd):
        return max(abs(Fraction(distance) - end) for end in exact.enclose(1100))
    return abs(Fraction(distance) - exact)


def is_within(distance, bound, exact):
    """Decide |distance - exact| <= bound, exactly, for a Fraction or a Surd.

    An infinite distance stands for any beyond the largest float64, within an infinite bound.
    """
    if bound == float("inf"):
        return abs(distance) < float("inf") or (distance > 0 and round_to_float(exact) == distance)
    distance, bound = Fraction(distance), Fraction(bound)
    return distance - bound <= exact <= distance + bound
