"""Validation of user input: one sentence that names the field, what was expected and what came.

Used where a record is made (the room `scene`) and where a public function receives arrays (`casting`, `rendering`),
never inside kernels.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def _shape_matches(shape: tuple[int, ...], expected: Sequence[int | str]) -> bool:
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
    expected = f"({', '.join(str(size) for size in shape)}{',' if len(shape) == 1 else ''}) {np.dtype(dtype).name}"
    try:
        raw = np.asarray(value)
        if raw.size and not np.can_cast(raw.dtype, dtype, casting="same_kind"):
            raise TypeError
        with np.errstate(over="ignore"):
            array: NDArray[Any] = np.ascontiguousarray(raw, dtype=dtype).reshape(raw.shape)
    except (TypeError, ValueError):
        kind = getattr(value, "dtype", None) or type(value).__name__
        raise ValueError(f"{field}: expected an array {expected}, got {kind}") from None
    if np.issubdtype(dtype, np.integer) and (array != raw).any():
        raise ValueError(f"{field}: expected an array {expected}, got {raw[array != raw].flat[0]}, which does not fit")
    if not _shape_matches(array.shape, shape):
        raise ValueError(f"{field}: expected shape {expected}, got {array.shape}")
    if array is value or array.base is not None:
        array = array.view()
    array.flags.writeable = False
    return array


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
