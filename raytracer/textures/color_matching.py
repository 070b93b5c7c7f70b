"""The eye: what red, green and blue light of each wavelength looks like.

References
----------
CIE 1931 standard colorimetric observer, steps of 5 nm, to four digits.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from raytracer.arrays.types import Floats

DATA = Path(__file__).with_name("color_matching.txt")
SHORTEST, STEP = 380.0, 5.0  # nanometres, of the table's rows
# To linear sRGB, from the white D65.
RGB_FROM_XYZ = np.array(
    [
        (3.2404542, -1.5371385, -0.4985314),
        (-0.9692660, 1.8760108, 0.0415560),
        (0.0556434, -0.2040259, 1.0572252),
    ]
)


@cache
def read_color_matching() -> Floats:
    """Return (81, 3) the observer's X, Y and Z."""
    return np.loadtxt(DATA)
