"""Wavelength: the color of light of one wavelength.

References
----------
Blender, intern/cycles/kernel/svm/wavelength.h: linear between them, and the scale.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from raytracer.arrays.vectors import transform
from raytracer.shading.nodes.operation import Array, Operation
from raytracer.textures.color_matching import RGB_FROM_XYZ, SHORTEST, STEP, read_color_matching

# Brings all colors to 1 at most.
SCALE = 1.0 / 2.52


def find_wavelength_color(wavelength: Any) -> Array:
    """Return linear RGB (..., 3) of wavelengths (...) in nanometres; black where nothing is seen."""
    table = read_color_matching()
    place = (np.asarray(wavelength, float) - SHORTEST) / STEP
    seen = (place > -1.0) & (place < len(table) - 1)
    row = np.clip(np.trunc(place), 0, len(table) - 2).astype(np.intp)
    share = (place - row)[..., np.newaxis]
    xyz = table[row] + (table[row + 1] - table[row]) * share
    color = np.maximum(transform(RGB_FROM_XYZ, xyz) * SCALE, 0.0)
    return np.where(seen[..., np.newaxis], color, 0.0)


OPERATIONS = {"WAVELENGTH": Operation(find_wavelength_color, ("Wavelength",), ("Color",))}
