"""Rows of a few numbers, (n, 3) mostly: selections and reductions column by column.

NumPy's own take many times as long for short rows: 32,768 rows of three, nanoseconds a row, `values[index]` 14,
`values.take(index, axis=0)` 4; `mask.any(axis=1)` 24, `values.mean(axis=1)` 15, of the columns 2.

What shading works on therefore lies column by column in memory (Fortran order), in arrays that are (n, 3) all the same:
what is made of such arrays lies so as well, and every expression reads as before, with the same bits. A row takes, by
rows and by columns: `where(s[:, None], v, w)` 8.0 and 1.7 ns, `s[:, None] * v` 2.7 and 0.5, `dot` 2.1 and 1.1.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Indices

# From so many rows on columns are copied one after the other, in a third of the time that NumPy takes at once.
MANY_ROWS = 2048
# From so many indices on a look at all of them costs less than a third of the time of taking three columns.
MANY_INDICES = 8192

# What `take` does about indices that are out of range.
Mode = Literal["raise", "wrap"]


def lay_columns(values: NDArray[Any]) -> NDArray[Any]:
    """Return (n, k) with its columns one after the other in memory."""
    return np.asfortranarray(values)


def lay_rows(values: NDArray[Any]) -> NDArray[Any]:
    """Return (n, k) with its rows one after the other in memory."""
    if values.ndim != 2 or len(values) < MANY_ROWS or values.flags.c_contiguous:
        return np.ascontiguousarray(values)
    rows = np.empty(values.shape, values.dtype)
    for target, column in zip(rows.T, values.T, strict=True):
        target[:] = column
    return rows


def split_columns(values: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    """Return the columns (...) of an array (..., k), each without gaps in memory.

    NumPy has sines, arctangents and powers of its own, but takes the C library's, often an ulp off, where an operand
    and the result may overlap; it counts the gap behind a view's last number to the view. So where memory happened to
    be free would decide about bits of what is worked out from views like `values[:, 2]`.
    """
    return tuple(column if column.flags.c_contiguous else column.copy() for column in np.moveaxis(values, -1, 0))


def make_zeros(count: int, width: int = 3) -> Floats:
    """Return zeros (n, k), column by column in memory."""
    return np.zeros((width, count)).T


def join_columns(*columns: Floats) -> Floats:
    """Return (n, k) of columns (n,), one after the other in memory."""
    joined = np.empty((len(columns), len(columns[0])))
    for row, column in zip(joined, columns, strict=True):
        row[:] = column
    return joined.T


def repeat_column(column: Floats) -> Floats:
    """Return (n, 3) of a column (n,) three times, one after the other in memory."""
    return join_columns(column, column, column)


def scale_vectors(vectors: Floats, factors: Floats) -> Floats:
    """Return vectors, (3,) one for all or (n, 3), times factors (n,): (n, 3), column by column in memory."""
    return np.multiply(np.atleast_2d(vectors).T, factors, order="C").T


def shorten_rows(rows: Indices, count: int) -> Indices | slice:
    """Return ascending rows (k,) of `count`, none twice; as a slice, which copies nothing, where they are all."""
    return slice(None) if len(rows) == count else rows


def take_rows(values: NDArray[Any], rows: Any, mode: Mode | None = None) -> NDArray[Any]:
    """Return `values[rows]` for a slice, an index array or a boolean array (n,), in the same order of memory.

    mode : of `find_mode`, where that is known
    """
    if values.ndim == 1:
        return values.take(rows, mode=mode) if mode == "wrap" else values[rows]
    if isinstance(rows, slice):
        return values[rows]
    rows = np.asarray(rows)
    rows = rows.nonzero()[0] if rows.dtype == np.bool_ else rows
    mode = mode or find_mode(rows, len(values))
    # A table that is not contiguous `take` would copy.
    if values.ndim == 2 and values.flags.f_contiguous:
        return values.T.take(rows, axis=1, mode=mode).T
    if values.ndim == 2 and values.strides[0] == values.itemsize:  # a slice of columns
        return np.stack([column.take(rows, mode=mode) for column in values.T]).T
    return values.take(rows, axis=0, mode=mode)


def find_mode(rows: Any, count: int) -> Mode:
    """Return how `take` shall treat rows of `count`: of many that are all there it need not ask of each whether it is,
    column by column, which takes a third of its time."""
    if not isinstance(rows, np.ndarray) or rows.size < MANY_INDICES or rows.dtype != np.int64:
        return "raise"
    return "wrap" if rows.view(np.uint64).max() < count else "raise"  # negative ones are huge then


def put_rows(target: NDArray[Any], rows: Indices | slice, values: NDArray[Any] | float) -> None:
    """Do `target[rows] = values` for a target (n, k), column by column; values : (m, k), or one number for all."""
    for number, column in enumerate(target.T):
        column[rows] = values[:, number] if isinstance(values, np.ndarray) else values


def add_rows(target: NDArray[Any], rows: Indices | slice, values: NDArray[Any]) -> None:
    """Do `target[rows] += values` for a target (n, k), column by column; values : (m, k)."""
    for column, added in zip(target.T, values.T, strict=True):
        column[rows] += added


def pick_columns(values: NDArray[Any], columns: Indices) -> NDArray[Any]:
    """Return (n,) of each row of (n, k) the value in its column (n,); -1 is the last, as anywhere."""
    place = columns * len(values) + np.arange(len(values))
    return values.T.ravel().take(place, mode="wrap")


def divide_where(numerator: Floats | float, denominator: Floats, mask: Booleans, elsewhere: float = 0.0) -> Floats:
    """Return numerator / denominator where a mask (n,) is True, mostly everywhere; one number elsewhere."""
    if mask.all():
        return np.divide(numerator, denominator)
    return np.divide(numerator, denominator, out=np.full(mask.shape, elsewhere), where=mask)


def keep_rows(values: Floats, mask: Booleans) -> Floats:
    """Return values (n,) where a mask (n,) is True, and 0 elsewhere, which takes as long whatever the mask is.

    `where` branches row by row: 3 to 4 ns where no processor foresees which, of this 0.4.
    """
    return (values.view(np.int64) & _spread_bits(mask)).view(np.float64)


def exchange(first: Floats, second: Floats, mask: Booleans) -> tuple[Floats, Floats]:
    """Return two columns (n,), exchanged where a mask (n,) is True, without branches as `keep_rows`."""
    ones, others = first.view(np.int64), second.view(np.int64)
    change = ones ^ others
    change &= _spread_bits(mask)
    return (ones ^ change).view(np.float64), (others ^ change).view(np.float64)


def _spread_bits(mask: Booleans) -> NDArray[np.int64]:
    """Return (n,) int64, all bits set where a mask (n,) is True."""
    bits = mask.astype(np.int64)
    return np.negative(bits, out=bits)


def find_sign(mask: Booleans) -> Floats:
    """Return 1 where a mask (n,) is True, and -1 elsewhere."""
    return 2.0 * mask - 1.0


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
