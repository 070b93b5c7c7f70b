"""Trees joined into one table; those that did not change since the last build are taken from its table.

A tree is built from a frame, triangles, and boxes of whatever else it holds. Two builds that give the same name to the
same input, bit for bit, share the tree: its rows are copied and renumbered, which costs a hundredth of building it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Integers
from raytracer.casting.bvh.clustering import Bounds
from raytracer.casting.bvh.leaves import LEAF_ROWS, pack_leaves
from raytracer.casting.bvh.tree import NODE_ROWS, REFERENCE_ROW, WIDTH, Frame, build_tree, to_bounds

Name = tuple[str, int]
# Triangles whose boxes are computed at a time.
BLOCK = 1 << 14
NO_CORNERS = np.zeros((0, 9))
NO_TRIANGLES = np.zeros((0, LEAF_ROWS, WIDTH), np.float32)
NO_BOUNDS = np.zeros((6, 0), np.float32)


@dataclass(frozen=True, eq=False)
class TreeInput:
    """What a tree is built from: t triangles and k boxes; its items count the triangles first.

    corners : (t, 9) of the triangles
    others : (6, k) bounds, in the frame, of what is no triangle
    """

    frame: Frame
    corners: NDArray
    others: Bounds

    def __len__(self) -> int:
        return len(self.corners) + self.others.shape[1]

    def equals(self, other: TreeInput) -> bool:
        same_frame = self.frame.exponent == other.frame.exponent and (self.frame.centre == other.frame.centre).all()
        return bool(
            same_frame and np.array_equal(self.corners, other.corners) and np.array_equal(self.others, other.others)
        )


@dataclass(frozen=True, eq=False)
class JoinedTree:
    """A tree within a table: views of its rows, the first of which are `node_base` and `leaf_base`.

    triangles : (b, 10, 4) float32, see `leaves`; none where leaves hold no triangles
    leaves : (b, 4) or (b, 1) int32 items of its leaves, counted in the input
    """

    source: TreeInput
    nodes: NDArray[np.float32]
    triangles: NDArray[np.float32]
    leaves: Integers
    node_base: int = 0
    leaf_base: int = 0

    def bounds(self) -> Bounds:
        """(6,) low and minus high of the root's children; empty slots are points at infinity."""
        box = self.nodes[0, :REFERENCE_ROW]
        high = np.where(box[3:] < np.inf, box[3:], -np.inf).max(axis=1)
        return np.concatenate([box[:3].min(axis=1), -high])


def grow_tree(source: TreeInput) -> JoinedTree:
    """Build a tree that begins a table of its own."""
    tree = build_tree(bound_all(source), source.frame)
    return JoinedTree(source, tree.nodes, pack_leaves(tree, source.corners), tree.leaves)


def grow_box_tree(source: TreeInput) -> JoinedTree:
    """Build a tree that begins a table of its own over boxes alone, one in a leaf."""
    tree = build_tree(source.others, source.frame, leaf_size=1)
    return JoinedTree(source, tree.nodes, NO_TRIANGLES, tree.leaves[:, :1].copy())


def bound_all(source: TreeInput) -> Bounds:
    """(6, t + k) bounds of a tree's triangles and boxes."""
    triangles = bound_triangles(source.frame, source.corners)
    return np.concatenate([triangles, source.others], axis=1) if source.others.shape[1] else triangles


def bound_triangles(frame: Frame, corners: NDArray) -> Bounds:
    """(6, t) bounds of triangles, (t, 9) corners, block by block."""
    bounds = np.empty((6, len(corners)), np.float32)
    for start in range(0, len(corners), BLOCK):
        a, b, c = np.ascontiguousarray(corners[start : start + BLOCK].T, dtype=np.float64).reshape(3, 3, -1)
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        bounds[:, start : start + BLOCK] = to_bounds(frame, np.stack([low.T, high.T], axis=1))
    return bounds


def name_items(leaves: Integers, item_ids: NDArray[np.int64]) -> NDArray[np.signedinteger]:
    """Return what leaves (b, 4) hold, ids instead of numbers of the input: these very leaves where both are the same,
    and at most 4 bytes each where that is enough."""
    count = len(item_ids)
    if count and item_ids[0] == 0 and item_ids[-1] == count - 1:  # ids ascend
        return leaves
    fits = item_ids.max(initial=0) <= np.iinfo(np.int32).max
    ids: NDArray[np.signedinteger] = item_ids.astype(np.int32 if fits else np.int64)
    return ids[leaves]


class Table:
    """Trees being joined. Names tell which tree of the last table a new one may be."""

    def __init__(self, last: Mapping[Name, JoinedTree]) -> None:
        self.last = last
        self.trees: dict[Name, JoinedTree] = {}
        self.items: list[NDArray[np.signedinteger]] = [np.zeros((0, WIDTH), np.int32)]
        self.node_count = self.leaf_count = 0

    def append(self, name: Name, source: TreeInput, item_ids: NDArray[np.int64]) -> int:
        """Add the tree of an input whose item k is `item_ids[k]`; return its root."""
        known = self.last.get(name)
        # The new input replaces the last one, so that the arrays of the last scene can be freed.
        tree = replace(known, source=source) if known and known.source.equals(source) else grow_tree(source)
        self.items.append(name_items(tree.leaves, item_ids))
        return self._add(name, tree, len(tree.leaves))

    def append_boxes(self, name: Name, source: TreeInput) -> tuple[int, Integers]:
        """Add the tree of an input without triangles, after all that have some; return its root, and the item of each
        of its leaves."""
        known = self.last.get(name)
        tree = replace(known, source=source) if known and known.source.equals(source) else grow_box_tree(source)
        return self._add(name, tree, len(tree.leaves)), tree.leaves[:, 0]

    def append_top(self, name: Name, frame: Frame, roots: Mapping[Name, int]) -> int:
        """Add a tree whose leaves are trees that are in the table already, given by their roots; return its root."""
        others = np.stack([self.trees[part].bounds() for part in roots], axis=1)
        tree = grow_box_tree(TreeInput(frame, NO_CORNERS, others))
        root = self._add(name, tree, 0)
        reference = self.trees[name].nodes.view(np.int32)[:, REFERENCE_ROW]
        leaf = reference < 0
        reference[leaf] = np.array(list(roots.values()), np.int32)[tree.leaves[~(reference[leaf] + self.leaf_count), 0]]
        return root

    def _add(self, name: Name, tree: JoinedTree, kept: int) -> int:
        """Renumber a tree's references and list it with the first `kept` of its leaves; return its root."""
        nodes = tree.nodes.copy()
        reference = nodes.view(np.int32)[:, REFERENCE_ROW]
        inner = np.int32(self.node_count - tree.node_base)
        reference += np.where(reference < 0, np.int32(tree.leaf_base - self.leaf_count), inner)
        root = self.node_count
        self.trees[name] = replace(
            tree,
            nodes=nodes,
            triangles=tree.triangles[:kept],
            leaves=tree.leaves[:kept],
            node_base=root,
            leaf_base=self.leaf_count,
        )
        self.node_count += len(nodes)
        self.leaf_count += kept
        return root

    def join(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.signedinteger]]:
        """Return nodes (k, 7, 4), triangles (b, 10, 4) and items (b, 4); `trees` become views of them."""
        if len(self.trees) == 1 and not self.last:  # it may be most of the memory: no copy
            (tree,) = self.trees.values()
            return tree.nodes, tree.triangles, self.items[-1]
        nodes = np.empty((self.node_count, NODE_ROWS, WIDTH), np.float32)
        items = np.concatenate(self.items)
        triangles = np.empty((len(items), LEAF_ROWS, WIDTH), np.float32)
        for name, tree in self.trees.items():
            rows = slice(tree.node_base, tree.node_base + len(tree.nodes))
            leaf_rows = slice(tree.leaf_base, tree.leaf_base + len(tree.triangles))
            nodes[rows], triangles[leaf_rows] = tree.nodes, tree.triangles
            self.trees[name] = replace(tree, nodes=nodes[rows], triangles=triangles[leaf_rows])
        return nodes, triangles, items
