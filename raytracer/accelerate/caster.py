"""The public caster: arrays of rays in, closest hits or occlusion out.

`build` packs a scene's geometry once; a Caster answers any number of batches. How candidates are found (`bvh` and
`traverse`, or `brute_force` for a handful of primitives) changes no result: decisions are made in `search`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytracer.accelerate.brute_force import offer_all
from raytracer.accelerate.crossings import CrossingSearch
from raytracer.accelerate.geometry import Geometry, pack_geometry
from raytracer.accelerate.hierarchy import build_hierarchy, choose_flattened
from raytracer.accelerate.primitives import PRECISIONS, Primitives, make_primitives
from raytracer.accelerate.search import Search
from raytracer.accelerate.traverse import offer_traversed
from raytracer.checks import require_choice
from raytracer.rays import Booleans, Hits, Rays, make_rays
from raytracer.scene import Scene

# Rays per batch: their state and the candidates they bring stay within a few tens of megabytes.
BATCH_RAYS = 1 << 16
# Up to this many primitives, testing all of them is quicker than a tree.
BRUTE_FORCE_LIMIT = 8


@dataclass(frozen=True, eq=False)
class Caster:
    """A scene ready to be cast into.

    offer : the accelerator, a function that offers a Search all candidates its rays can hit
    """

    scene: Scene
    primitives: Primitives
    offer: Callable[[Search], None]

    @property
    def geometry(self) -> Geometry:
        return self.primitives.geometry

    def closest_hit(
        self, origins: ArrayLike, directions: ArrayLike, t_min: ArrayLike = 0.0, t_max: ArrayLike = np.inf
    ) -> Hits:
        """Return the closest hit of each ray o + t d with t_min <= t <= t_max.

        Parameters
        ----------
        origins, directions : (n, 3) or (3,) float64, metres, world; directions of any length
        t_min, t_max : scalar or (n,), inclusive, in units of the direction's length; t_min below 0 counts as 0

        Returns
        -------
        Hits of n rays. NaN, infinite or zero-direction rays miss and are flagged in `Hits.valid`.

        Raises
        ------
        ValueError
            If shapes do not fit.

        Notes
        -----
        Closed sets: a ray through an edge or vertex hits every triangle there; among equal distances the lowest
        (instance, primitive) is returned. A triangle without area, or seen exactly edge-on, is never hit.
        """
        rays = make_rays(origins, directions, t_min, t_max)
        batches = [self._search(batch, any_hit=False).closest() if len(batch) else _misses(0) for batch in _split(rays)]
        found = _join(batches)
        valid = rays.valid()
        return found if valid.all() else _spread(found, valid)

    def any_hit(
        self, origins: ArrayLike, directions: ArrayLike, t_min: ArrayLike = 0.0, t_max: ArrayLike = np.inf
    ) -> Booleans:
        """Return (n,) bool: does anything lie on the ray with t_min <= t <= t_max? Parameters as `closest_hit`."""
        rays = make_rays(origins, directions, t_min, t_max)
        found = np.zeros(len(rays), dtype=bool)
        if len(rays):
            found[rays.valid()] = np.concatenate(
                [self._search(batch, any_hit=True).found_any() for batch in _split(rays)]
            )
        return found

    def crossings(self, origins: ArrayLike, directions: ArrayLike) -> NDArray[np.int32]:
        """Return how many triangles each ray crosses, (n,) int32; odd means inside a closed mesh.

        Exact parity also where a ray passes through edges and vertices or starts on a face (`crossings`). Spheres are
        not counted; invalid rays cross nothing.

        Raises
        ------
        ValueError
            If the caster's precision is not 'certified'.
        """
        if self.primitives.precision != "certified":
            raise ValueError(f"crossings: precision: expected 'certified', got {self.primitives.precision!r}")
        rays = make_rays(origins, directions)
        count = np.zeros(len(rays), np.int32)
        found = []
        for batch in _split(rays):
            search = CrossingSearch(self.primitives, batch)
            self.offer(search)
            found.append(search.counts())
        count[rays.valid()] = np.concatenate(found)
        return count

    def _search(self, rays: Rays, any_hit: bool) -> Search:
        search = Search(self.primitives, rays, any_hit)
        self.offer(search)
        return search


def build(scene: Scene, precision: str = "certified") -> Caster:
    """Return a Caster for `scene`.

    precision : 'certified' (every decision as exact arithmetic would make it), 'float64' or 'float32'

    Raises
    ------
    ValueError
        If the precision is unknown.
    """
    require_choice(precision, PRECISIONS, "build: precision")
    geometry = pack_geometry(scene)
    primitives = make_primitives(geometry, precision, choose_flattened(geometry))
    if geometry.first_id[-1] <= BRUTE_FORCE_LIMIT:
        return Caster(scene, primitives, offer_all)
    return Caster(scene, primitives, partial(offer_traversed, build_hierarchy(primitives)))


def _split(rays: Rays) -> list[Rays]:
    """The valid rays, in batches."""
    index = np.flatnonzero(rays.valid())
    return [
        Rays(rays.origins[part], rays.directions[part], rays.t_min[part], rays.t_max[part])
        for part in (index[start : start + BATCH_RAYS] for start in range(0, max(len(index), 1), BATCH_RAYS))
    ]


def _misses(count: int) -> Hits:
    return Hits(
        distance=np.full(count, np.inf),
        distance_error=np.zeros(count),
        instance=np.full(count, -1, np.int32),
        primitive=np.full(count, -1, np.int32),
        barycentric=np.zeros((count, 2)),
        valid=np.zeros(count, dtype=bool),
    )


def _join(batches: list[Hits]) -> Hits:
    if len(batches) == 1:
        return batches[0]
    return Hits(*(np.concatenate([getattr(hits, name) for hits in batches]) for name in Hits.__slots__))


def _spread(found: Hits, valid: Booleans) -> Hits:
    """Put the hits of the valid rays in their places among invalid ones."""
    hits = _misses(len(valid))
    for name in Hits.__slots__:
        getattr(hits, name)[valid] = getattr(found, name)
    return hits
