"""The power of Student's t: by how much means have to differ so that a test finds it.

A test of significance passes what it cannot see. Of d = mean_a - mean_b with a true value D and a standard error e that
is estimated with n degrees of freedom, d / e follows the noncentral t distribution of D / e: with Z standard normal and
S^2 = chi^2(n) / n, both independent,

    T = (Z + D / e) / S,    P(|T| >= q) = E[Phi(D / e - q S) + Phi(-D / e - q S)].

Where q is large, as the correction for thousands of tests makes it, most of what T does comes from S: the familiar sum
of two quantiles, q + z, is too small a D / e. So the expectation is computed, by quadrature over S, whose density is
c s^(n - 1) exp(-n s^2 / 2).

References
----------
Johnson, Kotz, Balakrishnan, "Continuous Univariate Distributions", volume 2, 1995, chapter 31 (noncentral t).
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from .metrics import Floats, student_quantile

# The probability with which a difference is found that is called the smallest one found.
POWER = 0.9
# Points of the quadrature over S, and where it ends, in standard deviations of S, 1 / sqrt(2 n), from its mean of about
# 1. Right to 1e-3 of the probability with n of 2 or more (a test has the closed form for n = 2).
POINTS = 256
REACH = 8.0


@cache
def list_nodes() -> tuple[Floats, Floats]:
    """Return nodes and weights of the Gauss-Legendre rule on -1 ... 1."""
    return np.polynomial.legendre.leggauss(POINTS)


def find_power(shift: float, quantile: float, degrees: int) -> float:
    """Return P(|T| >= quantile) for the noncentral t of `shift` standard errors with whole `degrees` of freedom."""
    half = REACH / math.sqrt(2.0 * degrees)
    nodes, weights = list_nodes()
    low, high = max(0.0, 1.0 - half), 1.0 + half
    s = (low + high + (high - low) * nodes) / 2.0
    density = weights * np.exp((degrees - 1) * np.log(s) - degrees * (s**2 - 1.0) / 2.0)
    found = normal_below(shift - quantile * s) + normal_below(-shift - quantile * s)
    return float(np.sum(density * found) / np.sum(density))


def normal_below(value: Floats) -> Floats:
    """Return Phi(value), the probability that a standard normal number is below."""
    return np.array([math.erfc(-each / math.sqrt(2.0)) / 2.0 for each in value.tolist()])


@cache
def find_shift(significance: float, degrees: int, power: float = POWER) -> float:
    """Return how many standard errors a difference needs so that a test of `significance` finds it with `power`."""
    quantile = student_quantile(significance, degrees)
    low, high = 0.0, 1.0
    while find_power(high, quantile, degrees) < power:
        low, high = high, 2.0 * high
    while high - low > SHIFT_STEP * high:
        middle = (low + high) / 2.0
        low, high = (middle, high) if find_power(middle, quantile, degrees) < power else (low, middle)
    return high


# Standard errors are known to some percent themselves.
SHIFT_STEP = 1e-4


def find_shifts(significance: float, degrees: NDArray[np.integer], power: float = POWER) -> Floats:
    """Return `find_shift` for each of an array of whole degrees of freedom."""
    values, places = np.unique(degrees, return_inverse=True)
    shifts = np.array([find_shift(significance, int(count), power) for count in values])
    return shifts[places].reshape(np.shape(degrees))
