"""How many triangles a ray crosses, exactly, also through edges and vertices: parity tells inside from outside.

The origin is thought to be moved by (e, e^2, e^3) for an infinitely small e > 0 (symbolic perturbation: H. Edelsbrunner
and E. Muecke, "Simulation of simplicity", 1990). A moved ray passes no edge and no vertex and starts on no plane, so a
closed mesh is entered and left alternately. What floating point cannot decide is decided in integers
(`exact.crosses`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.casting.candidates import Candidates
from raytracer.casting.geometry import Ids, Kind
from raytracer.casting.primitives import Primitives, gather_corners
from raytracer.casting.query import Query
from raytracer.casting.rays import Rays
from raytracer.predicates import exact


class CrossingQuery(Query):
    """Counts the triangles that rays cross; spheres do not count, edges and vertices are left to `exact`."""

    closed = False
    narrows = False

    def __init__(self, primitives: Primitives, rays: Rays) -> None:
        super().__init__(primitives, rays, any_hit=False)
        self.count = np.zeros(len(rays), np.int32)

    def offer(self, ray: Indices, primitive_id: Ids) -> Indices:
        triangle = self.primitives.geometry.is_kind(primitive_id, Kind.TRIANGLE)
        return super().offer(ray[triangle], primitive_id[triangle])

    def _weigh(
        self, ray: Indices, primitive_id: Ids, t: Floats, error: Floats, inside: Booleans, possible: Booleans
    ) -> Indices:
        """Count what is certainly crossed, drop what is certainly not, keep the rest; no ray's range shrinks."""
        with np.errstate(invalid="ignore"):
            low, high = t - error, t + error  # NaN where nothing is known, which is neither ahead nor behind
        crossed, behind = inside & (low > 0), high < 0
        self.add_crossings(ray[crossed], primitive_id[crossed])
        doubt = np.flatnonzero(possible & ~crossed & ~behind)
        self.pool.append(Candidates(ray, primitive_id, t, low, crossed).select(doubt))
        return ray[:0]

    def add_crossings(self, ray: Indices, primitive_id: Ids) -> None:
        """Count triangles that are crossed beyond doubt."""
        np.add.at(self.count, ray, 1)

    def settle_doubts(self) -> None:
        """Let integers decide what was left in doubt; call once, when all candidates were offered."""
        for doubtful in self.pool:
            corners = gather_corners(self.primitives, doubtful.primitive_id).T.reshape(-1, 3, 3)
            self.exact_count += len(corners)
            origins, directions = self.rays.origins[doubtful.ray].tolist(), self.rays.directions[doubtful.ray].tolist()
            crossed = np.array([exact.crosses(*line) for line in zip(origins, directions, corners, strict=True)], bool)
            self.add_crossings(doubtful.ray[crossed], doubtful.primitive_id[crossed])

    def counts(self) -> NDArray[np.int32]:
        """(n,) the number of crossings; call once, when all candidates were offered."""
        self.settle_doubts()
        return self.count
