"""Meshes whose vertices programs move: true displacement.

A program is asked once for each vertex, at the first corner of a triangle that moves it, with the normal of the vertex
whether or not the mesh is shaded smooth; what it answers is a way in world space. Smooth normals are made anew from the
moved faces where nothing else bends them.

References
----------
Blender, intern/cycles/scene/mesh_displace.cpp; kernel/geom/shader_data.h, shader_setup_from_displace.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Integers
from raytracer.arrays.vectors import normalize
from raytracer.casting.geometry import pack_geometry
from raytracer.casting.rays import Hits, make_rays
from raytracer.lecture import cross
from raytracer.scene.programs import Program, Register, Value
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Mesh
from raytracer.shading.evaluate import evaluate, find_needed, list_attributes
from raytracer.shading.site import Site
from raytracer.shading.site_tables import UNDISPLACED, make_site_tables
from raytracer.surfaces.surface import Surface, make_surface
from raytracer.surfaces.surface_tables import SurfaceTables, make_surface_tables


class Displacement(NamedTuple):
    """What moves the surface of a material.

    program, value : the way in world space, (3,), a constant or a register of the program
    bends : True where smooth normals follow; False where the material's own normal does it
    """

    program: Program
    value: Value
    bends: bool


def displace(scene: Scene, displacements: Mapping[int, Displacement], vertex_normals: Floats, smooth: Booleans) -> Mesh:
    """Return the mesh of a scene of one mesh and one instance, moved.

    displacements : by material
    vertex_normals : (v, 3) object space, what programs see as normals
    smooth : (t,) True for triangles whose corners have normals of vertices
    """
    (mesh,) = scene.meshes
    material = np.broadcast_to(mesh.material, len(mesh.triangles))
    moving = np.flatnonzero(np.isin(material, list(displacements)))
    vertex, corner = np.unique(mesh.triangles[moving].ravel(), return_index=True)
    triangle, corner = moving[corner // 3], corner % 3
    shown = dataclasses.replace(mesh, normals=np.asarray(vertex_normals, np.float64))
    way = _find_ways(dataclasses.replace(scene, meshes=[shown]), displacements, triangle, corner)
    assert scene.instances is not None
    linear = scene.instances.world_from_object[0, :3, :3]
    positions = mesh.positions.copy()
    if np.linalg.det(linear) != 0:
        positions[vertex] += np.linalg.solve(linear, np.nan_to_num(way, posinf=0.0, neginf=0.0).T).T
    bent, kept = (
        np.isin(material, [number for number, each in displacements.items() if each.bends == bends])
        for bends in (True, False)
    )
    normals = _bend_normals(mesh, positions, bent, kept, smooth)
    attributes = {**mesh.attributes, **({UNDISPLACED: mesh.positions} if kept.any() else {})}
    return dataclasses.replace(mesh, positions=positions, normals=normals, attributes=attributes)


def _find_ways(
    scene: Scene, displacements: Mapping[int, Displacement], triangle: NDArray[np.intp], corner: NDArray[np.intp]
) -> Floats:
    """Return the ways (n, 3) in world space of corners of triangles (n,)."""
    geometry = pack_geometry(scene)
    tables = make_surface_tables(scene, geometry, smooth_normals=True, uvs=False, barycentric=True)
    names = {name for each in displacements.values() for name in list_attributes(each.program)}
    sites = make_site_tables(scene, tables, names, None)
    surface = _make_points(tables, triangle, corner)
    ways = np.zeros((len(triangle), 3))
    for material, each in displacements.items():
        rows = np.flatnonzero(surface.material == material)
        site = Site(surface.select(rows), sites, None, np.zeros(len(rows)))
        outputs = evaluate(each.program, site, find_needed(each.program, [each.value]))
        ways[rows] = outputs[each.value] if isinstance(each.value, Register) else each.value
    return ways


def _make_points(tables: SurfaceTables, triangle: NDArray[np.intp], corner: NDArray[np.intp]) -> Surface:
    """Return the surface at corners of triangles, seen from the front along the normal."""
    count = len(triangle)
    hits = Hits(
        distance=np.ones(count),
        distance_error=np.zeros(count),
        instance=np.zeros(count, np.int32),
        primitive=triangle.astype(np.int32),
        barycentric=np.stack([corner == 1, corner == 2], axis=1).astype(np.float64),
        valid=np.ones(count, np.bool_),
    )
    ahead = np.broadcast_to((0.0, 0.0, 1.0), (count, 3))
    surface = make_surface(tables, make_rays(np.zeros((count, 3)), ahead), hits)
    return dataclasses.replace(surface, outgoing=surface.shading_normal, front=np.ones(count, np.bool_))


def _bend_normals(mesh: Mesh, positions: Floats, bent: Booleans, kept: Booleans, smooth: Booleans) -> Floats | None:
    """Return the normals of the corners of a mesh that moved to other positions.

    bent, kept : (t,) True where a displacement moves triangles and bends their normals, or keeps them

    Those at vertices of triangles `bent` are made anew: the mean of the unit normals of those triangles at all smooth
    ones. Flat triangles have their own where they are now, or where they were if that is kept.
    """
    if mesh.normals is None and not kept.any():
        return None
    corners = _read_corner_normals(mesh)
    flat = normalize(_face_normals(positions, mesh.triangles))
    total = np.zeros_like(positions)
    for corner in range(3):
        np.add.at(total, mesh.triangles[bent, corner], flat[bent])
    of_vertices = normalize(total)[mesh.triangles]
    known = smooth[:, np.newaxis] & (of_vertices != 0).any(axis=2)
    corners[known] = of_vertices[known]
    turned = ~smooth & ~kept
    corners[turned] = flat[turned, np.newaxis]
    return corners


def _read_corner_normals(mesh: Mesh) -> Floats:
    """Return (t, 3, 3) the normals of a mesh at the corners of its triangles."""
    if mesh.normals is None:
        return np.repeat(normalize(_face_normals(mesh.positions, mesh.triangles))[:, np.newaxis], 3, axis=1)
    return (mesh.normals if mesh.normals.ndim == 3 else mesh.normals[mesh.triangles]).copy()


def _face_normals(positions: Floats, triangles: Integers) -> Floats:
    a, b, c = (positions[triangles[:, corner]] for corner in range(3))
    return cross(b - a, c - a)
