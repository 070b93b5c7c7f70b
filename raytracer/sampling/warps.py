"""Warps of the unit square to other shapes, and how to weigh two ways of sampling.

References
----------
P. Shirley and K. Chiu, "A Low Distortion Map Between Disk and Square", 1997.
E. Veach and L. J. Guibas, "Optimally Combining Sampling Techniques for Monte Carlo Rendering", 1995.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.rows import divide_where, exchange, join_columns, sum_columns
from raytracer.arrays.types import Floats


def sample_disk(pair: Floats) -> Floats:
    """Map the unit square to the unit disk by concentric squares: area is kept, neighbours stay neighbours.

    With (a, b) = 2 (u, v) - 1, the coordinate of larger size is the radius and the ratio of the two is the angle within
    its quarter, pi/4 * smaller/larger.

    Parameters
    ----------
    pair : (n, 2) float64 in [0, 1)

    Returns
    -------
    (n, 2) float64, x^2 + y^2 <= 1
    """
    square = 2.0 * pair - 1.0
    size = np.abs(square)
    upright = size[:, 1] >= size[:, 0]
    radius, other = exchange(square[:, 0], square[:, 1], upright)
    # The centre itself has radius 0, where any angle will do.
    angle = np.pi / 4 * divide_where(other, radius, radius != 0)
    return join_columns(*exchange(radius * np.cos(angle), radius * np.sin(angle), upright))


def sample_cosine_hemisphere(pair: Floats) -> Floats:
    """Map the unit square to directions around +z with density z / pi (Malley's method: lift the disk).

    Parameters
    ----------
    pair : (n, 2) float64 in [0, 1)

    Returns
    -------
    (n, 3) float64, unit, z >= 0
    """
    disk = sample_disk(pair)
    height = np.sqrt(np.maximum(0.0, 1.0 - sum_columns(disk * disk)))
    return join_columns(*disk.T, height)


def power_heuristic(density: Floats, other: Floats) -> Floats:
    """Return p^2 / (p^2 + q^2) of two densities (n,): the weight of a sample that both could have taken.

    1 where p is infinite (no other way leads there) or q is 0; 0 where p is 0.
    """
    ratio = divide_where(other, density, density > 0, elsewhere=np.inf)
    ratio *= ratio
    ratio += 1.0
    weight = np.divide(1.0, ratio, out=ratio)
    infinite = np.isinf(density)
    return np.where(infinite, 1.0, weight) if infinite.any() else weight
