"""Arithmetic on pairs of float64 (high, low): about 106 bits, elementwise over arrays.

A pair stands for the exact sum high + low with |low| <= ulp(high) / 2. The building blocks and their bounds are those
of Dekker, "A floating-point technique for extending the available precision" (1971) and of Joldes, Muller and Popescu,
"Tight and rigorous error bounds for basic building blocks of double-word arithmetic" (2017), u = 2^-53:
`two_sum`, `two_difference` and `two_product` are exact; a product of pairs is off by at most 8 u^2 of itself, a sum or
difference by at most 4 u^2 (|x| + |y|).

Exact only without overflow and underflow: see `LARGEST` and `SMALLEST_PERMANENT`.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Floats

Pair = tuple[Floats, Floats]


PRODUCT_BOUND = 8 * 2.0**-106


SUM_BOUND = 4 * 2.0**-106


# Inputs up to LARGEST keep three-factor products clear of overflow; a term that underflows is then off by less than
# 2^-1074 LARGEST, negligible beside 2^-106 of a permanent above SMALLEST_PERMANENT.
LARGEST = 2.0**200


SMALLEST_PERMANENT = 2.0**-700


_SPLITTER = 2.0**27 + 1


def two_sum(x: Floats, y: Floats) -> Pair:
    """x + y exactly (Knuth)."""
    total = x + y
    shadow = total - x
    return total, (x - (total - shadow)) + (y - shadow)


def two_difference(x: Floats, y: Floats) -> Pair:
    """x - y exactly."""
    return two_sum(x, -y)


def split(x: Floats) -> Pair:
    """x as a sum of two floats of 26 bits (Veltkamp); the second is at most 2^-26 |x|. Overflows beyond 2^996."""
    shifted = _SPLITTER * x
    high = shifted - (shifted - x)
    return high, x - high


def two_product(x: Floats, y: Floats) -> Pair:
    """x y exactly (Dekker)."""
    product = x * y
    x_high, x_low = split(x)
    y_high, y_low = split(y)
    error = ((x_high * y_high - product) + x_high * y_low + x_low * y_high) + x_low * y_low
    return product, error


def _renormalise(high: Floats, low: Floats) -> Pair:
    total = high + low
    return total, low - (total - high)


def add(x: Pair, y: Pair) -> Pair:
    """x + y within SUM_BOUND (|x| + |y|)."""
    high, low = two_sum(x[0], y[0])
    return _renormalise(high, low + (x[1] + y[1]))


def subtract(x: Pair, y: Pair) -> Pair:
    """x - y within SUM_BOUND (|x| + |y|)."""
    return add(x, (-y[0], -y[1]))


def multiply(x: Pair, y: Pair) -> Pair:
    """x y within PRODUCT_BOUND |x y|."""
    high, low = two_product(x[0], y[0])
    return _renormalise(high, low + (x[0] * y[1] + x[1] * y[0]))


def dot(p: Pair, q: Pair) -> Pair:
    """p . q of planes (3, n): pairs of arrays."""
    terms = multiply(p, q)
    partial = add((terms[0][0], terms[1][0]), (terms[0][1], terms[1][1]))
    return add(partial, (terms[0][2], terms[1][2]))


def cross(p: Pair, q: Pair) -> Pair:
    """p x q of planes (3, n): pairs of arrays."""
    following, preceding = [1, 2, 0], [2, 0, 1]
    left = multiply((p[0][following], p[1][following]), (q[0][preceding], q[1][preceding]))
    right = multiply((p[0][preceding], p[1][preceding]), (q[0][following], q[1][following]))
    return subtract(left, right)


def exact(x: Floats) -> Pair:
    """A float64 as a pair."""
    return x, np.zeros_like(x)
