"""IES Texture: how strongly a luminaire shines into a direction.

References
----------
Blender, intern/cycles/kernel/svm/ies.h: how directions become angles.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from raytracer.arrays.rows import split_columns
from raytracer.arrays.vectors import normalize
from raytracer.shading.nodes.operation import Array, Operation
from raytracer.textures.ies import MISSING, Luminaire, find_intensity


def read_luminaire(vector: Any, strength: Any, *, horizontal: Array, vertical: Array, intensity: Array) -> Array:
    """The strength times the intensity towards a direction, z up, of the tables of a Luminaire; of empty ones 100."""
    if not np.size(intensity):
        return np.asarray(strength, float) * MISSING
    x, y, z = split_columns(normalize(np.atleast_2d(np.asarray(vector, float))))
    around, down = np.arctan2(x, y) + np.pi, np.arccos(np.clip(-z, -1.0, 1.0))
    found = find_intensity(Luminaire(horizontal, vertical, intensity), around, down)
    return strength * (found if np.ndim(vector) == 2 else found[0])


OPERATIONS = {
    "TEX_IES": Operation(
        read_luminaire,
        ("Vector", "Strength"),
        ("Fac",),
        ("horizontal", "vertical", "intensity"),
        links={"Vector": "TEX_COORD Normal"},
    )
}
