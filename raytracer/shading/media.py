"""Media at points in space: the volumes of materials and of the world, their programs evaluated, as mixtures.

A medium is the volume of one material of one object (`media.stack`). Its values are constant, or its program computes
them at each point. Nodes see what Cycles lets them see inside a volume: positions, coordinates of the object, grids by
name, and generated coordinates, which are those of the object's bounding box.

References
----------
Blender, intern/cycles/kernel/integrator/volume_shader.h.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Indices, Integers, Vectors
from raytracer.casting.geometry import pack_geometry, transform_points
from raytracer.media.mixtures import Mixture, add_mixtures, make_nothing
from raytracer.media.stack import MediaIndex
from raytracer.scene.camera import Camera
from raytracer.scene.media import Grid, Volume
from raytracer.scene.programs import Register
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Spheres
from raytracer.shading.evaluate import OPERATIONS, evaluate, find_needed, list_steps
from raytracer.shading.site import Site
from raytracer.shading.site_tables import SiteTables, make_site_tables
from raytracer.shading.volume_closures import list_lobes, mix_closures
from raytracer.surfaces.surface import imagine_surface
from raytracer.surfaces.surface_tables import SurfaceTables, make_surface_tables
from raytracer.textures.voxels import sample_grid

# Steps that read nothing but what is the same all over an object.
OF_OBJECT = ("OBJECT_INFO ", "OBJECT_PROPERTY ", "VIEW_LAYER_PROPERTY ")
GENERATED = "generated"


@dataclass(frozen=True, eq=False)
class MediaTable:
    """All media of a scene by number, then the world's, then nothing.

    index : which surfaces they lie behind
    instance : (media + 2,) int32, of the object; -1 of the last two
    varies : (media + 2,) bool, True where a program computes values that differ from place to place
    constant : Mixture of those that do not; 0 of others
    volume : (media + 2,) int64, number of the volume among `volumes`
    volumes : each volume once
    density : (media + 2,) float64, factor of the object
    sites, sky : what programs of objects and of the world read; None where nobody asks
    bounds : (instances + groups, 2, 3) float64, of each object, in its own space
    grids : by name, of each mesh, or None; and their matrices (4, 4) from object to index space
    world : number of the world's medium
    fills : True where the world has one
    """

    index: MediaIndex
    instance: Integers
    varies: Booleans
    constant: Mixture
    volume: NDArray[np.int64]
    volumes: tuple[Volume, ...]
    density: Floats
    sites: SiteTables | None
    sky: SiteTables | None
    bounds: Floats
    grids: Mapping[str, tuple[tuple[Grid, Floats] | None, ...]]
    world: int
    fills: bool

    @property
    def columns(self) -> int:
        """How many lobes a medium has at most."""
        return self.constant.lobes.kind.shape[1]


class VolumeSite(Site):
    """Points inside of volumes, as nodes see them."""

    @property
    def media(self) -> MediaTable:
        assert isinstance(self.tables, VolumeSiteTables)
        return self.tables.media

    def attribute_width(self, name: str) -> NDArray[np.int64]:
        """(n,) numbers per value of a grid; 3 of generated coordinates, 0 where there is none."""
        width = np.zeros(len(self), dtype=np.int64)
        for rows, grid, _ in self._find_grids(name):
            width[rows] = 1 if grid.values.ndim == 3 else grid.values.shape[3]
        if name == GENERATED:
            width[width == 0] = 3
        return width

    def read_attribute(self, name: str) -> Floats:
        """(n, 4) values of grids as color and alpha: numbers repeat, alpha is 1 where there is none."""
        values = np.zeros((len(self), 4))
        width = self.attribute_width(name)
        local = self.to_object(self.position)
        if name == GENERATED:
            low, high = np.moveaxis(self.media.bounds[self.surface.instance], 1, 0)
            size = np.where(high > low, high - low, 1.0)
            values[:, :3] = (local - low) / size
        for rows, grid, index_from_object in self._find_grids(name):
            found = sample_grid(grid, transform_points(index_from_object, local[rows]))
            channels = max(3, found.shape[-1]) if found.ndim == 2 else 3
            values[rows, :channels] = found if found.ndim == 2 else found[:, np.newaxis]
        values[(width > 0) & (width < 4), 3] = 1.0
        return values

    def _find_grids(self, name: str) -> list[tuple[Indices, Grid, Floats]]:
        """Return the rows whose mesh has a grid of that name, the grid and its matrix."""
        of_meshes = self.media.grids.get(name, ())
        if not of_meshes or self.tables is self.media.sky:
            return []
        instance, mesh_of = self.surface.instance, self.tables.geometry.instance_mesh
        mesh = np.where(instance < len(mesh_of), mesh_of[np.minimum(instance, len(mesh_of) - 1)], -1)
        found = []
        for number in np.unique(mesh):
            grid = None if number < 0 else of_meshes[number]
            if grid is not None:
                found.append((np.flatnonzero(mesh == number), *grid))
        return found


@dataclass(frozen=True, eq=False)
class VolumeSiteTables(SiteTables):
    """What programs of volumes read: objects and the camera, and the media."""

    media: MediaTable = None  # type: ignore[assignment]


def make_media_table(scene: Scene, surface: SurfaceTables, resolution: tuple[int, int] | None) -> MediaTable:
    """Return the media of a scene; resolution : of the full picture, pixels."""
    numbers: dict[Volume, int] = {}
    keys, instances, volumes = [], [], []
    for instance, materials in enumerate(_list_used_materials(scene)):
        for material in materials:
            volume = scene.materials[material].volume
            if volume is not None and volume.closures:
                keys.append(instance * len(scene.materials) + material)
                instances.append(instance)
                volumes.append(numbers.setdefault(volume, len(numbers)))
    # A record of its own, though an object may have the same: the world is no object.
    world = None if scene.world is None or scene.world.volume is None else replace(scene.world.volume)
    volumes += [numbers.setdefault(world or Volume(), len(numbers)), numbers.setdefault(Volume(), len(numbers))]
    varying = [_is_varying(volume) for volume in numbers]
    is_border = np.array([material.only_volume for material in scene.materials], dtype=np.bool_)
    count, columns = len(volumes), max(1, *(len(list_lobes(volume)) for volume in numbers))
    table = MediaTable(
        index=MediaIndex(np.array(keys, dtype=np.int64), len(scene.materials), is_border),
        instance=np.array([*instances, -1, -1], dtype=np.int32),
        varies=np.array([varying[number] for number in volumes], dtype=np.bool_),
        constant=make_nothing(count, columns),
        volume=np.array(volumes, dtype=np.int64),
        volumes=tuple(numbers),
        density=_gather_densities(scene, instances),
        sites=None,
        sky=None,
        bounds=_measure_bounds(scene),
        grids=_gather_grids(scene),
        world=count - 2,
        fills=world is not None and bool(world.closures),
    )
    if any(volume.program is not None for volume in numbers):
        sites = make_site_tables(scene, surface, set(), resolution)
        table = replace(table, sites=sites, sky=_make_sky_tables(scene.camera, resolution))
    return replace(table, constant=_fill_constants(table, scene))


def _list_used_materials(scene: Scene) -> list[list[int]]:
    """Return the materials of each instance, then group of spheres, rising."""
    of_mesh = [np.unique(mesh.material).tolist() for mesh in scene.meshes]
    placed = range(len(scene.meshes)) if scene.instances is None else scene.instances.mesh.tolist()
    return [*(of_mesh[mesh] for mesh in placed), *(np.unique(group.material).tolist() for group in scene.spheres)]


def _is_varying(volume: Volume) -> bool:
    """True where a parameter may differ from place to place."""
    registers = [register for closure in volume.closures for register in closure.registers.values()]
    if volume.program is None or not registers:
        return False
    steps = list_steps(volume.program, find_needed(volume.program, registers))
    return any(OPERATIONS[step.operation].reads_site and not step.operation.startswith(OF_OBJECT) for step in steps)


def _gather_densities(scene: Scene, instances: list[int]) -> Floats:
    given = None if scene.instances is None else scene.instances.volume_density
    factors = np.ones(scene.instance_count + len(scene.spheres))
    if given is not None:
        factors[: scene.instance_count] = given
    return np.append(factors[instances], (1.0, 1.0))


def _measure_bounds(scene: Scene) -> Floats:
    """Return the boxes (instances + groups, 2, 3) of objects in their own space."""
    boxes = [
        np.stack([mesh.positions.min(axis=0), mesh.positions.max(axis=0)]) if len(mesh.positions) else np.zeros((2, 3))
        for mesh in scene.meshes
    ]
    placed = range(len(scene.meshes)) if scene.instances is None else scene.instances.mesh.tolist()
    spheres = []
    for group in scene.spheres:
        low, high = group.centres - group.radii[:, np.newaxis], group.centres + group.radii[:, np.newaxis]
        spheres.append(np.stack([low.min(axis=0), high.max(axis=0)]) if len(low) else np.zeros((2, 3)))
    return np.array([*(boxes[mesh] for mesh in placed), *spheres]).reshape(-1, 2, 3)


def _gather_grids(scene: Scene) -> dict[str, tuple[tuple[Grid, Floats] | None, ...]]:
    names = sorted({name for mesh in scene.meshes for name in mesh.grids})

    def prepare(grid: Grid | None) -> tuple[Grid, Floats] | None:
        return None if grid is None else (grid, np.linalg.inv(grid.object_from_index))

    return {name: tuple(prepare(mesh.grids.get(name)) for mesh in scene.meshes) for name in names}


def _make_sky_tables(camera: Camera | None, resolution: tuple[int, int] | None) -> SiteTables:
    """Return what programs of the world's volume read: it is no object, and its space is the world's."""
    sphere = Scene(spheres=Spheres(np.zeros((1, 3)), np.ones(1)), camera=camera)
    surface = make_surface_tables(sphere, pack_geometry(sphere), smooth_normals=False, uvs=False)
    return make_site_tables(sphere, surface, set(), resolution)


def _fill_constants(table: MediaTable, scene: Scene) -> Mixture:
    """Return the mixtures of media that are the same at every place."""
    middle = np.zeros((len(table.instance), 3))
    if len(table.bounds):
        matrices = np.broadcast_to(np.eye(4), (len(table.bounds), 4, 4)).copy()
        if scene.instances is not None:
            matrices[: scene.instance_count] = scene.instances.world_from_object
        middle[:-2] = transform_points(matrices, table.bounds.mean(axis=1))[table.instance[:-2]]
    even = np.flatnonzero(~table.varies)
    whole = make_nothing(len(middle), table.columns)
    whole.put(even, _compute(table, even, middle[even]))
    return whole


def evaluate_media(table: MediaTable, medium: Integers, position: Vectors) -> Mixture:
    """Return the mixtures of media (n,) by number at points (n, 3), metres, world."""
    mixture = table.constant.select(medium)
    rows = np.flatnonzero(table.varies[medium])
    if not len(rows):
        return mixture
    mixture.put(rows, _compute(table, medium[rows], position[rows]))
    return mixture


def sum_media(table: MediaTable, inside: Integers, position: Vectors) -> Mixture:
    """Return the mixtures at points (n, 3) inside of several media, numbers (n, d): they add up."""
    return add_mixtures([evaluate_media(table, column, position) for column in inside.T])


def _compute(table: MediaTable, medium: Integers | Indices, position: Vectors) -> Mixture:
    """Return the mixtures of media (n,) at points (n, 3), volume by volume."""
    whole, number = make_nothing(len(medium), table.columns), table.volume[medium]
    for one in np.unique(number):
        rows, volume = np.flatnonzero(number == one), table.volumes[one]
        values = _evaluate_program(table, volume, medium[rows], position[rows])
        part = mix_closures(volume, values, len(rows), table.columns)
        factor = table.density[medium[rows], np.newaxis]
        lobes = replace(part.lobes, weight=factor[:, :, np.newaxis] * part.lobes.weight)
        extinction, scattering, emission = (
            factor * values for values in (part.extinction, part.scattering, part.emission)
        )
        whole.put(rows, Mixture(extinction, scattering, emission, lobes))
    return whole


def _evaluate_program(
    table: MediaTable, volume: Volume, medium: Integers | Indices, position: Vectors
) -> dict[Register, Any]:
    """Return what a volume's program computes at points of media (n,)."""
    registers = [register for closure in volume.closures for register in closure.registers.values()]
    if volume.program is None or not registers:
        return {}
    in_world = bool(table.instance[medium[0]] < 0)
    tables = table.sky if in_world else table.sites
    assert tables is not None
    instance = np.zeros(len(medium), np.int32) if in_world else table.instance[medium]
    site = make_volume_site(table, tables, instance, position)
    return evaluate(volume.program, site, find_needed(volume.program, registers))


def make_volume_site(table: MediaTable, tables: SiteTables, instance: Integers, position: Vectors) -> VolumeSite:
    """Return points (n, 3) inside of objects (n,) as programs see them."""
    upward = np.broadcast_to((0.0, 0.0, 1.0), position.shape)
    count = len(position)
    surface = imagine_surface(position, upward, upward, is_front=True, weights=np.zeros((count, 2)))
    fields = {name: getattr(tables, name) for name in SiteTables.__dataclass_fields__}
    whole = VolumeSiteTables(**fields, media=table)
    return VolumeSite(replace(surface, instance=instance), whole, None, np.zeros(count))
