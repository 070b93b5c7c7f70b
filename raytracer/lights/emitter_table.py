"""All emissive primitives of a scene, and how much of the light's samples each of them gets.

Triangles and spheres are listed one by one, in world space; those of meshes with several instances are not, where there
are many (`instanced_emitters`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import any_column, mean_column
from raytracer.arrays.types import Floats, Integers
from raytracer.arrays.vectors import normalize
from raytracer.bsdfs.bounce_kinds import COUNTED
from raytracer.casting.geometry import Kind, join_id, split_id, world_corners
from raytracer.casting.rays import Hits, Rays
from raytracer.lecture import cross, length
from raytracer.lights.instanced_emitters import (
    InstancedEmitters,
    find_emissive,
    find_instanced_meshes,
    find_materials,
    make_instanced_emitters,
)
from raytracer.shading.light_path import Depths, LightPath, describe_sampling
from raytracer.surfaces.surface import Surface, make_surface
from raytracer.surfaces.surface_tables import CASTER_ERROR, INTERPOLATION_ERROR, LARGEST_TABLE, SurfaceTables

# Points at which a radiance that varies is looked at before the render, to share out the samples of lights.
ESTIMATE_POINTS = 256
# What seems dark at all of them keeps this share of the brightest.
LEAST_SHARE = 2.0**-6
# Even steps through three dimensions: powers of the inverse of the real root of x^4 = x + 1 (M. Roberts, "The
# Unreasonable Effectiveness of Quasirandom Sequences", 2018).
GOLDEN_STEPS = 1.2207440846057596 ** -np.arange(1.0, 4.0)

RadianceAt = Callable[[Surface, LightPath], Floats]
Numbers = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Emitters:
    """All emissive primitives of a scene; k of them are listed, the others belong to `instanced`.

    An emitter's number is its row in the list, or k more than its primitive id.

    instance, primitive : (k,) int32, as in Hits
    material : (k,) int32
    corners : (k, 3 corners, 3) float64, world, and normal : (k, 3) float64, unit, of triangles; 0 for spheres
    error : (k,) float64, metres, bound on the error of a point on the triangle
    cumulative : (u,) float64, running sum of the shares of power of what is picked first: the listed primitives and
        the whole instances of `instanced`, by instance; ends at 1
    power : float, the mean size of radiance times area, of all together
    power_density : (materials,) float64, the material's mean size of radiance over `power`: the share of a primitive of
        area A is A times this
    radiance : (materials, 3) float64, 1 for those that programs compute
    varies : (materials,) bool, True for those, or None where all are constant
    find_radiance : (n, 3) radiance at points of a surface; asked for materials that vary
    instanced : None where all are listed
    number : (u,) int64, of each listed primitive, or of the instance's first; None where all are listed
    """

    tables: SurfaceTables
    instance: Integers
    primitive: Integers
    material: Integers
    corners: Floats
    normal: Floats
    error: Floats
    cumulative: Floats
    power: float
    power_density: Floats
    radiance: Floats
    varies: NDArray[np.bool_] | None = None
    find_radiance: RadianceAt | None = None
    instanced: InstancedEmitters | None = None
    number: NDArray[np.int64] | None = None

    @property
    def is_empty(self) -> bool:
        """True where nothing shines."""
        return not len(self.cumulative)

    @property
    def has_spheres(self) -> bool:
        """True where some of the primitives are spheres."""
        return bool(self.tables.geometry.belongs_to_kind(self.instance, Kind.SPHERE).any())

    @property
    def records(self) -> Integers:
        """The instances and groups that shine, some repeatedly."""
        return self.instance if self.instanced is None else np.concatenate([self.instance, self.instanced.instance])


def make_emitters(
    tables: SurfaceTables,
    radiance: Floats,
    find_radiance: RadianceAt | None = None,
    present: NDArray[np.bool_] | None = None,
    largest: int = LARGEST_TABLE,
) -> Emitters:
    """Collect the primitives whose material has radiance (materials, 3) other than 0, or NaN: `find_radiance` tells.

    Curves shine where they are met, but are not picked, as in Cycles.

    present : (instances + groups,) bool, True for those that count; None where all do
    largest : of more triangles, those of meshes with several instances are not listed
    """
    varies = any_column(np.isnan(radiance))
    radiance = np.where(varies[:, np.newaxis], 1.0, radiance)
    records = np.arange(tables.geometry.kind_owners[Kind.CURVE])
    if present is not None:
        records = records[present[records]]
    meshes = find_instanced_meshes(tables, radiance, records, largest)
    emitters = _collect(tables, radiance, mean_column(np.abs(radiance)), records, meshes)
    if find_radiance is None or not varies.any():
        return emitters
    mean = _estimate_means(emitters, varies, find_radiance)
    return replace(_collect(tables, radiance, mean, records, meshes), varies=varies, find_radiance=find_radiance)


def _collect(tables: SurfaceTables, radiance: Floats, mean: Floats, records: Numbers, meshes: Integers) -> Emitters:
    """Return the primitives that shine.

    mean : (materials,), by which they are picked; records : that count; meshes : whose triangles are not listed
    """
    instanced = make_instanced_emitters(tables, meshes, records, radiance, mean)
    listed = records if instanced is None else _leave_out(tables, records, meshes)
    found = [find_emissive(tables, record, radiance) for record in listed]
    instance = np.repeat(listed, [len(rows) for rows in found]).astype(np.int32)
    primitive = np.concatenate([np.zeros(0, np.int32), *found])
    material = find_materials(tables, instance, primitive)
    corners = _gather_corners(tables, instance, primitive)
    power = _areas(tables, instance, primitive, corners) * mean[material]
    shining = power > 0  # a triangle without area cannot be picked
    number = None
    shares, total = power[shining], float(power.sum())
    if instanced is not None:
        shares, number = _join_instances(tables, instance[shining], shares, instanced)
        total = float(shares.sum())
    normal, error = measure_corners(corners[shining])
    return Emitters(
        tables=tables,
        instance=instance[shining],
        primitive=primitive[shining],
        material=material[shining],
        corners=corners[shining],
        normal=normal,
        error=error,
        cumulative=np.cumsum(shares) / total if total > 0 else shares,
        power=total,
        power_density=mean / total if total > 0 else np.zeros_like(mean),
        radiance=radiance,
        instanced=instanced,
        number=number,
    )


def _leave_out(tables: SurfaceTables, records: Numbers, meshes: Integers) -> Numbers:
    """Return the records that are not instances of `meshes`."""
    count = len(tables.geometry.instance_mesh)
    left_out = np.zeros(len(tables.material_first), dtype=np.bool_)
    left_out[:count] = np.isin(tables.geometry.instance_mesh, meshes)
    return records[~left_out[records]]


def _join_instances(
    tables: SurfaceTables, instance: Integers, power: Floats, instanced: InstancedEmitters
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the power (u,) of listed primitives (k,) and of whole instances, in the order of all instances, and their
    numbers: as if the triangles were listed, but for rounding."""
    order = np.argsort(np.concatenate([instance, instanced.instance]), kind="stable")
    first = len(instance) + tables.geometry.first_id[instanced.instance]
    number = np.concatenate([np.arange(len(instance)), first])
    return np.concatenate([power, instanced.power[instanced.instance]])[order], number[order]


def measure_corners(corners: Floats) -> tuple[Floats, Floats]:
    """Return the unit normals (n, 3) of triangles (n, 3 corners, 3) and the bound on the error of their points."""
    a, b, c = (corners[:, k] for k in range(3))
    magnitude = np.maximum(np.maximum(length(a), length(b)), length(c))
    error = INTERPOLATION_ERROR * magnitude + CASTER_ERROR * np.maximum(length(b - a), length(c - a))
    return normalize(cross(b - a, c - a)), error


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
    areas[~flat] = 4.0 * np.pi * tables.geometry.radii[find_spheres(tables, instance[~flat], primitive[~flat])] ** 2
    return areas


def find_spheres(tables: SurfaceTables, instance: Integers, primitive: Integers) -> NDArray[np.int64]:
    """Return the rows (n,) of spheres among all."""
    return tables.geometry.find_rows(join_id(tables.geometry, instance, primitive), Kind.SPHERE)


def locate_emitters(emitters: Emitters, picked: Numbers) -> tuple[Integers, Integers]:
    """Return (instance, primitive), both (n,) int32, of emitters by their numbers."""
    if emitters.instanced is None:
        return emitters.instance[picked], emitters.primitive[picked]
    listed = len(emitters.instance)
    instance, primitive = split_id(emitters.tables.geometry, np.maximum(picked - listed, 0))
    rows = np.flatnonzero(picked < listed)
    instance[rows], primitive[rows] = emitters.instance[picked[rows]], emitters.primitive[picked[rows]]
    return instance, primitive


def _estimate_means(emitters: Emitters, varies: NDArray[np.bool_], find_radiance: RadianceAt) -> Floats:
    """Return about the mean radiance of each material (materials,): of those that vary from ESTIMATE_POINTS of their
    points; never 0, for they may shine elsewhere."""
    mean = mean_column(np.abs(emitters.radiance))
    numbers = (np.arange(ESTIMATE_POINTS)[:, np.newaxis] + 0.5) * GOLDEN_STEPS % 1.0
    for material in np.flatnonzero(varies):
        rows = _list_candidates(emitters, material, numbers[:, 2])
        if not len(rows):
            continue
        picked = rows[(numbers[:, 2] * len(rows)).astype(np.int64)]
        surface = place_surface(emitters, picked, numbers[:, :2], None, None)
        # As if from a metre away, after the first bounce.
        depths = Depths(np.zeros(ESTIMATE_POINTS, np.int32), np.zeros((ESTIMATE_POINTS, len(COUNTED)), np.int32))
        mean[material] = np.abs(find_radiance(surface, describe_sampling(np.ones(ESTIMATE_POINTS), depths))).mean()
    return np.maximum(mean, LEAST_SHARE * max(mean.max(initial=0.0), np.finfo(np.float64).tiny))


def _list_candidates(emitters: Emitters, material: int, choice: Floats) -> Numbers:
    """Return the numbers of the emitters of one material; of each mesh with instances only some, by uniform numbers."""
    listed = np.flatnonzero(emitters.material == material)
    if emitters.instanced is None:
        return listed
    tables, geometry, found = emitters.tables, emitters.tables.geometry, [listed]
    mesh = geometry.instance_mesh[emitters.instanced.instance]
    for placed in (emitters.instanced.instance[mesh == other] for other in np.unique(mesh)):
        primitives = find_emissive(tables, placed[0], emitters.radiance)
        primitives = primitives[find_materials(tables, np.full(len(primitives), placed[0]), primitives) == material]
        if len(primitives):
            instance = placed[np.arange(len(choice)) * len(placed) // len(choice)]
            primitive = primitives[(choice * len(primitives)).astype(np.int64)]
            found.append(len(emitters.instance) + join_id(geometry, instance, primitive))
    return np.concatenate(found)


def place_surface(
    emitters: Emitters, picked: Numbers, pair: Floats, rays: Rays | None, distance: Floats | None
) -> Surface:
    """Return the surface at points of primitives, as rays see it that end there; None: seen from straight above, where
    a sphere is met at one point."""
    instance, primitive = locate_emitters(emitters, picked)
    root = np.sqrt(pair[:, 0])
    weights = np.stack([root * (1.0 - pair[:, 1]), root * pair[:, 1]], axis=1)
    count = len(picked)
    if rays is None:
        down = np.tile((0.0, 0.0, -1.0), (count, 1))
        rays, distance = Rays(-down, down, np.zeros(count), np.full(count, np.inf)), np.zeros(count)
    assert distance is not None
    hits = Hits(distance, np.zeros(count), instance, primitive, weights, np.ones(count, dtype=np.bool_))
    return make_surface(emitters.tables, rays, hits)
