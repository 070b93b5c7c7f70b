"""Emissive geometry: triangles and spheres as one light, picked in proportion to their power.

A triangle of area A, picked with probability p, is sampled evenly on its area; density A^-1 there is t^2 / (A cos) in
solid angle. A sphere is sampled evenly over the cone in which it is seen. Both sides of a surface shine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from raytracer.arrays.rows import join_columns, take_rows
from raytracer.arrays.types import Floats, Integers
from raytracer.arrays.vectors import normalize
from raytracer.casting.geometry import Kind, world_corners
from raytracer.casting.rays import Rays
from raytracer.lecture import cross, dot, length
from raytracer.lights.emitter_table import (
    Emitters,
    Numbers,
    find_spheres,
    locate_emitters,
    measure_corners,
    place_surface,
)
from raytracer.lights.instanced_emitters import find_chances, find_materials, pick_triangles
from raytracer.lights.light_shapes import (
    LightSamples,
    distance_to_sphere,
    divide_rows,
    sample_sphere_directions,
    sphere_density,
)
from raytracer.shading.light_path import Depths, describe_sampling
from raytracer.surfaces.surface import Surface
from raytracer.surfaces.surface_tables import CASTER_ERROR, INTERPOLATION_ERROR, interpolate

# Emitters seen closer to edge-on than this light nothing that a float64 could tell from 0; keeps their distance finite.
SMALLEST_COSINE = 2.0**-26


def vary_radiance(
    emitters: Emitters,
    picked: Numbers,
    pair: Floats,
    surface: Surface,
    light: LightSamples,
    depths: Depths | None = None,
) -> None:
    """Multiply the weight of samples (n,) of emitters `picked` by what programs let them shine with, towards the points
    of `surface`.

    pair : (n, 2) the uniform numbers of the place
    depths : of the paths that lead to the points
    """
    if emitters.varies is None or emitters.find_radiance is None:
        return
    rows = np.flatnonzero(emitters.varies[find_picked_materials(emitters, picked)] & (light.density > 0))
    if not len(rows):
        return
    count = len(rows)
    rays = Rays(surface.position[rows], light.direction[rows], np.zeros(count), np.full(count, np.inf))
    shining = place_surface(emitters, picked[rows], pair[rows], rays, light.distance[rows])
    path = describe_sampling(light.distance[rows], None if depths is None else depths.select(rows))
    light.weight[rows] *= emitters.find_radiance(shining, path)


def sample_picked(
    emitters: Emitters, surface: Surface, picked: Numbers, pair: Floats, depths: Depths | None = None
) -> LightSamples:
    """Sample a direction from each point of `surface` to its emitter of `picked` (n,).

    Parameters
    ----------
    pair : (n, 2) uniform numbers
    depths : of the paths that lead to the points
    """
    samples = _aim_at_picked(emitters, surface, picked, pair)
    vary_radiance(emitters, picked, pair, surface, samples, depths)
    return samples


def _aim_at_picked(emitters: Emitters, surface: Surface, picked: Numbers, pair: Floats) -> LightSamples:
    """Sample directions to emitters `picked` (n,) as if those that vary had radiance 1."""
    round_ = emitters.tables.geometry.belongs_to_kind(locate_emitters(emitters, picked)[0], Kind.SPHERE)
    spheres = np.flatnonzero(round_)
    if not len(spheres):
        return sample_placed(place_on_triangles(emitters, picked, pair), surface)
    samples = LightSamples(
        *(np.zeros(shape) for shape in ((len(picked), 3), len(picked), (len(picked), 3), len(picked)))
    )
    flat = np.flatnonzero(~round_)
    for rows, part in (
        (flat, sample_placed(place_on_triangles(emitters, picked[flat], pair[flat]), surface.select(flat))),
        (spheres, _aim_at_spheres(emitters, surface.select(spheres), picked[spheres], pair[spheres])),
    ):
        for name in ("direction", "distance", "weight", "density"):
            getattr(samples, name)[rows] = getattr(part, name)
    return samples


def pick_emitters(emitters: Emitters, choice: Floats) -> Numbers:
    """Return the numbers (n,) of emitters, in proportion to their power, for uniform numbers (n,)."""
    unit = np.searchsorted(emitters.cumulative, choice, side="right").clip(max=len(emitters.cumulative) - 1)
    if emitters.instanced is None or emitters.number is None:
        return unit
    picked = emitters.number[unit]
    rows = np.flatnonzero(picked >= len(emitters.instance))
    # What is left of the number tells the triangle.
    rest = stretch_choice(emitters, unit[rows], choice[rows])
    picked[rows] += pick_triangles(emitters.instanced, locate_emitters(emitters, picked[rows])[0], rest)
    return picked


def stretch_choice(emitters: Emitters, unit: Numbers, choice: Floats) -> Floats:
    """Return where uniform numbers (n,) lie within the shares of what they have picked, in [0, 1)."""
    above = emitters.cumulative[unit]
    below = np.where(unit > 0, emitters.cumulative[unit - 1], 0.0)
    return np.clip((choice - below) / (above - below), 0.0, np.nextafter(1.0, 0.0))


def find_picked_materials(emitters: Emitters, picked: Numbers) -> Integers:
    """Return the materials (n,) of emitters by their numbers."""
    if emitters.instanced is None:
        return emitters.material[picked]
    return find_materials(emitters.tables, *locate_emitters(emitters, picked))


@dataclass(frozen=True, eq=False, slots=True)
class EmitterPoints:
    """Points on n emissive triangles.

    position, normal : (n, 3) float64; the normal is a unit vector of either side
    error : (n,) float64, metres, bound on the error of `position`
    density : (n,) float64, of picking the point, per area
    radiance : (n, 3) float64
    """

    position: Floats
    normal: Floats
    error: Floats
    density: Floats
    radiance: Floats

    def select(self, rows: Any) -> EmitterPoints:
        """Return some of the points, also repeatedly: index array."""
        return EmitterPoints(
            *(take_rows(getattr(self, name), rows) for name in ("position", "normal", "error", "density", "radiance"))
        )


def place_on_triangles(emitters: Emitters, picked: Numbers, pair: Floats) -> EmitterPoints:
    """Return points even on the triangles `picked` (n,), beta = sqrt(u) (1 - v), gamma = sqrt(u) v."""
    if emitters.instanced is None:
        corners, material = take_rows(emitters.corners, picked), emitters.material[picked]
        normal, error = take_rows(emitters.normal, picked), emitters.error[picked]
        density = emitters.power_density[material]
    else:
        instance, primitive = locate_emitters(emitters, picked)
        corners = np.stack(world_corners(emitters.tables.geometry, instance, primitive), axis=1)
        normal, error = measure_corners(corners)
        area = length(cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])) / 2.0
        material, density = _find_densities(emitters, instance, primitive, area)
    root = np.sqrt(pair[:, 0])
    weights = join_columns(root * (1.0 - pair[:, 1]), root * pair[:, 1])
    position = interpolate(weights, corners[:, 0], corners[:, 1], corners[:, 2])
    return EmitterPoints(position, normal, error, density, take_rows(emitters.radiance, material))


def _find_densities(
    emitters: Emitters, instance: Integers, primitive: Integers, area: Floats
) -> tuple[Integers, Floats]:
    """Return the materials (n,) of triangles of known area, and the density per area (n,) of points picked on them."""
    material = find_materials(emitters.tables, instance, primitive)
    density = emitters.power_density[material]
    if emitters.instanced is not None:
        rows, share = find_chances(emitters.instanced, instance, primitive)
        density[rows] = divide_rows(share, emitters.power * area[rows])
    return material, density


def sample_placed(points: EmitterPoints, surface: Surface) -> LightSamples:
    """Return the samples from each point of `surface` towards one of `points`: density t^2 / cos of that per area."""
    offset = points.position - surface.position
    distance = length(offset)
    direction = divide_rows(offset, distance)
    cosine = np.abs(dot(direction, points.normal))
    density = divide_rows(points.density * (distance * distance), cosine)
    reach = stop_before(distance, cosine, points.error, surface.position_error)
    weight = divide_rows(points.radiance, density)
    return LightSamples(direction, reach, weight, density, points.position, divide_rows(reach, distance))


def stop_before(distance: Floats, cosine: Floats, error: Floats, surface_error: Floats) -> Floats:
    """Return the lengths of shadow rays (n,), metres, shortened to end before the emitter: by the errors of both ends
    (and of the step off the surface) seen along the ray."""
    clearance = 2.0 * (error + surface_error) / np.maximum(cosine, SMALLEST_COSINE)
    return np.maximum(distance - clearance, 0.0)


def _aim_at_spheres(emitters: Emitters, surface: Surface, picked: Numbers, pair: Floats) -> LightSamples:
    """Directions even over the cones in which spheres are seen."""
    tables, (instance, primitive) = emitters.tables, locate_emitters(emitters, picked)
    sphere = find_spheres(tables, instance, primitive)
    radii = tables.geometry.radii[sphere]
    offset = tables.geometry.centres[sphere] - surface.position
    direction = sample_sphere_directions(offset, radii, pair)
    distance = distance_to_sphere(offset, radii, direction)
    distance = np.where(np.isinf(distance), dot(offset, direction), distance)
    cosine = np.abs(dot(direction, offset - distance[:, np.newaxis] * direction)) / radii
    error = INTERPOLATION_ERROR * length(tables.geometry.centres[sphere]) + CASTER_ERROR * radii
    density = emitter_density(emitters, surface.position, direction, instance, primitive)
    weight = divide_rows(emitters.radiance[find_picked_materials(emitters, picked)], density)
    return LightSamples(direction, stop_before(distance, cosine, error, surface.position_error), weight, density)


def emitter_density(
    emitters: Emitters, origins: Floats, directions: Floats, instance: Integers, primitive: Integers
) -> Floats:
    """Return the density per solid angle (n,) with which picked emitters are sampled in unit directions (n, 3) that
    meet the given primitives; 0 where those do not shine, or are met edge-on."""
    tables = emitters.tables
    share_per_area = emitters.power_density[find_materials(tables, instance, primitive)]
    density = np.zeros(len(instance))
    shines = share_per_area > 0
    flat = np.flatnonzero(shines & tables.geometry.belongs_to_kind(instance, Kind.TRIANGLE))
    if len(flat):
        a, b, c = world_corners(tables.geometry, instance[flat], primitive[flat])
        edges = cross(b - a, c - a)
        normal = normalize(edges)
        slope = dot(directions[flat], normal)
        distance = np.divide(dot(a - origins[flat], normal), slope, out=np.zeros(len(flat)), where=slope != 0)
        density[flat] = np.divide(distance**2, np.abs(slope), out=np.zeros(len(flat)), where=slope != 0)
        if emitters.instanced is not None:
            area = length(edges) / 2.0
            share_per_area[flat] = _find_densities(emitters, instance[flat], primitive[flat], area)[1]
    round_ = np.flatnonzero(shines & tables.geometry.belongs_to_kind(instance, Kind.SPHERE))
    if len(round_):
        sphere = find_spheres(tables, instance[round_], primitive[round_])
        offset, radii = tables.geometry.centres[sphere] - origins[round_], tables.geometry.radii[sphere]
        density[round_] = 4.0 * np.pi * radii**2 * sphere_density(offset, radii)
    return share_per_area * density
