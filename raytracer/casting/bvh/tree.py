"""Bounding volume hierarchies, four children wide, of clusters of boxes.

Boxes are float32, rounded outward, in a *frame* of the tree's own: x_frame = (x - centre) 2^exponent lies in
[-1, 1]^3, so that scenes of any size and far from the origin keep their resolution.

A node is eight rows of four floats, one per child: low x, y, z, high x, y, z, references, padding; a *row* of 16 bytes
is what traversal gathers. Child references are int32 in the same bits: a node >= 0, or ~leaf. A leaf is a row of up to
four items.

Sources: `clustering`; I. Wald, C. Benthin and S. Boulos, "Getting rid of packets" (2008) for the four-wide node;
H. Ylitie, T. Karras and S. Laine, "Efficient incoherent ray traversal on GPUs through compressed wide BVHs" (2017),
section 3.2, for making wide nodes of binary ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats, Integers
from raytracer.casting.bvh.clustering import (
    BLOCK,
    Bounds,
    Clusters,
    begin_clusters,
    half_surface,
    merge_clusters,
    sort_along_curve,
)

WIDTH = 4
NODE_ROWS = 7
REFERENCE_ROW = 6
# What a ray costs at a node and at a leaf, roughly as measured.
NODE_COST, LEAF_COST = np.float32(1), np.float32(1.5)
# Slots of a leaf that hold nothing.
NO_ITEM = -1


@dataclass(frozen=True, eq=False)
class Frame:
    """x_frame = (x - centre) * 2^exponent."""

    centre: Floats
    exponent: int

    def place(self, points: NDArray) -> Floats:
        """World points (..., 3) in the frame."""
        return np.ldexp(points - self.centre, self.exponent)


@dataclass(frozen=True, eq=False)
class Tree:
    """A four-wide hierarchy.

    nodes : (k, 7, 4) float32, node 0 is the root
    leaves : (b, 4) int32, the items of each leaf, NO_ITEM in empty slots
    """

    frame: Frame
    nodes: NDArray[np.float32]
    leaves: Integers


def make_frame(low: Floats, high: Floats) -> Frame:
    """The frame in which the box low, high fits into [-1, 1]^3."""
    centre, half = low / 2 + high / 2, float((high / 2 - low / 2).max())
    # |x - centre| may exceed half by a rounding: one exponent more when half is next to a power of two.
    exponent = -int(np.frexp(half * (1 + 2.0**-50))[1]) if half > 0 else 0
    return Frame(centre, exponent)


def round_down(values: Floats) -> NDArray[np.float32]:
    """The largest float32 not above each value."""
    nearest = values.astype(np.float32)
    return np.where(nearest > values, np.nextafter(nearest, np.float32(-np.inf)), nearest)


def to_bounds(frame: Frame, boxes: Floats) -> Bounds:
    """World boxes (t, 2, 3), low and high, as outward-rounded planes (6, t) of the frame: low and minus high."""
    scaled = frame.place(boxes).reshape(-1, 6).T
    return np.concatenate([round_down(scaled[:3]), round_down(-scaled[3:])])


def build_tree(bounds: Bounds, frame: Frame, leaf_size: int = WIDTH) -> Tree:
    """Return the hierarchy over t >= 1 boxes, (6, t) planes of `to_bounds`, at most `leaf_size` of them in a leaf."""
    clusters = begin_clusters(bounds, sort_along_curve(bounds))
    del bounds  # a tenth of what building takes at most, where nobody else keeps them
    merge_clusters(clusters)
    nodes, leaf = _widen(clusters, leaf_size)
    slot = np.arange(WIDTH, dtype=np.int32)
    position = np.minimum(clusters.first[leaf][:, None] + slot, len(clusters.items) - 1)  # (b, 4)
    return Tree(frame, nodes, np.where(slot < clusters.count[leaf][:, None], clusters.items[position], NO_ITEM))


def _widen(clusters: Clusters, leaf_size: int) -> tuple[NDArray[np.float32], Integers]:
    """Return the nodes, level by level, and the clusters that are leaves."""
    left_slots = _share_slots(clusters, leaf_size)
    current = np.array([len(clusters.count) - 1], np.int32)
    tables, leaves = [], []
    node_count = leaf_count = 0
    while len(current):
        children = _choose_children(clusters, left_slots, current)
        parent, slot = np.nonzero(children >= 0)
        chosen = children[parent, slot]
        is_leaf = clusters.count[chosen] <= leaf_size
        following, leaf = chosen[~is_leaf], chosen[is_leaf]
        node_count += len(current)
        reference = np.empty(len(chosen), np.int32)
        reference[~is_leaf] = node_count + np.arange(len(following))
        reference[is_leaf] = ~(leaf_count + np.arange(len(leaf)))
        tables.append(_make_nodes(len(current), parent, slot, clusters.bounds.take(chosen, axis=1), reference))
        leaves.append(leaf)
        leaf_count += len(leaf)
        current = following
    return np.concatenate(tables), np.concatenate(leaves)


def _share_slots(clusters: Clusters, leaf_size: int) -> NDArray[np.int8]:
    """Return (5, 2 t - 1): how many of s slots a cluster's left part gets where the cluster is opened, 0 if it is not.

    The price of a cluster in s slots is the least of: its price in s - 1 slots, its parts' prices over all ways to
    share the s slots; equal prices are settled in favour of opening and of equal shares. In one slot it costs its
    surface, which is how many rays enter it, times what a ray costs there, and a node moreover the price of its own
    four slots.
    """
    size = len(clusters.count)
    # Row s - 1: in s slots.
    price = np.empty((WIDTH - 1, size), np.float32)
    for start in range(0, size, BLOCK):
        part = slice(start, start + BLOCK)
        price[:, part] = LEAF_COST * half_surface(clusters.bounds[:, part])
    left_slots = np.zeros((WIDTH + 1, size), np.int8)
    for part in clusters.from_leaves():
        left, right = price.take(clusters.left[part], axis=1), price.take(clusters.right[part], axis=1)
        ways = np.stack([left[1] + right[1], left[0] + right[2], left[2] + right[0]])
        left_slots[4, part] = np.array([2, 1, 3]).take(ways.argmin(axis=0))
        node = NODE_COST * half_surface(clusters.bounds[:, part]) + ways.min(axis=0)
        price[0, part] = np.where(clusters.count[part] > leaf_size, node, price[0, part])
        opened = left[0] + right[0]
        left_slots[2, part] = opened <= price[0, part]
        price[1, part] = np.minimum(price[0, part], opened)
        ways = np.stack([left[0] + right[1], left[1] + right[0], price[1, part]])
        choice = ways.argmin(axis=0)
        left_slots[3, part] = np.where(choice < 2, choice + 1, left_slots[2, part])
        price[2, part] = ways.min(axis=0)
    return left_slots


def _choose_children(clusters: Clusters, left_slots: NDArray[np.int8], current: Integers) -> Integers:
    """The (k, 4) clusters below each node, -1 in empty slots."""
    children = np.full((len(current), WIDTH), -1, np.int32)
    slots = np.zeros((len(current), WIDTH), np.int8)
    children[:, 0], slots[:, 0] = current, WIDTH
    for _ in range(WIDTH - 1):
        given = left_slots[slots, children]
        node, slot = np.nonzero(given)
        given, opened = given[node, slot], children[node, slot]
        children[node, slot], children[node, slot + given] = clusters.left[opened], clusters.right[opened]
        slots[node, slot + given] = slots[node, slot] - given
        slots[node, slot] = given
    return children


def _make_nodes(count: int, parent: NDArray, slot: NDArray, bounds: Bounds, reference: Integers) -> NDArray[np.float32]:
    """Return nodes with children at (parent, slot); the others are points at infinity, which no ray can enter."""
    nodes = np.zeros((count, NODE_ROWS, WIDTH), np.float32)
    nodes[:, :REFERENCE_ROW] = np.inf
    for axis in range(3):
        nodes[parent, axis, slot] = bounds[axis]
        nodes[parent, 3 + axis, slot] = -bounds[3 + axis]
    nodes.view(np.int32)[parent, REFERENCE_ROW, slot] = reference
    return nodes
