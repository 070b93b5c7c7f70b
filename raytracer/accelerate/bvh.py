"""Bounding volume hierarchies, four children wide, built level by level with the binned surface area heuristic.

All nodes of a level are split together, by array operations over all items: there is no loop over nodes or items.
Boxes are float32, rounded outward, in a *frame* of the tree's own: x_frame = (x - centre) 2^exponent lies in
[-1, 1]^3, so that scenes of any size and far from the origin keep their resolution.

Sources: I. Wald, "On fast construction of SAH-based bounding volume hierarchies" (2007); I. Wald, C. Benthin and
S. Boulos, "Getting rid of packets" (2008) for the four-wide node. Imports `rays`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.rays import Floats

BINS = 16
LEAF_SIZE = 4
# A leaf is named by a negative child reference: ~(first * LEAF_STRIDE + count).
LEAF_STRIDE = 8
WIDTH = 4
# Columns of a node: low x, y, z and high x, y, z of each of the four children, their references, padding to 128 bytes.
NODE_COLUMNS = 32
CHILD_COLUMN = 24


@dataclass(frozen=True, eq=False)
class Frame:
    """x_frame = (x - centre) * 2^exponent."""

    centre: Floats
    exponent: int


@dataclass(frozen=True, eq=False)
class Tree:
    """A four-wide hierarchy.

    nodes : (k, 32) float32, see NODE_COLUMNS; child references are int32 in the same bits, node 0 is the root
    items : (t,) int32, the items in the order of the leaves
    """

    frame: Frame
    nodes: NDArray[np.float32]
    items: NDArray[np.int32]


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


def to_frame(frame: Frame, boxes: Floats) -> NDArray[np.float32]:
    """World boxes (t, 2, 3) as outward-rounded float32 boxes (t, 6) of the frame."""
    scaled = np.ldexp(boxes - frame.centre, frame.exponent)
    low, high = round_down(scaled[:, 0]), -round_down(-scaled[:, 1])
    return np.concatenate([low, high], axis=1)


def build_tree(boxes: Floats, frame: Frame) -> Tree:
    """Return the hierarchy over `boxes`, (t, 2, 3) float64 low and high corners of t >= 1 items."""
    bounds = to_frame(frame, boxes)
    binary = _build_binary(bounds)
    return Tree(frame, _widen(binary), binary.items)


@dataclass(frozen=True, eq=False)
class _Binary:
    """Binary nodes in breadth-first order: children of an inner node are `child` and `child` + 1; leaves have -1."""

    bounds: NDArray[np.float32]
    first: NDArray[np.int64]
    count: NDArray[np.int64]
    child: NDArray[np.int64]
    items: NDArray[np.int32]


def _build_binary(bounds: NDArray[np.float32]) -> _Binary:
    items = np.arange(len(bounds), dtype=np.int32)
    centres = bounds[:, :3] + bounds[:, 3:]  # twice the centres: only their order matters
    first, count = np.zeros(1, np.int64), np.array([len(bounds)])
    levels = []
    node_count = 1
    while len(first):
        box = _segment_bounds(bounds, items, first, count)
        child = np.full(len(first), -1)
        inner = np.flatnonzero(count > LEAF_SIZE)
        child[inner] = node_count + 2 * np.arange(len(inner))
        levels.append((box, first, count, child))
        if not len(inner):
            break
        left = _split_segments(bounds, centres, items, first[inner], count[inner])
        starts = np.stack([first[inner], first[inner] + left], axis=1).ravel()
        sizes = np.stack([left, count[inner] - left], axis=1).ravel()
        first, count = starts, sizes
        node_count += len(first)
    columns = [np.concatenate(column) for column in zip(*levels, strict=True)]
    return _Binary(columns[0], columns[1], columns[2], columns[3], items)


def _members(first: NDArray, count: NDArray) -> tuple[NDArray, NDArray]:
    """Return all positions first ... first + count of each segment, and each segment's offset among them."""
    offset = np.concatenate([[0], np.cumsum(count)[:-1]])
    return np.repeat(first - offset, count) + np.arange(int(count.sum())), offset


def _segment_bounds(bounds: NDArray, items: NDArray, first: NDArray, count: NDArray) -> NDArray[np.float32]:
    """The (k, 6) boxes of k segments of `items`."""
    positions, offset = _members(first, count)
    rows = bounds[items[positions]]
    low = np.minimum.reduceat(rows[:, :3], offset)
    return np.concatenate([low, np.maximum.reduceat(rows[:, 3:], offset)], axis=1)


def _split_segments(
    bounds: NDArray, centres: NDArray, items: NDArray, first: NDArray, count: NDArray
) -> NDArray[np.int64]:
    """Reorder each segment of `items` in place so that its left part is split off; return the left parts' sizes.

    The cost of a split is area(left) count(left) + area(right) count(right), over BINS bins along the axis in which
    the centres spread most. Where all centres coincide the segment is halved as it is.
    """
    positions, offset = _members(first, count)
    members = items[positions]
    segment = np.repeat(np.arange(len(first)), count)
    centre = centres[members]
    low, high = np.minimum.reduceat(centre, offset), np.maximum.reduceat(centre, offset)
    axis = np.argmax(high - low, axis=1)
    rows = np.arange(len(first))
    start, spread = low[rows, axis], (high - low)[rows, axis]
    scale = np.where(spread > 0, np.float32(BINS) / np.where(spread > 0, spread, 1), 0).astype(np.float32)
    along = centre[np.arange(len(members)), axis[segment]]
    bins = np.minimum(((along - start[segment]) * scale[segment]).astype(np.int32), BINS - 1)
    key = segment * BINS + bins
    order = np.argsort(key, kind="stable")
    items[positions] = members[order]
    per_bin = np.bincount(key, minlength=len(first) * BINS).reshape(-1, BINS)
    left = _best_split(bounds[members[order]], per_bin)
    return np.where(spread > 0, left, count // 2)


def _best_split(sorted_bounds: NDArray, per_bin: NDArray) -> NDArray[np.int64]:
    """The number of items left of each segment's cheapest split between two bins."""
    used = np.flatnonzero(per_bin.ravel())
    starts = np.concatenate([[0], np.cumsum(per_bin.ravel()[used])[:-1]])
    boxes = np.full((per_bin.size, 6), np.inf, np.float32)  # low, and minus high, so that both take a minimum
    boxes[used, :3] = np.minimum.reduceat(sorted_bounds[:, :3], starts)
    boxes[used, 3:] = -np.maximum.reduceat(sorted_bounds[:, 3:], starts)
    boxes = boxes.reshape(-1, BINS, 6)
    from_left = np.minimum.accumulate(boxes, axis=1)[:, :-1]
    from_right = np.minimum.accumulate(boxes[:, ::-1], axis=1)[:, ::-1][:, 1:]
    left_count = np.cumsum(per_bin, axis=1)[:, :-1]
    right_count = per_bin.sum(axis=1, keepdims=True) - left_count
    with np.errstate(invalid="ignore"):
        cost = _area(from_left) * left_count + _area(from_right) * right_count
    cost = np.where((left_count > 0) & (right_count > 0), cost, np.inf)
    best = np.argmin(cost, axis=1)
    return left_count[np.arange(len(best)), best]


def _area(boxes: NDArray) -> NDArray:
    """Half the surface area of boxes (..., 6) of low and minus high."""
    x, y, z = (-(boxes[..., 3 + k] + boxes[..., k]) for k in range(3))
    return x * y + y * z + z * x


def _widen(binary: _Binary) -> NDArray[np.float32]:
    """Skip every other level: a wide node's children are its binary grandchildren, or a child that is a leaf."""
    wide_of = np.full(len(binary.first), -1)
    current, rows, tables = np.array([0]), 0, []
    if binary.child[0] < 0:  # so few items that the root is a leaf: a node with one child
        table = _empty_nodes(1)
        _fill(table, binary, np.array([0]), np.array([0]), np.array([0]), wide_of)
        return table
    while len(current):
        wide_of[current] = rows + np.arange(len(current))
        slots = []
        for side in (0, 1):
            child = binary.child[current] + side
            inner = binary.child[child] >= 0
            slots += [np.where(inner, binary.child[child], child), np.where(inner, binary.child[child] + 1, -1)]
        grandchildren = np.stack(slots, axis=1)  # (k, 4), -1 = empty
        chosen = grandchildren[grandchildren >= 0]
        following = chosen[binary.child[chosen] >= 0]
        wide_of[following] = rows + len(current) + np.arange(len(following))
        table = _empty_nodes(len(current))
        parent, slot = np.nonzero(grandchildren >= 0)
        _fill(table, binary, parent, slot, chosen, wide_of)
        tables.append(table)
        rows += len(current)
        current = following
    return np.concatenate(tables)


def _empty_nodes(count: int) -> NDArray[np.float32]:
    """Nodes whose four children no ray can enter: points at infinity, for either sign of the direction."""
    table = np.zeros((count, NODE_COLUMNS), np.float32)
    table[:, : 6 * WIDTH] = np.inf
    return table


def _fill(table: NDArray, binary: _Binary, parent: NDArray, slot: NDArray, chosen: NDArray, wide_of: NDArray) -> None:
    """Write the boxes and references of binary nodes `chosen` into slots of wide nodes."""
    for column in range(6):
        table[parent, WIDTH * column + slot] = binary.bounds[chosen, column]
    leaf = ~(binary.first[chosen] * LEAF_STRIDE + binary.count[chosen])
    reference = np.where(binary.child[chosen] >= 0, wide_of[chosen], leaf).astype(np.int32)
    table.view(np.int32)[parent, CHILD_COLUMN + slot] = reference
