"""Scenes of many triangles, or of many instances: what memory and times of casters are measured on."""

from __future__ import annotations

import numpy as np

import raytracer
from tests import meshes


def make_terrain(count: int) -> raytracer.Scene:
    """A wavy grid of some `count` triangles, a metre in each direction from the origin."""
    side = int(np.sqrt(count / 2))
    grid = meshes.make_grid(side, 2.0, lambda x, y: 0.1 * np.sin(9 * x) * np.cos(7 * y))
    return raytracer.Scene(meshes=[raytracer.Mesh(*grid)])


def make_crowd(count: int, reach: float) -> raytracer.Scene:
    """`count` balls of 80 triangles, bent each in its own way, as far as `reach` metres along each axis."""
    rng = np.random.default_rng(0)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3] += rng.normal(size=(count, 3, 3)) * 0.2
    matrices[:, :3, 3] = rng.uniform(-reach, reach, (count, 3))
    instances = raytracer.Instances(np.zeros(count, np.int32), matrices)
    return raytracer.Scene(meshes=[raytracer.Mesh(*meshes.make_icosphere(1))], instances=instances)
