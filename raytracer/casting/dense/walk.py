"""A batch of rays on its way through the tree, all at once, level by level.

Each ray's nearest child of the root goes first, down to its triangles, and what is hit there culls the rest: unless
any hit will do and few rays have one, as some that are tried tell. Candidates and what is certain about them go to
`planes`, which decides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Indices
from raytracer.casting.bvh.stacks import Pairs
from raytracer.casting.dense.lines import DenseRays, to_bounds
from raytracer.casting.dense.packets import LANE_BLOCK, LANES, cross_triangles, enter_boxes, make_packets
from raytracer.casting.dense.tree import Blocks, DenseTree, TriangleBlocks
from raytracer.casting.planes import PlaneDecisions

# Large triangles tested before rays that they stop are left out.
LARGE_ROUND = 12
# Rays that go everywhere at once.
FEW_RAYS = 1024
# Of so many rays or more, of which any hit will do, so many are tried first. Where less than this share is stopped, the
# others go everywhere at once, too: 1.08 to 1.13 times as fast where 0 to 7% are, 0.4 to 0.8 times where half are.
MANY_RAYS, TRIED_RAYS, HIT_SHARE = 1 << 15, 256, 0.15
Levels = list[NDArray[np.float32]]
# What rays meet in blocks, from the blocks (p,) and the rays (p, l) of packets: places in (p, k, l), and whether they
# certainly do.
Meet = Callable[[Indices, Indices], tuple[NDArray[np.intp], Booleans]]
# Has candidates decided: rays, items of blocks, whether certainly met.
Decide = Callable[[Indices, Indices, Booleans], None]


class Descent:
    """Rays on their way down levels of boxes.

    best : (n,) float32, nothing farther matters, in the rows' distances; -inf or NaN once a ray is decided
    """

    def __init__(self, levels: Levels, rays: DenseRays, best: NDArray[np.float32]) -> None:
        self.levels, self.rays, self.best = levels, rays, best

    def enter_root(self, alive: Indices | None = None) -> Pairs:
        """Pairs of rays, all or those `alive`, and the root's children that they enter."""
        parts = [Pairs(np.zeros(0, np.int32), np.zeros(0, np.uint16), np.zeros(0, np.float32))]
        count = len(self.best) if alive is None else len(alive)
        for start in range(0, count, LANE_BLOCK):
            part = slice(start, min(start + LANE_BLOCK, count))
            slabs = in_packets(self.rays.slabs[part] if alive is None else self.rays.slabs.take(alive[part], axis=0))
            index, entry = enter_boxes(self.levels[0], slabs)
            child, ray = split_index(index, self.levels[0].shape[2] // 2, slabs.shape[1])
            ray = ray + start if alive is None else alive[part].take(ray)
            parts.append(Pairs(ray.astype(np.int32), child.astype(np.uint16), entry))
        return Pairs(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def drop_passed(self, pairs: Pairs) -> Pairs:
        """Leave out what lies beyond the best distance by now."""
        alive = np.flatnonzero(pairs.entry <= self.best.take(pairs.row))
        return pairs if len(alive) == len(pairs.row) else pairs.select(alive)

    def open_nodes(self, depth: int, pairs: Pairs, orders: bool) -> tuple[Pairs, Pairs]:
        """Pairs of rays and the children that they enter: all, or the nearest and the others."""
        table = self.levels[depth]
        fan = table.shape[2] // 2
        packets = make_packets(pairs.row, pairs.target, len(table), len(self.best))
        lanes = packets.ray.shape[1]
        step = LANE_BLOCK // lanes
        found = [(np.zeros(0, np.intp), np.zeros(0, np.float32))]
        for start in range(0, len(packets.node), step):
            part = slice(start, start + step)
            slabs = self.rays.slabs.take(packets.ray[part], axis=0)
            index, entry = enter_boxes(table.take(packets.node[part], axis=0), slabs)
            index += start * fan * lanes
            found.append((index, entry))
        index, entry = (np.concatenate(column) for column in zip(*found, strict=True))
        row = index // lanes  # packet F + child
        packet = row // fan
        lane = index + (packet - row) * lanes  # packet l + place
        ray = packets.ray.ravel().take(lane)
        alive = np.flatnonzero(entry <= self.best.take(ray, mode="clip"))
        row, packet, ray = row.take(alive), packet.take(alive), ray.take(alive)
        child = packets.node.take(packet) * fan + (row - packet * fan)
        numbers = np.uint16 if len(table) * fan <= 1 << 16 else np.int32
        entered = Pairs(ray.astype(np.int32), child.astype(numbers), entry.take(alive))
        if orders:
            return split_nearest(entered, lane.take(alive), packets.ray.size)
        return entered, entered.part(slice(0, 0))


class Walk(Descent):
    """Rays on their way through a tree down to its blocks."""

    def __init__(
        self, tree: Blocks, rays: DenseRays, best: NDArray[np.float32], any_hit: bool, meet: Meet, decide: Decide
    ) -> None:
        super().__init__(tree.levels, rays, best)
        self.items, self.any_hit, self.meet, self.decide = tree.items, any_hit, meet, decide
        # What comes first saves less than what two walks cost.
        self.few = len(best) <= FEW_RAYS

    def run(self, children: Pairs) -> None:
        """Have everything decided that rays may hit below children of the root that they enter."""
        if self.few:
            self._descend(children)
            return
        first, others = split_nearest(self.drop_passed(children), None, len(self.best))
        self._descend(first)
        self._descend(self.drop_passed(others))

    def try_some(self, children: Pairs) -> Pairs:
        """Have some rays decided, and see whether hits would cull what the others enter; return what those enter."""
        if not self.any_hit or len(self.best) < MANY_RAYS:
            return children
        children = self.drop_passed(children)
        tried = children.row % (len(self.best) // TRIED_RAYS) == 0
        some = children.select(tried.nonzero()[0])
        self.few = True
        self._descend(some)
        self.few = len(self.drop_passed(some).row) > (1 - HIT_SHARE) * len(some.row)
        return children.select((~tried).nonzero()[0])

    def _descend(self, pairs: Pairs) -> None:
        """Go from the root's children to what is in the blocks below."""
        later = []
        for depth in range(1, len(self.levels)):
            orders = self.any_hit and not self.few and depth == len(self.levels) - 1
            pairs, others = self.open_nodes(depth, pairs, orders)
            later.append(others)
        self._open_blocks(pairs)
        if later:
            self._open_blocks(self.drop_passed(later[-1]))

    def _open_blocks(self, pairs: Pairs) -> None:
        """Test what is in blocks with the rays that enter them."""
        size = self.items.shape[1]
        packets = make_packets(pairs.row, pairs.target, len(self.items), len(self.best))
        lanes = packets.ray.shape[1]
        step = LANE_BLOCK // lanes
        found = [(np.zeros(0, np.intp), np.zeros(0, bool))]
        for start in range(0, len(packets.node), step):
            part = slice(start, start + step)
            index, inside = self.meet(packets.node[part], packets.ray[part])
            index += start * size * lanes
            found.append((index, inside))
        index, inside = (np.concatenate(column) for column in zip(*found, strict=True))
        row = index // lanes  # packet k + slot
        packet = row // size
        ray = packets.ray.ravel().take(index + (packet - row) * lanes)
        item = self.items.ravel().take(packets.node.take(packet) * size + (row - packet * size))
        self.decide(ray, item, inside)


def cross_blocks(
    tree: TriangleBlocks, rays: DenseRays, node: Indices, ray: Indices
) -> tuple[NDArray[np.intp], Booleans]:
    """Which triangles of blocks lines may meet, see Meet."""
    return cross_triangles(tree.edges.take(node, axis=0), rays.lines.take(ray, axis=0))


def walk_world(tree: DenseTree, rays: DenseRays, best: NDArray[np.float32], decisions: PlaneDecisions) -> None:
    """Have all triangles of a tree in the world's frame decided; lowers `best`."""

    def decide(ray: Indices, triangle: Indices, inside: Booleans) -> None:
        changed = decisions.take_in(ray, triangle, inside)
        best[changed] = to_bounds(decisions.best.take(changed), rays.way.take(changed))

    walk = Walk(tree, rays, best, decisions.query.any_hit, partial(cross_blocks, tree, rays), decide)
    walk.run(walk.try_some(walk.enter_root(_test_large(tree, walk))))


def _test_large(tree: DenseTree, walk: Walk) -> Indices | None:
    """Test all rays with the triangles that are in no block; return the rays that are not decided by that, or None
    where all may be left."""
    alive, rounds = None, LARGE_ROUND if walk.any_hit else max(1, len(tree.large))
    for start in range(0, len(tree.large), rounds):
        part = slice(start, start + rounds)
        # The edges opposite corners a of all triangles come first, then b, then c.
        edges = tree.large_edges.reshape(3, len(tree.large), -1)[:, part].reshape(1, -1, tree.large_edges.shape[2])
        found = list(_cross_large(edges, walk.rays.lines, len(walk.best), alive))
        ray, slot, inside = (np.concatenate(column) for column in zip(*found, strict=True))
        walk.decide(ray, tree.large[part].take(slot), inside)
        if walk.any_hit:
            alive = np.flatnonzero(walk.best > -np.inf)
            if not len(alive):
                break
    return alive


def _cross_large(
    edges: NDArray[np.float32], rows: NDArray[np.float32], count: int, alive: Indices | None
) -> Iterator[tuple[Indices, Indices, Booleans]]:
    """Yield rays, triangles by slot and whether they certainly meet, of rays that are `alive` or of all."""
    count = count if alive is None else len(alive)
    size = edges.shape[1] // 3
    for start in range(0, max(count, 1), LANE_BLOCK):
        part = slice(start, min(start + LANE_BLOCK, count))
        lines = in_packets(rows[part] if alive is None else rows.take(alive[part], axis=0))
        index, inside = cross_triangles(edges, lines)
        slot, ray = split_index(index, size, lines.shape[1])
        yield ray + start if alive is None else alive[part].take(ray), slot, inside


def in_packets(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Rows (k, c) of rays as packets (p, l, c): of a size for which no library of matrix products starts threads."""
    lanes = LANES[-1]
    return rows.reshape(-1, lanes, rows.shape[1]) if len(rows) % lanes == 0 else rows[np.newaxis]


def split_index(index: NDArray[np.intp], fan: int, lanes: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The middle one of places in (p, fan, lanes), and the ray that the others make."""
    row = index // lanes
    packet = row // fan
    return row - packet * fan, index + (packet - row) * lanes


def split_nearest(pairs: Pairs, lane: NDArray[np.intp] | None, count: int) -> tuple[Pairs, Pairs]:
    """(nearest, others) of the pairs in each of `count` lanes, which are their rows unless given."""
    lane = pairs.row if lane is None else lane
    least = np.full(count, np.inf, np.float32)
    np.minimum.at(least, lane, pairs.entry)
    nearest = pairs.entry <= least.take(lane)
    return pairs.select(np.flatnonzero(nearest)), pairs.select(np.flatnonzero(~nearest))
