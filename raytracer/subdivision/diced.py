"""Meshes diced: their limit surface, or their polygons as they are, with all that is known of them carried along.

As in Cycles positions and what is made of them follow the limit surface, maps of UV do so as the modifier says, and
everything else is bilinear between the corners of a polygon.

References
----------
Blender, intern/cycles/subd/interpolation.cpp (what is smooth) and subd/osd.cpp (maps of UV).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from typing import Any

import numpy as np

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.arrays.vectors import normalize
from raytracer.lecture import cross
from raytracer.scene.shapes import Mesh
from raytracer.subdivision.cage import Cage, interpolate_corners, number_quads
from raytracer.subdivision.dicing import Dice, IsLong, dice
from raytracer.subdivision.limit import evaluate_limit, find_normals, make_limit
from raytracer.subdivision.maps import make_map_cage


@dataclasses.dataclass(frozen=True, eq=False)
class Base:
    """What a mesh of triangles was before its polygons were cut, for dicing them.

    cage : its polygons
    corners : (t, 3) the polygons' corner that each corner of the triangles is
    is_smooth : True for the limit surface of Catmull and Clark, False for the polygons themselves
    flat : (f,) True for polygons shown flat
    map_rule : how maps of UV follow, a name of `maps.RULES`
    places : names of attributes at vertices that follow the surface
    """

    cage: Cage
    corners: Indices
    is_smooth: bool
    flat: Booleans
    map_rule: str = "boundaries"
    places: Collection[str] = ()


@dataclasses.dataclass(frozen=True, eq=False)
class DicedMesh:
    """A mesh diced, and how: the same places of another shape of the base mesh can be found."""

    mesh: Mesh
    base: Base
    dice: Dice

    @property
    def polygons(self) -> Indices:
        """(t,) The polygon of each triangle."""
        return self.base.cage.polygons.face[self.dice.quad]


def dice_mesh(mesh: Mesh, base: Base, is_long: IsLong, rounds: int, most: int) -> DicedMesh | None:
    """Return a mesh diced until no edge is too long, or halved so many `rounds`; None where that takes more than `most`
    triangles.

    mesh : the triangles of the base's polygons, with normals and attributes at vertices or corners
    """
    quads, _ = number_quads(base.cage)
    limit = make_limit(base.cage, mesh.positions) if base.is_smooth else None
    polygons = base.cage.polygons
    at_corners = mesh.positions[polygons.vertex]

    def place(quad: Indices, uv: Floats) -> Floats:
        if limit is None:
            return interpolate_corners(polygons, at_corners, quad, uv)
        return evaluate_limit(limit, quad, uv).values

    found = dice(quads, place, is_long, rounds, most)
    return None if found is None else DicedMesh(make_mesh(mesh, base, found), base, found)


def make_mesh(mesh: Mesh, base: Base, found: Dice) -> Mesh:
    """Return the mesh of triangles on the quadrilaterals of a base."""
    polygon = base.cage.polygons.face[found.quad]
    material: Any = mesh.material
    if np.ndim(material):
        of_polygon = np.zeros(len(base.flat), np.int32)
        of_polygon[base.cage.polygons.face[base.corners[:, 0]]] = material
        material = of_polygon[polygon]
    return Mesh(
        found.positions,
        found.triangles.astype(np.int32),
        normals=carry_normals(mesh, base, found),
        uvs=None if mesh.uvs is None else carry_values(mesh.uvs, base, found, is_map=True),
        material=material,
        name=mesh.name,
        attributes={name: carry_attribute(name, values, base, found) for name, values in mesh.attributes.items()},
    )


def carry_attribute(name: str, values: Floats, base: Base, found: Dice) -> Floats:
    """Return the values of an attribute at the vertices, or the corners of triangles, where those of the mesh are."""
    if base.is_smooth and name in base.places and values.ndim == 2:
        return carry_places(values, base, found)
    return carry_values(values, base, found, is_map=values.ndim == 3 and values.shape[2] == 2)


def carry_places(values: Floats, base: Base, found: Dice) -> Floats:
    """Return (v, k) values that follow the limit surface, of those at the base's vertices."""
    if not base.is_smooth:
        return interpolate_vertices(values, base, found)
    return evaluate_limit(make_limit(base.cage, values), found.vertex_quad, found.vertex_uv).values


def interpolate_vertices(values: Floats, base: Base, found: Dice) -> Floats:
    """Return (v, k) values bilinear in those of the base's vertices."""
    polygons = base.cage.polygons
    return interpolate_corners(polygons, values[polygons.vertex], found.vertex_quad, found.vertex_uv)


def carry_values(values: Floats, base: Base, found: Dice, is_map: bool) -> Floats:
    """Return values at vertices (v, k), or at the corners of triangles (t, 3, k), where those of the mesh are.

    is_map : True for coordinates of a map of UV
    """
    if values.ndim == 2:
        return interpolate_vertices(values, base, found)
    polygons = base.cage.polygons
    at_corners = read_corners(values, base)
    first = at_corners[polygons.start[polygons.face]]
    if (at_corners == first).all():  # of polygons: the same number everywhere, not one that rounding varies
        return np.repeat(first[found.quad][:, np.newaxis], 3, axis=1)
    quad, uv = np.repeat(found.quad, 3), found.uv.reshape(-1, 2)
    if is_map and base.is_smooth and base.map_rule != "none":
        cage, at_vertices = make_map_cage(base.cage, at_corners, base.map_rule)
        found_values = evaluate_limit(make_limit(cage, at_vertices), quad, uv).values
    else:
        found_values = interpolate_corners(polygons, at_corners, quad, uv)
    return found_values.reshape(len(found.quad), 3, -1)


def read_corners(values: Floats, base: Base) -> Floats:
    """Return values (c, k) at the corners of polygons, of those at the corners of triangles (t, 3, k)."""
    at_corners = np.zeros((len(base.cage.polygons.vertex), values.shape[2]))
    at_corners[base.corners] = values
    return at_corners


def carry_normals(mesh: Mesh, base: Base, found: Dice) -> Floats | None:
    """Return the normals of a diced mesh: of its surface, but for flat polygons; None for a mesh that has none."""
    if mesh.normals is None:
        return None
    if base.is_smooth:
        normals = find_surface_normals(mesh.positions, base, found)
        if not base.flat.any():
            return normals
        at_corners = normals[found.triangles]
        flat = base.flat[base.cage.polygons.face[found.quad]]
        a, b, c = (found.positions[found.triangles[flat, corner]] for corner in range(3))
        at_corners[flat] = normalize(cross(b - a, c - a))[:, np.newaxis]
        return at_corners
    return normalize(carry_values(mesh.normals, base, found, is_map=False))


def find_surface_normals(positions: Floats, base: Base, found: Dice) -> Floats:
    """Return (v, 3) the normals of the limit surface of a base with positions (v, 3)."""
    points = evaluate_limit(make_limit(base.cage, positions), found.vertex_quad, found.vertex_uv)
    return find_normals(points.along_u, points.along_v)


def carry_vertex_normals(positions: Floats, normals: Floats, base: Base, found: Dice) -> Floats:
    """Return (v, 3) what programs that displace see as normals: of the limit surface, or interpolated."""
    if base.is_smooth:
        return find_surface_normals(positions, base, found)
    return normalize(interpolate_vertices(normals, base, found))
