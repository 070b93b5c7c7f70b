"""Validation of user input: one sentence that names the field, what was expected and what came.

Used where a record is made (the room `scene`) and where a public function receives arrays (`casting`, `rendering`),
never inside kernels.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytracer.arrays.rows import lay_rows


def _shape_matches(shape: tuple[int, ...], expected: Sequence[int | str]) -> bool:
    if shape == expected:
        return True
    if len(shape) != len(expected):
        return False
    sizes: dict[str, int] = {}
    for size, want in zip(shape, expected, strict=True):
        if isinstance(want, str):
            if sizes.setdefault(want, size) != size:
                return False
        elif size != want:
            return False
    return True


def as_array(value: ArrayLike, dtype: type, shape: Sequence[int | str], field: str) -> NDArray[Any]:
    """Return `value` as a C-contiguous read-only array of `dtype` and `shape`.

    Parameters
    ----------
    value : array_like
    dtype : NumPy scalar type; conversions stay within a kind (no integers from floating point, no reals from complex)
    shape : sizes; a letter stands for any size, the same letter for the same size
    field : the name used in the error message, such as ``"Mesh 'Cube': positions"``

    Raises
    ------
    ValueError
        If the value does not convert, does not fit into the integer type, or has another shape.
    """
    try:
        raw = np.asarray(value)
        array = raw if raw.dtype == dtype else _convert(raw, dtype)
        array = array if array.flags.c_contiguous else lay_rows(array)
    except (TypeError, ValueError):
        kind = getattr(value, "dtype", None) or type(value).__name__
        raise ValueError(f"{field}: expected an array {_describe(dtype, shape)}, got {kind}") from None
    if array.dtype != raw.dtype and array.dtype.kind in "iu" and (array != raw).any():
        odd = raw[array != raw].flat[0]
        raise ValueError(f"{field}: expected an array {_describe(dtype, shape)}, got {odd}, which does not fit")
    if not _shape_matches(array.shape, shape):
        raise ValueError(f"{field}: expected shape {_describe(dtype, shape)}, got {array.shape}")
    if array is raw or array.base is not None:  # the caller's, or that of a table whose column it is
        array = array.view()
    array.flags.writeable = False
    return array


def as_rows(vectors: ArrayLike, field: str) -> NDArray[Any]:
    """Return (3,) or (n, 3) vectors as (n, 3) float64; an empty list stands for none. ValueError as `as_array`."""
    try:
        rows = np.asarray(vectors)
    except ValueError:  # rows of different lengths, which `as_array` says in its own words
        return as_array(vectors, np.float64, ("n", 3), field)
    rows = np.zeros((0, 3)) if rows.shape == (0,) else np.atleast_2d(rows)
    return as_array(rows, np.float64, ("n", 3), field)


def _describe(dtype: type, shape: Sequence[int | str]) -> str:
    """Return what is expected, for a sentence: only errors need it, and thousands of arrays have none."""
    return f"({', '.join(str(size) for size in shape)}{',' if len(shape) == 1 else ''}) {np.dtype(dtype).name}"


def _convert(raw: NDArray[Any], dtype: type) -> NDArray[Any]:
    """Return an array of another type; TypeError where that is of another kind."""
    if np.can_cast(raw.dtype, dtype):
        return raw.astype(dtype, order="C")
    if raw.size and not np.can_cast(raw.dtype, dtype, casting="same_kind"):
        raise TypeError
    with np.errstate(over="ignore"):
        return raw.astype(dtype, order="C")


def require_finite(array: NDArray[Any], field: str) -> None:
    """Raise ValueError naming the first row that holds NaN or infinity."""
    finite = np.isfinite(array)
    if not finite.all():
        row = int(np.argwhere(~finite)[0][0]) if array.ndim else 0
        raise ValueError(f"{field}: expected finite numbers, got {array[row] if array.ndim else array} at row {row}")


def require_range(array: NDArray[Any], low: float, high: float, field: str) -> None:
    """Raise ValueError if any element leaves the closed interval [low, high]; NaN leaves it."""
    inside = (array >= low) & (array <= high)
    if not inside.all():
        worst = np.asarray(array)[~inside].flat[0]
        raise ValueError(f"{field}: expected numbers from {low:g} to {high:g}, got {worst:g}")


def require_choice(value: str, choices: Sequence[str], field: str) -> None:
    """Raise ValueError unless `value` is one of `choices`."""
    if not isinstance(value, str) or value not in choices:
        got = repr(value) if isinstance(value, str) else type(value).__name__
        raise ValueError(f"{field}: expected one of {', '.join(choices)}, got {got}")
