"""Where nodes are evaluated: points of surfaces, with all that nodes can read there.

A Site looks values up only when a node asks for them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats
from raytracer.arrays.vectors import normalize
from raytracer.casting.geometry import Kind, join_id, transform_points, world_corners
from raytracer.film.camera import find_on_film
from raytracer.lecture import dot
from raytracer.shading.light_path import LightPath
from raytracer.shading.probes import Probe
from raytracer.shading.site_tables import TANGENT, UNDISPLACED, CameraView, SiteTables
from raytracer.surfaces.surface import Surface
from raytracer.surfaces.surface_tables import gather_corners, split_offset


@dataclass(frozen=True, eq=False)
class Site:
    """n points of surfaces.

    surface : with `barycentric`
    path : None for points that no ray led to
    footprint : (n,) float64, metres, about the size of a pixel there; the step of finite differences
    apart : (n,) float64, metres between the places that a bump compares, of which this is one; None for others
    """

    surface: Surface
    tables: SiteTables
    path: LightPath | None
    footprint: Floats
    apart: Floats | None = None

    def __len__(self) -> int:
        return len(self.surface)

    # Geometry; normals stand on the side that the ray came from.

    @property
    def position(self) -> Floats:
        return self.surface.position

    @property
    def outgoing(self) -> Floats:
        return self.surface.outgoing

    @property
    def front(self) -> Booleans:
        return self.surface.front

    @property
    def normal(self) -> Floats:
        return np.where(self.front[:, np.newaxis], self.surface.shading_normal, -self.surface.shading_normal)

    @property
    def geometric_normal(self) -> Floats:
        return np.where(self.front[:, np.newaxis], self.surface.geometric_normal, -self.surface.geometric_normal)

    @property
    def parametric(self) -> Floats:
        """Blender's barycentric weights: of the first corner, then of the second; 0."""
        assert self.surface.barycentric is not None
        second, third = self.surface.barycentric.T
        return np.stack([1.0 - second - third, second, np.zeros_like(second)], axis=1)

    @property
    def is_triangle(self) -> Booleans:
        return self.tables.surface.geometry.belongs_to_kind(self.surface.instance, Kind.TRIANGLE)

    def find_edges(self) -> tuple[Floats, Floats]:
        """(n, 3) each, world, along which Cycles' parameters of a surface run: the first two edges of triangles, twice
        the direction of strands; 0 on spheres."""
        first, second = np.zeros((len(self), 3)), np.zeros((len(self), 3))
        rows = np.flatnonzero(self.is_triangle)
        a, b, c = world_corners(self.tables.geometry, self.surface.instance[rows], self.surface.primitive[rows])
        first[rows], second[rows] = b - a, c - a
        if self.surface.tangent is not None:
            rows = np.flatnonzero(self.is_strand)
            first[rows] = second[rows] = self.surface.tangent[rows]
        return first, second

    @property
    def is_strand(self) -> Booleans:
        """(n,) True on curves."""
        if self.tables.strands is None:
            return np.zeros(len(self), dtype=np.bool_)
        return self.tables.surface.geometry.belongs_to_kind(self.surface.instance, Kind.CURVE)

    @property
    def is_sphere(self) -> Booleans:
        return self.tables.surface.geometry.belongs_to_kind(self.surface.instance, Kind.SPHERE)

    def find_segments(self, rows: Any) -> NDArray[np.int64]:
        """The numbers of the segments that some rows are on, among those of all curves of the scene."""
        geometry = self.tables.geometry
        number = join_id(geometry, self.surface.instance[rows], self.surface.primitive[rows])
        return geometry.find_rows(number, Kind.CURVE)

    def find_radius(self) -> Floats:
        """(n,) metres, of strands; 0 elsewhere."""
        radius, rows = np.zeros(len(self)), np.flatnonzero(self.is_strand)
        if len(rows):
            assert self.tables.strands is not None
            assert self.surface.along is not None
            radius[rows] = self.tables.strands.find_radius(self.find_segments(rows), self.surface.along[rows])
        return radius

    @property
    def is_smooth(self) -> Booleans:
        """(n,) True on meshes with normals, on spheres and on curves."""
        smooth = ~self.is_triangle
        rows = np.flatnonzero(~smooth)
        smooth[rows] = self.tables.smooth[self.tables.geometry.instance_mesh[self.surface.instance[rows]]]
        return smooth

    # Attributes

    def attribute_width(self, name: str) -> NDArray[np.int64]:
        """(n,) numbers per value, 0 where the mesh, or the group of spheres or curves, lacks the attribute."""
        width, strands = np.zeros(len(self), dtype=np.int64), self.tables.strands
        rows = np.flatnonzero(self.is_triangle)
        width[rows] = self.tables.widths[name][self.tables.geometry.instance_mesh[self.surface.instance[rows]]]
        if name in self.tables.sphere_widths:
            rows = np.flatnonzero(self.is_sphere)
            width[rows] = self.tables.sphere_widths[name][self._group(rows)]
        if strands is not None and name in strands.widths:
            rows = np.flatnonzero(self.is_strand)
            width[rows] = strands.widths[name][self.surface.instance[rows] - strands.first]
        return width

    def _group(self, rows: Any) -> NDArray[np.int64]:
        """The numbers of the groups that the spheres of some rows are of."""
        return self.surface.instance[rows] - len(self.tables.geometry.instance_mesh)

    def find_spheres(self, rows: Any) -> NDArray[np.int64]:
        """The numbers of the spheres that some rows are on, among all of the scene."""
        return self.tables.first_sphere[self._group(rows)] + self.surface.primitive[rows]

    def has_attribute(self, name: str) -> Booleans:
        """(n,) True where the mesh, or the group of spheres, has the attribute."""
        return self.attribute_width(name) > 0

    def read_attribute(self, name: str) -> Floats:
        """(n, 4) values as color and alpha: numbers repeat, uvs are (u, v, 0), and alpha is 1 where there is none."""
        values, width = np.zeros((len(self), 4)), self.attribute_width(name)
        for rows, read in self._read_kinds(name, width > 0):
            values[rows, : read.shape[1]] = read
        values[(width > 0) & (width < 4), 3] = 1.0
        values[width == 1, 1:3] = values[width == 1, 0:1]
        return values

    def _read_kinds(self, name: str, has: Booleans) -> Iterator[tuple[NDArray[np.intp], Floats]]:
        """Rows that have an attribute, and its values there: of triangles, of spheres, which have one each, of
        strands."""
        surface, tables = self.surface, self.tables
        rows = np.flatnonzero(has & self.is_triangle)
        if len(rows):
            assert surface.barycentric is not None
            mesh = tables.geometry.instance_mesh[surface.instance[rows]]
            table = tables.attributes[name]
            yield rows, gather_corners(table, mesh, surface.primitive[rows], surface.barycentric[rows])
        rows = np.flatnonzero(has & self.is_sphere)
        if len(rows):
            yield rows, tables.sphere_values[name][self.find_spheres(rows)]
        rows = np.flatnonzero(has & self.is_strand)
        if len(rows):
            assert tables.strands is not None
            assert surface.along is not None
            yield rows, tables.strands.read(name, self.find_segments(rows), surface.along[rows])

    def read_tangent(self, name: str) -> tuple[Floats, Floats]:
        """(n, 3) the tangent for coordinates `name` in object space, interpolated and so not of unit length, and (n,)
        the sign of the bitangent; 0 without those coordinates."""
        values = self.read_attribute(TANGENT + name)
        return values[:, :3], values[:, 3]

    def read_object_normal(self) -> Floats:
        """(n, 3) interpolated normals of meshes in object space, not of unit length; zeros elsewhere."""
        values, surface, table = np.zeros((len(self), 3)), self.surface, self.tables.surface.normals
        rows = np.flatnonzero(self.is_smooth & self.is_triangle)
        if table is not None and len(rows):
            assert surface.barycentric is not None
            mesh = self.tables.geometry.instance_mesh[surface.instance[rows]]
            values[rows] = gather_corners(table, mesh, surface.primitive[rows], surface.barycentric[rows])
        return values

    def flat_object_normal(self) -> Floats:
        """(n, 3) the flat triangles' unit normals in object space, as wound."""
        return self.normal_to_object(self.surface.geometric_normal)

    # Objects and spaces; groups of spheres stand in world space.

    @property
    def object_location(self) -> Floats:
        return self._world_from_object[:, :3, 3]

    @property
    def object_color(self) -> Floats:
        return self.tables.color[self.surface.instance]

    @property
    def object_random(self) -> Floats:
        return self.tables.random[self.surface.instance]

    @property
    def object_index(self) -> Floats:
        return self.tables.index[self.surface.instance].astype(np.float64)

    def read_property(self, name: str) -> Floats:
        """(n, 4) a property of the objects as color and alpha; 0 where they have none."""
        table = self.tables.properties.get(name)
        return np.zeros((len(self), 4)) if table is None else table[self.surface.instance]

    @property
    def _world_from_object(self) -> Floats:
        strands = self.tables.strands
        return self._place(
            self.tables.geometry.world_from_object, None if strands is None else strands.world_from_object
        )

    @property
    def _object_from_world(self) -> Floats:
        strands = self.tables.strands
        return self._place(self.tables.object_from_world, None if strands is None else strands.object_from_world)

    def _place(self, of_instances: Floats, of_curves: Floats | None) -> Floats:
        """(n, 4, 4) the matrices of instances and of groups of curves; those of spheres leave all as it is."""
        values = np.broadcast_to(np.eye(4), (len(self), 4, 4)).copy()
        rows = np.flatnonzero(self.is_triangle)
        values[rows] = of_instances[self.surface.instance[rows]]
        if of_curves is not None:
            assert self.tables.strands is not None
            rows = np.flatnonzero(self.is_strand)
            values[rows] = of_curves[self.surface.instance[rows] - self.tables.strands.first]
        return values

    def to_object(self, points: Floats) -> Floats:
        """World to object space, points (n, 3)."""
        return transform_points(self._object_from_world, points)

    def normal_to_object(self, normals: Floats) -> Floats:
        """World to object space, normals (n, 3), unit: the transpose of the matrix."""
        matrices = self._world_from_object[:, :3, :3]
        return normalize(dot(np.swapaxes(matrices, 1, 2), normals[:, np.newaxis, :]))

    def normal_to_world(self, normals: Floats) -> Floats:
        """Object to world space, normals (n, 3), unit: the inverse transpose of the matrix."""
        matrices = self._object_from_world[:, :3, :3]
        return normalize(dot(np.swapaxes(matrices, 1, 2), normals[:, np.newaxis, :]))

    def to_camera(self, points: Floats) -> Floats:
        """World to camera space with nodes' axes, (n, 3)."""
        order, signs = self._view.axes
        return transform_points(self._view.camera_from_world, points)[..., order] * signs

    def to_window(self, points: Floats) -> Floats:
        """Where points are seen in the full picture: x and y from 0 to 1, 0."""
        view = self._view
        seen = transform_points(view.camera_from_world, points)
        x, y = find_on_film(view.camera, view.width, view.height, seen)
        return np.stack([x / view.width, y / view.height, np.zeros_like(x)], axis=1)

    @property
    def _view(self) -> CameraView:
        if self.tables.view is None:
            raise ValueError(
                "Scene: camera: expected a Camera, for a material reads coordinates in its space, got None"
            )
        return self.tables.view

    def to_world(self, vectors: Any, space: str, kind: str) -> Floats:
        """From WORLD, OBJECT or CAMERA space to world space; kind: POINT, VECTOR or NORMAL."""
        return self._transform(vectors, self._matrices(space, to_world=True), kind)

    def from_world(self, vectors: Any, space: str, kind: str) -> Floats:
        """From world space to WORLD, OBJECT or CAMERA space; kind: POINT, VECTOR or NORMAL."""
        return self._transform(vectors, self._matrices(space, to_world=False), kind)

    def _matrices(self, space: str, to_world: bool) -> tuple[Floats, Floats] | None:
        """The matrix and its inverse, (n, 4, 4) or (4, 4)."""
        if space == "WORLD":
            return None
        if space == "CAMERA":
            order, signs = self._view.axes
            turn = np.eye(4)
            turn[:3, :3] = signs[:, np.newaxis] * np.eye(3)[order]
            pair = self._view.camera.world_from_camera @ turn.T, turn @ self._view.camera_from_world
        else:
            pair = self._world_from_object, self._object_from_world
        return pair if to_world else pair[::-1]

    @staticmethod
    def _transform(vectors: Any, matrices: tuple[Floats, Floats] | None, kind: str) -> Floats:
        vectors = np.asarray(vectors, dtype=np.float64)
        if matrices is None:
            return vectors
        matrix, inverse = matrices
        if kind == "POINT":
            return transform_points(matrix, vectors)
        linear = np.swapaxes(inverse[..., :3, :3], -1, -2) if kind == "NORMAL" else matrix[..., :3, :3]
        return dot(linear, vectors[..., np.newaxis, :])

    # Rays

    def read_path(self, name: str) -> Floats:
        """(n,) one of the numbers of a LightPath."""
        values = self.path.values if self.path is not None else {}
        return values.get(name, np.zeros(len(self)))

    @property
    def probe(self) -> Probe | None:
        return None if self.path is None else self.path.probe

    def put_back(self) -> Site:
        """Return the site where its surface was before it was displaced; as it is where nothing says so."""
        moved = np.flatnonzero(self.has_attribute(UNDISPLACED))
        if not len(moved):
            return self
        place, position = self.read_attribute(UNDISPLACED)[:, :3], self.position.copy()
        matrices = self._world_from_object
        position[moved] = transform_points(matrices[moved], place[moved])
        return replace(self, surface=replace(self.surface, position=position))

    def shift(self, offset: Floats) -> Site:
        """Return the site moved by (n, 3) metres within each triangle's plane: position and barycentric weights."""
        return replace(self, surface=replace(self.surface, position=self.position + offset)).slide(offset)

    def slide(self, offset: Floats) -> Site:
        """Return the site whose barycentric weights alone, which attributes are read by, are moved."""
        surface = self.surface
        assert surface.barycentric is not None
        rows = np.flatnonzero(self.is_triangle & (offset != 0).any(axis=1))
        if not len(rows):
            return self
        weights = surface.barycentric.copy()
        corners = world_corners(self.tables.geometry, surface.instance[rows], surface.primitive[rows])
        weights[rows] += split_offset(*corners, offset[rows])
        return replace(self, surface=replace(surface, barycentric=weights))
