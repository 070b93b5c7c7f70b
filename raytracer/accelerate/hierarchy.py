"""Two levels of trees in one table: a world tree of flattened primitives, a world tree of instances, a tree per mesh.

Imports `bvh`, `placed` and `primitives`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.accelerate.bvh import CHILD_COLUMN, LEAF_STRIDE, WIDTH, Frame, Tree, build_tree, make_frame
from raytracer.accelerate.geometry import Geometry
from raytracer.accelerate.placed import PlacedTrees, can_be_placed, invert
from raytracer.accelerate.primitives import Primitives, instance_bounds
from raytracer.predicates import gamma
from raytracer.rays import Booleans, Floats

# Copies of triangles that flattening may add in all (72 bytes each, plus their share of a tree).
FLATTEN_LIMIT = 1 << 17


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """All trees of a scene in one table.

    frame : of the world trees
    nodes : (k, 32) float32, all trees' nodes; child references count in this table
    items : (t,) int64, what the leaves hold: primitive ids up to `instances_begin`, then instances up to
        `meshes_begin`, then triangles of shared meshes
    roots : nodes at which every ray begins
    placed : the shared meshes' trees, or None
    """

    frame: Frame
    nodes: NDArray[np.float32]
    items: NDArray[np.int64]
    instances_begin: int
    meshes_begin: int
    roots: tuple[int, ...]
    placed: PlacedTrees | None


class _Table:
    """Trees being joined into one table of nodes and items."""

    def __init__(self) -> None:
        self.nodes: list[NDArray[np.float32]] = []
        self.items: list[NDArray[np.int64]] = []
        self.node_count = self.item_count = 0

    def append(self, tree: Tree, item_ids: NDArray[np.int64]) -> int:
        """Add a tree whose item k is `item_ids[k]`, renumbering its references; return its root."""
        table = tree.nodes
        reference = table.view(np.int32)[:, CHILD_COLUMN : CHILD_COLUMN + WIDTH]
        shift = np.where(reference < 0, -self.item_count * LEAF_STRIDE, self.node_count)
        reference += shift.astype(np.int32)
        root = self.node_count
        self.nodes.append(table)
        self.items.append(item_ids[tree.items])
        self.node_count += len(table)
        self.item_count += len(tree.items)
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
            exponents[mesh] = _mesh_frame(_mesh_boxes(geometry, mesh)).exponent
        matrices = geometry.world_from_object[shared]
        flattened[shared] = ~can_be_placed(matrices, exponents[geometry.instance_mesh[shared]], frame.exponent)
    return flattened


def build_hierarchy(primitives: Primitives) -> Hierarchy:
    """Build all trees that the primitives need, and no other."""
    geometry = primitives.geometry
    flat_boxes, flat_ids = _flat_items(primitives)
    shared = np.flatnonzero(~primitives.flattened)
    placed_boxes = instance_bounds(geometry, shared)
    everything = np.concatenate([flat_boxes, placed_boxes])
    if not len(everything):
        return Hierarchy(make_frame(np.zeros(3), np.zeros(3)), np.zeros((0, 32), np.float32), flat_ids, 0, 0, (), None)
    frame = make_frame(everything[:, 0].min(axis=0), everything[:, 1].max(axis=0))
    table = _Table()
    roots = []
    if len(flat_ids):
        roots.append(table.append(build_tree(flat_boxes, frame), flat_ids))
    instances_begin = table.item_count
    if len(shared):
        roots.append(table.append(build_tree(placed_boxes, frame), shared.astype(np.int64)))
    meshes_begin = table.item_count
    placed = _build_meshes(table, geometry, shared) if len(shared) else None
    nodes, items = np.concatenate(table.nodes), np.concatenate(table.items)
    return Hierarchy(frame, nodes, items, instances_begin, meshes_begin, tuple(roots), placed)


def _flat_items(primitives: Primitives) -> tuple[Floats, NDArray[np.int64]]:
    """Boxes (k, 2, 3) and ids (k,) of flattened triangles and spheres."""
    geometry = primitives.geometry
    triangle = np.repeat(primitives.flattened, np.diff(geometry.first_id)[: len(primitives.flattened)])
    corners = primitives.corners.reshape(-1, 3, 3)
    low, high = corners.min(axis=1, initial=np.inf), corners.max(axis=1, initial=-np.inf)
    triangles = np.stack([low, high], axis=1).astype(np.float64)
    # A sphere's box: one rounding each, made up for by one step outward.
    radii = geometry.radii[:, None]
    low = np.nextafter(geometry.centres - radii, -np.inf)
    spheres = np.stack([low, np.nextafter(geometry.centres + radii, np.inf)], axis=1)
    ids = np.concatenate([np.flatnonzero(triangle), np.arange(geometry.sphere_id, geometry.first_id[-1])])
    return np.concatenate([triangles, spheres]), ids.astype(np.int64)


def _mesh_boxes(geometry: Geometry, mesh: int) -> Floats:
    """Object-space boxes (t, 2, 3) of a mesh's triangles."""
    first, count = geometry.mesh_first[mesh], geometry.mesh_count[mesh]
    corners = geometry.positions[geometry.triangles[first : first + count]]
    return np.stack([corners.min(axis=1), corners.max(axis=1)], axis=1)


def _mesh_frame(boxes: Floats) -> Frame:
    return make_frame(boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0))


def _build_meshes(table: _Table, geometry: Geometry, shared: NDArray) -> PlacedTrees:
    """Build one tree per mesh of the shared instances; meshes that share their geometry share the tree."""
    count = len(geometry.instance_mesh)
    root, exponent = np.zeros(count, np.int32), np.zeros(count, np.int32)
    centre, largest = np.zeros((count, 3)), np.zeros((count, 3))
    first_row = geometry.mesh_first[geometry.instance_mesh]
    for row in np.unique(first_row[shared]):
        users = shared[first_row[shared] == row]
        boxes = _mesh_boxes(geometry, int(geometry.instance_mesh[users[0]]))
        frame = _mesh_frame(boxes)
        root[users] = table.append(build_tree(boxes, frame), np.arange(len(boxes)))
        centre[users], exponent[users] = frame.centre, frame.exponent
        largest[users] = np.abs(boxes).max(axis=(0, 1))
    matrices = geometry.world_from_object
    inverse, residual = invert(matrices)
    sizes = np.einsum("kij,kj->ki", np.abs(matrices[:, :3, :3]), largest) + np.abs(matrices[:, :3, 3])
    corner_error = np.einsum("kij,kj->ki", np.abs(inverse), gamma(4) * sizes)
    first_id = geometry.first_id[:count]
    return PlacedTrees(root, first_id, inverse, matrices[:, :3, 3], centre, exponent, residual, corner_error)
