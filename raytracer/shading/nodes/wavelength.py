"""Wavelength: the color of light of one wavelength.

References
----------
CIE 1931 standard colorimetric observer, steps of 5 nm, to four digits.
Blender, intern/cycles/kernel/svm/wavelength.h: linear between them, and the scale.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import transform
from raytracer.shading.nodes.blackbody import RGB_FROM_XYZ
from raytracer.shading.nodes.operation import Array, Operation

DATA = Path(__file__).with_name("color_matching.txt")
SHORTEST, STEP = 380.0, 5.0  # nanometres, of the table's rows
# Brings all colors to 1 at most.
SCALE = 1.0 / 2.52


@cache
def read_color_matching() -> Floats:
    """Return (81, 3) the observer's X, Y and Z."""
    return np.loadtxt(DATA)


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
