"""Blender's lights to the tracer's, in Blender's units: watts, and W/m^2 for the sun.

Conventions are those of Cycles (`src/scene/light.cpp`, `intern/cycles/blender/light.cpp`): an object's scale
stretches area lights and spot cones but no radius; without `normalize` the power counts per unit of emitting area
(per unit of projected solid angle for a sun), which is turned into the power of the whole light here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

import raytracer
from raytracer.scene.lights import Light, LightNodes, is_askew
from raytracer.scene.programs import Register

from .. import versions
from .parts import ObjectEntry
from .shaders.nodes import Color, WarningContext
from .warnings import WarningList

Matrix = NDArray[np.float64]


def extract_light(
    part: ObjectEntry,
    world_from_light: Matrix,
    random: float,
    warnings: WarningList,
    properties: Mapping[str, Color] | None = None,
) -> Light | None:
    """Return one light placed by a (4, 4) matrix, or None where it emits nothing, or its numbers are none.

    random, properties : the instance's number, and what its nodes read of it by name
    """
    light, place = part.light, WarningContext(warnings, object=part.object.name)
    if light.type == "AREA" and versions.is_portal(light):
        return None  # a portal guides Cycles' sampling of the world and adds no light
    settings = versions.read_light_settings(light)
    power = np.array(light.color, dtype=np.float64) * settings.temperature_color * settings.gain * light.energy
    common = {
        "cast_shadow": light.use_shadow,
        "name": part.object.name,
        "seen_by": part.seen_by,
        "shadow_catcher": part.shadow_catcher,
        "max_bounces": versions.read_light_bounces(light),
        "caustics": versions.makes_caustics(light),
    }
    factor = part.light_factor
    if factor.program is not None and isinstance(factor.value, Register):
        placed = raytracer.Instances(
            [0],
            world_from_light[np.newaxis],
            pass_index=[part.pass_index],
            random=[random],
            color=[part.color],
            properties={name: value[np.newaxis] for name, value in (properties or {}).items()},
        )
        common["nodes"] = LightNodes(factor.value, factor.program, placed)
    else:
        power = power * factor.value
    if not power.any():
        return None
    make = {"POINT": make_point, "SPOT": make_spot, "SUN": make_sun, "AREA": make_area}[light.type]
    try:
        return make(light, world_from_light, power, settings.normalize, common, place)
    except ValueError as error:  # NaN, or more than there is, as of a driver that divides by 0
        place.warn(f"light left out: {str(error).partition(': ')[2]}")
        return None


def read_angle(angle: float) -> float:
    """Return an angle of at most pi; Blender's own pi, in float32, is larger."""
    return min(angle, math.pi)


def read_bulb(light: Any, normalize: bool, power: Color) -> tuple[float, Color]:
    """Return radius and power of the sphere, of area 4 pi r^2, that a point or spot light is.

    A light without radius counts as 4 m^2 in Cycles where power is not normalized (rendered with 5.0 and 5.2).
    """
    radius = light.shadow_soft_size
    area = 4 * math.pi * radius**2 if radius > 0 else 4.0
    return radius, power if normalize else power * area


def make_point(light: Any, matrix: Matrix, power: Color, normalize: bool, common: Any, place: WarningContext) -> Any:
    radius, power = read_bulb(light, normalize, power)
    return raytracer.PointLight(matrix[:3, 3], power, radius, light.use_soft_falloff, **common)


def make_spot(light: Any, matrix: Matrix, power: Color, normalize: bool, common: Any, place: WarningContext) -> Any:
    if np.linalg.det(matrix[:3, :3]) == 0:
        place.warn("a spot light scaled to zero is left out")
        return None
    radius, power = read_bulb(light, normalize, power)
    return raytracer.SpotLight(
        position=matrix[:3, 3],
        power=power,
        radius=radius,
        soft_falloff=light.use_soft_falloff,
        world_from_light=matrix[:3, :3],
        spot_size=read_angle(light.spot_size),
        spot_blend=light.spot_blend,
        **common,
    )


def make_sun(light: Any, matrix: Matrix, power: Color, normalize: bool, common: Any, place: WarningContext) -> Any:
    if not matrix[:3, 2].any():
        place.warn("a sun scaled to zero has no direction and is left out")
        return None
    # Irradiance of radiance L over the disc: pi sin^2(angle / 2) L.
    angle = read_angle(light.angle)
    strength = power if normalize or angle == 0 else power * math.pi * math.sin(angle / 2) ** 2
    return raytracer.SunLight(matrix[:3, 2], strength, angle, **common)


def make_area(light: Any, matrix: Matrix, power: Color, normalize: bool, common: Any, place: WarningContext) -> Any:
    height = light.size_y if light.shape in ("RECTANGLE", "ELLIPSE") else light.size
    axis_u, axis_v = matrix[:3, 0] * light.size, matrix[:3, 1] * height
    if np.linalg.det(matrix[:3, :3]) < 0:
        axis_v = -axis_v  # the front is -(u x v): keep it on the light's -z side in a mirror as well
    is_ellipse = light.shape in ("DISK", "ELLIPSE")
    is_plain_ellipse = is_ellipse and common.get("nodes") is None  # nodes see along which sides it lies
    leans = is_askew(axis_u, matrix[:3, 2]) or is_askew(axis_v, matrix[:3, 2])
    if leans or (is_askew(axis_u, axis_v) and not is_plain_ellipse):
        place.warn("sheared by an uneven scale of its parents: it has right angles, and shines straight from its face")
    if is_askew(axis_u, axis_v):
        axis_u, axis_v = (find_own_axes if is_plain_ellipse else set_upright)(axis_u, axis_v)
    area = np.linalg.norm(axis_u) * np.linalg.norm(axis_v) * (math.pi / 4 if is_ellipse else 1.0)
    if area == 0:
        place.warn("an area light without area is left out")
        return None
    if not matrix[:3, 2].any():
        place.warn("an area light scaled to zero along its axis has no direction and is left out")
        return None
    return raytracer.AreaLight(
        position=matrix[:3, 3],
        axis_u=axis_u,
        axis_v=axis_v,
        power=power if normalize else power * area,
        shape="ellipse" if is_ellipse else "rectangle",
        spread=read_angle(light.spread),
        **common,
    )


def find_own_axes(axis_u: Matrix, axis_v: Matrix) -> tuple[Matrix, Matrix]:
    """Return the axes of the ellipse that a sheared one is, on the same side.

    u cos t + v sin t with the sides U S W of (u, v) is U S times a point that W turns, or mirrors, on the unit circle.
    """
    left, sizes, right = np.linalg.svd(np.stack([axis_u, axis_v], axis=1), full_matrices=False)
    own_u, own_v = (left * sizes).T
    return own_u, own_v * np.sign(np.linalg.det(right))


def set_upright(axis_u: Matrix, axis_v: Matrix) -> tuple[Matrix, Matrix]:
    """Return axes at right angles, of the nearest directions, that span the same area in the same proportion."""
    left, _, right = np.linalg.svd(np.stack([axis_u, axis_v], axis=1), full_matrices=False)
    width, height = np.linalg.norm(axis_u), np.linalg.norm(axis_v)
    share = math.sqrt(np.linalg.norm(np.cross(axis_u, axis_v)) / (width * height))
    upright_u, upright_v = (left @ right).T
    return upright_u * width * share, upright_v * height * share
