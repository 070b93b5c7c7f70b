"""What the programs of a scene's materials read, packed once: attributes of meshes, values of objects, the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import split_columns
from raytracer.arrays.types import Booleans, Floats
from raytracer.casting.geometry import Geometry, invert_matrices
from raytracer.film.camera import find_on_film
from raytracer.scene.camera import Camera
from raytracer.scene.scene import Scene
from raytracer.shading.strand_tables import OWN_UV, StrandTables, make_strand_tables
from raytracer.surfaces.surface_tables import CornerTable, SurfaceTables, pack_corners
from raytracer.surfaces.tangents import make_tangents
from raytracer.textures.image import map_sphere

# What the names of tangents begin with; the coordinates they are for follow.
TANGENT = "tangent "
# The undeformed places of a mesh's vertices, which stand in for its own coordinates where it has none.
UNDEFORMED = "undeformed"
# Where the vertices of a displaced mesh were, in object space, if what displaced it also bends its normals.
UNDISPLACED = "undisplaced position"

# Within which a panorama's picture is taken for even, radians.
SMALL_ANGLE = 1e-3


@dataclass(frozen=True, eq=False)
class CameraView:
    """What nodes know of the camera: the record, the size of the full picture in pixels, and the inverse matrix."""

    camera: Camera
    width: int
    height: int
    camera_from_world: Floats

    @property
    def axes(self) -> tuple[list[int], Floats]:
        """What nodes call x, y and z of camera space (`choose_axes`)."""
        return choose_axes(self.camera)

    @property
    def pixel(self) -> float:
        """The width of a pixel on the film plane: metres at 1 m distance, or at any distance if orthographic.

        Of a panorama, about: in the middle of its picture.
        """
        if self.camera.panorama is not None:
            near = np.array([[0.0, 0.0, -1.0], [SMALL_ANGLE, 0.0, -1.0]])
            x = find_on_film(self.camera, self.width, self.height, near)[0]
            return float(SMALL_ANGLE / abs(x[1] - x[0]))
        x = find_on_film(self.camera, self.width, self.height, np.array([[0.0, 0.0, -1.0], [1.0, 0.0, -1.0]]))[0]
        return float(1.0 / (x[1] - x[0]))


def choose_axes(camera: Camera) -> tuple[list[int], Floats]:
    """Return what nodes call x, y and z of camera space: axes of Blender's, and their signs.

    z is forward; Cycles' panoramas look along x with z up, and its mirror ball along y.
    """
    if camera.panorama is None:
        return [0, 1, 2], np.array([1.0, 1.0, -1.0])
    if camera.panorama.kind == "mirror_ball":
        return [0, 2, 1], np.ones(3)
    return [2, 0, 1], np.array([-1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class SiteTables:
    """What the programs of a scene read, packed once.

    object_from_world : (i, 4, 4) float64
    attributes : by name, the values at the corners of all meshes
    widths : by name, (meshes,) int64, numbers per value, 0 = the mesh lacks it
    sphere_widths : by name, (g,) int64, the same of groups of spheres; only what a group has
    sphere_values : by name, (s, k) the values of all spheres, group by group; only what a group has
    first_sphere : (g,) int64, the first sphere of each group
    random : (i + g,) float64; color : (i + g, 4); index : (i + g,) int32; instances, then groups
    properties : by name, (i + g, 4) float64, 0 where there is none
    smooth : (meshes,) bool, True for meshes with normals
    view : CameraView, or None without a camera
    strands : what programs read of curves; None without any
    """

    surface: SurfaceTables
    object_from_world: Floats
    attributes: dict[str, CornerTable]
    widths: dict[str, NDArray[np.int64]]
    sphere_widths: dict[str, NDArray[np.int64]]
    sphere_values: dict[str, Floats]
    first_sphere: NDArray[np.int64]
    random: Floats
    color: Floats
    index: NDArray[np.int32]
    properties: dict[str, Floats]
    smooth: Booleans
    view: CameraView | None
    strands: StrandTables | None = None

    @property
    def geometry(self) -> Geometry:
        return self.surface.geometry


def make_site_tables(
    scene: Scene, surface: SurfaceTables, names: set[str], resolution: tuple[int, int] | None
) -> SiteTables:
    """Pack the attributes `names`, objects and camera of a scene; resolution : of the full picture."""
    geometry, instances = surface.geometry, scene.instances
    count, groups = scene.instance_count, len(scene.groups)
    random, color = np.zeros(count + groups), np.ones((count + groups, 4))
    random[count:] = [group.random for group in scene.groups]
    color[count:] = np.reshape([group.color for group in scene.groups], (groups, 4))
    index = np.zeros(count + groups, dtype=np.int32)
    index[count:] = [group.pass_index for group in scene.groups]
    if instances is not None:
        index[:count] = instances.pass_index
        random[:count] = 0.0 if instances.random is None else instances.random
        color[:count] = 1.0 if instances.color is None else instances.color
    widths = {name: _find_widths(scene, name) for name in sorted(names)}
    sphere_widths = _find_sphere_widths(scene, names)
    return SiteTables(
        surface=surface,
        object_from_world=invert_matrices(geometry.world_from_object),
        attributes={name: _pack(scene, name, int(width.max(initial=1))) for name, width in widths.items()},
        widths=widths,
        sphere_widths=sphere_widths,
        sphere_values={name: _pack_spheres(scene, name, int(width.max())) for name, width in sphere_widths.items()},
        first_sphere=np.cumsum([0, *(len(group.radii) for group in scene.spheres)])[:-1],
        random=random,
        color=color,
        index=index,
        properties=_gather_properties(scene),
        smooth=np.array([mesh.normals is not None for mesh in scene.meshes], dtype=np.bool_),
        view=_make_view(scene.camera, resolution),
        strands=make_strand_tables(scene, geometry.strands, names),
    )


def _gather_properties(scene: Scene) -> dict[str, Floats]:
    """By name, (i + g, 4) the properties of instances, then of groups."""
    count, groups = scene.instance_count, len(scene.groups)
    of_instances = scene.instances.properties if scene.instances is not None else {}
    names = set(of_instances).union(*(group.properties for group in scene.groups))
    tables = {name: np.zeros((count + groups, 4)) for name in sorted(names)}
    for name, table in tables.items():
        table[:count] = of_instances.get(name, 0.0)
        for row, group in enumerate(scene.groups, count):
            table[row] = group.properties.get(name, 0.0)
    return tables


def _make_view(camera: Camera | None, resolution: tuple[int, int] | None) -> CameraView | None:
    if camera is None or resolution is None:
        return None
    return CameraView(camera, *resolution, np.linalg.inv(camera.world_from_camera))


def _values_of(mesh: Any, name: str) -> Floats | None:
    """An attribute of a mesh; "uv" is its own coordinates, "tangent x" the tangents for coordinates x.

    Tangents of a mesh without coordinates of its own are those of longitude and latitude around its origin, if it says
    where its vertices are undeformed (Cycles, blender/mesh.cpp, MikkMeshWrapper; no seam shows in what it renders).
    """
    if name.startswith(TANGENT):
        uvs = _values_of(mesh, name.removeprefix(TANGENT))
        if uvs is not None:
            return make_tangents(mesh, uvs[..., :2])
        if name != TANGENT + OWN_UV or UNDEFORMED not in mesh.attributes:
            return None
        return make_tangents(
            mesh, np.stack(map_sphere(*split_columns(mesh.attributes[UNDEFORMED])), axis=1), closed=True
        )
    return mesh.uvs if name == OWN_UV and OWN_UV not in mesh.attributes else mesh.attributes.get(name)


def _find_widths(scene: Scene, name: str) -> NDArray[np.int64]:
    values = [_values_of(mesh, name) for mesh in scene.meshes]
    return np.array([0 if value is None else value.shape[-1] for value in values], dtype=np.int64)


def _find_sphere_widths(scene: Scene, names: set[str]) -> dict[str, NDArray[np.int64]]:
    """Numbers per value (g,) of the attributes that some group of spheres has."""
    found = sorted(names & set[str]().union(*(group.attributes for group in scene.spheres)))
    values = {name: [group.attributes.get(name) for group in scene.spheres] for name in found}
    return {name: np.array([0 if one is None else one.shape[-1] for one in of]) for name, of in values.items()}


def _pack(scene: Scene, name: str, width: int) -> CornerTable:
    def read(mesh: Any) -> Floats | None:
        values = _values_of(mesh, name)
        return None if values is None else _widen(values, width)

    return pack_corners(scene, read, width)


def _pack_spheres(scene: Scene, name: str, width: int) -> Floats:
    """The values of all spheres (s, width), 0 in groups without."""
    tables = [group.attributes.get(name, np.zeros((len(group.radii), width))) for group in scene.spheres]
    return np.concatenate([_widen(values, width) for values in tables])


def _widen(values: Floats, width: int) -> Floats:
    """Values (..., k) with zeros behind them, (..., width)."""
    padding = [(0, 0)] * (values.ndim - 1) + [(0, width - values.shape[-1])]
    return values if values.shape[-1] == width else np.pad(values, padding)
