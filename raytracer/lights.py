"""Lamps: what they send to a point, and what a ray that meets one sees.

Every lamp answers two questions, each by one function per kind:

    sample     a direction towards the lamp from each point, with its density in solid angle
    evaluate   the radiance and the density of a given direction, by intersecting the lamp's shape in closed form
               (lecture, "Ray-Object Intersection": line and plane, point and line)

so that light arriving through sampled surface reflection can be weighed against light sampled here. Lamps are not part
of the geometry: they stop no ray, and no ray stops at them. Lamps without extent are reached by `sample` only.

Units and conventions are those of Blender's Cycles (intern/cycles/scene/light.cpp and kernel/light/*.h): a point lamp
of P watts has the radiant intensity P / (4 pi), an area lamp of area A the radiance P / (pi A), a sun its irradiance.
Imports `lecture`, `frames`, `light_shapes`, `sampling`, `scene`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from raytracer.frames import normalize, to_world
from raytracer.lecture import dot, intersect_plane, length, point_on_line
from raytracer.light_shapes import (
    cone_density,
    distance_to_sphere,
    rectangle_solid_angle,
    sample_cone,
    sample_rectangle,
    sample_sphere_directions,
    sphere_density,
)
from raytracer.rays import Booleans, Floats
from raytracer.sampling import sample_disk
from raytracer.scene import AreaLight, Light, PointLight, SpotLight, SunLight


@dataclass(frozen=True, eq=False, slots=True)
class LightSamples:
    """One direction towards a light for each of n points.

    direction : (n, 3) float64, unit, from the point to the light
    distance : (n,) float64, metres, how far a shadow ray has to go; inf for a sun
    weight : (n, 3) float64, radiance / density; for a lamp without extent the irradiance on a plane that faces it
    density : (n,) float64, per solid angle; inf for a lamp without extent, 0 where nothing was sampled
    """

    direction: Floats
    distance: Floats
    weight: Floats
    density: Floats


@dataclass(frozen=True, eq=False, slots=True)
class LightHits:
    """What n rays see of a lamp.

    distance : (n,) float64, metres, to the lamp; inf for a sun and where the lamp is missed
    radiance : (n, 3) float64, 0 where the lamp is missed
    density : (n,) float64, with which `sample` would have taken this direction, per solid angle; 0 where missed
    """

    distance: Floats
    radiance: Floats
    density: Floats


def sample_light(light: Light, positions: Floats, pair: Floats) -> LightSamples:
    """Sample a direction to `light` from each of (n, 3) positions, with (n, 2) uniform numbers."""
    if isinstance(light, SunLight):
        return _sample_sun(light, len(positions), pair)
    if isinstance(light, AreaLight):
        return _sample_area(light, positions, pair)
    if light.soft_falloff or light.radius == 0:
        return _sample_facing_disk(light, positions, pair)
    return _sample_ball(light, positions, pair)


def evaluate_light(light: Light, origins: Floats, directions: Floats) -> LightHits:
    """Return what rays of (n, 3) origins and unit directions see of `light`, were nothing in between."""
    if isinstance(light, SunLight):
        return _evaluate_sun(light, directions)
    if isinstance(light, AreaLight):
        return _evaluate_area(light, origins, directions)
    if light.soft_falloff:
        return _evaluate_facing_disk(light, origins, directions)
    return _evaluate_ball(light, origins, directions)


def has_extent(light: Light) -> bool:
    """True where a ray can meet the lamp."""
    if isinstance(light, SunLight):
        return light.angle > 0
    if isinstance(light, AreaLight):
        return light.spread > 0 and _area_of(light) > 0
    return light.radius > 0


def _miss_where(missed: Booleans, distance: Floats, radiance: Floats, density: Floats) -> LightHits:
    return LightHits(
        np.where(missed, np.inf, distance),
        np.where(missed[:, np.newaxis], 0.0, radiance),
        np.where(missed, 0.0, density),
    )


# Point and spot ------------------------------------------------------------------------------------------------------


def _point_radiance(light: PointLight, directions: Floats) -> Floats:
    """Return what leaves the lamp against `directions` (n, 3), dimmed by a spot's cone.

    The radiance P / (4 pi r^2) / pi of a ball or a facing disk of radius r, the intensity P / (4 pi) where r = 0.
    """
    area = 4.0 * np.pi * light.radius**2 if light.radius > 0 else 4.0
    radiance = np.broadcast_to(light.power / (area * np.pi), directions.shape)
    return radiance * spot_attenuation(light, directions)[:, np.newaxis] if isinstance(light, SpotLight) else radiance


def spot_attenuation(light: SpotLight, directions: Floats) -> Floats:
    """Return 3 x^2 - 2 x^3 with x = (cos theta - cos(size / 2)) / (blend (1 - cos(size / 2))), limited to [0, 1].

    theta is the angle to the spot's axis, measured in the lamp's own space, so that a scaled lamp has an elliptic cone.

    directions : (n, 3) float64, from the lit points to the lamp
    """
    local = normalize(np.linalg.solve(light.world_from_light, -directions.T).T)
    edge = np.cos(light.spot_size / 2.0)
    inside = -local[:, 2] - edge
    width = light.spot_blend * (1.0 - edge)
    if width == 0:
        return (inside > 0).astype(np.float64)
    x = np.clip(inside / width, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


def _sample_facing_disk(light: PointLight, positions: Floats, pair: Floats) -> LightSamples:
    """A disk of the lamp's radius that faces each point ("soft falloff"), or the point itself where the radius is 0.

    Density r^-2 / pi on the disk is t^2 / (pi r^2 cos) in solid angle.
    """
    towards = normalize(light.position - positions)
    target = np.broadcast_to(light.position, positions.shape)
    if light.radius > 0:
        disk = light.radius * sample_disk(pair)
        target = target + to_world(np.pad(disk, ((0, 0), (0, 1))), towards)
    direction, distance = normalize(target - positions), length(target - positions)
    radiance = _point_radiance(light, direction)
    if light.radius == 0:
        return _without_extent(direction, distance, _over(radiance, distance * distance))
    projected_area = np.pi * light.radius**2 * dot(towards, direction)
    density = _over(distance * distance, projected_area)
    return LightSamples(direction, distance, _over(radiance, density), density)


def _without_extent(direction: Floats, distance: Floats, irradiance: Floats) -> LightSamples:
    lit = (irradiance > 0).any(axis=1)
    return LightSamples(direction, distance, irradiance, np.where(lit, np.inf, 0.0))


def _over(numerator: Floats, denominator: Floats) -> Floats:
    """numerator / denominator by rows, 0 where the denominator is 0 (the point lies on the lamp itself)."""
    denominator = denominator.reshape(-1, *(1,) * (numerator.ndim - 1))
    return np.divide(numerator, denominator, out=np.zeros_like(numerator), where=denominator > 0)


def _evaluate_facing_disk(light: PointLight, origins: Floats, directions: Floats) -> LightHits:
    towards = normalize(light.position - origins)
    distance = intersect_plane(origins, directions, towards, dot(towards, light.position))
    offset = length(point_on_line(origins, directions, distance) - light.position)
    hit = (distance > 0) & (offset <= light.radius)
    projected_area = np.pi * light.radius**2 * np.where(hit, dot(towards, directions), 1.0)
    distance = np.where(hit, distance, np.inf)
    density = np.where(hit, distance, 0.0) ** 2 / projected_area
    return _miss_where(~hit, distance, _point_radiance(light, directions), density)


def _sample_ball(light: PointLight, positions: Floats, pair: Floats) -> LightSamples:
    """Sample the cone in which each point sees the ball evenly; all directions for points inside it."""
    offset = light.position - positions
    outside = length(offset) > light.radius
    radii = np.full(len(positions), light.radius)
    direction = sample_sphere_directions(offset, radii, pair)
    density = sphere_density(offset, radii)
    distance = distance_to_sphere(offset, radii, direction)
    distance = np.where(np.isinf(distance), dot(offset, direction), distance)  # touched at the border of the cone
    radiance = _ball_radiance(light, direction, outside)
    return LightSamples(direction, distance, _over(radiance, density), density)


def _ball_radiance(light: PointLight, directions: Floats, outside: Booleans) -> Floats:
    """A spot's cone does not dim what is seen from inside its ball, as in Cycles."""
    radiance = _point_radiance(light, directions)
    if isinstance(light, SpotLight):
        full = light.power / (4.0 * np.pi * light.radius**2 * np.pi)
        radiance = np.where(outside[:, np.newaxis], radiance, full)
    return radiance


def _evaluate_ball(light: PointLight, origins: Floats, directions: Floats) -> LightHits:
    offset = light.position - origins
    radii = np.full(len(origins), light.radius)
    distance = distance_to_sphere(offset, radii, directions)
    outside = length(offset) > light.radius
    radiance = _ball_radiance(light, directions, outside)
    return _miss_where(np.isinf(distance), distance, radiance, sphere_density(offset, radii))


# Sun -----------------------------------------------------------------------------------------------------------------


def _sun_radiance(light: SunLight) -> Floats:
    """strength / (pi sin^2(angle / 2)): a plane that faces the sun then gets `strength`, however wide the disc."""
    return light.strength / (np.pi * np.sin(light.angle / 2.0) ** 2)


def _sample_sun(light: SunLight, count: int, pair: Floats) -> LightSamples:
    axis = np.broadcast_to(light.direction, (count, 3))
    distance = np.full(count, np.inf)
    if light.angle == 0:
        return _without_extent(axis, distance, np.broadcast_to(light.strength, (count, 3)))
    versine = np.full(count, 2.0 * np.sin(light.angle / 4.0) ** 2)
    density = cone_density(versine)
    weight = np.broadcast_to(_sun_radiance(light), (count, 3)) / density[:, np.newaxis]
    return LightSamples(sample_cone(axis, versine, pair), distance, weight, density)


def _evaluate_sun(light: SunLight, directions: Floats) -> LightHits:
    """1 - cos = |d - s|^2 / 2 is exact for small angles, where the cosine itself is rounded away."""
    versine = 2.0 * np.sin(light.angle / 4.0) ** 2
    missed = dot(directions - light.direction, directions - light.direction) / 2.0 > versine
    count = len(directions)
    radiance = np.broadcast_to(_sun_radiance(light), (count, 3))
    return _miss_where(missed, np.full(count, np.inf), radiance, np.full(count, float(cone_density(versine))))


# Area ----------------------------------------------------------------------------------------------------------------


def _area_of(light: AreaLight) -> float:
    area = float(length(light.axis_u) * length(light.axis_v))
    return area * np.pi / 4.0 if light.shape == "ellipse" else area


def _area_axes(light: AreaLight) -> tuple[Floats, Floats, Floats]:
    """Return unit axes u, v and the side that shines, -(u x v)."""
    u, v = normalize(light.axis_u), normalize(light.axis_v)
    return u, v, -normalize(np.cross(u, v))


def area_spread_factor(light: AreaLight, cosine: Floats) -> Floats:
    """Return (tan h - tan x) / (tan h - h) for the angle x off the lamp's axis and half the spread h, 0 beyond it.

    The share of light that the slats of a soft box let through at x, normalized to keep the lamp's power:
    2 integral_0^h (tan h - tan x) cos x sin x dx = tan h - h.

    cosine : (n,) float64, cos x
    """
    if light.spread >= np.pi:
        return np.ones_like(cosine)
    half = light.spread / 2.0
    tangent = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0)) / np.maximum(cosine, np.finfo(np.float64).tiny)
    return np.maximum(np.tan(half) - tangent, 0.0) / _tangent_excess(half)


def _tangent_excess(angle: float) -> float:
    """tan h - h; by its series h^3/3 + 2 h^5/15 + 17 h^7/315 + 62 h^9/2835 below 2^-6, where the difference cancels
    and the next term is below 2^-57 of the sum."""
    if angle > 2.0**-6:
        return float(np.tan(angle) - angle)
    square = angle * angle
    return angle * square * (1 / 3 + square * (2 / 15 + square * (17 / 315 + square * 62 / 2835)))


def _area_radiance(light: AreaLight, cosine: Floats) -> Floats:
    """P / (pi A), dimmed by the spread: (n, 3)."""
    return light.power / (np.pi * _area_of(light)) * area_spread_factor(light, cosine)[:, np.newaxis]


def _visible_part(light: AreaLight, positions: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the part of the lamp's rectangle that can light each point: low (n, 2), high (n, 2) along u and v from the
    centre, and the height (n,) of the point over the lamp's plane, on the side that shines."""
    u, v, axis = _area_axes(light)
    offset = positions - light.position
    height = dot(offset, axis)
    half_size = np.array([length(light.axis_u), length(light.axis_v)]) / 2.0
    low, high = np.broadcast_to(-half_size, (len(positions), 2)), np.broadcast_to(half_size, (len(positions), 2))
    if light.spread < np.pi:
        foot = np.stack([dot(offset, u), dot(offset, v)], axis=1)
        reach = (np.maximum(height, 0.0) * np.tan(light.spread / 2.0))[:, np.newaxis]
        low, high = np.maximum(low, foot - reach), np.minimum(high, foot + reach)
    return low, high, height


def _is_sampled_by_area(light: AreaLight) -> bool:
    """A full ellipse is sampled evenly on its area; every other lamp by the solid angle of a rectangle around it."""
    return light.shape == "ellipse" and light.spread >= np.pi


def _sample_area(light: AreaLight, positions: Floats, pair: Floats) -> LightSamples:
    if light.spread == 0:
        return _sample_parallel_area(light, positions)
    u, v, axis = _area_axes(light)
    low, high, height = _visible_part(light, positions)
    lit = (height > 0) & (high > low).all(axis=1)
    if _is_sampled_by_area(light):
        local = sample_disk(pair) * high
    else:
        local = sample_rectangle(_relative(light, positions), low, high, pair)
        lit &= _is_inside(light, local)
    target = light.position + local[:, 0:1] * u + local[:, 1:2] * v
    direction, distance = normalize(target - positions), length(target - positions)
    density = np.where(lit, _area_density(light, positions, low, high, distance, -dot(direction, axis)), 0.0)
    return LightSamples(direction, distance, _over(_area_radiance(light, -dot(direction, axis)), density), density)


def _relative(light: AreaLight, positions: Floats) -> Floats:
    """Return positions in the lamp's frame (u, v, shining axis), from its centre."""
    offset = positions - light.position
    return np.stack([dot(offset, axis) for axis in _area_axes(light)], axis=1)


def _is_inside(light: AreaLight, local: Floats) -> Booleans:
    """True where points (n, 2) of the lamp's plane lie on its ellipse; rectangles are sampled within their border."""
    if light.shape == "rectangle":
        return np.ones(len(local), dtype=np.bool_)
    half_u, half_v = length(light.axis_u) / 2.0, length(light.axis_v) / 2.0
    return (local[:, 0] / half_u) ** 2 + (local[:, 1] / half_v) ** 2 <= 1.0


def _area_density(
    light: AreaLight, positions: Floats, low: Floats, high: Floats, distance: Floats, cosine: Floats
) -> Floats:
    """Return the density (n,) per solid angle with which `_sample_area` takes directions at `cosine` off the axis."""
    if _is_sampled_by_area(light):
        return _over(distance * distance, _area_of(light) * np.maximum(cosine, 0.0))
    area = np.maximum(high - low, 0.0).prod(axis=1)
    solid_angle, by_area = rectangle_solid_angle(_relative(light, positions), low, high)
    by_distance = _over(distance * distance, area * np.maximum(cosine, 0.0))
    return np.where(by_area, by_distance, _over(np.ones_like(solid_angle), solid_angle))


def _sample_parallel_area(light: AreaLight, positions: Floats) -> LightSamples:
    """A spread of 0: parallel light along the axis, irradiance P / A where the point lies below the lamp."""
    u, v, axis = _area_axes(light)
    offset = positions - light.position
    local = np.stack([dot(offset, u) / length(light.axis_u), dot(offset, v) / length(light.axis_v)], axis=1)
    inside = (np.abs(local) <= 0.5).all(axis=1) if light.shape == "rectangle" else (local**2).sum(axis=1) <= 0.25
    height = dot(offset, axis)
    irradiance = np.where((inside & (height > 0))[:, np.newaxis], light.power / _area_of(light), 0.0)
    return _without_extent(np.broadcast_to(-axis, positions.shape), height, irradiance)


def _evaluate_area(light: AreaLight, origins: Floats, directions: Floats) -> LightHits:
    u, v, axis = _area_axes(light)
    low, high, height = _visible_part(light, origins)
    distance = intersect_plane(origins, directions, axis, dot(axis, light.position))
    offset = point_on_line(origins, directions, distance) - light.position
    local = np.stack([dot(offset, u), dot(offset, v)], axis=1)
    hit = (height > 0) & (distance > 0) & (local >= low).all(axis=1) & (local <= high).all(axis=1)
    hit &= _is_inside(light, np.where(hit[:, np.newaxis], local, 0.0))
    distance = np.where(hit, distance, 1.0)
    cosine = np.where(hit, -dot(directions, axis), 1.0)
    density = _area_density(light, origins, low, high, distance, cosine)
    return _miss_where(~hit, distance, _area_radiance(light, cosine), density)
