"""When the dense tree is used and when it is built: by the first large batch, for triangles alone.

Batches too small for that take the four-wide tree unless the dense one is there already; their times hardly differ, but
it is built in a third of the time. It also serves what no hit narrows (`crossings`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from raytracer.casting.dense.tree import MOST_TRIANGLES, DenseTree, build_dense_tree, pack_dense_tree
from raytracer.casting.dense.walk import offer_dense
from raytracer.casting.primitives import Primitives
from raytracer.casting.query import Query

# Rays for which the dense tree is built.
SMALLEST_BATCH = 4096
# How much more surface the blocks of moved triangles may have, as a share of the scene's, before they are chosen anew.
MOST_GROWTH = 1.25


def suits_dense(primitives: Primitives) -> bool:
    """True where there are only triangles, all with world corners, and rays that are decided exactly."""
    return (
        primitives.precision == "certified"
        and bool(primitives.flattened.all())
        and not len(primitives.geometry.radii)
        and 0 < len(primitives.corners) <= MOST_TRIANGLES
    )


class DenseOffer:
    """Offers candidates found by a dense tree, or by `other` where that is better.

    tree : the tree once it is built, or the last one if nothing has moved since
    last : a tree of as many triangles before they moved, whose blocks are tried first
    """

    def __init__(self, primitives: Primitives, other: Callable[[Query], None], last: DenseOffer | None = None) -> None:
        self.primitives, self.other = primitives, other
        self.tree: DenseTree | None = None
        self.last: DenseTree | None = None
        if last is not None:
            self._take_last(last)

    def _take_last(self, last: DenseOffer) -> None:
        corners = self.primitives.corners
        if last.tree is not None and np.array_equal(last.primitives.corners, corners):
            self.tree = last.tree
        elif len(last.primitives.corners) == len(corners):
            self.last = last.tree if last.tree is not None else last.last

    def __call__(self, query: Query) -> None:
        """Offer a query all primitives that its rays may hit."""
        if not query.narrows or (self.tree is None and len(query.rays) < SMALLEST_BATCH):
            self.other(query)
            return
        if self.tree is None:
            self.tree, self.last = self._build(), None
        offer_dense(self.tree, query)

    def _build(self) -> DenseTree:
        corners, bounds = self.primitives.corners, self.primitives.bounds
        if self.last is not None:
            moved = pack_dense_tree(bounds, corners, self.last.items, self.last.count, self.last.large)
            if moved.surface <= MOST_GROWTH * self.last.surface:
                return moved
        return build_dense_tree(corners, bounds)
