"""What the constructors of records share: fields replaced by checked, read-only arrays and plain numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.checks import as_array, require_finite, require_range

# The classes of rays that may see an object or a light, as bits; shadow rays look for light from a surface.
SEEN_BY = {"camera": 1, "diffuse": 2, "glossy": 4, "transmission": 8, "shadow": 16}
SEEN_BY_ALL = sum(SEEN_BY.values())
# Each object belongs to one of so many sets; what shines lights some of them, as bits of a number.
SET_COUNT = 63
ALL_SETS = 2**SET_COUNT - 1


def set_field(record: Any, name: str, value: Any) -> None:
    object.__setattr__(record, name, value)


def set_array(record: Any, name: str, dtype: type, shape: Sequence[int | str], label: str) -> NDArray[Any]:
    """Replace a field by its checked, read-only array."""
    array = as_array(getattr(record, name), dtype, shape, f"{label}: {name}")
    if np.issubdtype(dtype, np.floating):
        require_finite(array, f"{label}: {name}")
    set_field(record, name, array)
    return array


def set_color(record: Any, name: str, label: str) -> None:
    """Replace a field by a non-negative linear RGB triple; a single number stands for grey."""
    value = getattr(record, name)
    set_field(record, name, np.full(3, value, dtype=np.float64) if np.ndim(value) == 0 else value)
    require_range(set_array(record, name, np.float64, (3,), label), 0.0, np.inf, f"{label}: {name}")


def set_number(record: Any, name: str, low: float, high: float, label: str) -> None:
    require_range(set_array(record, name, np.float64, (), label), low, high, f"{label}: {name}")
    set_field(record, name, float(getattr(record, name)))


def set_seen_by(record: Any, label: str) -> None:
    """Check the field `seen_by`: one number of bits of SEEN_BY."""
    mask = set_array(record, "seen_by", np.int32, (), label)
    require_range(mask, 0, SEEN_BY_ALL, f"{label}: seen_by")
    set_field(record, "seen_by", int(mask))


def set_receivers(record: Any, label: str) -> None:
    """Check the field `receivers`: the sets of objects that are lit, as bits of one number."""
    mask = set_array(record, "receivers", np.int64, (), label)
    require_range(mask, 0, ALL_SETS, f"{label}: receivers")
    set_field(record, "receivers", int(mask))
