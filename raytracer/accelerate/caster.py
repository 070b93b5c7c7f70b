"""The public caster: arrays of rays in, closest hits or occlusion out.

`build` packs a scene's geometry once; a Caster answers any number of batches. How candidates are found (`bvh` and
`traverse`, or `brute_force` for a handful of primitives) changes no result: decisions are made in `search`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
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
        (instance, primitive) is returned. A triangle without area, or seen exactly edge-on, is never hit. A hit beyond
        the largest float64 has an infinite distance and error.
        """
        rays = make_rays(origins, directions, t_min, t_max)
        hits = _misses(rays)
        for index in _batches(hits.valid):
            search = Search(self.primitives, rays.select(index), any_hit=False)
            self.offer(search)
            found = search.closest()
            for name in Hits.__slots__:
                getattr(hits, name)[index] = getattr(found, name)
        return hits

    def any_hit(
        self, origins: ArrayLike, directions: ArrayLike, t_min: ArrayLike = 0.0, t_max: ArrayLike = np.inf
    ) -> Booleans:
        """Return (n,) bool: does anything lie on the ray with t_min <= t <= t_max? Parameters as `closest_hit`."""
        rays = make_rays(origins, directions, t_min, t_max)
        found = np.zeros(len(rays), dtype=bool)
        for index in _batches(rays.valid()):
            search = Search(self.primitives, rays.select(index), any_hit=True)
            self.offer(search)
            found[index] = search.found_any()
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
        for index in _batches(rays.valid()):
            search = CrossingSearch(self.primitives, rays.select(index))
            self.offer(search)
            count[index] = search.counts()
        return count


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


def _batches(valid: Booleans) -> Iterator[NDArray[np.intp]]:
    """Yield the indices of the valid rays, BATCH_RAYS at a time."""
    index = np.flatnonzero(valid)
    for start in range(0, len(index), BATCH_RAYS):
        yield index[start : start + BATCH_RAYS]


def _misses(rays: Rays) -> Hits:
    count = len(rays)
    return Hits(
        distance=np.full(count, np.inf),
        distance_error=np.zeros(count),
        instance=np.full(count, -1, np.int32),
        primitive=np.full(count, -1, np.int32),
        barycentric=np.zeros((count, 2)),
        valid=rays.valid(),
    )
