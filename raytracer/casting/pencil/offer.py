"""Drawing as an accelerator for rays that leave, or arrive at, one point: clusters are made when first asked for."""

from __future__ import annotations

from raytracer.casting.pencil.clusters import Clusters, make_clusters
from raytracer.casting.pencil.draw import offer_drawn
from raytracer.casting.pencil.grids import Grid
from raytracer.casting.primitives import Primitives
from raytracer.casting.query import Query


class DrawnOffer:
    """Offers candidates found by drawing clusters of triangles, which are made when the first rays ask for them."""

    def __init__(self, primitives: Primitives) -> None:
        self.primitives = primitives
        self.clusters: Clusters | None = None

    def __call__(self, grid: Grid, query: Query) -> None:
        """Offer a query, whose rays are the grid's, all primitives that they may hit."""
        offer_drawn(grid, self.find_clusters(), query)

    def find_clusters(self) -> Clusters:
        """Return the clusters; they are made once."""
        if self.clusters is None:
            self.clusters = make_clusters(self.primitives)
        return self.clusters
