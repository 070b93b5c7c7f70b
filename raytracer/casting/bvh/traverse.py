"""Traversal of wide hierarchies by whole batches: a last-in-first-out stack of (row, node, entry distance).

Each step takes a chunk of pairs from the top of the stack, tests all four children of each, and pushes the entered
ones, the nearest last, so that a ray's nearer boxes are opened first and its best distance culls the rest. Leaves wait
in a buffer until there are enough to test together. There is no Python loop over rays, triangles or nodes.

What is gathered are rows of four floats, one per child: a node's as they are stored, a ray's with each number four
times. So nothing is transposed, and every operation runs over contiguous memory. Hits that the float32 test of a leaf
is sure of cull at once; the exact test of candidates waits until there are many.

Nanoseconds per pair of ray and node on one core: gathering 17 rows 20, slabs 12, ordering 5, the rest 25; per pair of
ray and leaf 150. Tried in vain: rays sorted by place or direction (4% quicker, which is what sorting costs), eight
children per node, steps of other sizes from 4096 to 32768, no ordering (20% more nodes where much lies behind).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.casting.bvh.culling import ROW_COLUMNS, SLACK, prepare_rays, to_row_distance, to_row_start
from raytracer.casting.bvh.hierarchy import Hierarchy
from raytracer.casting.bvh.instances import place_rays
from raytracer.casting.bvh.leaves import test_leaves
from raytracer.casting.bvh.stacks import Buffer, Pairs, Stack
from raytracer.casting.bvh.tree import NODE_ROWS, REFERENCE_ROW, WIDTH
from raytracer.casting.query import Query

# Pairs per step. Shorter steps spend their time on the calls; NumPy copies operands of fewer than 8192 columns.
CHUNK = 8192
# Pairs of ray and leaf collected before their primitives are tested, and before their instances are entered.
LEAF_BATCH = 4096
# Candidates collected before they are offered.
OFFER_BATCH = 1 << 15
INFINITY_BITS = np.int32(0x7F800000)
SLOT_BITS = np.int32(WIDTH - 1)
BEGIN = ROW_COLUMNS
# The columns of a row that `leaves.may_hit` reads: origin - pad, direction, tolerance.
LINE_COLUMNS = (3, 4, 5, 9, 10, 11, 12, 13)


class _Rows:
    """The rows of rays and, once instances are entered, what each row belongs to; grows by doubling.

    planes : (14, rows, 4) float32, the columns of `culling` rows and where the ray begins, each number four times
    """

    def __init__(self, rows: NDArray[np.float32], begin: NDArray[np.float32]) -> None:
        self.count = self.ray_count = len(begin)
        self.ray = np.arange(self.count, dtype=np.int32)
        self.id_shift = np.zeros(self.count, np.int64)
        self.planes = np.empty((ROW_COLUMNS + 1, self.count, WIDTH), np.float32)
        self._fill(slice(0, self.count), rows, begin)

    def _fill(self, where: slice, rows: NDArray[np.float32], begin: NDArray[np.float32]) -> None:
        for slot in range(WIDTH):
            self.planes[:ROW_COLUMNS, where, slot] = rows
            self.planes[BEGIN, where, slot] = begin

    def rays_of(self, row: NDArray) -> NDArray:
        return row if self.count == self.ray_count else self.ray.take(row)

    def append(self, rows: NDArray, begin: NDArray, ray: NDArray, id_shift: NDArray) -> NDArray[np.int32]:
        """Add rows; return their numbers."""
        end = self.count + len(ray)
        if end > len(self.ray):
            extra = max(end, 2 * len(self.ray)) - len(self.ray)
            self.planes = np.concatenate([self.planes, np.empty((len(self.planes), extra, WIDTH), np.float32)], axis=1)
            self.ray = np.concatenate([self.ray, np.empty(extra, np.int32)])
            self.id_shift = np.concatenate([self.id_shift, np.empty(extra, np.int64)])
        added = slice(self.count, end)
        self.ray[added], self.id_shift[added] = ray, id_shift
        self._fill(added, rows, begin)
        self.count = end
        return np.arange(added.start, end, dtype=np.int32)


class _Workspace:
    """Arrays of one step, allocated once."""

    def __init__(self) -> None:
        self.planes = np.empty((8, CHUNK, WIDTH), np.float32)
        self.keys = np.empty(WIDTH * CHUNK, np.int32)
        self.slots = np.tile(np.arange(WIDTH, dtype=np.int32), (CHUNK, 1))


class Traversal:
    """One batch on its way through a hierarchy."""

    def __init__(self, hierarchy: Hierarchy, query: Query) -> None:
        self.hierarchy = hierarchy
        self.query = query
        self.node_rows = hierarchy.nodes.reshape(-1, WIDTH)
        self.references = hierarchy.nodes.view(np.int32).ravel()[WIDTH * REFERENCE_ROW :]
        self.leaf_rows = hierarchy.triangles.reshape(-1, WIDTH)
        self.items = hierarchy.items.ravel()
        self.rays = prepare_rays(hierarchy.frame, query.rays.origins, query.rays.directions)
        self.begin = to_row_start(self.rays, query.t_min)
        self.rows = _Rows(self.rays.rows, self.begin)
        everyone = np.arange(len(query.rays))
        # Nothing farther matters: once per ray, and as a row to gather.
        self.best = to_row_distance(self.rays, everyone, query.best)
        self.best_rows = np.repeat(self.best, WIDTH).reshape(-1, WIDTH)
        self.stack = Stack(4 * max(len(query.rays), CHUNK))
        self.leaves, self.instances, self.candidates = Buffer(), Buffer(), Buffer()
        # Where the stack and the rows ended when instances were entered: below that, their rows are done with.
        self.marks: list[tuple[int, int]] = []
        self.narrows = query.narrows and query.certified
        self.surely_begun = to_row_distance(self.rays, everyone, query.surely_begun)
        self.surely_before_end = to_row_start(self.rays, query.rays.t_max)
        self.work = _Workspace()

    def run(self) -> None:
        """Offer the query every primitive whose boxes the rays enter."""
        everyone = np.arange(len(self.query.rays), dtype=np.int32)
        for root in self.hierarchy.roots:
            self.stack.push(Pairs(everyone, np.full(len(everyone), root, np.int32), self.begin))
        # Capped reciprocals times far planes may overflow to infinity, with the right sign.
        with np.errstate(all="ignore"):
            while self._step():
                pass

    def _step(self) -> bool:
        """Do what is most worth doing next; False when there is nothing left."""
        floor = self._release_rows()
        if self.leaves.count >= LEAF_BATCH:
            self._open_leaves()
        elif self.instances.count >= LEAF_BATCH:
            self._enter_instances()
        elif self.stack.size:
            self._open_nodes(self.stack.pop(CHUNK, floor))
        elif self.instances.count:
            self._enter_instances()
        elif self.leaves.count:
            self._open_leaves()
        elif self.candidates.count:
            self._offer()
        else:
            return False
        return True

    def _open_nodes(self, pairs: Pairs) -> None:
        """Test the four children of each node and push those that the rays enter, the nearest last."""
        row, node, _ = pairs = self._drop_passed(pairs)
        count = len(row)
        if not count:
            return
        keys = self._enter_boxes(row, node).reshape(WIDTH, count)
        if not self.query.any_hit:  # for which the order hardly matters
            keys = _sort_four(keys)
        chosen = np.flatnonzero(keys < INFINITY_BITS)
        key = keys.ravel().take(chosen)
        lane = chosen - chosen // count * count  # far quicker than the remainder
        child = self.references.take(node.take(lane) * (NODE_ROWS * WIDTH) + (key & SLOT_BITS))
        entered = Pairs(row.take(lane), child, key.view(np.float32))
        self.stack.push(entered.select(np.flatnonzero(child >= 0)))
        self._keep_leaves(entered.select(np.flatnonzero(child < 0)))

    def _drop_passed(self, pairs: Pairs) -> Pairs:
        """Leave out what lies beyond the best distance by now."""
        alive = np.flatnonzero(pairs.entry <= self.best.take(self.rows.rays_of(pairs.row)))
        return pairs if len(alive) == len(pairs.row) else pairs.select(alive)

    def _enter_boxes(self, row: NDArray, node: NDArray) -> NDArray[np.int32]:
        """The (4 c,) keys of the boxes of all children, slot by slot.

        A key is the entry distance's bits, the lowest two replaced by the slot; at least INFINITY_BITS where the ray
        misses the box or is past its best. Non-negative floats sort as their bits do. Clearing two bits rounds the
        entry down, which only opens a box earlier.
        """
        count = len(row)
        low, high, origin_low, origin_high, reciprocal, entry, leave = self.work.planes[:7, :count]
        ray, row, node = self.rows.rays_of(row), row.astype(np.intp), node.astype(np.intp) * NODE_ROWS
        planes = self.rows.planes
        planes[BEGIN].take(row, axis=0, out=entry, mode="clip")
        self.best_rows.take(ray, axis=0, out=leave, mode="clip")
        for axis in range(3):
            self.node_rows[axis:].take(node, axis=0, out=low, mode="clip")
            self.node_rows[3 + axis :].take(node, axis=0, out=high, mode="clip")
            planes[axis].take(row, axis=0, out=origin_low, mode="clip")
            planes[3 + axis].take(row, axis=0, out=origin_high, mode="clip")
            planes[6 + axis].take(row, axis=0, out=reciprocal, mode="clip")
            np.multiply(np.subtract(low, origin_low, out=low), reciprocal, out=low)
            np.multiply(np.subtract(high, origin_high, out=high), reciprocal, out=high)
            np.maximum(entry, np.minimum(low, high, out=origin_low), out=entry)
            np.minimum(leave, np.maximum(low, high, out=origin_high), out=leave)
        np.multiply(leave, SLACK, out=leave)
        # The sign of leave - entry, spread over the bits of infinity; all other bits only make the key larger.
        missed = np.right_shift(np.subtract(leave, entry, out=leave).view(np.int32), 31, out=leave.view(np.int32))
        missed &= INFINITY_BITS
        bits = entry.view(np.int32)
        bits &= ~SLOT_BITS
        bits |= missed
        bits |= self.work.slots[:count]
        keys = self.work.keys[: WIDTH * count]
        keys.reshape(WIDTH, count)[...] = bits.T
        return keys

    def _keep_leaves(self, pairs: Pairs) -> None:
        """Put (row, ~leaf) pairs where they wait."""
        pairs = pairs._replace(target=~pairs.target)
        if self.hierarchy.placed is None:
            self.leaves.append(pairs)
            return
        instance = pairs.target >= self.hierarchy.instances_begin
        self.instances.append(pairs.select(np.flatnonzero(instance)))
        self.leaves.append(pairs.select(np.flatnonzero(~instance)))

    def _open_leaves(self) -> None:
        """Test what waits in leaves, chunk by chunk: hits that are sure cull the next."""
        waiting = self.leaves.take_all()
        for start in range(0, len(waiting.row), CHUNK):
            row, leaf, _ = self._drop_passed(waiting.part(slice(start, start + CHUNK)))
            if len(row):
                self._test_leaves(row, leaf.astype(np.intp))
        if self.candidates.count >= OFFER_BATCH:
            self._offer()

    def _test_leaves(self, row: NDArray[np.int32], leaf: NDArray[np.intp]) -> None:
        """Keep the candidates that leaves hold for rays; let those that are surely hit lower the best distance."""
        lines = self.work.planes[:, : len(row)]
        for line, column in zip(lines, LINE_COLUMNS, strict=True):
            self.rows.planes[column].take(row, axis=0, out=line, mode="clip")
        hits = test_leaves(self.leaf_rows, leaf, lines)
        ray = self.rows.rays_of(row)
        low = np.where(hits.low > -np.inf, hits.low, -np.inf)
        found = np.flatnonzero(hits.possible & (low <= self.best_rows.take(ray, axis=0)))
        pair, slot = found // WIDTH, found % WIDTH
        item = self.items.take(leaf.take(pair) * WIDTH + slot).astype(np.int64, copy=False)
        if self.hierarchy.placed is not None:
            item += self.rows.id_shift.take(row.take(pair))
        candidates = Pairs(ray.take(pair), item, low.ravel().take(found))
        if self.narrows:
            self._narrow(candidates, hits.sure.ravel().take(found), hits.high.ravel().take(found))
        self.candidates.append(candidates)

    def _narrow(self, candidates: Pairs, sure: NDArray, high: NDArray[np.float32]) -> None:
        """Let candidates that are hit beyond doubt, and in range, lower the best distance, or settle an any-hit ray."""
        index = np.flatnonzero(sure)
        ray, item, low = candidates.select(index)
        high = high.take(index)
        inside = low >= self.surely_begun.take(ray)
        if self.query.any_hit:
            inside &= high <= self.surely_before_end.take(ray)
            self.query.settle(ray[inside], item[inside])
            high = np.full(len(high), -np.inf, np.float32)
        self._lower_best(ray[inside], high[inside])

    def _lower_best(self, ray: NDArray, distance: NDArray[np.float32]) -> None:
        np.minimum.at(self.best, ray, distance)
        self.best_rows[ray] = self.best[ray][:, None]

    def _offer(self) -> None:
        """Offer the query the candidates that are still near enough."""
        ray, item, _ = self._drop_passed(self.candidates.take_all())
        changed = self.query.offer(ray, item)
        self._lower_best(changed, to_row_distance(self.rays, changed, self.query.best[changed]))

    def _enter_instances(self) -> None:
        """Give rays that enter an instance's box a row in the frame of its mesh, and push its root."""
        placed = self.hierarchy.placed
        assert placed is not None
        pairs = self._drop_passed(self.instances.take_all())
        ray, instance = pairs.row, self.hierarchy.instances[pairs.target - self.hierarchy.instances_begin]
        self.marks.append((self.stack.size, self.rows.count))
        rows = place_rays(placed, self.hierarchy.frame, self.rays, ray, instance)
        row = self.rows.append(rows, self.begin[ray], ray, placed.first_id[instance])
        self.stack.push(Pairs(row, placed.root[placed.mesh[instance]], pairs.entry))

    def _release_rows(self) -> int:
        """Forget the rows of instances that are done with; return where the stack of those in work begins."""
        while self.marks:
            floor, row_count = self.marks[-1]
            if self.stack.size > floor:
                return floor
            if self.leaves.count:
                self._open_leaves()
            self.rows.count = row_count
            self.marks.pop()
        return 0


def _sort_four(keys: NDArray[np.int32]) -> NDArray[np.int32]:
    """Sort each column's four keys, the largest first."""
    for one, other in ((0, 1), (2, 3), (0, 2), (1, 3), (1, 2)):
        low = np.minimum(keys[one], keys[other])
        np.maximum(keys[one], keys[other], out=keys[one])
        keys[other] = low
    return keys


def offer_traversed(hierarchy: Hierarchy, query: Query) -> None:
    """Offer a query all primitives that its rays may hit, found by the hierarchy."""
    if len(query.rays) and hierarchy.roots:
        Traversal(hierarchy, query).run()
