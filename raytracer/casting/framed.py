"""Rays brought to the size of a frame: origins as `tree.Frame` places points, directions between a half and one.

Both are scaled by powers of two, which is exact. A product with a power takes a tenth of the time of `ldexp`, which is
left for powers that are no float64 or whose inverse is none.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.casting.bvh.tree import Frame

# Powers of two from 2^-LARGEST_EXPONENT to 2^LARGEST_EXPONENT have an inverse, and so have their neighbors.
LARGEST_EXPONENT = 1000
EXPONENT_BITS = np.int64(0x7FF0000000000000)


class FramedRays(NamedTuple):
    """k rays o + t d in a frame.

    origin, direction : (3, k) float64 planes; a direction's largest component is at least 1/2 and below 1
    unit : (k,) float64, a power of two: t in the frame is `unit` times the ray's own; infinite or 0 out of range
    place : (3, k) the origins in the frame's unit, but not from its middle: exact
    """

    origin: Floats
    direction: Floats
    unit: Floats
    place: Floats


def times_power(values: NDArray, exponent: int) -> Floats:
    """values 2^exponent."""
    if abs(exponent) <= LARGEST_EXPONENT:
        return values * 2.0**exponent
    return np.ldexp(values, exponent)


def largest_row(planes: NDArray) -> NDArray:
    """(k,) the largest of three rows (3, k); NaN where any is."""
    return np.maximum(np.maximum(planes[0], planes[1]), planes[2])


def frame_rays(frame: Frame, origins: Floats, directions: Floats) -> FramedRays:
    """Bring rays (k, 3) with directions that are not zero into a frame."""
    origins, directions = np.ascontiguousarray(origins.T), np.ascontiguousarray(directions.T)
    origin = times_power(origins - frame.centre[:, np.newaxis], frame.exponent)
    place = times_power(origins, frame.exponent)
    largest = largest_row(np.abs(directions))
    if len(largest) and largest.min() > 2.0**-LARGEST_EXPONENT and largest.max() < 2.0**LARGEST_EXPONENT:
        # The bits of the exponent alone are the largest power of two that is not above the number.
        length = 2 * (largest.view(np.int64) & EXPONENT_BITS).view(np.float64)
        return FramedRays(origin, directions * (1 / length), times_power(length, frame.exponent), place)
    exponent = np.frexp(largest)[1]
    return FramedRays(origin, np.ldexp(directions, -exponent), np.ldexp(1.0, exponent + frame.exponent), place)
