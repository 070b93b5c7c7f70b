"""Rays worth comparing: those of the camera, random ones, and those aimed where casters are known to fail.

All rays are rounded to float32, the precision in which Blender takes them, so that both sides get the same rays.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.casting.geometry import Geometry, world_corners
from raytracer.film.camera import primary_rays
from raytracer.scene.camera import Camera

# Origins of random rays lie in the scene's bounding box grown by this share of its diagonal.
SURROUNDINGS = 0.25


class Aimed(NamedTuple):
    """Rays (n, 3) each, float64 numbers that float32 holds, and the name of each one's family, (n,)."""

    origins: Floats
    directions: Floats
    family: NDArray[np.str_]


def aim_rays(geometry: Geometry, camera: Camera | None, width: int, height: int, count: int, seed: int) -> Aimed:
    """Return the camera's rays through its pixel centres, and `count` rays of each other family.

    Families: 'camera', 'random' (between random points), 'vertex' and 'edge' (towards a random vertex of a random
    triangle, or a random point on an edge of it).
    """
    rng = np.random.default_rng(seed)
    families = {}
    if camera is not None:
        row, column = np.mgrid[0:height, 0:width] + 0.5
        rays = primary_rays(camera, width, height, column.ravel(), row.ravel())
        families["camera"] = rays.origins, rays.directions
    triangle_count = geometry.sphere_id
    if triangle_count:
        chosen = rng.integers(triangle_count, size=(2, count))
        instance = np.searchsorted(geometry.first_id, chosen, side="right") - 1
        vertex, _, _ = world_corners(geometry, instance[0], chosen[0] - geometry.first_id[instance[0]])
        start, end, _ = world_corners(geometry, instance[1], chosen[1] - geometry.first_id[instance[1]])
        edge = start + rng.random((count, 1)) * (end - start)
        box = _measure_surroundings(vertex, edge)
        targets = {"random": rng.uniform(*box, size=(count, 3)), "vertex": vertex, "edge": edge}
        for name, target in targets.items():
            origins = rng.uniform(*box, size=(count, 3)).astype(np.float32).astype(np.float64)
            families[name] = origins, target - origins
    return _join_families(families)


def _measure_surroundings(*points: Floats) -> tuple[Floats, Floats]:
    """Return lower and upper corner of the box of all points, grown on every side."""
    stacked = np.concatenate(points)
    lower, upper = stacked.min(axis=0), stacked.max(axis=0)
    margin = SURROUNDINGS * float(np.linalg.norm(upper - lower))
    return lower - margin, upper + margin


def _join_families(families: dict[str, tuple[Floats, Floats]]) -> Aimed:
    names = [np.full(len(origins), name) for name, (origins, _) in families.items()]
    rounded = [
        np.concatenate([rays[part] for rays in families.values()] or [np.zeros((0, 3))]).astype(np.float32)
        for part in range(2)
    ]
    usable = (rounded[1] != 0).any(axis=1)
    family = np.concatenate(names) if names else np.zeros(0, dtype="U1")
    return Aimed(rounded[0][usable].astype(np.float64), rounded[1][usable].astype(np.float64), family[usable])
