"""What a caster is asked besides its first hits: the methods of `Caster` that need no more than those, or its geometry.

All surfaces along rays (`layers`), the inside of closed meshes (`inside`), closest points (`nearest`).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from raytracer.arrays.types import Booleans
from raytracer.casting.inside import CrossingCaster, find_inside
from raytracer.casting.layers import AllHits, find_all_hits, iterate_layers
from raytracer.casting.nearest.forest import Forest, build_forest
from raytracer.casting.nearest.search import ClosestPoints, find_closest
from raytracer.casting.primitives import Primitives
from raytracer.casting.ray_visibility import SceneCaster
from raytracer.casting.rays import Hits
from raytracer.scene.scene import Scene


class Questions:
    """The methods; a Caster has what they ask for."""

    scene: Scene
    primitives: Primitives

    def layers(
        self: SceneCaster, origins: ArrayLike, directions: ArrayLike, t_min: ArrayLike = 0.0, t_max: ArrayLike = np.inf
    ) -> Iterator[Hits]:
        """Yield the hits of n rays with the next surface each, until all miss (`iterate_layers`).

        Examples
        --------
        >>> import raytracer
        >>> spheres = raytracer.Spheres(centres=[(0, 0, 0), (0, 0, 5)], radii=[1, 1])
        >>> caster = raytracer.build(raytracer.Scene(spheres=[spheres]))
        >>> [float(hits.distance[0]) for hits in caster.layers((0, 0, -3), (0, 0, 1))]
        [2.0, 4.0, 7.0, 9.0]
        """
        return iterate_layers(self, origins, directions, t_min, t_max)

    def all_hits(
        self: SceneCaster,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        most: int | None = None,
    ) -> AllHits:
        """Return all surfaces that rays meet, at most `most` for each ray (`find_all_hits`).

        Examples
        --------
        >>> import raytracer
        >>> spheres = raytracer.Spheres(centres=[(0, 0, 0), (0, 0, 5)], radii=[1, 1])
        >>> caster = raytracer.build(raytracer.Scene(spheres=[spheres]))
        >>> found = caster.all_hits([(0, 0, -3), (0, 9, 0), (0, 0, 3)], (0, 0, 1))
        >>> found.count.tolist(), found.ray.tolist(), found.hits.distance.tolist()
        ([4, 0, 2], [0, 0, 0, 0, 2, 2], [2.0, 4.0, 7.0, 9.0, 1.0, 3.0])
        """
        return find_all_hits(self, origins, directions, t_min, t_max, most)

    def inside(self: CrossingCaster, points: ArrayLike) -> Booleans:
        """Return (n,) bool: which points lie inside a closed mesh or a sphere; exact (`find_inside`).

        Examples
        --------
        >>> import raytracer
        >>> corners, faces = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
        >>> caster = raytracer.build(raytracer.Scene(meshes=[raytracer.Mesh(corners, faces)]))
        >>> caster.inside([(0.25, 0.25, 0.25), (2, 2, 2)]).tolist()
        [True, False]
        """
        return find_inside(self, points)

    @cached_property
    def _forest(self) -> Forest | None:
        return build_forest(self.scene, self.primitives.geometry)

    def closest_point(self, points: ArrayLike, distance: ArrayLike = np.inf) -> ClosestPoints:
        """Return the point of the scene that is closest to each of n points, at most `distance` away (`find_closest`).

        Examples
        --------
        >>> import raytracer
        >>> mesh = raytracer.Mesh(positions=[(0, 0, 0), (1, 0, 0), (0, 1, 0)], triangles=[(0, 1, 2)])
        >>> caster = raytracer.build(raytracer.Scene(meshes=[mesh]))
        >>> closest = caster.closest_point([(0.25, 0.5, 2), (-3, -4, 0)])
        >>> closest.distance.tolist(), closest.location.tolist()
        ([2.0, 5.0], [[0.25, 0.5, 0.0], [0.0, 0.0, 0.0]])
        """
        return find_closest(self._forest, self.primitives, points, distance)
