"""Two levels of trees in one table: a world tree of flattened primitives, a world tree of instances, a tree per mesh.

Imports `bvh`, `leaves`, `placed` and `primitives`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.accelerate.bvh import NODE_ROWS, REFERENCE_ROW, WIDTH, Frame, Tree, build_tree, make_frame, to_bounds
from raytracer.accelerate.clustering import Bounds
from raytracer.accelerate.geometry import Geometry
from raytracer.accelerate.leaves import LEAF_ROWS, pack_leaves
from raytracer.accelerate.placed import PlacedTrees, can_be_placed, invert
from raytracer.accelerate.primitives import Primitives, extremes, instance_bounds
from raytracer.predicates import gamma
from raytracer.rays import Booleans, Floats

# Copies of triangles that flattening may add in all (72 bytes each, plus their share of a tree).
FLATTEN_LIMIT = 1 << 17
# Triangles whose boxes are computed at a time.
BLOCK = 1 << 14
NO_CORNERS = np.zeros((0, 9))


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """All trees of a scene in one table.

    frame : of the world trees
    nodes : (k, 8, 4) float32, all trees' nodes; child references count in this table
    triangles : (b, 10, 4) float32, the triangles of all leaves, see `leaves`
    items : (b, 4) int64, what the leaves hold: primitive ids up to row `instances_begin`, then instances up to
        `meshes_begin`, then triangles of shared meshes
    roots : nodes at which every ray begins
    placed : the shared meshes' trees, or None
    """

    frame: Frame
    nodes: NDArray[np.float32]
    triangles: NDArray[np.float32]
    items: NDArray[np.int64]
    instances_begin: int
    meshes_begin: int
    roots: tuple[int, ...]
    placed: PlacedTrees | None


class _Table:
    """Trees being joined into one table of nodes and leaves."""

    def __init__(self) -> None:
        self.nodes = [np.zeros((0, NODE_ROWS, WIDTH), np.float32)]
        self.triangles = [np.zeros((0, LEAF_ROWS, WIDTH), np.float32)]
        self.items = [np.zeros((0, WIDTH), np.int64)]
        self.node_count = self.leaf_count = 0

    def append(self, tree: Tree, corners: NDArray, item_ids: NDArray[np.int64]) -> int:
        """Add a tree whose item k is `item_ids[k]`, the first of them triangles, renumbering it; return its root."""
        nodes = tree.nodes
        reference = nodes.view(np.int32)[:, REFERENCE_ROW]
        reference += np.where(reference < 0, np.int32(-self.leaf_count), np.int32(self.node_count))
        root = self.node_count
        self.nodes.append(nodes)
        self.triangles.append(pack_leaves(tree, corners))
        self.items.append(item_ids[tree.leaves])
        self.node_count += len(nodes)
        self.leaf_count += len(tree.leaves)
        return root


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
        for mesh in np.unique(geometry.instance_mesh[shared]):
            exponents[mesh] = _mesh_frame(_mesh_corners(geometry, mesh)).exponent
        matrices = geometry.world_from_object[shared]
        flattened[shared] = ~can_be_placed(matrices, exponents[geometry.instance_mesh[shared]], frame.exponent)
    return flattened


def build_hierarchy(primitives: Primitives) -> Hierarchy:
    """Build all trees that the primitives need, and no other."""
    geometry = primitives.geometry
    shared = np.flatnonzero(~primitives.flattened)
    sphere_boxes = _sphere_boxes(geometry)
    frame = _world_frame(primitives, sphere_boxes)
    table = _Table()
    roots = []
    flat_ids = _flat_ids(primitives)
    if len(flat_ids):
        bounds = np.concatenate([_triangle_bounds(frame, primitives.corners), to_bounds(frame, sphere_boxes)], axis=1)
        roots.append(table.append(build_tree(bounds, frame), primitives.corners, flat_ids))
    instances_begin = table.leaf_count
    if len(shared):
        tree = build_tree(to_bounds(frame, instance_bounds(geometry, shared)), frame, leaf_size=1)
        roots.append(table.append(tree, NO_CORNERS, shared.astype(np.int64)))
    meshes_begin = table.leaf_count
    placed = _build_meshes(table, geometry, shared) if len(shared) else None
    return Hierarchy(
        frame=frame,
        nodes=np.concatenate(table.nodes),
        triangles=np.concatenate(table.triangles),
        items=np.concatenate(table.items),
        instances_begin=instances_begin,
        meshes_begin=meshes_begin,
        roots=tuple(roots),
        placed=placed,
    )


def _world_frame(primitives: Primitives, sphere_boxes: Floats) -> Frame:
    """The frame of all triangles, shared ones included, and spheres."""
    triangles = primitives.bounds if primitives.geometry.sphere_id else np.zeros((0, 3))
    points = np.concatenate([triangles, sphere_boxes.reshape(-1, 3)])
    return make_frame(*extremes(points)) if len(points) else make_frame(np.zeros(3), np.zeros(3))


def _flat_ids(primitives: Primitives) -> NDArray[np.int64]:
    """(k,) ids of flattened triangles, as `Primitives.corners` orders them, then of spheres."""
    geometry = primitives.geometry
    triangle = np.repeat(primitives.flattened, np.diff(geometry.first_id)[: len(primitives.flattened)])
    return np.concatenate([np.flatnonzero(triangle), np.arange(geometry.sphere_id, geometry.first_id[-1])])


def _sphere_boxes(geometry: Geometry) -> Floats:
    """(s, 2, 3) boxes of spheres: one rounding each, made up for by one step outward."""
    radii = geometry.radii[:, None]
    low = np.nextafter(geometry.centres - radii, -np.inf)
    return np.stack([low, np.nextafter(geometry.centres + radii, np.inf)], axis=1)


def _triangle_bounds(frame: Frame, corners: NDArray) -> Bounds:
    """(6, t) bounds of triangles, (t, 9) corners, block by block."""
    bounds = np.empty((6, len(corners)), np.float32)
    for start in range(0, len(corners), BLOCK):
        a, b, c = np.ascontiguousarray(corners[start : start + BLOCK].T, dtype=np.float64).reshape(3, 3, -1)
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        bounds[:, start : start + BLOCK] = to_bounds(frame, np.stack([low.T, high.T], axis=1))
    return bounds


def _mesh_corners(geometry: Geometry, mesh: int) -> Floats:
    """Object-space corners (t, 9) of a mesh's triangles."""
    first, count = geometry.mesh_first[mesh], geometry.mesh_count[mesh]
    return geometry.positions[geometry.triangles[first : first + count]].reshape(-1, 9)


def _mesh_frame(corners: Floats) -> Frame:
    return make_frame(*extremes(corners.reshape(-1, 3)))


def _build_meshes(table: _Table, geometry: Geometry, shared: NDArray) -> PlacedTrees:
    """Build one tree per mesh of the shared instances; meshes that share their geometry share the tree."""
    count = len(geometry.instance_mesh)
    root, exponent = np.zeros(count, np.int32), np.zeros(count, np.int32)
    centre, largest = np.zeros((count, 3)), np.zeros((count, 3))
    first_row = geometry.mesh_first[geometry.instance_mesh]
    for row in np.unique(first_row[shared]):
        users = shared[first_row[shared] == row]
        corners = _mesh_corners(geometry, int(geometry.instance_mesh[users[0]]))
        frame = _mesh_frame(corners)
        tree = build_tree(_triangle_bounds(frame, corners), frame)
        root[users] = table.append(tree, corners, np.arange(len(corners)))
        centre[users], exponent[users] = frame.centre, frame.exponent
        largest[users] = np.abs(corners.reshape(-1, 3)).max(axis=0)
    matrices = geometry.world_from_object
    inverse, residual = invert(matrices)
    sizes = np.einsum("kij,kj->ki", np.abs(matrices[:, :3, :3]), largest) + np.abs(matrices[:, :3, 3])
    corner_error = np.einsum("kij,kj->ki", np.abs(inverse), gamma(4) * sizes)
    first_id = geometry.first_id[:count]
    return PlacedTrees(root, first_id, inverse, matrices[:, :3, 3], centre, exponent, residual, corner_error)
