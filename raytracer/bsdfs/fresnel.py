"""How much a smooth surface reflects, and where it refracts to: dielectrics, conductors, and Blender's metals.

References
----------
A. J. Fresnel, 1823; C. Schlick, "An Inexpensive BRDF Model for Physically-based Rendering", 1994.
Blender, intern/cycles/kernel/closure/bsdf_util.h.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import normalize
from raytracer.lecture import dot

# An index of refraction of 0, which reflects all, would be divided by.
SMALLEST_INDEX = 2.0**-100


CONSTANT, METAL, DIELECTRIC, CONDUCTOR = range(4)


# Fresnel -------------------------------------------------------------------------------------------------------------


def normal_reflectance(eta: Floats) -> Floats:
    """F0 = ((eta - 1) / (eta + 1))^2."""
    root: Floats = (eta - 1.0) / (eta + 1.0)
    return root * root


def transmitted_cosine(cosine: Floats, eta: Floats) -> Floats:
    """Return the cosine behind the surface by Snell's law, sqrt(1 - (1 - cos^2) / eta^2); 0 in total reflection."""
    return np.sqrt(np.maximum(1.0 - (1.0 - cosine * cosine) / (eta * eta), 0.0))


def dielectric_reflectance(cosine: Floats, eta: Floats) -> Floats:
    """Return Fresnel's reflectance of unpolarized light, the mean of its two polarizations; 1 in total reflection.

    r_s = (c - eta c') / (c + eta c'), r_p = (eta c - c') / (eta c + c') for cosines c before and c' behind.

    cosine, eta : arrays that broadcast; 0 <= cosine <= 1
    """
    behind = transmitted_cosine(cosine, eta)
    total = (cosine <= 0) | (behind == 0)
    some = np.any(total)
    front, behind = (np.where(total, 1.0, cosine), np.where(total, 1.0, behind)) if some else (cosine, behind)
    slow, fast = eta * behind, eta * front
    across = (front - slow) / (front + slow)
    along = (fast - behind) / (fast + behind)
    partial = (across * across + along * along) / 2.0
    return np.where(total, 1.0, partial) if some else partial


def metal_slope(f0: Floats, bent: Floats) -> Floats:
    """Return the factor of c (1 - c)^6 that brings Schlick's curve to `bent` at c = 1/7 (82 degrees)."""
    step = 6.0 / 7.0
    return (f0 + (1.0 - f0) * step**5 - bent) * 7.0 / step**6


def metal_coefficient(f0: Floats, tint: Floats) -> Floats:
    """Return the factor of c (1 - c)^6 that brings Schlick's curve to `tint` times itself at c = 1/7."""
    return metal_slope(f0, 0.0 * f0) * (1.0 - tint)


def metal_mean(f0: Floats, f82: Floats) -> Floats:
    """Return the mean reflectance 2 integral_0^1 F(c) c dc of a metal."""
    return f0 + (1.0 - f0) / 21.0 - f82 / 126.0


def metal_reflectance(cosine: Floats, f0: Floats, f82: Floats) -> Floats:
    """F0 + (1 - F0) (1 - c)^5 - B c (1 - c)^6, limited to [0, 1]; cosine (m, 1), f0 and f82 (m, 3)."""
    fifth = (1.0 - cosine) ** 5
    return np.clip(f0 + (1.0 - f0) * fifth - f82 * cosine * fifth * (1.0 - cosine), 0.0, 1.0)


def conductor_reflectance(cosine: Floats, index: Floats, extinction: Floats) -> Floats:
    """Return Fresnel's reflectance of unpolarized light by a conductor of index m = n + i k; arrays that broadcast.

    With c'^2 = 1 - (1 - c^2) / m^2: |r_s|^2 = |(c - m c') / (c + m c')|^2, |r_p|^2 = |(m c - c') / (m c + c')|^2.
    """
    m = np.maximum(index, SMALLEST_INDEX) + 1j * extinction
    behind = np.sqrt(1.0 - (1.0 - cosine * cosine) / (m * m))
    across = (cosine - m * behind) / (cosine + m * behind)
    along = (m * cosine - behind) / (m * cosine + behind)
    return (np.abs(across) ** 2 + np.abs(along) ** 2) / 2.0


def schlick_share(cosine: Floats, eta: Floats) -> Floats:
    """Return how far the real Fresnel curve has come from F0 (0) to grazing incidence (1), (m,)."""
    f0 = normal_reflectance(eta)
    return np.clip((dielectric_reflectance(cosine, eta) - f0) / (1.0 - f0), 0.0, 1.0)


def refract(outgoing: Floats, normals: Floats, eta: Floats) -> Floats:
    """Return the direction behind the surface, -o / eta + (c / eta - c') n, by Snell's law: (m, 3).

    In total reflection, where there is none, c' is 0 and the result lies in the surface.
    """
    cosine = dot(outgoing, normals)
    factor = cosine / eta - transmitted_cosine(cosine, eta)
    bent: Floats = factor[:, np.newaxis] * normals - outgoing / eta[:, np.newaxis]
    return normalize(bent)
