"""A worker without work, to see what its parent has to do; in a file of its own, for processes find it by name."""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.film.passes import find_pass
from raytracer.rendering.block_plan import BLOCK_SECONDS
from raytracer.rendering.blocks import Block, BlockResult


class Sender:
    """A worker that has traced already: sends what a block of samples of some passes takes."""

    def __init__(self, passes: tuple[str, ...]) -> None:
        self.passes = passes
        self.values: dict[int, dict[str, Floats]] = {}

    def __call__(self, block: Block) -> BlockResult:
        """Return its strip, or each sample of its pixels."""
        count = len(block) * block.samples
        if block.strip is not None:
            block.strip.sums.counts.spread()[...] += block.samples // 2
            return BlockResult(block, {}, None, count, BLOCK_SECONDS)
        if count not in self.values:
            self.values[count] = {name: np.ones((count, find_pass(name).channels)) for name in self.passes}
        return BlockResult(block, self.values[count], None, count, BLOCK_SECONDS)
