"""Emissive geometry: triangles and spheres as one light, picked in proportion to their power.

A triangle of area A, picked with probability p, is sampled evenly on its area; density A^-1 there is t^2 / (A cos) in
solid angle. A sphere is sampled evenly over the cone in which it is seen. Both sides of a surface shine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import any_column, mean_column, take_rows
from raytracer.arrays.types import Floats, Integers
from raytracer.arrays.vectors import normalize
from raytracer.casting.geometry import Kind, join_id, world_corners
from raytracer.casting.rays import Hits, Rays
from raytracer.lecture import cross, dot, length
from raytracer.lights.light_shapes import (
    LightSamples,
    distance_to_sphere,
    divide_rows,
    sample_sphere_directions,
    sphere_density,
)
from raytracer.shading.light_path import Depths, LightPath, describe_sampling
from raytracer.surfaces.surface import Surface, make_surface
from raytracer.surfaces.surface_tables import CASTER_ERROR, INTERPOLATION_ERROR, SurfaceTables, interpolate

# Emitters seen closer to edge-on than this light nothing that a float64 could tell from 0; keeps their distance finite.
SMALLEST_COSINE = 2.0**-26

# Points at which a radiance that varies is looked at before the render, to share out the samples of lights.
ESTIMATE_POINTS = 256
# What seems dark at all of them keeps this share of the brightest.
LEAST_SHARE = 2.0**-6
# Even steps through three dimensions: powers of the inverse of the real root of x^4 = x + 1 (M. Roberts, "The
# Unreasonable Effectiveness of Quasirandom Sequences", 2018).
GOLDEN_STEPS = 1.2207440846057596 ** -np.arange(1.0, 4.0)

RadianceAt = Callable[[Surface, LightPath], Floats]


@dataclass(frozen=True, eq=False)
class Emitters:
    """All emissive primitives of a scene.

    instance, primitive : (k,) int32, as in Hits
    material : (k,) int32
    corners : (k, 3 corners, 3) float64, world, and normal : (k, 3) float64, unit, of triangles; 0 for spheres
    error : (k,) float64, metres, bound on the error of a point on the triangle
    cumulative : (k,) float64, running sum of the shares of power, ending at 1
    power_density : (materials,) float64, the material's mean size of radiance times pi over the total power: the share
        of a primitive of area A is A times this
    radiance : (materials, 3) float64, 1 for those that programs compute
    varies : (materials,) bool, True for those, or None where all are constant
    find_radiance : (n, 3) radiance at points of a surface; asked for materials that vary
    """

    tables: SurfaceTables
    instance: Integers
    primitive: Integers
    material: Integers
    corners: Floats
    normal: Floats
    error: Floats
    cumulative: Floats
    power_density: Floats
    radiance: Floats
    varies: NDArray[np.bool_] | None = None
    find_radiance: RadianceAt | None = None

    @property
    def is_empty(self) -> bool:
        """True where nothing shines."""
        return not len(self.instance)

    @property
    def has_spheres(self) -> bool:
        """True where some of the primitives are spheres."""
        return bool(self.tables.geometry.belongs_to_kind(self.instance, Kind.SPHERE).any())


def make_emitters(
    tables: SurfaceTables,
    radiance: Floats,
    find_radiance: RadianceAt | None = None,
    present: NDArray[np.bool_] | None = None,
) -> Emitters:
    """Collect the primitives whose material has radiance (materials, 3) other than 0, or NaN: `find_radiance` tells.

    present : (instances + groups,) bool, True for those that count; None where all do
    """
    varies = any_column(np.isnan(radiance))
    radiance = np.where(varies[:, np.newaxis], 1.0, radiance)
    emitters = _collect(tables, radiance, mean_column(np.abs(radiance)), present)
    if find_radiance is None or not varies.any():
        return emitters
    mean = _estimate_means(emitters, varies, find_radiance)
    return replace(_collect(tables, radiance, mean, present), varies=varies, find_radiance=find_radiance)


def _collect(
    tables: SurfaceTables, radiance: Floats, mean: Floats, present: NDArray[np.bool_] | None = None
) -> Emitters:
    """Return the primitives that shine; mean : (materials,), by which they are picked."""
    found = [
        _find_emissive(tables, record, radiance) if present is None or present[record] else np.zeros(0, np.int32)
        for record in range(len(tables.material_first))
    ]
    instance = np.concatenate(
        [np.zeros(0, np.int32), *(np.full(len(rows), k, np.int32) for k, rows in enumerate(found))]
    )
    primitive = np.concatenate([np.zeros(0, np.int32), *found])
    material = _materials(tables, instance, primitive)
    corners = _gather_corners(tables, instance, primitive)
    power = _areas(tables, instance, primitive, corners) * mean[material]
    total = power.sum()
    shining = power > 0  # a triangle without area cannot be picked
    a, b, c = (corners[shining, k] for k in range(3))
    magnitude = np.maximum(np.maximum(length(a), length(b)), length(c))
    return Emitters(
        tables=tables,
        instance=instance[shining],
        primitive=primitive[shining],
        material=material[shining],
        corners=corners[shining],
        normal=normalize(cross(b - a, c - a)),
        error=INTERPOLATION_ERROR * magnitude + CASTER_ERROR * np.maximum(length(b - a), length(c - a)),
        cumulative=np.cumsum(power[shining]) / total if total > 0 else power[shining],
        power_density=mean / total if total > 0 else np.zeros_like(mean),
        radiance=radiance,
    )


def _estimate_means(emitters: Emitters, varies: NDArray[np.bool_], find_radiance: RadianceAt) -> Floats:
    """Return about the mean radiance of each material (materials,): of those that vary from ESTIMATE_POINTS of their
    points; never 0, for they may shine elsewhere."""
    mean = mean_column(np.abs(emitters.radiance))
    material = emitters.material
    numbers = (np.arange(ESTIMATE_POINTS)[:, np.newaxis] + 0.5) * GOLDEN_STEPS % 1.0
    for number in np.flatnonzero(varies):
        rows = np.flatnonzero(material == number)
        if not len(rows):
            continue
        picked = rows[(numbers[:, 2] * len(rows)).astype(np.int64)]
        surface = _place_surface(emitters, picked, numbers[:, :2], None, None)
        # As if from a metre away, after the first bounce.
        depths = Depths(np.zeros(ESTIMATE_POINTS, np.int32), np.zeros((ESTIMATE_POINTS, 3), np.int32))
        mean[number] = np.abs(find_radiance(surface, describe_sampling(np.ones(ESTIMATE_POINTS), depths))).mean()
    return np.maximum(mean, LEAST_SHARE * max(mean.max(initial=0.0), np.finfo(np.float64).tiny))


def _place_surface(
    emitters: Emitters, picked: NDArray[np.intp], pair: Floats, rays: Rays | None, distance: Floats | None
) -> Surface:
    """Return the surface at points of primitives, as rays see it that end there; None: seen from straight above, where
    a sphere is met at one point."""
    instance, primitive = emitters.instance[picked], emitters.primitive[picked]
    root = np.sqrt(pair[:, 0])
    weights = np.stack([root * (1.0 - pair[:, 1]), root * pair[:, 1]], axis=1)
    count = len(picked)
    if rays is None:
        down = np.tile((0.0, 0.0, -1.0), (count, 1))
        rays, distance = Rays(-down, down, np.zeros(count), np.full(count, np.inf)), np.zeros(count)
    assert distance is not None
    hits = Hits(distance, np.zeros(count), instance, primitive, weights, np.ones(count, dtype=np.bool_))
    return make_surface(emitters.tables, rays, hits)


def vary_radiance(
    emitters: Emitters,
    picked: NDArray[np.intp],
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
    material = emitters.material[picked]
    rows = np.flatnonzero(emitters.varies[material] & (light.density > 0))
    if not len(rows):
        return
    count = len(rows)
    rays = Rays(surface.position[rows], light.direction[rows], np.zeros(count), np.full(count, np.inf))
    shining = _place_surface(emitters, picked[rows], pair[rows], rays, light.distance[rows])
    path = describe_sampling(light.distance[rows], None if depths is None else depths.select(rows))
    light.weight[rows] *= emitters.find_radiance(shining, path)


def _find_emissive(tables: SurfaceTables, record: int, radiance: Floats) -> Integers:
    """Return the emissive primitives of one instance or group."""
    count = int(np.diff(tables.geometry.first_id)[record])
    primitives = np.arange(count, dtype=np.int32)
    material = _materials(tables, np.full(count, record, dtype=np.int32), primitives)
    return primitives[any_column(radiance[material] != 0)]


def _materials(tables: SurfaceTables, instance: Integers, primitive: Integers) -> Integers:
    return tables.material[tables.material_first[instance] + tables.material_step[instance] * primitive]


def _spheres(tables: SurfaceTables, instance: Integers, primitive: Integers) -> NDArray[np.int64]:
    return tables.geometry.find_rows(join_id(tables.geometry, instance, primitive), Kind.SPHERE)


def _gather_corners(tables: SurfaceTables, instance: Integers, primitive: Integers) -> Floats:
    """Return the world corners (k, 3 corners, 3) of triangles, 0 for spheres."""
    corners = np.zeros((len(instance), 3, 3))
    flat = tables.geometry.belongs_to_kind(instance, Kind.TRIANGLE)
    corners[flat] = np.stack(world_corners(tables.geometry, instance[flat], primitive[flat]), axis=1)
    return corners


def _areas(tables: SurfaceTables, instance: Integers, primitive: Integers, corners: Floats) -> Floats:
    """Return the area of each primitive: |(b - a) x (c - a)| / 2, or 4 pi r^2."""
    a, b, c = (corners[:, k] for k in range(3))
    areas = length(cross(b - a, c - a)) / 2.0
    flat = tables.geometry.belongs_to_kind(instance, Kind.TRIANGLE)
    areas[~flat] = 4.0 * np.pi * tables.geometry.radii[_spheres(tables, instance[~flat], primitive[~flat])] ** 2
    return areas


def sample_picked(
    emitters: Emitters, surface: Surface, picked: NDArray[np.intp], pair: Floats, depths: Depths | None = None
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


def _aim_at_picked(emitters: Emitters, surface: Surface, picked: NDArray[np.intp], pair: Floats) -> LightSamples:
    """Sample directions to emitters `picked` (n,) as if those that vary had radiance 1."""
    spheres = np.flatnonzero(emitters.tables.geometry.belongs_to_kind(emitters.instance[picked], Kind.SPHERE))
    if not len(spheres):
        return sample_placed(place_on_triangles(emitters, picked, pair), surface)
    samples = LightSamples(
        *(np.zeros(shape) for shape in ((len(picked), 3), len(picked), (len(picked), 3), len(picked)))
    )
    flat = np.flatnonzero(emitters.tables.geometry.belongs_to_kind(emitters.instance[picked], Kind.TRIANGLE))
    for rows, part in (
        (flat, sample_placed(place_on_triangles(emitters, picked[flat], pair[flat]), surface.select(flat))),
        (spheres, _aim_at_spheres(emitters, surface.select(spheres), picked[spheres], pair[spheres])),
    ):
        for name in ("direction", "distance", "weight", "density"):
            getattr(samples, name)[rows] = getattr(part, name)
    return samples


def pick_emitters(emitters: Emitters, choice: Floats) -> NDArray[np.intp]:
    """Return (n,) rows of `emitters`, in proportion to their power, for uniform numbers (n,)."""
    return np.searchsorted(emitters.cumulative, choice, side="right").clip(max=len(emitters.cumulative) - 1)


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
            *(getattr(self, name).take(rows, axis=0) for name in ("position", "normal", "error", "density", "radiance"))
        )


def place_on_triangles(emitters: Emitters, picked: NDArray[np.intp], pair: Floats) -> EmitterPoints:
    """Return points even on the triangles `picked` (n,), beta = sqrt(u) (1 - v), gamma = sqrt(u) v."""
    corners = take_rows(emitters.corners, picked)
    root = np.sqrt(pair[:, 0])
    weights = np.stack([root * (1.0 - pair[:, 1]), root * pair[:, 1]], axis=1)
    material = emitters.material[picked]
    return EmitterPoints(
        position=interpolate(weights, corners[:, 0], corners[:, 1], corners[:, 2]),
        normal=take_rows(emitters.normal, picked),
        error=emitters.error[picked],
        density=emitters.power_density[material],
        radiance=take_rows(emitters.radiance, material),
    )


def sample_placed(points: EmitterPoints, surface: Surface) -> LightSamples:
    """Return the samples from each point of `surface` towards one of `points`: density t^2 / cos of that per area."""
    offset = points.position - surface.position
    distance = length(offset)
    direction = divide_rows(offset, distance)
    cosine = np.abs(dot(direction, points.normal))
    density = divide_rows(points.density * (distance * distance), cosine)
    reach = _stop_before(distance, cosine, points.error, surface.position_error)
    weight = divide_rows(points.radiance, density)
    return LightSamples(direction, reach, weight, density, points.position, divide_rows(reach, distance))


def _stop_before(distance: Floats, cosine: Floats, error: Floats, surface_error: Floats) -> Floats:
    """Shorten shadow rays (n,), metres, to end before the emitter, by the errors of both ends (and of the step off the
    surface) seen along the ray."""
    clearance = 2.0 * (error + surface_error) / np.maximum(cosine, SMALLEST_COSINE)
    return np.maximum(distance - clearance, 0.0)


def _aim_at_spheres(emitters: Emitters, surface: Surface, picked: NDArray[np.intp], pair: Floats) -> LightSamples:
    """Directions even over the cones in which spheres are seen."""
    tables, instance, primitive = emitters.tables, emitters.instance[picked], emitters.primitive[picked]
    sphere = _spheres(tables, instance, primitive)
    radii = tables.geometry.radii[sphere]
    offset = tables.geometry.centres[sphere] - surface.position
    direction = sample_sphere_directions(offset, radii, pair)
    distance = distance_to_sphere(offset, radii, direction)
    distance = np.where(np.isinf(distance), dot(offset, direction), distance)
    cosine = np.abs(dot(direction, offset - distance[:, np.newaxis] * direction)) / radii
    error = INTERPOLATION_ERROR * length(tables.geometry.centres[sphere]) + CASTER_ERROR * radii
    density = emitter_density(emitters, surface.position, direction, instance, primitive)
    weight = divide_rows(emitters.radiance[emitters.material[picked]], density)
    return LightSamples(direction, _stop_before(distance, cosine, error, surface.position_error), weight, density)


def emitter_density(
    emitters: Emitters, origins: Floats, directions: Floats, instance: Integers, primitive: Integers
) -> Floats:
    """Return the density per solid angle (n,) with which picked emitters are sampled in unit directions (n, 3) that
    meet the given primitives; 0 where those do not shine, or are met edge-on."""
    tables = emitters.tables
    share_per_area = emitters.power_density[_materials(tables, instance, primitive)]
    density = np.zeros(len(instance))
    shines = share_per_area > 0
    flat = np.flatnonzero(shines & tables.geometry.belongs_to_kind(instance, Kind.TRIANGLE))
    if len(flat):
        a, b, c = world_corners(tables.geometry, instance[flat], primitive[flat])
        normal = normalize(cross(b - a, c - a))
        slope = dot(directions[flat], normal)
        distance = np.divide(dot(a - origins[flat], normal), slope, out=np.zeros(len(flat)), where=slope != 0)
        density[flat] = np.divide(distance**2, np.abs(slope), out=np.zeros(len(flat)), where=slope != 0)
    round_ = np.flatnonzero(shines & tables.geometry.belongs_to_kind(instance, Kind.SPHERE))
    if len(round_):
        sphere = _spheres(tables, instance[round_], primitive[round_])
        offset, radii = tables.geometry.centres[sphere] - origins[round_], tables.geometry.radii[sphere]
        density[round_] = 4.0 * np.pi * radii**2 * sphere_density(offset, radii)
    return share_per_area * density
