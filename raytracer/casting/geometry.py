"""All geometry of a scene in packed arrays, and the one number that names each primitive of each instance.

A *primitive id* (int64) counts the triangles of instance 0, then those of instance 1, and so on, then the spheres of
each group, then the segments of each group of curves. Ids therefore sort as (instance, primitive) does, and "ties go to
the lowest index" is a comparison of numbers.

The true triangle of an instance is the float64 triangle that `world_corners` returns: each world coordinate is
((m0 x + m1 y) + m2 z) + m3, every operation rounded to nearest. An identity matrix changes nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Integers
from raytracer.casting.curves.strands import Strands, pack_strands
from raytracer.scene.scene import Scene

Ids = NDArray[np.int64]
# Triangles whose corners are gathered together.
BLOCK = 1 << 16


class Kind(IntEnum):
    """Kinds of primitives, in the order of their ids.

    A new kind is one more member, what `Geometry.kind_owners` says of it, and its own arrays there.
    """

    TRIANGLE = 0
    SPHERE = 1
    CURVE = 2


Corners = tuple[Floats, Floats, Floats]


@dataclass(frozen=True, eq=False)
class Geometry:
    """Packed geometry; meshes that share their arrays are stored once.

    positions : (v, 3) float64, object space
    triangles : (t, 3) int32, rows of `positions`
    mesh_first, mesh_count : (m,) int64, each mesh's slice of `triangles`
    instance_mesh : (i,) int32
    world_from_object : (i, 4, 4) float64
    centres, radii : (s, 3), (s,) float64, world space
    first_id : (i + g + 1,) int64, primitive id at which each instance, then each group of spheres, then each of curves,
        begins; then the end
    strands : the curves, or None where there are none
    curve_groups : how many groups of curves there are
    """

    positions: Floats
    triangles: Integers
    mesh_first: Ids
    mesh_count: Ids
    instance_mesh: Integers
    world_from_object: Floats
    centres: Floats
    radii: Floats
    first_id: Ids
    strands: Strands | None = None
    curve_groups: int = 0

    @property
    def kind_owners(self) -> tuple[int, ...]:
        """The first instance or group of each kind of primitive, and the end."""
        end = len(self.first_id) - 1
        return 0, len(self.instance_mesh), end - self.curve_groups, end

    def kind_range(self, kind: Kind) -> tuple[int, int]:
        """Return the first primitive id of a kind, and the one behind its last."""
        owners = self.kind_owners
        return int(self.first_id[owners[kind]]), int(self.first_id[owners[kind + 1]])

    @property
    def sphere_id(self) -> int:
        """The primitive id of the first sphere."""
        return self.kind_range(Kind.SPHERE)[0]

    def is_kind(self, primitive_id: Ids, kind: Kind) -> Booleans:
        """(n,) True for primitive ids of a kind."""
        return _lies_within(primitive_id, self.kind_range(kind), kind, self._is_last(kind))

    def belongs_to_kind(self, instance: Integers, kind: Kind) -> Booleans:
        """(n,) True for instances, or groups, of a kind's primitives."""
        return _lies_within(instance, self.kind_owners[kind : kind + 2], kind, self._is_last(kind))

    def _is_last(self, kind: Kind) -> bool:
        """Whether nothing can come behind a kind: curves, or spheres where there are no curves."""
        return kind == Kind.CURVE or (kind == Kind.SPHERE and not self.curve_groups)

    def find_rows(self, primitive_id: Ids, kind: Kind) -> Ids:
        """Return the (n,) rows of primitives among all of their kind."""
        return primitive_id - self.kind_range(kind)[0]


def _lies_within(numbers: NDArray[Any], ends: tuple[int, ...], kind: Kind, is_last: bool) -> Booleans:
    """(n,) True for numbers between two ends; the first and the last kind have only one neighbor."""
    above = numbers >= ends[0] if kind > min(Kind) else None
    below = None if is_last else numbers < ends[1]
    if above is None or below is None:
        return above if below is None else below  # type: ignore[return-value]
    return above & below


def _stack(arrays: list[NDArray], shape: tuple[int, ...], dtype: type) -> NDArray:
    """Return all arrays as one; that of a single mesh, which may be large, is not copied."""
    if len(arrays) == 1:
        return arrays[0]
    return np.concatenate(arrays) if arrays else np.zeros((0, *shape), dtype)


def pack_geometry(scene: Scene) -> Geometry:
    """Return the packed arrays of a scene's meshes, instances, spheres and curves."""
    slices: dict[tuple[int, int], tuple[int, int]] = {}
    positions: list[NDArray] = []
    triangles: list[NDArray] = []
    vertex_count = triangle_count = 0
    ranges = []
    for mesh in scene.meshes:
        key = (mesh.positions.ctypes.data, mesh.triangles.ctypes.data)
        if key not in slices or not len(mesh.triangles):
            slices[key] = (triangle_count, len(mesh.triangles))
            positions.append(mesh.positions)
            triangles.append(mesh.triangles + np.int32(vertex_count) if vertex_count else mesh.triangles)
            vertex_count += len(mesh.positions)
            triangle_count += len(mesh.triangles)
        ranges.append(slices[key])
    first, count = np.array(ranges, dtype=np.int64).reshape(-1, 2).T
    if scene.instances is None:
        instance_mesh = np.arange(len(scene.meshes), dtype=np.int32)
        matrices = np.tile(np.eye(4), (len(scene.meshes), 1, 1))
    else:
        instance_mesh, matrices = scene.instances.mesh, scene.instances.world_from_object
    groups = [*(len(group.radii) for group in scene.spheres), *(group.segment_count for group in scene.curves)]
    sizes = np.concatenate([count[instance_mesh], groups])
    return Geometry(
        positions=_stack(positions, (3,), np.float64),
        triangles=_stack(triangles, (3,), np.int32),
        mesh_first=first,
        mesh_count=count,
        instance_mesh=instance_mesh,
        world_from_object=matrices,
        centres=_stack([group.centres for group in scene.spheres], (3,), np.float64),
        radii=_stack([group.radii for group in scene.spheres], (), np.float64),
        first_id=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        strands=pack_strands(scene.curves) if scene.curves else None,
        curve_groups=len(scene.curves),
    )


def invert_matrices(matrices: Floats) -> Floats:
    """Return the inverses of (c, 4, 4) affine matrices; zeros for those that flatten."""
    usable = np.linalg.det(matrices[:, :3, :3]) != 0
    inverse = np.zeros_like(matrices)
    inverse[usable] = np.linalg.inv(matrices[usable])
    return inverse


def transform_points(matrix: Floats, points: Floats) -> Floats:
    """((m0 x + m1 y) + m2 z) + m3 for each row: (..., 4, 4) matrices and (..., 3) points that broadcast."""
    x, y, z = points[..., 0, None], points[..., 1, None], points[..., 2, None]
    return ((matrix[..., :3, 0] * x + matrix[..., :3, 1] * y) + matrix[..., :3, 2] * z) + matrix[..., :3, 3]


def split_id(geometry: Geometry, primitive_id: Ids) -> tuple[Integers, Integers]:
    """Return (instance, primitive), both (n,) int32, of primitive ids; groups follow the instances."""
    if len(geometry.first_id) == 2:
        return np.zeros(len(primitive_id), np.int32), primitive_id.astype(np.int32)
    instance = np.searchsorted(geometry.first_id, primitive_id, side="right") - 1
    return instance.astype(np.int32), (primitive_id - geometry.first_id[instance]).astype(np.int32)


def join_id(geometry: Geometry, instance: Integers, primitive: Integers) -> Ids:
    """Return the (n,) int64 primitive ids of (instance, primitive)."""
    return geometry.first_id[instance] + primitive


def list_meshes(geometry: Geometry, instances: NDArray) -> NDArray[np.intp]:
    """Return the numbers of the meshes that instances (k,) are of, ascending; no sorting of a million instances."""
    return np.flatnonzero(np.bincount(geometry.instance_mesh[instances]))


def world_corners(geometry: Geometry, instance: Integers, primitive: Integers) -> Corners:
    """Return the world-space corners a, b, c, each (n, 3) float64, of triangles given by instance and primitive."""
    row = geometry.mesh_first[geometry.instance_mesh[instance]] + primitive
    vertices = geometry.triangles.take(row, axis=0)  # (n, 3)
    # Element by element, over all triangles: by rows of three each product would take five times as long.
    matrices = geometry.world_from_object
    matrices = matrices if len(matrices) == 1 else matrices.take(instance, axis=0)
    elements = np.ascontiguousarray(np.moveaxis(matrices, 0, -1))  # (4, 4, n), or (4, 4, 1) for all
    a, b, c = (_place(elements, geometry.positions.take(corner, axis=0)) for corner in vertices.T)
    return a, b, c


def _place(elements: Floats, points: Floats) -> Floats:
    """Do what `transform_points` does for one matrix for each of (n, 3) points, whose elements (4, 4, n) come one after
    the other; the result lies column by column in memory."""
    x, y, z = np.ascontiguousarray(points.T)
    placed = np.empty((3, len(x)))
    for (m0, m1, m2, m3), coordinate in zip(elements[:3], placed, strict=True):
        coordinate[:] = ((m0 * x + m1 * y) + m2 * z) + m3
    return placed.T


def instance_corners(geometry: Geometry, instance: int) -> Floats:
    """Return all world-space triangles of one instance, (t, 3 corners, 3) float64."""
    corners: Floats = np.empty((geometry.mesh_count[geometry.instance_mesh[instance]], 3, 3))
    fill_corners(geometry, instance, corners)
    return corners


def fill_corners(geometry: Geometry, instance: int, corners: NDArray) -> None:
    """Set (t, 3 corners, 3) to all world-space triangles of one instance, block by block."""
    first = geometry.mesh_first[geometry.instance_mesh[instance]]
    triangles = geometry.triangles[first : first + len(corners)]
    if not len(triangles):
        return
    low, high = triangles.min(), triangles.max()
    # Once for each vertex: triangles share them.
    positions = transform_points(geometry.world_from_object[instance], geometry.positions[low : high + 1])
    for start in range(0, len(corners), BLOCK):
        part = slice(start, start + BLOCK)
        corners[part] = positions.take(triangles[part] - low, axis=0)
