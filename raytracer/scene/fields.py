"""What the constructors of records share: fields replaced by checked, read-only arrays and plain numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.checks import as_array, require_finite, require_range

# The classes of rays that may see an object or a light, as bits; shadow rays look for light from a surface or a medium,
# those of volumes have been scattered by one.
SEEN_BY = {"camera": 1, "diffuse": 2, "glossy": 4, "transmission": 8, "shadow": 16, "volume": 32}
SEEN_BY_ALL = sum(SEEN_BY.values())
# Each object belongs to one of this many sets for light, and to one for shadow; a light or an emissive object lights
# some of the former and is blocked by some of the latter, bits of a number.
SET_COUNT = 63
ALL_SETS = 2**SET_COUNT - 1
# What pictures, which are float32, can show; and products of a few such numbers are finite in float64.
LARGEST = float(np.finfo(np.float32).max)
LARGEST_INDEX = int(np.iinfo(np.int32).max)


def set_field(record: Any, name: str, value: Any) -> None:
    object.__setattr__(record, name, value)


def set_array(record: Any, name: str, dtype: type, shape: Sequence[int | str], label: str) -> NDArray[Any]:
    """Replace a field by its checked, read-only array."""
    array = as_array(getattr(record, name), dtype, shape, f"{label}: {name}")
    if array.dtype.kind == "f":
        require_finite(array, f"{label}: {name}")
    set_field(record, name, array)
    return array


def set_light(record: Any, name: str, label: str) -> NDArray[Any]:
    """Replace a field by a linear RGB triple; a single number stands for grey, and what is below 0 takes light away."""
    value = getattr(record, name)
    set_field(record, name, np.full(3, value) if np.ndim(value) == 0 else value)
    array = set_array(record, name, np.float64, (3,), label)
    require_range(array, -LARGEST, LARGEST, f"{label}: {name}")
    return array


def set_color(record: Any, name: str, label: str) -> None:
    """Replace a field by a non-negative linear RGB triple; a single number stands for grey."""
    require_range(set_light(record, name, label), 0.0, LARGEST, f"{label}: {name}")


def set_number(record: Any, name: str, low: float, high: float, label: str) -> None:
    limits = max(low, -LARGEST), min(high, LARGEST)
    require_range(set_array(record, name, np.float64, (), label), *limits, f"{label}: {name}")
    set_field(record, name, float(getattr(record, name)))


def set_flags(record: Any, names: Sequence[str], label: str) -> None:
    """Check fields that are True or False."""
    for name in names:
        set_field(record, name, bool(set_array(record, name, np.bool_, (), label)))


def set_count(record: Any, name: str, label: str) -> None:
    """Check a field that is a whole number of 0 or more, such as an index."""
    value = set_array(record, name, np.int32, (), label)
    require_range(value, 0, LARGEST_INDEX, f"{label}: {name}")
    set_field(record, name, int(value))


def require_text(value: Any, field: str) -> None:
    """Raise ValueError unless `value` is text."""
    if not isinstance(value, str):
        raise ValueError(f"{field}: expected text, got {type(value).__name__}")


def set_seen_by(record: Any, label: str) -> None:
    """Check the field `seen_by`: one number of bits of SEEN_BY."""
    mask = set_array(record, "seen_by", np.int32, (), label)
    require_range(mask, 0, SEEN_BY_ALL, f"{label}: seen_by")
    set_field(record, "seen_by", int(mask))


def set_linked_sets(record: Any, label: str) -> None:
    """Check the fields `receivers` and `blockers`: sets of objects, each as bits of one number."""
    for name in ("receivers", "blockers"):
        mask = set_array(record, name, np.int64, (), label)
        require_range(mask, 0, ALL_SETS, f"{label}: {name}")
        set_field(record, name, int(mask))


def set_properties(record: Any, shape: Sequence[int | str], label: str) -> None:
    """Replace the field `properties` by a table of checked, read-only arrays of one shape."""
    if not isinstance(record.properties, Mapping):
        raise ValueError(f"{label}: properties: expected a table, got {type(record.properties).__name__}")
    table = {}
    for name, values in record.properties.items():
        require_text(name, f"{label}: properties")
        table[name] = as_array(values, np.float64, shape, f"{label}: property {name!r}")
        require_finite(table[name], f"{label}: property {name!r}")
    set_field(record, "properties", table)


def set_attributes(record: Any, points: int, triangles: int | None, label: str, field: str = "attributes") -> None:
    """Attributes have (k) numbers of each point, or (3, k) of each triangle where a record has triangles."""
    table, checked = getattr(record, field), {}
    if not isinstance(table, Mapping):
        raise ValueError(f"{label}: {field}: expected a table, got {type(table).__name__}")
    for name, values in table.items():
        require_text(name, f"{label}: {field}")
        rows = (points,) if triangles is None or np.ndim(values) != 3 else (triangles, 3)
        array = as_array(np.asarray(values), np.float64, (*rows, "k"), f"{label}: attribute {name!r}")
        require_range(np.asarray(array.shape[-1]), 1, 4, f"{label}: attribute {name!r}: width")
        require_finite(array, f"{label}: attribute {name!r}")
        checked[name] = array
    set_field(record, field, checked)


def set_material(record: Any, count: int, label: str) -> None:
    """Material indices are one int for all primitives, or one per primitive."""
    if type(record.material) is int and 0 <= record.material <= LARGEST_INDEX:
        return  # as thousands of meshes have it
    if np.ndim(record.material) == 0:
        lowest = int(set_array(record, "material", np.int32, (), label))
        set_field(record, "material", lowest)
    else:
        lowest = int(set_array(record, "material", np.int32, (count,), label).min(initial=0))
    if lowest < 0:
        raise ValueError(f"{label}: material: expected indices of 0 or more, got {lowest}")


def set_object(record: Any, label: str) -> None:
    """Check what a group of primitives is as one object: the fields that Instances has of each."""
    set_count(record, "pass_index", label)
    set_flags(record, ("holdout", "shadow_catcher"), label)
    set_seen_by(record, label)
    set_linked_sets(record, label)
    for name in ("light_set", "shadow_set"):
        require_range(set_array(record, name, np.int32, (), label), 0, SET_COUNT - 1, f"{label}: {name}")
        set_field(record, name, int(getattr(record, name)))
    set_number(record, "random", 0.0, 1.0, label)
    set_array(record, "color", np.float64, (4,), label)
    set_properties(record, (4,), label)


def make_records(value: Any, kind: Any, field: str) -> tuple[Any, ...]:
    """Return records as a tuple; one alone, or None, stands for a sequence of one or none.

    Raises
    ------
    ValueError
        If something else than a record of that kind is among them.
    """
    if isinstance(value, kind):
        return (value,)
    records = tuple(value) if isinstance(value, Iterable) else () if value is None else (value,)
    for record in records:
        if not isinstance(record, kind):
            wanted = getattr(kind, "__name__", "light")
            raise ValueError(f"{field}: expected {wanted} records, got {type(record).__name__}")
    return records
