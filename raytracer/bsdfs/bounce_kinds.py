"""Kinds of bounces, as bits, and how many of each a path has taken.

References
----------
Blender, intern/cycles/kernel/integrator/path_state.h: which bounces count as what.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.rows import lay_columns, sum_columns, take_rows
from raytracer.arrays.types import Counts, Floats, Kinds

# The bits of a kind. A reflection lacks TRANSMITTED, and is DIFFUSE or GLOSSY; what is SINGULAR is GLOSSY as well.
# What a medium has scattered is nothing else.
STRAIGHT, DIFFUSE, GLOSSY, SINGULAR, TRANSMITTED, SCATTERED = 0, 1, 2, 4, 8, 16


# Counts (n, 4) of bounces: diffuse reflections, glossy reflections, transmissions of any kind, scattering by media.
COUNTED = ("diffuse", "glossy", "transmission", "volume")


def _count_one(kind: int) -> list[bool]:
    """Return the counts of one bounce."""
    column = 3 if kind & SCATTERED else 2 if kind & TRANSMITTED else 0 if kind & DIFFUSE else 1
    return [kind != STRAIGHT and column == other for other in range(len(COUNTED))]


# What a bounce of each kind adds to the counts.
ADDED_BY_KIND = lay_columns(np.array([_count_one(kind) for kind in range(17)], np.int32))


def count_bounces(counts: Counts, kind: Kinds | int) -> Counts:
    """Return the counts (n, 4) of paths after a bounce of a `kind`, one for all or (n,); straight passages count
    nowhere."""
    return counts + (ADDED_BY_KIND[kind] if isinstance(kind, int) else take_rows(ADDED_BY_KIND, kind))


def describe_kinds(kind: Kinds, counts: Counts) -> dict[str, Floats]:
    """Return what the Light Path node tells of rays of each `kind` (n,), as 0 or 1, and depths; all (n,) float64."""
    transmitted = (kind & TRANSMITTED) > 0
    flags = {
        "camera": kind == STRAIGHT,
        "diffuse": (kind & DIFFUSE) > 0,
        "glossy": (kind & GLOSSY) > 0,
        "singular": (kind & SINGULAR) > 0,
        "volume": (kind & SCATTERED) > 0,
        "reflection": (kind != STRAIGHT) & (kind != SCATTERED) & ~transmitted,
        "transmission": transmitted,
        "depth": sum_columns(counts),
        **{f"{name}_depth": counts[:, column] for column, name in enumerate(COUNTED)},
    }
    return {name: values.astype(np.float64) for name, values in flags.items()}
