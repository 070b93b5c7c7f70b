"""Blackbody: the color of a body that glows at a temperature, of luminance 1.

References
----------
M. Planck, "Ueber das Gesetz der Energieverteilung im Normalspectrum", 1901; CIE 1931 standard colorimetric observer;
IEC 61966-2-1 (the primaries of Rec. 709 and its white).
Blender, intern/cycles/kernel/svm/math_util.h: that colors are constant beyond the ends of its fit.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from raytracer.arrays.vectors import transform
from raytracer.lecture import dot
from raytracer.shading.nodes.operation import Array, Operation
from raytracer.textures.color_matching import RGB_FROM_XYZ
from raytracer.textures.sky_spectra import COLOR_MATCHING

# Metres: of the rows of COLOR_MATCHING.
WAVELENGTHS = 1e-9 * np.linspace(380.0, 780.0, len(COLOR_MATCHING))
# h c / k, metres kelvin (exact in the SI of 2019, to the digits given).
SECOND_RADIATION_CONSTANT = 1.438776877e-2
# Cycles' colors change from the first to the second, kelvin.
COLDEST, HOTTEST = 800.0, 12000.0


def find_blackbody_color(temperature: Any) -> Array:
    """Return linear RGB (..., 3) of temperatures (...), of luminance 1; below 1900 K its blue is negative, for no sum
    of the primaries is as red.

    Planck's law, B ~ 1 / (w^5 (exp(c2 / (w T)) - 1)) at wavelengths w, seen by the standard observer.
    """
    kelvin = np.clip(np.asarray(temperature, np.float64), COLDEST, HOTTEST)[..., np.newaxis]
    radiance = WAVELENGTHS**-5 / np.expm1(SECOND_RADIATION_CONSTANT / (WAVELENGTHS * kelvin))
    x, y, z = (dot(radiance, matching) for matching in COLOR_MATCHING.T)
    relative = np.stack([x / y, np.ones_like(y), z / y], axis=-1)
    return transform(RGB_FROM_XYZ, relative)


def show_blackbody(temperature: Any) -> Array:
    """Return the color that the node shows, (..., 3): what is negative is cut."""
    return np.maximum(find_blackbody_color(temperature), 0.0)


OPERATIONS = {"BLACKBODY": Operation(show_blackbody, ("Temperature",), ("Color",))}
