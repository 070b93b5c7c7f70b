"""Evaluated Blender meshes and point clouds to arrays: one read per attribute that is needed, no loop over elements.

Buffers are flat and of Blender's own type, so that `foreach_get` copies memory; everything stays in object space.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

import raytracer

from .. import versions
from .warnings import WarningList

DEFAULT_POINT_RADIUS = 0.01  # Blender's radius of points that have no radius attribute


def read_array(collection: Any, field: str, dtype: type, width: int = 1) -> NDArray[Any]:
    """Return one field of a bpy collection as an array (n, width), or (n,) where width is 1.

    Notes
    -----
    Whole numbers are read as np.intc and np.uintc, C's int: `foreach_get` copies memory only into buffers of the
    letters 'i' and 'I'. np.int32 has them on Linux and macOS, but is C's long, 'l', on Windows, where each number would
    be converted (145 ms instead of 2.6 for the corners of 318,402 triangles).
    """
    flat: NDArray[Any] = np.empty(len(collection) * width, dtype=dtype)
    collection.foreach_get(field, flat)
    return flat if width == 1 else flat.reshape(-1, width)


def read_attribute(owner: Any, name: str, field: str, dtype: type, width: int = 1) -> NDArray[Any] | None:
    """Return a named attribute as `read_array` does, or None where it is absent."""
    attribute = owner.attributes.get(name)
    return None if attribute is None else read_array(attribute.data, field, dtype, width)


@dataclass(frozen=True)
class Geometry:
    """One evaluated mesh, before materials are assigned.

    mesh : raytracer.Mesh with material 0
    polygons : (t,) int32, the Blender polygon that each triangle is part of
    slots : (t,) int32, material slot of each triangle; None = slot 0 for all
    used_slots : the slot numbers that triangles have
    kept : (all triangles of the Blender mesh,) bool, False for those left out; None = all are kept
    base : what it is to be diced from, an AdaptiveBase, or None
    """

    mesh: raytracer.Mesh
    polygons: NDArray[np.int32]
    slots: NDArray[np.int32] | None
    used_slots: tuple[int, ...]
    kept: NDArray[np.bool_] | None = None
    base: Any = None

    @cached_property
    def extent(self) -> NDArray[np.float64]:
        """(3,) metres along the axes of object space."""
        positions = self.mesh.positions
        return np.asarray(positions.max(axis=0) - positions.min(axis=0))  # np.ptp takes twice as long for a few


@contextmanager
def open_mesh(source: Any, mesh: Any, before_subdivision: bool = False) -> Iterator[Any]:
    """Give the mesh of an evaluated object for reading, or what it was before its last modifier subdivided it.

    One that is being edited and has no modifiers lies in Blender's edit structures: it is converted.
    """
    if before_subdivision:
        owner = versions.open_base(source)
        yield owner.mesh_base
        del owner  # it holds the mesh until now
        return
    if not mesh.is_editmode:
        yield mesh
        return
    try:
        yield source.to_mesh()
    finally:
        source.to_mesh_clear()


def extract_geometry(
    mesh: Any, name: str, with_uvs: bool, warnings: WarningList, last: Geometry | None = None
) -> Geometry | None:
    """Return the triangles of an evaluated mesh, `last` itself if they are the same, or None where it has none.

    Triangles with a vertex that is not finite are dropped with a warning; those without area stay, no ray hits them.
    """
    mesh.calc_loop_triangles()
    positions = read_attribute(mesh, "position", "vector", np.float32, 3)
    if positions is None or not len(mesh.loop_triangles):
        return None
    # Vertex indices are not negative: uintc is what Blender copies without converting.
    triangles = read_array(mesh.loop_triangles, "vertices", np.uintc, 3).view(np.intc)  # (t, 3)
    polygons = read_array(mesh.loop_triangle_polygons, "value", np.intc)  # (t,)
    slots = read_attribute(mesh, "material_index", "value", np.intc)  # (polygons,)
    slots = np.maximum(slots, 0)[polygons] if slots is not None and slots.any() else None  # (t,)
    kept = find_finite_triangles(positions, triangles, name, warnings)
    normals, uvs = read_normals(mesh), read_uvs(mesh) if with_uvs else None
    if kept is not None:
        triangles, polygons, slots = triangles[kept], polygons[kept], None if slots is None else slots[kept]
        positions = np.where(np.isfinite(positions), positions, 0.0)
        normals, uvs = select_corners(normals, kept), select_corners(uvs, kept)
    if not len(triangles):
        return None
    if normals is not None and not np.isfinite(normals).all():
        warnings.add("custom normals are NaN or infinite: face normals are used instead", name)
        normals = replace_broken_normals(normals, positions, triangles)
    if last is not None and is_same(last, name, (positions, triangles, normals, uvs, polygons, slots, kept)):
        return last
    record = raytracer.Mesh(positions, triangles, normals=normals, uvs=uvs, name=name)
    used_slots = (0,) if slots is None else tuple(np.flatnonzero(np.bincount(slots)).tolist())
    return Geometry(record, polygons, slots, used_slots, kept)


def is_same(last: Geometry, name: str, arrays: tuple[NDArray[Any] | None, ...]) -> bool:
    """Return True where a Geometry was made of these arrays; float32 numbers are the same as float64."""
    mesh = last.mesh
    before = (mesh.positions, mesh.triangles, mesh.normals, mesh.uvs, last.polygons, last.slots, last.kept)
    return mesh.name == name and all(
        one is other if one is None or other is None else np.array_equal(one, other)
        for one, other in zip(before, arrays, strict=True)
    )


def find_finite_triangles(
    positions: NDArray[np.float32], triangles: NDArray[np.int32], name: str, warnings: WarningList
) -> NDArray[np.bool_] | None:
    """Return (t,) True for triangles whose corners are finite, or None where all vertices are."""
    finite = np.isfinite(positions).all(axis=1)  # (v,)
    if finite.all():
        return None
    kept: NDArray[np.bool_] = finite[triangles].all(axis=1)
    broken, dropped = int((~finite).sum()), int((~kept).sum())
    warnings.add(f"{broken} vertices are NaN or infinite, {dropped} triangles that use them are left out", name)
    return kept


def select_corners(values: NDArray[Any] | None, kept: NDArray[np.bool_]) -> NDArray[Any] | None:
    """Return the kept triangles' part of per-corner values; per-vertex values stay as they are."""
    return values[kept] if values is not None and values.ndim == 3 else values


def read_normals(mesh: Any) -> NDArray[np.float32] | None:
    """Return (v, 3) vertex normals, (t, 3, 3) corner normals, or None for a mesh of flat faces only."""
    if mesh.normals_domain == "FACE":
        return None
    if mesh.normals_domain == "POINT":
        return read_array(mesh.vertex_normals, "vector", np.float32, 3)
    return read_array(mesh.corner_normals, "vector", np.float32, 3)[read_corners(mesh)]


def read_uvs(mesh: Any) -> NDArray[np.float32] | None:
    """Return (t, 3, 2) coordinates of the UV map that renders use, or None without one."""
    layer = next((layer for layer in mesh.uv_layers if layer.active_render), None)
    return None if layer is None else read_array(layer.uv, "vector", np.float32, 2)[read_corners(mesh)]


def read_corners(mesh: Any) -> NDArray[np.int32]:
    """Return (t, 3) the face corner of each corner of each triangle."""
    return read_array(mesh.loop_triangles, "loops", np.uintc, 3).view(np.intc)


def replace_broken_normals(
    normals: NDArray[np.float32], positions: NDArray[Any], triangles: NDArray[np.int32]
) -> NDArray[Any]:
    """Return (t, 3, 3) corner normals with each that is not finite replaced by its triangle's own."""
    corners = (normals if normals.ndim == 3 else normals[triangles]).astype(np.float64)
    a, b, c = (positions[triangles[:, corner]].astype(np.float64) for corner in range(3))  # (t, 3) each
    flat = np.cross(b - a, c - a)
    lengths = np.linalg.norm(flat, axis=1, keepdims=True)
    flat = np.divide(flat, lengths, out=np.zeros_like(flat), where=lengths > 0)
    flat[lengths[:, 0] == 0] = (0.0, 0.0, 1.0)  # Blender's normal of a face without area
    broken = ~np.isfinite(corners).all(axis=2, keepdims=True)
    return np.where(broken, flat[:, None, :], corners)


def has_shape(shape: tuple[Any, Any], middle: tuple[Any, Any]) -> bool:
    """Return whether positions and normals at a step are as many as in the middle."""
    return all(np.shape(one) == np.shape(other) for one, other in zip(shape, middle, strict=True) if other is not None)


def assign_materials(
    geometry: Geometry, materials: tuple[int, ...], attributes: Mapping[str, NDArray[np.float64]] | None = None
) -> raytracer.Mesh:
    """Return the mesh with `materials`, one for each of its used slots; all arrays but the assignment are shared."""
    material: int | NDArray[np.int32] = materials[0]
    if len(set(materials)) > 1:
        assert geometry.slots is not None
        material_of_slot = np.zeros(geometry.used_slots[-1] + 1, dtype=np.int32)
        material_of_slot[list(geometry.used_slots)] = materials
        material = material_of_slot[geometry.slots]  # (t,)
    if not attributes and isinstance(material, int) and material == geometry.mesh.material:
        return geometry.mesh
    return geometry.mesh.with_material(material, attributes or None)


def read_shape(mesh: Any, corners: NDArray[np.int32] | None) -> tuple[NDArray[Any], NDArray[Any] | None] | None:
    """Return positions (v, 3) and normals, of vertices or of the corners of triangles; None where some are not finite.

    corners : (t, 3) face corners of the triangles in the middle of the time, or None
    """
    positions = read_attribute(mesh, "position", "vector", np.float32, 3)
    if positions is None:
        return None
    normals = None
    if corners is not None:
        all_corners = read_array(mesh.corner_normals, "vector", np.float32, 3)
        if corners.max() >= len(all_corners):
            return None
        normals = all_corners[corners]
    elif mesh.normals_domain == "POINT":
        normals = read_array(mesh.vertex_normals, "vector", np.float32, 3)
    finite = np.isfinite(positions).all() and (normals is None or np.isfinite(normals).all())
    return (positions, normals) if finite else None


@dataclass(frozen=True)
class Points:
    """A point cloud in object space.

    centres : (s, 3) float64
    radii : (s,) float64
    kept : (all points of the cloud,) bool, False for those left out
    attributes : by name, (s, k) float64, what materials read of them
    """

    centres: NDArray[np.float64]
    radii: NDArray[np.float64]
    kept: NDArray[np.bool_]
    attributes: Mapping[str, NDArray[Any]] = field(default_factory=dict)


def extract_points(cloud: Any, name: str, warnings: WarningList) -> Points | None:
    """Return the points that have a size, or None without any; points that are not finite are dropped."""
    centres = read_attribute(cloud, "position", "vector", np.float32, 3)
    if centres is None:
        return None
    radii = read_attribute(cloud, "radius", "value", np.float32)
    if radii is None:
        radii = np.full(len(centres), DEFAULT_POINT_RADIUS, dtype=np.float32)
    finite = np.isfinite(centres).all(axis=1) & np.isfinite(radii)  # (s,)
    if not finite.all():
        warnings.add(f"{int((~finite).sum())} points are NaN or infinite and left out", name)
    kept = finite & (radii > 0)
    if not kept.any():
        return None
    return Points(centres[kept].astype(np.float64), radii[kept].astype(np.float64), kept)


def has_points(cloud: Points | None, middle: Points) -> bool:
    """Return whether a point cloud at a step is what it is in the middle."""
    return (
        cloud is not None
        and np.array_equal(cloud.centres, middle.centres)
        and np.array_equal(cloud.radii, middle.radii)
    )
