"""Instances that share their mesh's dense tree: levels of boxes above them, and rays brought into an instance's frame.

Meshes whose trees have levels of the same fan-outs are joined, each with a root of its own: rays that enter any
instances of any of them walk together, in packets by node, whichever instance they are in.

The tree holds the triangles of the mesh; the true ones are the rounded world triangles (`geometry.world_corners`). With
X the inverse of the instance's linear part M as computed, and 2^e, 2^f the units of the mesh's frame and the world's, a
ray o + t d in the world's unit (d below one), from the world's origin, becomes

    A (o - t') + t A d,    A = 2^(e - f) X,  t' the translation in the world's unit,

in the mesh's unit, from the mesh's origin: so planes have it (`planes`), for boxes and edges c' = 2^e c is subtracted,
c the center of the mesh's frame. How far the true line, brought back exactly, is from that one near the mesh, and how
far the true corners are from the mesh's, is at most w in all: with l = |A (o - t') - c'|, s = |A d|, |A| the largest
sum of a row, v = 2^-53, and r >= |X M - 1|,

    (o - t'):            both are exact: v |o - t'| |A| for the difference
    times A, minus c':   gamma(3) |A| |o - t'|, and v l
    the inverse:         X M q = q + (X M - 1) q, the point q in the mesh's unit: 1.01 r (l + |c'|)
    the direction:       over t up to the far side of the mesh, (l + 2) / s: gamma(3) |A| + 1.01 r s for each t
    the corners:         |X| gamma(5) (|M| |corner| + |translation|), in the mesh's unit

of which gamma(8) (|o - t'| |A| + (l + |c'| + 2) (1 + |A| / s)) + 4 r (l + |c'| + 2) + corners is more, and at least
32 v, as s < |A|. Where that is not below MOVED (`lines`), nothing is known: every triangle of the mesh is left to
`query`.

How wide the query's own interval may be there. It comes from the world's triangle: with sides of at most S, the bound
is 18 v |a - o|_1 S^2 on the numerator and 16 v |d|_1 S^2 on the denominator (`filtered`). Largest components and sums
|.|_1 of three grow by at most k through M, k the largest sum of a row or column, and determinants by |det M|. So with s
the largest side of the mesh's triangle, n the largest component of its normal, and K = k^3 / |det M| >= 1, the query
has less than

    e_q = v K (24 (s + 2 w)^2 / n + 1)

where `planes.meet_moved_planes` has E = e + 6 f w, also for a t of up to twice the one there, and 2 e_q for the
denominator. Its interval reaches as far again as it is off: twice that, over D - 4 e_q. Where D > 12 e_q, 3 e_q / E
times the bound there are more; where it is not, that is more than t, and nothing certain. Now s <= 2, n <= 2 s^2 and
w < MOST_MOVED, so (s + 2 w)^2 / n < 1.91 f and f >= 3/8, e_q < 49 v K f, and (1 + 26 v K / w) times the bound is wider
than the query's interval. K is computed within a few v k |X|, which is far below one where w is below MOVED.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats, Indices, Integers
from raytracer.casting.bvh.clustering import half_surface
from raytracer.casting.bvh.hierarchy import mesh_corners
from raytracer.casting.bvh.instances import invert
from raytracer.casting.bvh.tree import Frame, make_frame, to_bounds
from raytracer.casting.dense.lines import BLOCK, MOVED, SMALLEST_MOVED_ROWS, DenseRays, empty_rays, fill_rows
from raytracer.casting.dense.split import split_evenly
from raytracer.casting.dense.tree import (
    SMALLEST_SURFACE,
    DenseTree,
    TriangleBlocks,
    choose_blocks,
    make_levels,
    pack_boxes,
    pack_dense_tree,
)
from raytracer.casting.framed import EXPONENT_BITS, FramedRays, largest_row
from raytracer.casting.geometry import Geometry, Ids
from raytracer.casting.planes import LARGEST_SIZE, LINE_COLUMNS, Lanes, make_lines
from raytracer.casting.primitives import Primitives, bound_images, extremes, instance_bounds
from raytracer.predicates.rounding import UNIT_ROUNDOFF, gamma

# Instances below one node of the last level, within a factor of the square root of two.
NODE_INSTANCES = 12
# In units of v K / w, how much wider than the bound of `planes` the query's own may be.
QUERY_SHARE = 26.0
# A size that is divided by.
SMALLEST_SIZE = 2.0**-1000
# The low sides of a box that is never entered; the high ones are minus that.
NO_BOX = 1e30
NO_ENTRY = WHOLE = -1
# A ray through the scene enters about as many boxes as their surface is a multiple of the scene's. From this on, what
# is entered are the children of the meshes' roots, unless there are too many: 45 instead of 160 microseconds a ray
# where 1000 instances are at one place, but a third slower than whole ones where they stand beside each other.
OPENED_LOAD = 32.0
MOST_OPENED = 1 << 19
# Columns of `Instances.frames`: A, t', c', |A|, 4 r, the bound on corners, |c'|, 26 v K.
FRAME_COLUMNS = 20


@dataclass(frozen=True, eq=False)
class Instances:
    """i instances of meshes that are not flattened, their boxes, and their meshes' trees.

    levels : tables of boxes as `Blocks.levels`; children of the last one are `slots`
    slots : (m,) int32, entries below each node of the last level, NO_ENTRY where there are fewer
    instance : (e,) int32, of each entry
    child : (e,) int32, the entry's child of the root of its mesh; WHOLE for all of the mesh
    trees : joined trees of meshes
    tree, root : (i,) int32, each instance's tree and its root there
    id_shift : (i,) int64, add to a row of the tree's planes to get the primitive id
    frames : (i, FRAME_COLUMNS) float64
    """

    levels: list[NDArray[np.float32]]
    slots: Integers
    instance: Integers
    child: Integers
    trees: list[TriangleBlocks]
    tree: Integers
    root: Integers
    id_shift: Ids
    frames: Floats


def build_instances(primitives: Primitives, frame: Frame) -> Instances:
    """Return the instances of `primitives` that are not flattened, one at least; `frame` is the world's."""
    geometry = primitives.geometry
    counts = np.diff(geometry.first_id)[: len(primitives.flattened)]
    shared = np.flatnonzero(~primitives.flattened & (counts > 0))
    rows, mesh = np.unique(geometry.mesh_first[geometry.instance_mesh[shared]], return_index=True)
    trees = [_build_mesh(mesh_corners(geometry, int(geometry.instance_mesh[shared[first]]))) for first in mesh]
    mesh_of_instance = np.searchsorted(rows, geometry.mesh_first[geometry.instance_mesh[shared]])
    shapes = [tuple(level.shape[2] for level in tree.levels) for tree in trees]
    joined, place = [], np.zeros((3, len(trees)), np.int64)  # tree, root, first row of each mesh
    for number, shape in enumerate(sorted(set(shapes))):
        members = [k for k, other in enumerate(shapes) if other == shape]
        joined.append(_join([trees[k] for k in members]))
        sizes = np.cumsum([0] + [len(trees[k].planes) for k in members])
        place[0, members], place[1, members], place[2, members] = number, np.arange(len(members)), sizes[:-1]
    tree, root, first_row = place[:, mesh_of_instance]
    mesh_frames = [tree.frame for tree in trees]
    frames = _make_frames(geometry, frame, shared, mesh_frames, mesh_of_instance)
    id_shift = geometry.first_id[shared] - first_row
    instance, child, boxes = _list_entries(geometry, shared, trees, mesh_of_instance, root)
    levels, slots = _build_levels(frame, boxes)
    return Instances(
        levels, slots, instance, child, joined, tree.astype(np.int32), root.astype(np.int32), id_shift, frames
    )


def _list_entries(
    geometry: Geometry, shared: NDArray, trees: list[DenseTree], mesh: NDArray, root: NDArray
) -> tuple[Integers, Integers, Floats]:
    """The entries: instance and child (e,), and world boxes (e, 2, 3)."""
    boxes = instance_bounds(geometry, shared)
    fans = np.array([tree.levels[0].shape[2] // 2 for tree in trees])
    if _find_load(boxes) < OPENED_LOAD or fans.take(mesh).sum() > MOST_OPENED:
        return np.arange(len(shared), dtype=np.int32), np.full(len(shared), WHOLE, np.int32), boxes
    parts = []
    for number, tree in enumerate(trees):
        members = np.flatnonzero(mesh == number)
        instance = np.repeat(members, fans[number])
        child = (root[members][:, np.newaxis] * fans[number] + np.arange(fans[number])).ravel()
        inner = np.tile(_list_children(tree), (len(members), 1, 1))
        parts.append((instance, child, bound_images(geometry.world_from_object[shared[instance]], inner)))
    instance, child, opened = (np.concatenate(column) for column in zip(*parts, strict=True))
    return instance.astype(np.int32), child.astype(np.int32), opened


def _find_load(boxes: Floats) -> float:
    """The surface of boxes (k, 2, 3) as a multiple of the surface around all."""
    bounds = np.concatenate([boxes[:, 0], -boxes[:, 1]], axis=1).T
    bounds = bounds / max(np.abs(bounds).max(), SMALLEST_SIZE)
    return float(half_surface(bounds).sum() / max(half_surface(bounds.min(axis=1)), SMALLEST_SURFACE))


def _list_children(tree: DenseTree) -> Floats:
    """Boxes (F, 2, 3) of the children of a mesh's root, in the mesh's units."""
    rows = tree.levels[0][0].reshape(3, 2, -1, 3)[:, 0].astype(np.float64)  # (3, F, (center, minus half, 1))
    center, half = rows[:, :, 0].T, -rows[:, :, 1].T
    return np.ldexp(np.stack([center - half, center + half], axis=1), -tree.frame.exponent) + tree.frame.centre


def _build_mesh(corners: Floats) -> DenseTree:
    """The tree of a mesh's triangles (t, 9), all of them in blocks."""
    low_high = extremes(corners.reshape(-1, 3))
    blocks = choose_blocks(make_frame(*low_high), corners, most_large=0)
    return pack_dense_tree(low_high, corners, *blocks, smallest_rows=SMALLEST_MOVED_ROWS)


def _join(trees: list[DenseTree]) -> TriangleBlocks:
    """Trees of equal levels as one of as many roots."""
    size = max(tree.items.shape[1] for tree in trees)
    first = np.cumsum([0] + [len(tree.planes) for tree in trees])
    items = [
        np.pad(tree.items, ((0, 0), (0, size - tree.items.shape[1])), mode="edge") + np.int32(row)
        for tree, row in zip(trees, first[:-1], strict=True)
    ]
    edges = []
    for tree in trees:
        padded = np.full((len(tree.items), 3, size, 6), np.nan, np.float32)
        padded[:, :, : tree.items.shape[1]] = tree.edges.reshape(len(tree.items), 3, -1, 6)
        edges.append(padded.reshape(len(tree.items), -1, 6))
    levels = [np.concatenate(tables) for tables in zip(*(tree.levels for tree in trees), strict=True)]
    planes = np.concatenate([tree.planes for tree in trees])
    return TriangleBlocks(levels, np.concatenate(items).astype(np.int32), np.concatenate(edges), planes)


def _build_levels(frame: Frame, boxes: Floats) -> tuple[list[NDArray[np.float32]], Integers]:
    """Levels above world boxes (k, 2, 3) and the boxes by slot, see Instances."""
    count = len(boxes)
    bits = int(np.log2(count / NODE_INSTANCES * np.sqrt(2))) if count > NODE_INSTANCES else 0
    order, starts = split_evenly(to_bounds(frame, boxes), bits)
    sizes = np.diff(starts)
    fan = int(sizes.max())
    slot = np.arange(fan)
    filled = slot < sizes[:, np.newaxis]
    slots = np.where(filled, order.take(np.minimum(starts[:-1, np.newaxis] + slot, count - 1)), NO_ENTRY)
    placed = frame.place(boxes).take(slots, axis=0)  # (b, fan, 2, 3)
    low = np.where(filled[..., np.newaxis], placed[:, :, 0], NO_BOX)
    high = np.where(filled[..., np.newaxis], placed[:, :, 1], -NO_BOX)
    leaves = pack_boxes(low.reshape(-1, 3), high.reshape(-1, 3), fan)
    return [*make_levels(low.min(axis=1), high.max(axis=1)), leaves], slots.astype(np.int32).ravel()


def _make_frames(geometry: Geometry, frame: Frame, shared: NDArray, mesh_frames: list[Frame], mesh: NDArray) -> Floats:
    """The frames (i, FRAME_COLUMNS) of the instances `shared`, whose meshes `mesh` have frames of their own."""
    frames = np.empty((len(shared), FRAME_COLUMNS))
    exponent = np.array([each.exponent for each in mesh_frames])
    centre = np.array([each.centre for each in mesh_frames])
    for start in range(0, len(shared), BLOCK):  # what a block needs stays within the cache
        part = slice(start, start + BLOCK)
        matrices = geometry.world_from_object[shared[part]]
        _fill_frames(frames[part], matrices, frame, exponent.take(mesh[part]), centre.take(mesh[part], axis=0))
    return frames


def _fill_frames(frames: Floats, matrices: Floats, frame: Frame, exponent: Integers, centre: Floats) -> None:
    """Fill in frames (k, FRAME_COLUMNS) of matrices (k, 4, 4), of meshes with frames of (k,) and (k, 3)."""
    inverse, residual = invert(matrices)
    largest = np.abs(centre) + np.ldexp(1.0, -exponent)[:, np.newaxis]
    translation = matrices[:, :3, 3]
    sizes = np.einsum("kij,kj->ki", np.abs(matrices[:, :3, :3]), largest) + np.abs(translation)
    corners = np.einsum("kij,kj->ki", np.abs(inverse), gamma(5) * sizes).max(axis=1)
    frames[:, :9] = np.ldexp(inverse, (exponent - frame.exponent)[:, np.newaxis, np.newaxis]).reshape(-1, 9)
    frames[:, 9:12] = np.ldexp(translation, frame.exponent)
    frames[:, 12:15] = np.ldexp(centre, exponent[:, np.newaxis])
    frames[:, 15] = np.abs(frames[:, :9]).reshape(-1, 3, 3).sum(axis=2).max(axis=1)
    known = abs(frame.exponent) < LARGEST_SIZE
    frames[:, 16], frames[:, 17] = 4 * residual, np.ldexp(corners, exponent) if known else np.inf
    frames[:, 18] = np.abs(frames[:, 12:15]).max(axis=1)
    frames[:, 19] = QUERY_SHARE * UNIT_ROUNDOFF * _find_growth(matrices[:, :3, :3])


def _find_growth(linear: Floats) -> Floats:
    """K of matrices (i, 3, 3): how much more errors of determinants may grow through them than determinants."""
    size = np.abs(linear)
    largest = np.maximum(size.sum(axis=1).max(axis=1), size.sum(axis=2).max(axis=1))
    return 1 / np.abs(np.linalg.det(linear / largest[:, np.newaxis, np.newaxis]))


def place_rays(instances: Instances, lines: Floats, ray: Indices, instance: Indices) -> tuple[DenseRays, Lanes]:
    """Return rays in the frames of instances that they enter, k each.

    lines : (n, 8) all rays in the world's frame, see `planes.make_lines`
    """
    count = len(ray)
    rows = empty_rays(count)
    unit, share = np.empty((2, count))
    lanes = Lanes(ray, np.empty((count, LINE_COLUMNS)), unit, instances.id_shift.take(instance), share)
    for start in range(0, count, BLOCK):
        part = slice(start, min(start + BLOCK, count))
        world = np.ascontiguousarray(lines.take(ray[part], axis=0).T)
        frames = np.ascontiguousarray(instances.frames.take(instance[part], axis=0).T)
        framed, moved = _bring(frames, world)
        unit[part], share[part] = framed.unit, 1 + frames[19] / moved
        lanes.lines[part] = make_lines(framed.place, framed.direction, world[7] * framed.unit, moved)
        fill_rows(DenseRays(rows.slabs[part], rows.lines[part], rows.way[part]), framed, moved)
    return rows, lanes


def _bring(frames: Floats, world: Floats) -> tuple[FramedRays, Floats]:
    """Rays (8, k) of the world's frame in frames (FRAME_COLUMNS, k), and the bound w on how far they are off."""
    matrix, translation, centre = frames[:9], frames[9:12], frames[12:15]
    norm, residual, corners, far_centre = frames[15:19]
    away = world[:3] - translation
    place, slope = _apply(matrix, away), _apply(matrix, world[3:6])
    origin = place - centre
    reach = norm * largest_row(np.abs(away))
    extent = largest_row(np.abs(origin)) + far_centre + 2
    steepest = largest_row(np.abs(slope))
    moved = gamma(8) * (reach + extent * (1 + norm / steepest)) + residual * extent + corners
    # What is unknown of the world's ray is unknown of this one.
    np.copyto(moved, np.inf, where=~(world[6] < np.inf))
    np.copyto(moved, np.inf, where=~(moved < MOVED))
    # The bits of the exponent alone are the largest power of two that is not above the number.
    unit = 2 * (steepest.view(np.int64) & EXPONENT_BITS).view(np.float64)
    return FramedRays(origin, slope / unit, unit, place), moved


def _apply(matrix: Floats, vector: Floats) -> Floats:
    """(3, k) products of matrices (9, k), by rows, and vectors (3, k)."""
    product = np.empty_like(vector)
    for row in range(3):
        terms = matrix[3 * row : 3 * row + 3] * vector
        np.add(np.add(terms[0], terms[1], out=terms[0]), terms[2], out=product[row])
    return product
