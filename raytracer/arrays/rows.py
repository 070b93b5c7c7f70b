"""Rows of a few numbers, (n, 3) mostly: selections and reductions column by column.

NumPy's own take many times as long for short rows: 32,768 rows of three, nanoseconds a row, `values[index]` 14,
`values.take(index, axis=0)` 4; `mask.any(axis=1)` 24, `values.mean(axis=1)` 15, of the columns 2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats


def take_rows(values: NDArray[Any], rows: Any) -> NDArray[Any]:
    """Return `values[rows]` for a slice, an index array or a boolean array (n,) of rows."""
    if isinstance(rows, slice) or values.ndim == 1:
        return values[rows]
    rows = np.asarray(rows)
    return values.take(np.flatnonzero(rows) if rows.dtype == np.bool_ else rows, axis=0)


def any_column(mask: Booleans) -> Booleans:
    """Return (n,) True where any of a few columns of (n, k) is."""
    found = mask[:, 0].copy()
    for column in mask.T[1:]:
        found |= column
    return found


def all_columns(mask: Booleans) -> Booleans:
    """Return (n,) True where all of a few columns of (n, k) are."""
    found = mask[:, 0].copy()
    for column in mask.T[1:]:
        found &= column
    return found


def sum_columns(values: NDArray[Any]) -> NDArray[Any]:
    """Return the sums (n,) of a few columns of (n, k), from left to right."""
    total = values[:, 0].copy()
    for column in values.T[1:]:
        total += column
    return total


def mean_column(values: Floats) -> Floats:
    """Return the means (n,) of a few columns of (n, k)."""
    return sum_columns(values) / values.shape[1]


def largest_column(values: Floats) -> Floats:
    """Return the largest (n,) of a few columns of (n, k); NaN where any is."""
    largest = values[:, 0].copy()
    for column in values.T[1:]:
        np.maximum(largest, column, out=largest)
    return largest
