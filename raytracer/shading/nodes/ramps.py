"""Color Ramp and curves: tables of what Blender itself evaluates, read between their entries.

The add-on fills the tables with TABLE_SIZE entries, as Cycles does, so that every interpolation and color mode is
Blender's own.

References
----------
Blender, intern/cycles/kernel/svm/ramp_util.h.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from raytracer.shading.nodes.operation import Array, Operation, mix, saturate, spread, stack

# An entry for each 256th, and the end: Cycles' tables, said to be of 256, have one more.
TABLE_SIZE = 257


def read_table(table: Array, position: Any, interpolate: bool = True, extrapolate: bool = False) -> Array:
    """Return the entries (..., k) of a table (s, k) over 0 to 1 at positions (...), straight lines between them.

    Outside the end's entry holds, or its slope goes on.
    """
    position = np.nan_to_num(np.asarray(position, dtype=np.float64))
    at = saturate(position) * (len(table) - 1)
    entry = at.astype(np.int64)
    if not interpolate:
        return table[entry]
    inside = mix(table[entry], table[np.minimum(entry + 1, len(table) - 1)], spread(at - entry))
    if not extrapolate:
        return inside
    steps = (len(table) - 1) * spread(position)
    below, above = (
        table[0] + (table[1] - table[0]) * steps,
        table[-1] + (table[-1] - table[-2]) * (steps - len(table) + 1),
    )
    return np.where(spread(position) < 0, below, np.where(spread(position) > 1, above, inside))


def read_ramp(factor: Any, *, table: Array, interpolate: bool) -> tuple[Array, Array]:
    """Color and alpha of a Color Ramp."""
    entry = read_table(table, factor, interpolate)
    return entry[..., :3], entry[..., 3]


def apply_curves(factor: Any, color: Any, *, table: Array, low: float, high: float, extrapolate: bool) -> Array:
    """Each component through its own curve, over arguments from low to high, blended with what came in."""
    position = (np.asarray(color, float) - low) / (high - low)
    curves = [read_table(table[:, k : k + 1], position[..., k], extrapolate=extrapolate)[..., 0] for k in range(3)]
    return mix(color, stack(*curves), spread(factor))


def apply_curve(factor: Any, value: Any, *, table: Array, low: float, high: float, extrapolate: bool) -> Array:
    """A number through a curve."""
    position = (np.asarray(value, float) - low) / (high - low)
    return mix(value, read_table(table, position, extrapolate=extrapolate)[..., 0], factor)


_CURVE = ("table", "low", "high", "extrapolate")

OPERATIONS = {
    "VALTORGB": Operation(read_ramp, ("Fac",), ("Color", "Alpha"), ("table", "interpolate")),
    "CURVE_RGB": Operation(apply_curves, ("Fac", "Color"), ("Color",), _CURVE),
    "CURVE_VEC": Operation(apply_curves, ("Fac", "Vector"), ("Vector",), _CURVE),
    "CURVE_FLOAT": Operation(apply_curve, ("Factor", "Value"), ("Value",), _CURVE),
}
