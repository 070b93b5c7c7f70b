"""Two levels of trees in one table: world trees of flattened primitives and of instances, a tree per shared mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats
from raytracer.casting.bvh.clustering import Bounds
from raytracer.casting.bvh.instances import BLOCK, MeshTree, PlacedTrees, can_be_placed, place_trees
from raytracer.casting.bvh.tree import Frame, make_frame, to_bounds
from raytracer.casting.bvh.tree_table import NO_BOUNDS, NO_CORNERS, JoinedTree, Name, Table, TreeInput
from raytracer.casting.geometry import Geometry, Kind, list_meshes
from raytracer.casting.primitives import Primitives, extremes, instance_bounds

# Copies of triangles that flattening may add in all (72 bytes each, plus their share of a tree).
FLATTEN_LIMIT = 1 << 19
# Flattened instances of as many triangles have trees of their own, so that they need not be built again when another
# moves; a tree costs some milliseconds however small it is.
PART_TRIANGLES = 1 << 15


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """All trees of a scene in one table.

    frame : of the world trees
    nodes : (k, 7, 4) float32, all trees' nodes; child references count in this table
    triangles : (b, 10, 4) float32, the triangles of the leaves before `instances_begin`, see `leaves`
    items : (b, 4) int32 or int64, what those leaves hold: primitive ids, and triangles of shared meshes
    instances_begin : number of the first leaf that holds an instance
    instances : (i,) int64, the instances that such leaves hold
    roots : nodes at which every ray begins
    placed : the shared meshes' trees, or None
    trees : the trees by name, for the next build
    """

    frame: Frame
    nodes: NDArray[np.float32]
    triangles: NDArray[np.float32]
    items: NDArray[np.signedinteger]
    instances_begin: int
    instances: NDArray[np.int64]
    roots: tuple[int, ...]
    placed: PlacedTrees | None
    trees: dict[Name, JoinedTree]


def choose_flattened(geometry: Geometry) -> Booleans:
    """(i,) True for instances whose world triangles are stored: all that cost little to copy, and all that must be.

    A mesh used once costs nothing; of the others the cheapest are flattened while FLATTEN_LIMIT lasts. Matrices that
    rays cannot be brought through are always flattened.
    """
    uses = np.bincount(geometry.instance_mesh, minlength=len(geometry.mesh_first))
    copies = np.maximum(uses - 1, 0) * geometry.mesh_count
    order = np.argsort(copies, kind="stable")
    affordable = np.zeros(len(copies), dtype=bool)
    affordable[order] = np.cumsum(copies[order]) <= FLATTEN_LIMIT
    flattened = affordable[geometry.instance_mesh]
    shared = np.flatnonzero(~flattened)
    if len(shared):
        boxes = instance_bounds(geometry, np.arange(len(geometry.instance_mesh)))
        frame = make_frame(boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0))
        exponents = np.zeros(len(geometry.mesh_first), np.int32)
        for mesh in list_meshes(geometry, shared):
            exponents[mesh] = mesh_frame(mesh_corners(geometry, mesh)).exponent
        for start in range(0, len(shared), BLOCK):
            part = shared[start : start + BLOCK]
            matrices, exponent = geometry.world_from_object[part], exponents[geometry.instance_mesh[part]]
            flattened[part] = ~can_be_placed(matrices, exponent, frame.exponent)
    return flattened


def build_hierarchy(primitives: Primitives, last: Hierarchy | None = None) -> Hierarchy:
    """Build all trees that the primitives need, and no other.

    last : the hierarchy of the scene as it was before; trees of what did not move or change since are taken from it.
        What is flattened has a tree of its own per instance of at least PART_TRIANGLES triangles; the rest shares one.
    """
    geometry = primitives.geometry
    shared = np.flatnonzero(~primitives.flattened)
    sphere_boxes = bound_spheres(geometry)
    frame = _world_frame(primitives, sphere_boxes, last)
    table = Table(last.trees if last else {})
    roots = []
    if len(primitives.corners) + len(sphere_boxes):
        roots.append(_build_flattened(table, primitives, frame, to_bounds(frame, sphere_boxes)))
    placed = _build_meshes(table, geometry, shared) if len(shared) else None
    instances, instances_begin = shared, table.leaf_count
    if len(shared):
        source = TreeInput(frame, NO_CORNERS, to_bounds(frame, instance_bounds(geometry, shared)))
        root, order = table.append_boxes(("instances", 0), source)
        roots.append(root)
        instances = shared.take(order)
    nodes, triangles, items = table.join()
    return Hierarchy(
        frame=frame,
        nodes=nodes,
        triangles=triangles,
        items=items,
        instances_begin=instances_begin,
        instances=instances,
        roots=tuple(roots),
        placed=placed,
        trees=table.trees,
    )


def _world_frame(primitives: Primitives, sphere_boxes: Floats, last: Hierarchy | None) -> Frame:
    """The frame of all triangles, shared ones included, and spheres; the last one while it fits well enough."""
    low, high = bound_world(primitives, sphere_boxes)
    frame = make_frame(low, high)
    if last is None or abs(last.frame.exponent - frame.exponent) > 1:
        return frame
    fits = np.abs(last.frame.place(np.stack([low, high]))).max() <= 1
    return last.frame if fits else frame


def bound_world(primitives: Primitives, sphere_boxes: Floats) -> Floats:
    """(2, 3) a box around all triangles, and all spheres with given boxes."""
    triangles = primitives.bounds if primitives.geometry.sphere_id else np.zeros((0, 3))
    points = np.concatenate([triangles, sphere_boxes.reshape(-1, 3)])
    return extremes(points) if len(points) else np.zeros((2, 3))


def _build_flattened(table: Table, primitives: Primitives, frame: Frame, sphere_bounds: Bounds) -> int:
    """Build the trees of flattened triangles and spheres; return the root."""
    geometry = primitives.geometry
    count = np.diff(geometry.first_id)[: len(primitives.flattened)]
    large = np.flatnonzero(primitives.flattened & (count >= PART_TRIANGLES))
    rest = np.ones(len(primitives.corners), dtype=bool)
    roots: dict[Name, int] = {}
    for instance in large:
        ids = geometry.first_id[instance] + np.arange(count[instance])
        rows = slice(ids[0] + primitives.row_shift[instance], ids[-1] + 1 + primitives.row_shift[instance])
        rest[rows] = False
        name = ("instance", int(instance))
        roots[name] = table.append(name, TreeInput(frame, primitives.corners[rows], NO_BOUNDS), ids)
    ids = np.flatnonzero(np.repeat(primitives.flattened, count))[rest]
    ids = np.concatenate([ids, np.arange(*geometry.kind_range(Kind.SPHERE))])
    if len(ids):
        corners = primitives.corners if rest.all() else primitives.corners[rest]
        roots["rest", 0] = table.append(("rest", 0), TreeInput(frame, corners, sphere_bounds), ids)
    return table.append_top(("parts", 0), frame, roots) if len(roots) > 1 else next(iter(roots.values()))


def bound_spheres(geometry: Geometry) -> Floats:
    """(s, 2, 3) boxes of spheres: one rounding each, made up for by one step outward."""
    radii = geometry.radii[:, None]
    low = np.nextafter(geometry.centres - radii, -np.inf)
    return np.stack([low, np.nextafter(geometry.centres + radii, np.inf)], axis=1)


def mesh_corners(geometry: Geometry, mesh: int) -> Floats:
    """Object-space corners (t, 9) of a mesh's triangles."""
    first, count = geometry.mesh_first[mesh], geometry.mesh_count[mesh]
    return geometry.positions[geometry.triangles[first : first + count]].reshape(-1, 9)


def mesh_frame(corners: Floats) -> Frame:
    return make_frame(*extremes(corners.reshape(-1, 3)))


def _build_meshes(table: Table, geometry: Geometry, shared: NDArray) -> PlacedTrees:
    """Build one tree per mesh of the shared instances; meshes that share their geometry share the tree."""
    used = list_meshes(geometry, shared)
    rows, first, row_of_used = np.unique(geometry.mesh_first[used], return_index=True, return_inverse=True)
    row_of_mesh = np.zeros(len(geometry.mesh_first), np.int32)
    row_of_mesh[used] = row_of_used
    meshes = []
    for row, mesh in zip(rows, used[first], strict=True):
        corners = mesh_corners(geometry, mesh)
        frame = mesh_frame(corners)
        root = table.append(("mesh", int(row)), TreeInput(frame, corners, NO_BOUNDS), np.arange(len(corners)))
        meshes.append(MeshTree(root, frame, np.abs(corners.reshape(-1, 3)).max(axis=0)))
    return place_trees(geometry, meshes, row_of_mesh[geometry.instance_mesh])
