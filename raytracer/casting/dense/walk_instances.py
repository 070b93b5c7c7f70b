"""A batch of rays on its way through instances: down the boxes above them, then through their meshes' trees.

A ray that enters an instance becomes a *lane*: the ray in the frame of the mesh (`instances`). Each ray's nearest
instance goes first, and what is hit there culls the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Indices
from raytracer.casting.bvh.stacks import Pairs
from raytracer.casting.dense.instances import NO_ENTRY, WHOLE, Instances, place_rays
from raytracer.casting.dense.lines import DenseRays, to_bounds
from raytracer.casting.dense.walk import Descent, Walk, cross_blocks, split_nearest
from raytracer.casting.planes import PlaneDecisions

# Pairs of rays and instances that are looked for together, and lanes that walk together.
MOST_PAIRS, MOST_LANES = 1 << 20, 1 << 17
# With fewer lanes than this, calls cost more than lanes that the nearest instance's hits would have culled.
FEWEST_LANES = 4096
# Times that each ray's nearest one is opened alone, while there are more pairs than this for each ray: of nodes, whose
# entries are opened in order anyway, and of entries.
ROUNDS = 2
FEW_NODES, FEW_ENTRIES = 1.0, 0.25


class InstanceWalk(Descent):
    """Rays on their way through the levels of boxes above instances."""

    def __init__(
        self, instances: Instances, rays: DenseRays, best: NDArray[np.float32], decisions: PlaneDecisions
    ) -> None:
        super().__init__(instances.levels, rays, best)
        self.instances, self.decisions = instances, decisions

    def run(self) -> None:
        """Have every triangle of instances decided that rays may hit."""
        first, others = split_nearest(self.drop_passed(self.enter_root()), None, len(self.best))
        self._descend(first)
        self._descend(self.drop_passed(others))

    def _descend(self, pairs: Pairs) -> None:
        """Go from the root's children to the entries below."""
        for depth in range(1, len(self.levels) - 1):
            pairs, _ = self.open_nodes(depth, pairs, False)
        self._open_in_order(pairs, self._open_last, FEW_NODES)

    def _open_last(self, pairs: Pairs) -> None:
        """Open nodes of the last level."""
        last = len(self.levels) - 1
        step = max(1, MOST_PAIRS * 2 // self.levels[last].shape[2])
        for start in range(0, len(pairs.row), step):
            part = self.drop_passed(pairs.part(slice(start, start + step)))
            entered, _ = self.open_nodes(last, part, False)
            slot = self.instances.slots.take(entered.target)
            filled = entered._replace(target=slot).select(np.flatnonzero(slot != NO_ENTRY))
            self._open_in_order(filled, self._enter, FEW_ENTRIES)

    def _open_in_order(self, pairs: Pairs, open_pairs: Callable[[Pairs], None], few: float) -> None:
        """Open what is nearest to each ray, then what is left of the next, until there are few."""
        fewest = max(FEWEST_LANES, int(few * len(self.best)))
        for _ in range(ROUNDS):
            if len(pairs.row) > fewest:
                first, pairs = split_nearest(pairs, None, len(self.best))
                open_pairs(first)
                pairs = self.drop_passed(pairs)
        for part in _rank(pairs) if len(pairs.row) > fewest else [pairs]:
            open_pairs(self.drop_passed(part))

    def _enter(self, pairs: Pairs) -> None:
        """Walk through the trees of instances."""
        tree = self.instances.tree.take(self.instances.instance.take(pairs.target))
        for number in np.flatnonzero(np.bincount(tree)):
            some = pairs.select(np.flatnonzero(tree == number)) if len(self.instances.trees) > 1 else pairs
            for start in range(0, len(some.row), MOST_LANES):
                part = self.drop_passed(some.part(slice(start, start + MOST_LANES)))
                if len(part.row):
                    self._walk(number, part)

    def _walk(self, number: int, pairs: Pairs) -> None:
        """Walk through one tree."""
        ray, instance = pairs.row.astype(np.intp), self.instances.instance.take(pairs.target)
        rows, lanes = place_rays(self.instances, self.decisions.lines, ray, instance)
        tree, decisions = self.instances.trees[number], self.decisions

        def bound_lanes() -> NDArray[np.float32]:
            return to_bounds(decisions.best.take(ray) * lanes.unit, rows.way)

        def decide(lane: Indices, row: Indices, inside: Booleans) -> None:
            changed = decisions.take_in_lanes(lanes, tree.planes, lane, row, inside)
            self.best[changed] = to_bounds(decisions.best.take(changed), self.rays.way.take(changed))
            walk.best[:] = bound_lanes()

        meet = partial(cross_blocks, tree, rows)
        walk = Walk(tree, rows, bound_lanes(), decisions.query.any_hit, meet, decide)
        child = self.instances.child.take(pairs.target)
        lane = np.arange(len(ray), dtype=np.int32)
        begun = Pairs(lane, child.astype(np.uint16), np.full(len(ray), -np.inf, np.float32))
        whole = np.flatnonzero(child == WHOLE)
        if len(whole):
            at_root = begun.select(whole)._replace(target=self.instances.root.take(instance.take(whole)))
            walk.run(walk.open_nodes(0, at_root, False)[0])
        if len(whole) < len(lane):
            walk.run(begun.select(np.flatnonzero(child != WHOLE)))


def _rank(pairs: Pairs) -> Iterator[Pairs]:
    """Yield each ray's nearest one, its next two, its next four, and so on."""
    # Floats that are not negative sort as their bits do.
    nearness = np.maximum(pairs.entry, np.zeros_like(pairs.entry)).view(np.int32)
    order = np.argsort((pairs.row.astype(np.int64) << 32) | nearness)
    ray = pairs.row.take(order)
    begins = np.concatenate([[True], ray[1:] != ray[:-1]])
    place = np.arange(len(ray))
    rank = place - np.maximum.accumulate(np.where(begins, place, 0))
    group = np.frexp(rank + 1.0)[1]
    for number in range(1, int(group.max()) + 1):
        yield pairs.select(order.take(np.flatnonzero(group == number)))
