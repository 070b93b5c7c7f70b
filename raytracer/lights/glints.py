"""Glints: light that is bright and small, as a narrow lobe, a mirror or clear glass sees it.

Samples do not aim at it there, and reflected rays meet it rarely: what of it a picture lacks, nothing in the picture
tells. So each is known as a ball, or a disk in the sky, of about its size and brightness.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from raytracer.arrays.rows import mean_column
from raytracer.arrays.types import Floats
from raytracer.lecture import length
from raytracer.lights.area_lights import unit_axes
from raytracer.lights.emitter_table import Emitters
from raytracer.lights.environment import Environment
from raytracer.lights.lights import evaluate_light
from raytracer.sampling.direction_map import place_equirectangular
from raytracer.scene.fields import SEEN_BY_ALL
from raytracer.scene.lights import AreaLight, Light, SpotLight, SunLight


@dataclass(frozen=True, eq=False)
class Glint:
    """A light as reflections see it.

    radiance : where it is brightest, the mean size of its channels
    centre : (3,) float64, world; of one in the sky the unit direction to it
    radius : metres; of one in the sky radians; inf where it may be anywhere
    is_far : True for one in the sky
    seen_by : bits of SEEN_BY, the rays that meet it
    light : the light that it is; None for what else shines
    """

    radiance: float
    centre: Floats
    radius: float
    is_far: bool = False
    seen_by: int = SEEN_BY_ALL
    light: Light | None = None


def list_glints(lights: Iterable[Light], emitters: Emitters | None, background: Environment | None) -> list[Glint]:
    """Return what reflections can meet: lights with extent, all emissive geometry as one, the brightest of the sky.

    Of what a program computes its mean is taken.
    """
    glints = [describe_light(light) for light in lights]
    if emitters is not None and not emitters.is_empty:
        glints.append(Glint(float(emitters.power_density.max()) * emitters.power, np.zeros(3), np.inf))
    if background is not None and background.grid is not None:
        density = background.grid.density
        row, column = divmod(int(density.argmax()), density.shape[1])
        middle = np.array([column + 0.5]) / density.shape[1], np.array([row + 0.5]) / density.shape[0]
        direction = place_equirectangular(*middle)[0]
        # As large as a disk of that density alone.
        radius = float(1.0 / np.sqrt(np.pi * density.max()))
        glints.append(Glint(background.brightest, direction, radius, True, background.seen_by))
    return glints


def describe_light(light: Light) -> Glint:
    """Return a light with extent, as it is seen on its axis."""
    if isinstance(light, SunLight):
        seen = evaluate_light(light, np.zeros((1, 3)), light.direction[np.newaxis])
        return Glint(_measure(seen.radiance), light.direction, light.angle / 2.0, True, light.seen_by, light)
    radius = float(light.radius) if not isinstance(light, AreaLight) else _measure_diagonal(light)
    # From far enough to see all of it, whatever its spread.
    axis = _find_axis(light)
    seen = evaluate_light(light, (light.position - 2.0 * radius * axis)[np.newaxis], axis[np.newaxis])
    return Glint(_measure(seen.radiance), light.position, radius, seen_by=light.seen_by, light=light)


def _measure(radiance: Floats) -> float:
    return float(mean_column(np.abs(radiance))[0])


def _measure_diagonal(light: AreaLight) -> float:
    return float(np.hypot(length(light.axis_u), length(light.axis_v))) / 2.0


def _find_axis(light: Light) -> Floats:
    """Return the direction (3,) in which a ray meets the middle of a light that is not far."""
    if isinstance(light, AreaLight):
        return -unit_axes(light)[2]
    if isinstance(light, SpotLight):
        axis = light.world_from_light[:, 2]
        return axis / length(axis)
    return np.array([0.0, 0.0, 1.0])
