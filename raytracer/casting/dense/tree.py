"""The hierarchy as tables of matrices: a few wide levels of boxes above blocks of triangles.

    levels    node j of a level has the children j F ... j F + F - 1 of the next, F its fan-out: nothing is referred to.
    boxes     for axis k, with center c and half size h, rows (c, -h, 1) and (-c, -h, -1): times (r, |r|, -o r) of a
              ray, r = 1 / d, they are where it enters the slab and minus where it leaves it, whatever the sign of d.
    triangles for the edge from p to q the row (p x q, q - p) / s: times (d, m), m = o x d, it is the edge function
              d . (p x q) + m . (q - p) over s. `lines` scales (d, m) so that it is off by 1 at most.

Why no box is missed. With u = 2^-24, the three terms c r, h |r| and o r are rounded 4 times each: factors, product and
two sums; and |c| + h <= 1 + PAD, |o| <= FAR = 4. A plane that r crosses appears moved by 4 u (5 + PAD) at most, 21 u
with everything of float64. The origin may be off by MOVED = 12 u, and one that was moved towards the scene may start
behind the box's plane by 3/8 of that (`lines`). PAD, by which boxes are grown, is more than 21 u + 12 u + 5 u; so every
t at which the ray is in the box lies between entry and exit as computed, which are compared without tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats, Integers
from raytracer.casting.bvh.clustering import Bounds, half_surface
from raytracer.casting.bvh.culling import FLOAT32_ROUNDOFF
from raytracer.casting.bvh.tree import Frame, make_frame, round_down
from raytracer.casting.dense.split import split_evenly
from raytracer.casting.planes import PLANE_COLUMNS, make_moved_planes, make_planes
from raytracer.predicates.filtered import cross

PAD = 40 * FLOAT32_ROUNDOFF
# Triangles of a block, within a factor of the square root of two; with 17 or 34 rays take up to a tenth longer.
BLOCK_TRIANGLES = 24
# Children of the root and of the nodes below it, at most, as powers of two: as few levels as these allow, and of those
# the root the fewest boxes, as every ray is tested with them.
ROOT_BITS, NODE_BITS, FEWEST_BITS = 5, 4, 4
# Triangles with a larger share of the scene's surface are tested with every ray: most rays enter their boxes anyway.
LARGE_SHARE, MOST_LARGE = 0.02, 64
# Triangles, and blocks, that are packed at a time: what they need fits the cache.
PACKED_TRIANGLES = 1 << 13
# So many have 2^16 blocks: their numbers of 16 bits sort quickly.
MOST_TRIANGLES = 1 << 21
# A surface that is divided by.
SMALLEST_SURFACE = 2.0**-100
# Added to the size of a triangle's rows, for what rounds in float64: see `lines`.
SMALLEST_ROWS = 2.0**-28


@dataclass(frozen=True, eq=False)
class Blocks:
    """Primitives in b blocks of up to k, and the levels of boxes above them.

    levels : tables (nodes, 3 axes, 2 F, 3) float32 of boxes, the root's first
    items : (b, k) int32, primitives of each block; the last repeated where there are fewer
    """

    levels: list[NDArray[np.float32]]
    items: Integers


@dataclass(frozen=True, eq=False)
class TriangleBlocks(Blocks):
    """t triangles in blocks.

    edges : (b, 3 k, 6) float32, rows of the edges opposite corners a, then b, then c; NaN where there are fewer
    planes : (t, 8) float64, see `planes`
    """

    edges: NDArray[np.float32]
    planes: Floats


@dataclass(frozen=True, eq=False)
class DenseTree(TriangleBlocks):
    """Blocks in a frame, and what is in none.

    large, large_edges : (g,) int32 and (1, 3 g, 6), triangles that are in no block
    count : (b,) triangles of each block
    surface : of all blocks together, as a multiple of the surface of all
    """

    frame: Frame
    large: Integers
    large_edges: NDArray[np.float32]
    count: NDArray[np.intp]
    surface: float


def build_dense_tree(corners: NDArray, low_high: Floats) -> DenseTree:
    """Return the tree of t >= 1 triangles with world corners (t, 9) in the box `low_high` (2, 3)."""
    return pack_dense_tree(low_high, corners, *choose_blocks(make_frame(*low_high), corners))


def choose_blocks(
    frame: Frame, corners: NDArray, most_large: int = MOST_LARGE
) -> tuple[Integers, NDArray[np.intp], Integers]:
    """The items and counts of blocks, and the large triangles, see DenseTree."""
    bounds = _bound_triangles(frame, corners)
    surface = half_surface(bounds)
    large = np.flatnonzero(surface > LARGE_SHARE * half_surface(bounds.min(axis=1)))
    large = large[np.argsort(-surface[large], kind="stable")[: min(most_large, len(corners) - 1)]]
    small = np.delete(np.arange(len(corners), dtype=np.int32), large)
    level_count = int(np.log2(len(small) / BLOCK_TRIANGLES * np.sqrt(2))) if len(small) > BLOCK_TRIANGLES else 0
    order, starts = split_evenly(bounds.take(small, axis=1), level_count)
    count = np.diff(starts)
    slot = np.minimum(np.arange(count.max()), count[:, np.newaxis] - 1)
    items = small.take(order).take(starts[:-1, np.newaxis] + slot)  # (b, k)
    return items, count, large.astype(np.int32)


def pack_dense_tree(
    low_high: Floats,
    corners: NDArray,
    items: Integers,
    count: NDArray[np.intp],
    large: Integers,
    smallest_rows: float = SMALLEST_ROWS,
) -> DenseTree:
    """Return the tree of triangles (t, 9) in the box `low_high` (2, 3) with given blocks, see DenseTree.

    smallest_rows : SMALLEST_MOVED_ROWS for triangles that may be moved
    """
    make = make_moved_planes if smallest_rows > SMALLEST_ROWS else make_planes
    frame = make_frame(*low_high)
    edges = np.empty((len(items), 3 * items.shape[1], 6), np.float32)
    planes = np.empty((len(corners), PLANE_COLUMNS))
    low, high = np.empty((2, len(items), 3))
    step = max(1, PACKED_TRIANGLES // items.shape[1])
    for start in range(0, len(items), step):
        part = slice(start, start + step)
        placed = _place(frame, corners, items[part])
        planes[items[part]] = make(_turn(corners, items[part]), frame.exponent).reshape(*items[part].shape, -1)
        low[part], high[part] = placed.min(axis=(0, 3)).T, placed.max(axis=(0, 3)).T
        edges[part] = pack_edges(placed, smallest_rows)
    # Blocks differ in size by one at most.
    edges.reshape(len(items), 3, -1, 6)[count < items.shape[1], :, -1] = np.nan
    placed = _place(frame, corners, large[np.newaxis])
    planes[large] = make(_turn(corners, large), frame.exponent)
    boxes = np.concatenate([low, -high], axis=1).T.astype(np.float32)
    surface = float(half_surface(boxes).sum() / max(half_surface(boxes.min(axis=1)), SMALLEST_SURFACE))
    levels = make_levels(low, high)
    return DenseTree(levels, items, edges, planes, frame, large, pack_edges(placed), count, surface)


def _bound_triangles(frame: Frame, corners: NDArray) -> Bounds:
    """(6, t) boxes, low and minus high, in the frame; what rounds does not matter where they are only compared."""
    bounds = np.empty((6, len(corners)), np.float32)
    for start in range(0, len(corners), PACKED_TRIANGLES):
        part = slice(start, start + PACKED_TRIANGLES)
        placed = _place(frame, corners, np.arange(len(corners))[part])
        bounds[:3, part], bounds[3:, part] = placed.min(axis=0), -placed.max(axis=0)
    return bounds


def _place(frame: Frame, corners: NDArray, items: NDArray) -> Floats:
    """Corners (3 corners, 3, ...) in the frame of triangles (...)."""
    points = frame.place(corners.take(items.ravel(), axis=0).reshape(-1, 3).astype(np.float64, copy=False))
    return np.ascontiguousarray(points.reshape(-1, 9).T).reshape(3, 3, *items.shape)


def _turn(corners: NDArray, items: NDArray) -> Floats:
    """Corners (3 corners, 3, k) of k triangles, as they are given."""
    rows = corners.take(items.ravel(), axis=0).astype(np.float64, copy=False)
    return np.ascontiguousarray(rows.T).reshape(3, 3, -1)


def pack_edges(corners: Floats, smallest: float = SMALLEST_ROWS) -> NDArray[np.float32]:
    """(b, 3 k, 6) float32 rows (p x q, q - p) / s of corners (3 corners, 3, b, k) in the frame, s their largest
    component over a triangle's edges plus `smallest`."""
    following, preceding = corners[[1, 2, 0]], corners[[2, 0, 1]]
    rows = np.empty((6, *corners.shape[2:], 3))  # (6, b, k, 3 edges)
    for edge in range(3):
        rows[:3, ..., edge] = cross(following[edge], preceding[edge])
        rows[3:, ..., edge] = preceding[edge] - following[edge]
    rows /= np.abs(rows).max(axis=(0, 3))[..., np.newaxis] + smallest
    return np.ascontiguousarray(rows.transpose(1, 3, 2, 0), np.float32).reshape(corners.shape[2], -1, 6)


def make_levels(low: Floats, high: Floats) -> list[NDArray[np.float32]]:
    """The tables of all levels above 2^k blocks with boxes low, high (b, 3): of the root first."""
    bits = len(low).bit_length() - 1
    depth = -(-(bits - min(bits, ROOT_BITS)) // NODE_BITS)
    root_bits = min(bits, max(bits - depth * NODE_BITS, FEWEST_BITS))
    levels = []
    for step in range(depth):
        fan = 1 << ((bits - root_bits + step) // depth)
        levels.append(pack_boxes(low, high, fan))
        low, high = low.reshape(-1, fan, 3).min(axis=1), high.reshape(-1, fan, 3).max(axis=1)
    return [pack_boxes(low, high, len(low)), *reversed(levels)]


def pack_boxes(low: Floats, high: Floats, fan: int) -> NDArray[np.float32]:
    """(nodes, 3, 2 fan, 3) float32 rows of boxes (nodes fan, 3), grown by PAD and what rounds."""
    center = ((low + high) / 2).astype(np.float32)
    half = -round_down(-(np.maximum(high - center, center - low) + PAD))
    table = np.empty((len(low) // fan, 3, 2, fan, 3), np.float32)
    for axis in range(3):
        c, h = center[:, axis].reshape(-1, fan), half[:, axis].reshape(-1, fan)
        table[:, axis, 0, :, 0], table[:, axis, 1, :, 0] = c, -c
        table[:, axis, :, :, 1] = -h[:, np.newaxis]
    table[:, :, 0, :, 2], table[:, :, 1, :, 2] = 1, -1
    return table.reshape(len(table), 3, -1, 3)
