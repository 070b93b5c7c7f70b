"""Color spaces that images may be in, to linear Rec. 709 with white D65, Blender's default working space.

Matrices follow from the chromaticities of primaries and white; white is adapted by Bradford's method.

References
----------
ITU-R BT.709, BT.2020; SMPTE RP 431-2 and EG 432-1 (P3); SMPTE ST 2065-1, Academy S-2014-004 (ACES).
B. Lindbloom, "RGB/XYZ Matrices" and "Chromatic Adaptation".
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.textures.image import decode_srgb

Decoder = Callable[[NDArray[np.float32]], Floats]


D65, D60, EQUAL = (0.3127, 0.3290), (0.32168, 0.33767), (1 / 3, 1 / 3)


REC709 = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))


REC2020 = ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046))


P3 = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060))


AP0 = ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.0770))


AP1 = ((0.713, 0.293), (0.165, 0.830), (0.128, 0.044))


ADOBE = ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06))


BRADFORD = np.array(((0.8951, 0.2664, -0.1614), (-0.7502, 1.7135, 0.0367), (0.0389, -0.0685, 1.0296)))


# Primaries (None for XYZ itself) and white of linear spaces.
LINEAR_SPACES = {
    "Linear Rec.709": (REC709, D65),
    "Linear": (REC709, D65),
    "scene_linear": (REC709, D65),
    "Linear Rec.2020": (REC2020, D65),
    "Linear DCI-P3 D65": (P3, D65),
    "Linear Adobe RGB": (ADOBE, D65),
    "ACEScg": (AP1, D60),
    "ACES2065-1": (AP0, D60),
    "Linear CIE-XYZ D65": (None, D65),
    "Linear CIE-XYZ E": (None, EQUAL),
}


# Encoded spaces: the linear one, and the exponent of its curve, or 0 for the curve of sRGB.
ENCODED_SPACES = {
    "Display P3": ("Linear DCI-P3 D65", 0.0),
    "Rec.1886": ("Linear Rec.709", 2.4),
    "Rec.2020": ("Linear Rec.2020", 2.4),
    "Gamma 1.8 Encoded Rec.709": ("Linear Rec.709", 1.8),
    "Gamma 2.2 Encoded Rec.709": ("Linear Rec.709", 2.2),
    "Gamma 2.4 Encoded Rec.709": ("Linear Rec.709", 2.4),
}


def xyz_of(chromaticity: tuple[float, float]) -> Floats:
    """XYZ of a chromaticity, Y = 1."""
    x, y = chromaticity
    return np.array((x / y, 1.0, (1.0 - x - y) / y))


def xyz_from_linear(primaries: tuple[tuple[float, float], ...] | None, white: tuple[float, float]) -> Floats:
    """Return the matrix from a linear space to XYZ with white D65."""
    if primaries is None:
        matrix = np.eye(3)
    else:
        columns = np.stack([np.array((x, y, 1.0 - x - y)) for x, y in primaries], axis=1)
        matrix = columns * np.linalg.solve(columns, xyz_of(white))
    cones = (BRADFORD @ xyz_of(D65)) / (BRADFORD @ xyz_of(white))
    return np.linalg.inv(BRADFORD) @ np.diag(cones) @ BRADFORD @ matrix


def find_decoder(name: str) -> Decoder | None:
    """Return the function from colors (..., 3) of a space to the working space, or None for a space not known here."""
    linear, exponent = ENCODED_SPACES.get(name, (name, 1.0))
    if linear not in LINEAR_SPACES:
        return None
    matrix = np.linalg.inv(xyz_from_linear(REC709, D65)) @ xyz_from_linear(*LINEAR_SPACES[linear])

    def decode(color: NDArray[np.float32]) -> Floats:
        values = decode_srgb(color.astype(np.float64)) if exponent == 0.0 else np.maximum(color, 0.0) ** exponent
        return values @ matrix.T

    return decode
