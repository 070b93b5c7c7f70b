"""A batch of rays on its way through instances: down the boxes above them, then through their meshes' trees.

A ray that enters an instance becomes a *lane*: the ray in the frame of the mesh (`instances`). Each ray's nearest
instance goes first, and what is hit there culls the rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Indices
from raytracer.casting.bvh.stacks import Pairs
from raytracer.casting.dense.instances import NO_INSTANCE, Instances, place_rays
from raytracer.casting.dense.lines import DenseRays, to_bounds
from raytracer.casting.dense.walk import Descent, Walk, split_nearest
from raytracer.casting.planes import PlaneDecisions

# Pairs of rays and instances that are looked for together, and lanes that walk together.
MOST_PAIRS, MOST_LANES = 1 << 20, 1 << 17
# With fewer lanes than this, calls cost more than lanes that the nearest instance's hits would have culled.
FEWEST_LANES = 4096


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
        """Go from the root's children to the instances below."""
        last = len(self.levels) - 1
        for depth in range(1, last):
            pairs, _ = self.open_nodes(depth, pairs, False)
        step = max(1, MOST_PAIRS * 2 // self.levels[last].shape[2])
        for start in range(0, len(pairs.row), step):
            part = self.drop_passed(pairs.part(slice(start, start + step)))
            self._enter_in_order(self.open_nodes(last, part, False)[0])

    def _enter_in_order(self, pairs: Pairs) -> None:
        """Enter each ray's nearest instance, then what is left of the next, until few are left."""
        slot = self.instances.slots.take(pairs.target)
        pairs = pairs._replace(target=slot).select(np.flatnonzero(slot != NO_INSTANCE))
        while len(pairs.row) > FEWEST_LANES:
            first, pairs = split_nearest(pairs, None, len(self.best))
            self._enter(first)
            pairs = self.drop_passed(pairs)
        self._enter(pairs)

    def _enter(self, pairs: Pairs) -> None:
        """Walk through the trees of instances."""
        tree = self.instances.tree.take(pairs.target)
        for number in np.flatnonzero(np.bincount(tree)):
            some = pairs.select(np.flatnonzero(tree == number)) if len(self.instances.trees) > 1 else pairs
            for start in range(0, len(some.row), MOST_LANES):
                part = self.drop_passed(some.part(slice(start, start + MOST_LANES)))
                if len(part.row):
                    self._walk(number, part)

    def _walk(self, number: int, pairs: Pairs) -> None:
        """Walk through one tree."""
        ray, instance = pairs.row.astype(np.intp), pairs.target.astype(np.intp)
        rows, lanes = place_rays(self.instances, self.decisions.lines, ray, instance)
        tree, decisions = self.instances.trees[number], self.decisions

        def bound_lanes() -> NDArray[np.float32]:
            return to_bounds(decisions.best.take(ray) * lanes.unit, rows.way)

        def decide(lane: Indices, row: Indices, inside: Booleans) -> None:
            changed = decisions.take_in_lanes(lanes, tree.planes, lane, row, inside)
            self.best[changed] = to_bounds(decisions.best.take(changed), self.rays.way.take(changed))
            walk.best[:] = bound_lanes()

        walk = Walk(tree, rows, bound_lanes(), decisions.query.any_hit, decide)
        at_root = Pairs(np.arange(len(ray), dtype=np.int32), self.instances.root.take(instance), pairs.entry)
        walk.run(walk.open_nodes(0, at_root, False)[0])
