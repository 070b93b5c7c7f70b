"""What a light sends along a bent way: samples of the light taken on the straight way, weighed for the bent one.

A sample stands for 1 / p of the light's surface. Its density p per area is w cos a / d^2: w is that per solid angle
from the lit point, d the distance and a the angle to the light's normal. The bent way leaves the normal by b. With J =
|d solid angle at the lit point / d area across the bent way at the light| the lit point gets the irradiance

    L J cos b / p = L J cos b d^2 / (w cos a)

on a plane that faces the way. From a light without extent, of the intensity I, it gets I J; from one infinitely far
away J times what comes straight, for the direction is the same, and J is by solid angle.

References
----------
Blender, intern/cycles/kernel/light/sample.h: light_sample_update.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.rows import scale_vectors
from raytracer.arrays.types import Colors, Numbers, Vectors
from raytracer.arrays.vectors import normalize
from raytracer.lecture import dot
from raytracer.lights.area_lights import area_radiance, unit_axes
from raytracer.lights.light_shapes import LightSamples, divide_rows
from raytracer.lights.lights import has_extent, point_radiance
from raytracer.scene.lights import AreaLight, Light, SunLight


def can_bend(light: Light) -> bool:
    """True for lights that `weigh_bent` knows: not those whose nodes vary, nor parallel ones of a limited width."""
    return light.nodes is None and (not isinstance(light, AreaLight) or has_extent(light))


def weigh_bent(
    light: Light, positions: Vectors, samples: LightSamples, last: Vectors, towards: Vectors, spread: Numbers
) -> Colors:
    """Return the irradiance (n, 3), per sample, that bent ways bring to lit points.

    positions : (n, 3) the lit points
    samples : of the light, on the straight ways
    last : (n, 3) where the bent ways turn to the light for good
    towards : (n, 3) unit, directions from there to the same points of the light
    spread : (n,) float64, J
    """
    if isinstance(light, SunLight):
        return scale_vectors(samples.weight, spread)
    if not has_extent(light):
        return scale_vectors(_find_radiance(light, towards), spread)
    points = positions + samples.distance[:, np.newaxis] * samples.direction
    straight = _find_cosine(light, positions, points, samples.direction)
    bent = _find_cosine(light, last, points, towards)
    density = np.where(bent > 0, samples.density * np.maximum(straight, 0.0), 0.0)
    share = bent * samples.distance**2 * spread
    return divide_rows(scale_vectors(_find_radiance(light, towards), share), density)


def _find_radiance(light: Light, towards: Vectors) -> Colors:
    """Return what a light sends against directions (n, 3), radiance or the intensity of one without extent."""
    if isinstance(light, AreaLight):
        return area_radiance(light, -dot(towards, unit_axes(light)[2]))
    assert not isinstance(light, SunLight)
    return point_radiance(light, towards)


def _find_cosine(light: Light, viewer: Vectors, points: Vectors, towards: Vectors) -> Numbers:
    """Return the cosines (n,) by which viewers (n, 3) see the light's surface at points (n, 3) of it, in directions
    (n, 3). A disk faces each viewer."""
    if isinstance(light, AreaLight):
        return -dot(towards, unit_axes(light)[2])
    assert not isinstance(light, SunLight)
    if light.soft_falloff:
        return dot(towards, normalize(light.position - viewer))
    return -dot(towards, normalize(points - light.position))
