"""The pixel filter: how far from a pixel's centre its samples lie.

A filter is importance-sampled, as in Cycles: offsets are drawn with the filter as their density, so every sample counts
the same and belongs to one pixel, and a picture with a border is the crop of the full one.

References
----------
F. J. Harris, "On the Use of Windows for Harmonic Analysis with the Discrete Fourier Transform", 1978.
M. Ernst, M. Stamminger and G. Greiner, "Filter Importance Sampling", 2006.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from raytracer.arrays.types import Floats

# The 4-term window of Harris.
BLACKMAN_HARRIS = (0.35875, -0.48829, 0.14128, -0.01168)


# The inverse is exact at so many quantiles and linear between them: at most 1/16384 of the samples are displaced.
QUANTILES = 2**14


def sample_pixel_filter(pair: Floats, pixel_filter: str, width: float) -> Floats:
    """Map the unit square to offsets from the pixel's centre, with the filter as their density.

    Parameters
    ----------
    pair : (n, 2) float64 in [0, 1)
    pixel_filter : 'blackman_harris' or 'box'
    width : pixels; the radius of Blackman-Harris, the whole side of the box

    Returns
    -------
    (n, 2) float64, pixels
    """
    if pixel_filter == "box":
        return (pair - 0.5) * width
    position = pair * QUANTILES
    index = position.astype(np.intp)
    position -= index
    quantiles = _blackman_harris_quantiles()
    low = quantiles.take(index)  # (n, 2)
    index += 1
    offset = quantiles.take(index)
    offset -= low
    offset *= position
    offset += low
    offset *= width
    return offset


def find_reach(pixel_filter: str, width: float) -> float:
    """Return how far from a pixel's centre its samples lie at most, along each axis, pixels."""
    return width / 2.0 if pixel_filter == "box" else width


def find_filter_density(offset: Floats, pixel_filter: str, width: float) -> Floats:
    """Return the density, per pixel, of offsets along one axis, of any shape: that of `sample_pixel_filter`."""
    position = np.abs(offset) / find_reach(pixel_filter, width)
    if pixel_filter == "box":
        return np.where(position <= 1.0, 1.0 / width, 0.0)
    angle = np.pi * (np.minimum(position, 1.0) + 1.0)
    window = sum(part * np.cos(k * angle) for k, part in enumerate(BLACKMAN_HARRIS))
    return np.where(position < 1.0, window / (2.0 * BLACKMAN_HARRIS[0] * width), 0.0)


def integrate_blackman_harris(x: Floats) -> Floats:
    """Return the share of the Blackman-Harris window left of x, for x from -1 to 1, its whole support.

    The window is sum_k a_k cos(k pi (x + 1)), so its integral is sum_k a_k sin(k pi (x + 1)) / (k pi), a_0 (x + 1)
    for k = 0; all of it is 2 a_0.
    """
    angle = np.pi * (x + 1.0)
    total = BLACKMAN_HARRIS[0] * (x + 1.0)
    for k in (1, 2, 3):
        total = total + BLACKMAN_HARRIS[k] * np.sin(k * angle) / (k * np.pi)
    return total / (2.0 * BLACKMAN_HARRIS[0])


@lru_cache(maxsize=1)
def _blackman_harris_quantiles() -> Floats:
    """Return (QUANTILES + 1,) the x at which 0, 1, 2 ... QUANTILES equal shares of the window lie to the left."""
    x = np.linspace(-1.0, 1.0, 4 * QUANTILES + 1)
    return np.interp(np.linspace(0.0, 1.0, QUANTILES + 1), integrate_blackman_harris(x), x)
