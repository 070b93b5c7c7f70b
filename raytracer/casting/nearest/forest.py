"""Boxes over a scene for questions of distance: a tree for each mesh in its own space, and one over all that is placed.

A tree is complete: every node has FAN children down to the leaves, so that it needs no more than the number of the
first one. An instance is searched in the space of its mesh: with M = U S V^T (singular values s),
|M x| >= s_min |x|, so

    distance in the world >= s_min (distance from the box in object space) - slack
                          <= s_max (distance from its farthest corner) + slack.

The slack covers what rounds: the inverse and its product with the point (`bvh.instances`: residual and gamma(16) of the
condition number, times the numbers that enter), world corners (gamma(4)), and the measurement itself (`distances`),
so that no order of search changes what is found. Instances whose matrix has no good inverse have a tree of their own
in world space. Trees of meshes stay while the mesh does: what only moves is not built again.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats
from raytracer.casting.bvh.instances import WORST_RESIDUAL, invert
from raytracer.casting.dense.split import split_evenly
from raytracer.casting.geometry import Geometry, instance_corners
from raytracer.casting.nearest.distances import ROUNDING
from raytracer.lecture import length
from raytracer.predicates.rounding import gamma
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Mesh

FAN_BITS = 2
FAN = 1 << FAN_BITS
# Two triangles cost about as much as two boxes.
LEAF_SIZE = 2


@dataclass(frozen=True, eq=False)
class BoxTree:
    """A tree over k items.

    boxes : (m, 2, 3) float64, low and high of each node; the root is node 0
    first : (m,) int64, the first child of a node, or of a leaf its first entry of `items`
    count : (m,) int64, the children of a node, or how many items a leaf has
    leaf : (m,) bool
    items : (k,) int64
    """

    boxes: Floats
    first: NDArray[np.int64]
    count: NDArray[np.int64]
    leaf: Booleans
    items: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Forest:
    """All trees of a scene in one; owners are instances, then groups of spheres, then the tree over them.

    tree : all trees, one behind the other
    root : (owners,) the root of each; -1 for one without primitives
    inverse : (owners, 3, 3), translation : (owners, 3), object from world: inverse (p - translation)
    shrink, stretch : (owners,) the least and the largest length in the world of a unit in object space
    slack, reach : (owners,) lower bounds on distances from p are off by slack (|p| + reach)
    """

    tree: BoxTree
    root: NDArray[np.int64]
    inverse: Floats
    translation: Floats
    shrink: Floats
    stretch: Floats
    slack: Floats
    reach: Floats


_trees: WeakKeyDictionary[Mesh, BoxTree] = WeakKeyDictionary()


def build_tree(boxes: Floats) -> BoxTree:
    """Return the tree over boxes (k, 2, 3), k >= 1."""
    depth = max(0, int(np.ceil(np.log(len(boxes) / LEAF_SIZE) / np.log(FAN)))) if len(boxes) > LEAF_SIZE else 0
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    size = float((high - low).max()) or 1.0
    # Only compared: what rounds does not matter.
    planes = np.concatenate([(boxes[:, 0] - low) / size, (low - boxes[:, 1]) / size], axis=1).T.astype(np.float32)
    order, starts = split_evenly(np.ascontiguousarray(planes), FAN_BITS * depth)
    sorted_boxes = boxes[order]
    levels = [
        np.stack(
            [
                np.minimum.reduceat(sorted_boxes[:, 0], starts[:-1]),
                np.maximum.reduceat(sorted_boxes[:, 1], starts[:-1]),
            ],
            axis=1,
        )
    ]
    while len(levels[0]) > 1:
        children = levels[0].reshape(-1, FAN, 2, 3)
        levels.insert(0, np.stack([children[:, :, 0].min(axis=1), children[:, :, 1].max(axis=1)], axis=1))
    inner = sum(map(len, levels[:-1]))
    first = np.concatenate([1 + FAN * np.arange(inner), starts[:-1]])
    count = np.concatenate([np.full(inner, FAN), np.diff(starts)])
    leaf = np.arange(len(first)) >= inner
    return BoxTree(np.concatenate(levels), first, count, leaf, order.astype(np.int64))


def bound_corners(corners: Floats) -> Floats:
    """Return the boxes (t, 2, 3) of triangles (t, 3, 3)."""
    return np.stack([corners.min(axis=1), corners.max(axis=1)], axis=1)


def find_tree(mesh: Mesh) -> BoxTree:
    """Return the tree over a mesh's triangles in object space; remembered while the mesh exists."""
    if mesh not in _trees:
        _trees[mesh] = build_tree(bound_corners(mesh.positions[mesh.triangles]))
    return _trees[mesh]


def build_forest(scene: Scene, geometry: Geometry) -> Forest | None:
    """Return the forest of a scene; None for one without primitives."""
    trees, boxes = _plant_trees(scene, geometry)
    filled = np.flatnonzero([tree is not None for tree in trees])
    if not len(filled):
        return None
    top = build_tree(boxes[filled])
    trees.append(BoxTree(top.boxes, top.first, top.count, top.leaf, filled[top.items]))
    tree, root = _join_trees(trees)
    return _place_trees(geometry, tree, root, boxes)


def _plant_trees(scene: Scene, geometry: Geometry) -> tuple[list[BoxTree | None], Floats]:
    """Return the tree of each owner, None where it has no primitives, and boxes around them in the world."""
    trees: list[BoxTree | None] = [None] * (len(geometry.first_id) - 1)
    boxes = np.zeros((len(trees), 2, 3))
    _, residual = invert(geometry.world_from_object)
    for instance, mesh in enumerate(geometry.instance_mesh):
        if not geometry.mesh_count[mesh]:
            continue
        matrix = geometry.world_from_object[instance]
        if residual[instance] < WORST_RESIDUAL:
            tree = find_tree(scene.meshes[mesh])
            boxes[instance] = _move_box(matrix, tree.boxes[0])
        else:
            tree = build_tree(bound_corners(instance_corners(geometry, instance)))
            boxes[instance] = tree.boxes[0]
        trees[instance] = tree
    for owner, group in enumerate(scene.spheres, start=len(geometry.instance_mesh)):
        if len(group.radii):
            radii = group.radii[:, np.newaxis]
            trees[owner] = tree = build_tree(np.stack([group.centres - radii, group.centres + radii], axis=1))
            boxes[owner] = tree.boxes[0]
    return trees, boxes


def _place_trees(geometry: Geometry, tree: BoxTree, root: NDArray[np.int64], boxes: Floats) -> Forest:
    """Return the Forest: where no space of its own is searched, the identity."""
    owners = len(root)
    inverse, translation = np.tile(np.eye(3), (owners, 1, 1)), np.zeros((owners, 3))
    shrink, stretch = np.ones((2, owners))
    slack, reach = np.full(owners, gamma(16) + 2 * ROUNDING), np.zeros(owners)
    inverses, residual = invert(geometry.world_from_object)
    rows = np.flatnonzero(residual < WORST_RESIDUAL)
    singular = np.linalg.svd(geometry.world_from_object[rows, :3, :3], compute_uv=False)  # (k, 3) descending
    inverse[rows], translation[rows] = inverses[rows], geometry.world_from_object[rows, :3, 3]
    shrink[rows], stretch[rows] = singular[:, 2] * (1 - WORST_RESIDUAL), singular[:, 0] * (1 + WORST_RESIDUAL)
    slack[rows] += (2 * residual[rows] + gamma(64)) * singular[:, 0] / singular[:, 2]
    reach[:-1] = np.sqrt(3) * np.abs(boxes).max(axis=(1, 2)) + length(translation[:-1])
    reach[-1] = reach.max()
    return Forest(tree, root, inverse, translation, shrink, stretch, slack, reach)


def _move_box(matrix: Floats, box: Floats) -> Floats:
    """Return a box (2, 3) around the image of a box; what rounds is in the slack."""
    middle, half = (
        matrix[:3, :3] @ (box.sum(axis=0) / 2) + matrix[:3, 3],
        np.abs(matrix[:3, :3]) @ (box[1] - box[0]) / 2,
    )
    return np.stack([middle - half, middle + half])


def _join_trees(trees: list[BoxTree | None]) -> tuple[BoxTree, NDArray[np.int64]]:
    """Return all trees as one, and the roots; what appears several times is there once."""
    distinct = list(dict.fromkeys(tree for tree in trees if tree is not None))
    node_start = np.cumsum([0, *(len(tree.first) for tree in distinct)])
    item_start = np.cumsum([0, *(len(tree.items) for tree in distinct)])
    first = [
        tree.first + np.where(tree.leaf, items, nodes)
        for tree, nodes, items in zip(distinct, node_start[:-1], item_start[:-1], strict=True)
    ]
    number = dict(zip(distinct, node_start[:-1], strict=True))
    joined = BoxTree(
        np.concatenate([tree.boxes for tree in distinct]),
        np.concatenate(first),
        np.concatenate([tree.count for tree in distinct]),
        np.concatenate([tree.leaf for tree in distinct]),
        np.concatenate([tree.items for tree in distinct]),
    )
    return joined, np.array([-1 if tree is None else number[tree] for tree in trees], dtype=np.int64)
