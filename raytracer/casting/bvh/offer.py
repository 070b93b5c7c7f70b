"""The tree of boxes as an accelerator: it is built when the first rays ask for it."""

from __future__ import annotations

from raytracer.casting.bvh.hierarchy import Hierarchy, build_hierarchy
from raytracer.casting.bvh.traverse import offer_traversed
from raytracer.casting.primitives import Primitives
from raytracer.casting.query import Query


class TreeOffer:
    """Offers candidates found by a hierarchy, which is built when the first rays ask for it.

    latest : the hierarchy, or until it is built the one that it will be built from
    """

    def __init__(self, primitives: Primitives, last: Hierarchy | None = None) -> None:
        self.primitives = primitives
        self.latest = last
        self.is_built = False

    def __call__(self, query: Query) -> None:
        """Offer a query all primitives that its rays may hit."""
        if not self.is_built:
            self.latest, self.is_built = build_hierarchy(self.primitives, self.latest), True
        assert self.latest is not None
        offer_traversed(self.latest, query)
