"""Geometry that shines: emissive triangles and spheres as one light, picked in proportion to their power.

A triangle of area A, picked with probability p, is sampled evenly on its area; density A^-1 there is t^2 / (A cos) in
solid angle. A sphere is sampled evenly over the cone in which it is seen. Both sides of a surface shine.
Imports `lecture`, `frames`, `light_shapes`, `surface`, `accelerate.geometry`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.accelerate.geometry import world_corners
from raytracer.frames import normalize
from raytracer.lecture import cross, dot, length
from raytracer.light_shapes import LightSamples, distance_to_sphere, sample_sphere_directions, sphere_density
from raytracer.rays import Floats, Integers, Surface
from raytracer.surface import CASTER_ERROR, INTERPOLATION_ERROR, SurfaceTables, interpolate

# Emitters seen closer to edge-on than this light nothing that a float64 could tell from 0; keeps their distance finite.
SMALLEST_COSINE = 2.0**-26


@dataclass(frozen=True, eq=False)
class Emitters:
    """All emissive primitives of a scene.

    instance, primitive : (k,) int32, as in Hits
    cumulative : (k,) float64, running sum of the shares of power, ending at 1
    power_density : (materials,) float64, the material's mean radiance times pi over the total power: the share of a
        primitive of area A is A times this
    radiance : (materials, 3) float64
    """

    tables: SurfaceTables
    instance: Integers
    primitive: Integers
    cumulative: Floats
    power_density: Floats
    radiance: Floats

    @property
    def is_empty(self) -> bool:
        """True where nothing shines."""
        return not len(self.instance)


def make_emitters(tables: SurfaceTables, radiance: Floats) -> Emitters:
    """Collect the primitives whose material has radiance (materials, 3) above 0."""
    found = [_find_emissive(tables, record, radiance) for record in range(len(tables.material_first))]
    instance = np.concatenate(
        [np.zeros(0, np.int32), *(np.full(len(rows), k, np.int32) for k, rows in enumerate(found))]
    )
    primitive = np.concatenate([np.zeros(0, np.int32), *found])
    mean = radiance.mean(axis=1)
    power = _areas(tables, instance, primitive) * mean[_materials(tables, instance, primitive)]
    total = power.sum()
    shining = power > 0  # a triangle without area cannot be picked
    return Emitters(
        tables=tables,
        instance=instance[shining],
        primitive=primitive[shining],
        cumulative=np.cumsum(power[shining]) / total if total > 0 else power[shining],
        power_density=mean / total if total > 0 else np.zeros_like(mean),
        radiance=radiance,
    )


def _find_emissive(tables: SurfaceTables, record: int, radiance: Floats) -> Integers:
    """Return the emissive primitives of one instance or group."""
    count = int(np.diff(tables.geometry.first_id)[record])
    primitives = np.arange(count, dtype=np.int32)
    material = _materials(tables, np.full(count, record, dtype=np.int32), primitives)
    return primitives[(radiance[material] > 0).any(axis=1)]


def _materials(tables: SurfaceTables, instance: Integers, primitive: Integers) -> Integers:
    return tables.material[tables.material_first[instance] + tables.material_step[instance] * primitive]


def _spheres(tables: SurfaceTables, instance: Integers, primitive: Integers) -> NDArray[np.int64]:
    return tables.geometry.first_id[instance] + primitive - tables.geometry.sphere_id


def _areas(tables: SurfaceTables, instance: Integers, primitive: Integers) -> Floats:
    """Return the area of each primitive: |(b - a) x (c - a)| / 2, or 4 pi r^2."""
    areas = np.empty(len(instance))
    flat = instance < tables.instance_count
    a, b, c = world_corners(tables.geometry, instance[flat], primitive[flat])
    areas[flat] = length(cross(b - a, c - a)) / 2.0
    areas[~flat] = 4.0 * np.pi * tables.geometry.radii[_spheres(tables, instance[~flat], primitive[~flat])] ** 2
    return areas


def sample_emitters(emitters: Emitters, surface: Surface, choice: Floats, pair: Floats) -> LightSamples:
    """Sample a direction to the emissive geometry from each point of `surface`.

    Parameters
    ----------
    choice, pair : (n,), (n, 2) uniform numbers
    """
    picked = np.searchsorted(emitters.cumulative, choice, side="right").clip(max=len(emitters.cumulative) - 1)
    instance, primitive = emitters.instance[picked], emitters.primitive[picked]
    count = len(choice)
    direction, distance = np.zeros((count, 3)), np.zeros(count)
    for rows, sample in (
        (np.flatnonzero(instance < emitters.tables.instance_count), _sample_triangles),
        (np.flatnonzero(instance >= emitters.tables.instance_count), _sample_spheres),
    ):
        if len(rows):
            at = surface.position[rows]
            direction[rows], distance[rows], cosine, error = sample(
                emitters.tables, at, instance[rows], primitive[rows], pair[rows]
            )
            # Ends before the emitter, by the errors of both ends (and of the step off the surface) seen along the ray.
            clearance = 2.0 * (error + surface.position_error[rows]) / np.maximum(cosine, SMALLEST_COSINE)
            distance[rows] = np.maximum(distance[rows] - clearance, 0.0)
    density = emitter_density(emitters, surface.position, direction, instance, primitive)
    radiance = emitters.radiance[_materials(emitters.tables, instance, primitive)]
    weight = np.divide(radiance, density[:, np.newaxis], out=np.zeros((count, 3)), where=density[:, np.newaxis] > 0)
    return LightSamples(direction, distance, weight, density)


def _sample_triangles(
    tables: SurfaceTables, positions: Floats, instance: Integers, primitive: Integers, pair: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Points even on triangles, beta = sqrt(u) (1 - v), gamma = sqrt(u) v.

    Returns direction (n, 3), distance, cosine at the emitter and error of its position, each (n,).
    """
    corners = world_corners(tables.geometry, instance, primitive)
    root = np.sqrt(pair[:, 0])
    target = interpolate(np.stack([root * (1.0 - pair[:, 1]), root * pair[:, 1]], axis=1), *corners)
    offset = target - positions
    direction = normalize(offset)
    a, b, c = corners
    cosine = np.abs(dot(direction, normalize(cross(b - a, c - a))))
    magnitude = np.maximum(np.maximum(length(a), length(b)), length(c))
    error = INTERPOLATION_ERROR * magnitude + CASTER_ERROR * np.maximum(length(b - a), length(c - a))
    return direction, length(offset), cosine, error


def _sample_spheres(
    tables: SurfaceTables, positions: Floats, instance: Integers, primitive: Integers, pair: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Directions even over the cones in which spheres are seen; returns what `_sample_triangles` does."""
    sphere = _spheres(tables, instance, primitive)
    radii = tables.geometry.radii[sphere]
    offset = tables.geometry.centres[sphere] - positions
    direction = sample_sphere_directions(offset, radii, pair)
    distance = distance_to_sphere(offset, radii, direction)
    distance = np.where(np.isinf(distance), dot(offset, direction), distance)
    cosine = np.abs(dot(direction, offset - distance[:, np.newaxis] * direction)) / radii
    error = INTERPOLATION_ERROR * length(tables.geometry.centres[sphere]) + CASTER_ERROR * radii
    return direction, distance, cosine, error


def emitter_density(
    emitters: Emitters, origins: Floats, directions: Floats, instance: Integers, primitive: Integers
) -> Floats:
    """Return the density per solid angle (n,) with which `sample_emitters` takes unit directions (n, 3) that meet the
    given primitives; 0 where those do not shine, or are met edge-on."""
    tables = emitters.tables
    share_per_area = emitters.power_density[_materials(tables, instance, primitive)]
    density = np.zeros(len(instance))
    flat = np.flatnonzero(instance < tables.instance_count)
    if len(flat):
        a, b, c = world_corners(tables.geometry, instance[flat], primitive[flat])
        normal = normalize(cross(b - a, c - a))
        slope = dot(directions[flat], normal)
        distance = np.divide(dot(a - origins[flat], normal), slope, out=np.zeros(len(flat)), where=slope != 0)
        density[flat] = np.divide(distance**2, np.abs(slope), out=np.zeros(len(flat)), where=slope != 0)
    round_ = np.flatnonzero(instance >= tables.instance_count)
    if len(round_):
        sphere = _spheres(tables, instance[round_], primitive[round_])
        offset, radii = tables.geometry.centres[sphere] - origins[round_], tables.geometry.radii[sphere]
        density[round_] = 4.0 * np.pi * radii**2 * sphere_density(offset, radii)
    return share_per_area * density
