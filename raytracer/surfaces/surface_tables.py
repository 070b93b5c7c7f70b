"""What surfaces are made from, packed once: materials, normals, uvs and corners by instance and primitive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import join_columns, largest_column, lay_columns, take_rows
from raytracer.arrays.types import Floats, Integers
from raytracer.arrays.vectors import normalize
from raytracer.casting.geometry import Geometry, split_id, world_corners
from raytracer.lecture import cross, dot, length
from raytracer.predicates.rounding import gamma
from raytracer.scene.curves import Curves
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Mesh, Spheres
from raytracer.surfaces.layers import LayerTable, make_layer_table

# alpha = 1 - beta - gamma, three products and two sums: 7 roundings at most, in each coordinate.
INTERPOLATION_ERROR = gamma(7)


# What a float64 caster rounds when it compares the spawned origin with the primitive it left: T = (a - o) . N over
# |N|, at most 8 u times a permanent of 6 products, each below |edge| |N| (see `filtered`): in units of the size.
CASTER_ERROR = gamma(48)


# Triangles whose corners and normals are worked out once, not at every hit: 7 MB, which gathers from the cache.
LARGEST_TABLE = 1 << 16


@dataclass(frozen=True, eq=False)
class CornerTable:
    """Values at triangle corners of all meshes, packed; meshes without them have none.

    values : (k, width) float64
    rows : (t, 3) int32, rows of `values` of each packed triangle's corners
    first : (meshes,) int64, first row of `rows` of each mesh, -1 = the mesh has none
    """

    values: Floats
    rows: Integers
    first: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Triangles:
    """World-space triangles: corners a, b, c and geometric normal, (n, 3) float64; error (n,) float64, metres, bound on
    the error of a position interpolated between the corners."""

    a: Floats
    b: Floats
    c: Floats
    normal: Floats
    error: Floats

    def select(self, rows: NDArray[np.int64]) -> Triangles:
        """Return some of the triangles: index array."""
        a, b, c, normal = (take_rows(values, rows) for values in (self.a, self.b, self.c, self.normal))
        return Triangles(a, b, c, normal, self.error.take(rows))


@dataclass(frozen=True, eq=False)
class SurfaceTables:
    """What a scene's surfaces are made from, packed once.

    material : (k,) int32, per-primitive material indices, packed; a record with one material has one entry
    material_first : (instances + groups,) int64, first entry of each
    material_step : (instances + groups,) int64, 1 for an entry per primitive, 0 for one for all
    normal_from_object : (instances, 3, 3) float64, the inverse transpose of the instance's matrix, or a multiple of it
    mirrored : (instances,) bool, True where the matrix turns the winding around
    normals, uvs : CornerTable, or None where no mesh has any, or nothing reads them
    with_barycentric : True where programs of materials read more
    triangles : of all instances, by primitive id, or None where there are too many
    roundoff : unit roundoff of the caster's arithmetic over float64's
    layers : what the order of surfaces at one place goes by, or None where that makes no difference
    """

    geometry: Geometry
    instance_count: int
    material: Integers
    material_first: NDArray[np.int64]
    material_step: NDArray[np.int64]
    normal_from_object: Floats
    mirrored: NDArray[np.bool_]
    normals: CornerTable | None
    uvs: CornerTable | None
    with_barycentric: bool = False
    triangles: Triangles | None = None
    roundoff: float = 1.0
    layers: LayerTable | None = None


def make_surface_tables(
    scene: Scene, geometry: Geometry, smooth_normals: bool, uvs: bool, barycentric: bool = False, roundoff: float = 1.0
) -> SurfaceTables:
    """Pack what `make_surface` gathers from; normals, uvs and barycentric weights only where asked for.

    roundoff : unit roundoff of the caster's arithmetic over float64's; bounds on positions grow with it
    """
    instance_meshes = [scene.meshes[mesh] for mesh in geometry.instance_mesh]
    mesh_material = [np.atleast_1d(np.asarray(mesh.material, dtype=np.int32)) for mesh in scene.meshes]
    group_material = [np.atleast_1d(_list_materials(group)) for group in scene.groups]
    mesh_first = _first_entries([len(entries) for entries in mesh_material])
    group_first = _first_entries([len(entries) for entries in group_material]) + sum(map(len, mesh_material))
    records = [*instance_meshes, *scene.groups]
    normal_from_object = _cofactors(geometry.world_from_object[:, :3, :3])
    mirrored = dot(geometry.world_from_object[:, 0, :3], normal_from_object[:, 0]) < 0
    return SurfaceTables(
        geometry=geometry,
        instance_count=scene.instance_count,
        material=np.concatenate([*mesh_material, *group_material, np.zeros(0, dtype=np.int32)]),
        material_first=np.concatenate([mesh_first[geometry.instance_mesh], group_first]).astype(np.int64),
        material_step=np.array([np.ndim(record.material) for record in records], dtype=np.int64),
        normal_from_object=normal_from_object,
        mirrored=mirrored,
        normals=pack_corners(scene, lambda mesh: mesh.normals, 3) if smooth_normals else None,
        uvs=pack_corners(scene, lambda mesh: mesh.uvs, 2) if uvs else None,
        with_barycentric=barycentric,
        triangles=_measure_all_triangles(geometry, mirrored),
        roundoff=roundoff,
        layers=make_layer_table(scene),
    )


def _list_materials(group: Spheres | Curves) -> Integers:
    """Return the material indices of a group's primitives, or of all; a strand's is that of each of its segments."""
    material = np.asarray(group.material, dtype=np.int32)
    if isinstance(group, Curves) and material.ndim:
        return np.repeat(material, np.diff(group.strands) - 1)
    return material


def _first_entries(counts: list[int]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(counts)])[: len(counts)].astype(np.int64)


def _cofactors(matrices: Floats) -> Floats:
    """Return det(M) M^-T of (i, 3, 3) matrices, which also exists where M flattens: rows b x c, c x a, a x b.

    In memory the elements of all matrices lie one after the other, as columns do.
    """
    a, b, c = matrices[:, 0], matrices[:, 1], matrices[:, 2]
    elements = np.stack([column for row in (cross(b, c), cross(c, a), cross(a, b)) for column in row.T])
    return np.moveaxis(elements.reshape(3, 3, -1), -1, 0)


def turn_normals(tables: SurfaceTables, instance: Integers, normals: Floats) -> Floats:
    """Return normals (n, 3) of instances (n,) in world space, of any length."""
    matrices = tables.normal_from_object
    return join_columns(*(dot(take_rows(matrices[:, row], instance), normals) for row in range(3)))


def pack_corners(scene: Scene, values_of: Callable[[Mesh], Floats | None], width: int) -> CornerTable:
    """Pack one corner attribute: (v, width) per vertex or (t, 3, width) per corner, of the meshes that have it."""
    values, rows, first = [np.zeros((0, width))], [np.zeros((0, 3), dtype=np.int32)], []
    value_count = row_count = 0
    for mesh in scene.meshes:
        array = values_of(mesh)
        first.append(-1 if array is None else row_count)
        if array is None:
            continue
        per_corner = array.ndim == 3
        index = np.arange(array.size // width, dtype=np.int32).reshape(-1, 3) if per_corner else mesh.triangles
        rows.append(index + np.int32(value_count))
        values.append(array.reshape(-1, width))
        value_count += len(values[-1])
        row_count += len(index)
    return CornerTable(np.concatenate(values), np.concatenate(rows), np.array(first, dtype=np.int64))


def measure_triangles(
    geometry: Geometry, mirrored: NDArray[np.bool_], instance: Integers, primitive: Integers
) -> Triangles:
    """Return what does not depend on where n triangles are hit."""
    a, b, c = world_corners(geometry, instance, primitive)
    magnitude = np.maximum(np.maximum(np.abs(a), np.abs(b)), np.abs(c))
    first, second = b - a, c - a
    size = 2.0 * largest_column(np.maximum(np.abs(first), np.abs(second)))  # above the length of either edge
    error = INTERPOLATION_ERROR * length(magnitude) + CASTER_ERROR * size
    # Edges are scaled before their product, which would underflow for triangles below 1e-160.
    scale = np.where(size > 0, size, 1.0)[:, np.newaxis]
    normal = normalize(lay_columns(cross(first / scale, second / scale)))
    turned = mirrored[instance]
    normal = np.where(turned[:, np.newaxis], -normal, normal) if turned.any() else normal
    return Triangles(a, b, c, normal, error)


def _measure_all_triangles(geometry: Geometry, mirrored: NDArray[np.bool_]) -> Triangles | None:
    """Return the table of a scene's triangles, by primitive id; None where it would be larger than the cache."""
    count = int(geometry.first_id[len(geometry.instance_mesh)])
    if count > LARGEST_TABLE:
        return None
    return measure_triangles(geometry, mirrored, *split_id(geometry, np.arange(count)))


def interpolate(weights: Floats, a: Floats, b: Floats, c: Floats) -> Floats:
    """alpha a + beta b + gamma c with alpha = 1 - beta - gamma (lecture, "Barycentric Coordinates").

    weights : (n, 2) float64, beta and gamma; a, b, c : (n, k) float64, values at the corners
    """
    second, third = weights[:, 0:1], weights[:, 1:2]
    total = (1.0 - second - third) * a
    total += second * b
    total += third * c
    return total


def split_offset(a: Floats, b: Floats, c: Floats, offset: Floats) -> Floats:
    """Return by how much barycentric weights (n, 2) change as points of triangles move by (n, 3) within their planes.

    d = db e1 + dc e2 with the edges e1, e2: db = (d x e2) . n / n . n and dc = (e1 x d) . n / n . n, n = e1 x e2.
    """
    first, second = b - a, c - a
    normal = cross(first, second)
    square = dot(normal, normal)
    square = np.where(square > 0, square, 1.0)
    return np.stack([dot(cross(offset, second), normal) / square, dot(cross(first, offset), normal) / square], axis=1)


def gather_corners(table: CornerTable, mesh: Integers, primitive: Integers, weights: Floats) -> Floats:
    """Interpolate a corner table at n points, (n, width)."""
    rows = table.rows.take(table.first[mesh] + primitive, axis=0)  # (n, 3 corners)
    return interpolate(weights, *(lay_columns(table.values.take(corner, axis=0)) for corner in rows.T))
