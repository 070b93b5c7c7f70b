"""Daylight in closed form: the skies of Preetham and of Hosek and Wilkie, fits to simulated atmospheres.

Both give the radiance of a direction from the angle theta to the zenith and the angle gamma to the sun. Preetham's is a
product of Perez's function for each of the luminance Y and the chromaticities x, y,

    F = (1 + A exp(B / cos theta)) (1 + C exp(D gamma) + E cos^2 gamma),

scaled to what the zenith has; Hosek and Wilkie's, for each of X, Y, Z, one of more terms, with a glow around the sun,

    F = (1 + A exp(B / (cos theta + 0.01)))
        (C + D exp(E gamma) + F cos^2 gamma + G (1 + cos^2 gamma) / (1 + I^2 - 2 I cos gamma)^1.5 + H sqrt(cos theta)),

whose coefficients are quintic Bezier curves over the cube root of the sun's elevation. Neither has a sun's disc, and
below the horizon both go on as they are there.

References
----------
A. J. Preetham, P. Shirley, B. Smits, "A Practical Analytic Model for Daylight", SIGGRAPH 1999, appendix A.2.
L. Hosek, A. Wilkie, "An Analytic Model for Full Spectral Sky-Dome Radiance", ACM Transactions on Graphics 31(4), 2012.
Blender, intern/cycles/scene/shader_nodes.cpp (sky_texture_precompute_*), kernel/svm/sky.h: scales and limits.
"""

from __future__ import annotations

from functools import lru_cache
from math import comb
from pathlib import Path

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.lecture import dot

# Thousands of candela per square metre to what Blender's worlds shine with.
LUMINANCE_SCALE = 0.06
# From watts to the same, of Hosek and Wilkie's sky.
RADIANCE_SCALE = 2.0 * np.pi / 683.0
# The lowest angle over the horizon that the models are asked for.
HORIZON = 0.001
TURBIDITIES = (1.0, 10.0)
DATA = Path(__file__).with_name("hosek_wilkie.txt")

# Perez's coefficients A to E for Y, x and y: those of the turbidity, and the rest.
PEREZ = np.array(
    [
        [(0.1787, -1.4630), (-0.3554, 0.4275), (-0.0227, 5.3251), (0.1206, -2.5771), (-0.0670, 0.3703)],
        [(-0.0193, -0.2592), (-0.0665, 0.0008), (-0.0004, 0.2125), (-0.0641, -0.8989), (-0.0033, 0.0452)],
        [(-0.0167, -0.2608), (-0.0950, 0.0092), (-0.0079, 0.2102), (-0.0441, -1.6537), (-0.0109, 0.0529)],
    ]
)
# The zenith's x and y: of T^2, T and 1 those of theta^3, theta^2, theta and 1.
ZENITH = np.array(
    [
        [
            (0.00166, -0.00375, 0.00209, 0.0),
            (-0.02903, 0.06377, -0.03202, 0.00394),
            (0.11693, -0.21196, 0.06052, 0.25886),
        ],
        [
            (0.00275, -0.00610, 0.00317, 0.0),
            (-0.04214, 0.08970, -0.04153, 0.00516),
            (0.15346, -0.26756, 0.06670, 0.26688),
        ],
    ]
)


def measure_angles(directions: Floats, sun: Floats) -> tuple[Floats, Floats]:
    """Return theta and gamma (n,) of unit directions (n, 3); theta ends just above the horizon."""
    theta = np.arccos(np.clip(directions[:, 2], -1.0, 1.0))
    return np.minimum(theta, np.pi / 2 - HORIZON), np.arccos(np.clip(dot(directions, sun), -1.0, 1.0))


def place_sun_above(sun: Floats) -> Floats:
    """Return a unit direction to the sun, raised to the horizon where it lies below."""
    if sun[2] >= 0:
        return sun
    across = np.hypot(sun[0], sun[1])
    return np.array((sun[0] / across, sun[1] / across, 0.0)) if across > 0 else np.array((0.0, 1.0, 0.0))


# Preetham ------------------------------------------------------------------------------------------------------------


def _evaluate_perez(coefficients: Floats, theta: Floats, gamma: Floats) -> Floats:
    """Return F (n, 3) of coefficients (3, 5)."""
    a, b, c, d, e = coefficients.T
    theta, gamma = theta[:, np.newaxis], gamma[:, np.newaxis]
    near = 1.0 + c * np.exp(d * gamma) + e * np.cos(gamma) ** 2
    return (1.0 + a * np.exp(b / np.cos(theta))) * near


def evaluate_preetham(directions: Floats, sun: Floats, turbidity: float) -> Floats:
    """Return the radiance of unit directions (n, 3) as XYZ (n, 3); sun : (3,) unit."""
    height = float(np.arccos(np.clip(sun[2], -1.0, 1.0)))
    coefficients = dot(PEREZ, np.array([turbidity, 1.0]))  # (3, 5)
    chi = (4.0 / 9.0 - turbidity / 120.0) * (np.pi - 2.0 * height)
    luminance = (4.0453 * turbidity - 4.9710) * np.tan(chi) - 0.2155 * turbidity + 2.4192
    rows = dot(ZENITH, np.array([height**3, height**2, height, 1.0]))  # (2, 3)
    chroma = dot(rows, np.array([turbidity**2, turbidity, 1.0]))  # (2,)
    zenith = np.array((LUMINANCE_SCALE * luminance, *chroma))
    zenith = zenith / _evaluate_perez(coefficients, np.zeros(1), np.array([height]))[0]
    big, x, y = (zenith * _evaluate_perez(coefficients, *measure_angles(directions, sun))).T
    share = np.divide(big, y, out=np.zeros_like(y), where=y != 0)
    return np.stack([share * x, big, share * (1.0 - x - y)], axis=1)


# Hosek and Wilkie ----------------------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def _load_data() -> Floats:
    """Return (3, 2, 10, 6, 10): X, Y, Z; albedo 0, 1; turbidity 1 to 10; control points; coefficients and radiance."""
    return np.loadtxt(DATA).reshape(3, 2, 10, 6, 10)


def find_coefficients(elevation: float, turbidity: float, albedo: float) -> tuple[Floats, Floats]:
    """Return the coefficients (3, 9) and the mean radiances (3,) for a sun at an elevation, radians.

    Linear in albedo and turbidity; over x = cbrt(elevation / (pi / 2)) it is sum_k binom(5, k) (1 - x)^(5-k) x^k p_k.
    """
    data, turbidity = _load_data(), min(max(turbidity, TURBIDITIES[0]), TURBIDITIES[1])
    lower = min(int(turbidity), 9)
    share = turbidity - lower
    among = (1.0 - share) * data[:, :, lower - 1] + share * data[:, :, lower]  # (3, 2, 6, 10)
    points = (1.0 - albedo) * among[:, 0] + albedo * among[:, 1]  # (3, 6, 10)
    x = np.cbrt(elevation / (np.pi / 2))
    weights = np.array([comb(5, k) * (1.0 - x) ** (5 - k) * x**k for k in range(6)])
    found = dot(np.moveaxis(points, 1, -1), weights)
    return found[:, :9], found[:, 9]


def evaluate_hosek_wilkie(directions: Floats, sun: Floats, turbidity: float, albedo: float) -> Floats:
    """Return the radiance of unit directions (n, 3) as XYZ (n, 3); sun : (3,) unit; albedo : of the ground."""
    sun = place_sun_above(sun)
    coefficients, radiance = find_coefficients(float(np.arcsin(min(sun[2], 1.0))), turbidity, albedo)
    theta, gamma = (angle[:, np.newaxis] for angle in measure_angles(directions, sun))
    a, b, c, d, e, f, g, h, i = coefficients.T
    up, near = np.cos(theta), np.cos(gamma)
    glow = (1.0 + near**2) / (1.0 + i * i - 2.0 * i * near) ** 1.5
    around = c + d * np.exp(e * gamma) + f * near**2 + g * glow + h * np.sqrt(up)
    return (1.0 + a * np.exp(b / (up + 0.01))) * around * radiance * RADIANCE_SCALE
