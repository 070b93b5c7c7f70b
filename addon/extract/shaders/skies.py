"""Sky Texture: the table of the sky and the sun in it, or what the daylight of older files depends on."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from raytracer.scene.programs import Image
from raytracer.textures.sky import Atmosphere, find_multiple_sun, find_single_sun, tabulate_multiple, tabulate_single

from ... import versions

SKY_TYPES = ("NISHITA", "SINGLE_SCATTERING", "MULTIPLE_SCATTERING")  # the first until 4.5, the others since 5.0
SMALLEST_SUN = 0.0005  # radians, as in Cycles
EARTH_RADIUS = 6371e3  # metres, for the dip of the horizon


def read_sky_settings(node: Any) -> dict[str, Any]:
    """Return the settings of the operation TEX_SKY."""
    elevation, rotation = place_sun(node.sun_elevation, node.sun_rotation)
    aerosol = node.aerosol_density if hasattr(node, "aerosol_density") else node.dust_density
    atmosphere = Atmosphere(elevation, node.altitude, node.air_density, aerosol, node.ozone_density)
    multiple = node.sky_type == "MULTIPLE_SCATTERING"
    half = versions.has_half_skies()
    table = tabulate_multiple(atmosphere) if multiple else tabulate_single(atmosphere, half)
    rgb_from_xyz = versions.find_rgb_from_xyz()
    pixels = np.pad(table @ rgb_from_xyz.T, ((0, 0), (0, 0), (0, 1)), constant_values=1.0).astype(np.float32)
    size = max(node.sun_size, SMALLEST_SUN)
    solid_angle = 2.0 * math.pi * (1.0 - math.cos(size / 2))
    find_sun = find_multiple_sun if multiple else find_single_sun
    sun = (find_sun(atmosphere, elevation + side * size / 2, solid_angle) for side in (-1, 1))
    bottom, top = (rgb_from_xyz @ color for color in sun)
    return {
        "image": Image(pixels, "linear", "sky"),
        "elevation": elevation,
        "rotation": rotation,
        "sun_size": size if node.sun_disc else 0.0,
        "sun_bottom": bottom * node.sun_intensity,
        "sun_top": top * node.sun_intensity,
        "horizon": math.asin(EARTH_RADIUS / (EARTH_RADIUS + node.altitude)) - math.pi / 2,
        "ground": not half,
    }


def read_daylight_settings(node: Any) -> dict[str, Any]:
    """Return what the skies of Preetham and of Hosek and Wilkie share."""
    sun = np.array(node.sun_direction, dtype=np.float64)
    length = np.linalg.norm(sun)
    return {
        "sun": sun / length if length > 0 else np.array((0.0, 0.0, 1.0)),
        "turbidity": node.turbidity,
        "rgb_from_xyz": versions.find_rgb_from_xyz(),
    }


def place_sun(elevation: float, rotation: float) -> tuple[float, float]:
    """Return the sun's elevation within a right angle up or down, behind the zenith turned round, and the angle that
    the sky is turned by, clockwise as Blender counts it."""
    elevation = math.remainder(elevation, 2.0 * math.pi)
    if abs(elevation) >= math.pi / 2:
        elevation, rotation = math.copysign(math.pi, elevation) - elevation, rotation + math.pi
    return elevation, 2.0 * math.pi - rotation % (2.0 * math.pi)
