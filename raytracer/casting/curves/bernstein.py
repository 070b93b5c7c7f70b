"""Polynomials in Bernstein form on [0, 1]: (n + 1, k) coefficients of k polynomials of degree n.

    p(u) = sum_i  b_i  C(n, i) u^i (1 - u)^(n - i)

Where they have no change of sign, p has no root in (0, 1); in general there are as many roots as changes of sign, or
fewer by an even number (Descartes' rule for this form).

References
----------
R. T. Farouki, V. T. Rajan, "On the numerical condition of polynomials in Bernstein form", 1987: products, division.
"""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats


def multiply(first: Floats, second: Floats) -> Floats:
    """Return the products of polynomials: c_k = sum over i + j = k of C(m, i) C(n, j) / C(m + n, k) a_i b_j."""
    m, n = len(first) - 1, len(second) - 1
    product = np.zeros((m + n + 1, first.shape[1]))
    for i in range(m + 1):
        for j in range(n + 1):
            product[i + j] += (comb(m, i) * comb(n, j) / comb(m + n, i + j)) * (first[i] * second[j])
    return product


def divide(coefficients: Floats) -> tuple[Floats, Floats]:
    """Return the coefficients on [0, 1/2] and on [1/2, 1], by de Casteljau's rule."""
    left, right = np.empty_like(coefficients), coefficients.copy()
    degree = len(coefficients) - 1
    left[0] = right[0]
    for level in range(1, degree + 1):
        right[: degree + 1 - level] += right[1 : degree + 2 - level]
        right[: degree + 1 - level] *= 0.5
        left[level] = right[0]
    return left, right


def count_changes(coefficients: Floats) -> NDArray[np.intp]:
    """Return how often the signs of coefficients change, (k,); 0 counts as positive."""
    negative = coefficients < 0
    changes: NDArray[np.intp] = (negative[1:] != negative[:-1]).sum(axis=0)
    return changes
