"""Lights: what they send to a point, and what a ray that meets one sees.

Every light answers two questions, each by one function per kind: point, spot and sun here, area lights in
`area_lights`; where pixels share points of lights, `shared_points` samples instead.

    sample     a direction towards the light from each point, with its density in solid angle
    evaluate   the radiance and the density of a given direction, by intersecting the light's shape in closed form
               (lecture, "Ray-Object Intersection": line and plane, point and line)

so that light arriving through sampled surface reflection can be weighed against light sampled here. Lights are not part
of the geometry: they stop no ray, and no ray stops at them. Lights without extent are reached by `sample` only.

Units and conventions are those of Blender's Cycles (intern/cycles/scene/light.cpp and kernel/light/*.h): a point light
of P watts has the radiant intensity P / (4 pi), an area light of area A the radiance P / (pi A), a sun its irradiance.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from raytracer.arrays.rows import join_columns, take_rows
from raytracer.arrays.types import Booleans, Floats
from raytracer.arrays.vectors import normalize, to_world
from raytracer.lecture import cross, dot, intersect_plane, length, point_on_line
from raytracer.lights.area_lights import area_of, evaluate_area, sample_area
from raytracer.lights.light_shapes import (
    LightHits,
    LightSamples,
    cone_density,
    distance_to_sphere,
    divide_rows,
    place_hits,
    sample_cone,
    sample_sphere_directions,
    sphere_density,
    without_extent,
)
from raytracer.sampling.warps import sample_disk
from raytracer.scene.lights import AreaLight, Light, PointLight, SpotLight, SunLight


def sample_light(light: Light, positions: Floats, pair: Floats) -> LightSamples:
    """Sample a direction to `light` from each of (n, 3) positions, with (n, 2) uniform numbers.

    light : one for all, or a record of n lights alike (`stacked_lights`)
    """
    if isinstance(light, SunLight):
        return _sample_sun(light, len(positions), pair)
    if isinstance(light, AreaLight):
        return sample_area(light, positions, pair)
    if light.soft_falloff or not has_radius(light):
        return _sample_facing_disk(light, positions, pair)
    return _sample_ball(light, positions, pair)


def evaluate_light(light: Light, origins: Floats, directions: Floats) -> LightHits:
    """Return what rays of (n, 3) origins and unit directions see of `light`, were nothing in between."""
    if isinstance(light, SunLight):
        return _evaluate_sun(light, directions)
    if isinstance(light, AreaLight):
        return evaluate_area(light, origins, directions)
    if light.soft_falloff:
        return _evaluate_facing_disk(light, origins, directions)
    return _evaluate_ball(light, origins, directions)


def has_extent(light: Light) -> bool:
    """True where a ray can meet the light."""
    if isinstance(light, SunLight):
        return light.angle > 0
    if isinstance(light, AreaLight):
        return light.spread > 0 and bool(area_of(light) > 0)
    return has_radius(light)


def has_radius(light: PointLight) -> bool:
    """True for a ball, or a disk, and not a point."""
    return bool(np.any(light.radius > 0))


# Point and spot ------------------------------------------------------------------------------------------------------


def point_radiance(light: PointLight, directions: Floats) -> Floats:
    """Return what leaves the light against `directions` (n, 3), dimmed by a spot's cone.

    The radiance P / (4 pi r^2) / pi of a ball or a facing disk of radius r, the intensity P / (4 pi) where r = 0.
    """
    area = np.asarray(4.0 * np.pi * np.square(light.radius) if has_radius(light) else 4.0)
    radiance = np.broadcast_to(light.power / (area * np.pi)[..., np.newaxis], directions.shape)
    return radiance * spot_attenuation(light, directions)[:, np.newaxis] if isinstance(light, SpotLight) else radiance


def spot_attenuation(light: SpotLight, directions: Floats) -> Floats:
    """Return 3 x^2 - 2 x^3 with x = (cos theta - cos(size / 2)) / (blend (1 - cos(size / 2))), limited to [0, 1].

    theta is the angle to the spot's axis, measured in the light's own space: a scaled light has an elliptic cone.

    directions : (n, 3) float64, from the lit points to the light
    """
    largest = np.abs(light.world_from_light).max(axis=(-2, -1), keepdims=True)
    a, b, c = np.moveaxis(light.world_from_light / largest, -1, 0)
    # Cramer's rule: the rows of the inverse are (b x c, c x a, a x b) / D; of the determinant D the sign is left.
    sign = np.sign(dot(a, cross(b, c)))[..., np.newaxis]
    inverse = (cross(b, c) * sign, cross(c, a) * sign, cross(a, b) * sign)
    local = normalize(np.stack([dot(-directions, row) for row in inverse], axis=-1))
    edge = np.cos(light.spot_size / 2.0)
    inside = -local[:, 2] - edge
    width = light.spot_blend * (1.0 - edge)
    x = np.clip(inside / np.where(width > 0, width, 1.0), 0.0, 1.0)
    dimmed: Floats = np.where(width > 0, x * x * (3.0 - 2.0 * x), inside > 0)
    return dimmed


def _sample_facing_disk(light: PointLight, positions: Floats, pair: Floats) -> LightSamples:
    """A disk of the light's radius that faces each point ("soft falloff"), or the point itself where the radius is 0.

    Density r^-2 / pi on the disk is t^2 / (pi r^2 cos) in solid angle.
    """
    towards = normalize(light.position - positions)
    target = np.broadcast_to(light.position, positions.shape)
    if has_radius(light):
        disk = np.asarray(light.radius)[..., np.newaxis] * sample_disk(pair)
        target = target + to_world(join_columns(*disk.T, np.zeros(len(disk))), towards)
    direction, distance = normalize(target - positions), length(target - positions)
    radiance = point_radiance(light, direction)
    if not has_radius(light):
        samples = without_extent(direction, distance, divide_rows(radiance, distance * distance))
        return dataclasses.replace(samples, target=target, reach=np.ones(len(target)))
    projected_area = np.pi * np.square(light.radius) * dot(towards, direction)
    density = divide_rows(distance * distance, projected_area)
    return LightSamples(direction, distance, divide_rows(radiance, density), density)


def _evaluate_facing_disk(light: PointLight, origins: Floats, directions: Floats) -> LightHits:
    towards = normalize(light.position - origins)
    distance = intersect_plane(origins, directions, towards, dot(towards, light.position))
    offset = length(point_on_line(origins, directions, distance) - light.position)
    rows = np.flatnonzero((distance > 0) & (offset <= light.radius))
    towards, directions, distance = take_rows(towards, rows), take_rows(directions, rows), distance[rows]
    density = distance**2 / (np.pi * light.radius**2 * dot(towards, directions))
    return place_hits(rows, len(origins), distance, point_radiance(light, directions), density)


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
    return LightSamples(direction, distance, divide_rows(radiance, density), density)


def _ball_radiance(light: PointLight, directions: Floats, outside: Booleans) -> Floats:
    """A spot's cone does not dim what is seen from inside its ball, as in Cycles."""
    radiance = point_radiance(light, directions)
    if isinstance(light, SpotLight):
        full = light.power / np.asarray(4.0 * np.pi * np.square(light.radius) * np.pi)[..., np.newaxis]
        radiance = np.where(outside[:, np.newaxis], radiance, full)
    return radiance


def _evaluate_ball(light: PointLight, origins: Floats, directions: Floats) -> LightHits:
    offset = light.position - origins
    distance = distance_to_sphere(offset, np.full(len(origins), light.radius), directions)
    rows = np.flatnonzero(np.isfinite(distance))
    offset = take_rows(offset, rows)
    radiance = _ball_radiance(light, take_rows(directions, rows), length(offset) > light.radius)
    density = sphere_density(offset, np.full(len(rows), light.radius))
    return place_hits(rows, len(origins), distance[rows], radiance, density)


# Sun -----------------------------------------------------------------------------------------------------------------


def _sun_radiance(light: SunLight) -> Floats:
    """strength / (pi sin^2(angle / 2)): a plane that faces the sun then gets `strength`, however wide the disc."""
    return light.strength / (np.pi * np.sin(light.angle / 2.0) ** 2)


def _sample_sun(light: SunLight, count: int, pair: Floats) -> LightSamples:
    axis = np.broadcast_to(light.direction, (count, 3))
    distance = np.full(count, np.inf)
    if light.angle == 0:
        return without_extent(axis, distance, np.broadcast_to(light.strength, (count, 3)))
    versine = np.full(count, 2.0 * np.sin(light.angle / 4.0) ** 2)
    density = cone_density(versine)
    weight = np.broadcast_to(_sun_radiance(light), (count, 3)) / density[:, np.newaxis]
    return LightSamples(sample_cone(axis, versine, pair), distance, weight, density)


def _evaluate_sun(light: SunLight, directions: Floats) -> LightHits:
    """1 - cos = |d - s|^2 / 2 is exact for small angles, where the cosine itself is rounded away."""
    versine = 2.0 * np.sin(light.angle / 4.0) ** 2
    offset = directions - light.direction
    rows = np.flatnonzero(dot(offset, offset) / 2.0 <= versine)
    radiance = np.broadcast_to(_sun_radiance(light), (len(rows), 3))
    return place_hits(rows, len(directions), np.inf, radiance, float(cone_density(versine)))
