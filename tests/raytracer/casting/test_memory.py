"""What large scenes take to be cast into, in bytes of arrays: kept, and at most while trees are built."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest

import raytracer
from raytracer.casting.geometry import pack_geometry
from tests import meshes

COUNT = 100_000
# A ray, so that the tree is built.
RAY = ((0.1, 0.2, 9.0), (0.0, 0.0, -1.0))


def make_terrain() -> raytracer.Scene:
    """A grid of COUNT triangles."""
    side = int(np.sqrt(COUNT / 2))
    x, y = np.meshgrid(*2 * [np.linspace(-1, 1, side + 1)])
    positions = np.stack([x, y, 0.1 * np.sin(9 * x) * np.cos(7 * y)], axis=-1).reshape(-1, 3)
    corner = np.arange(side * (side + 1)).reshape(side, side + 1)[:, :-1].ravel()
    lower, upper = (corner, corner + 1, corner + side + 2), (corner, corner + side + 2, corner + side + 1)
    return raytracer.Scene(meshes=[raytracer.Mesh(positions, np.concatenate([np.stack(t, 1) for t in (lower, upper)]))])


def make_crowd() -> raytracer.Scene:
    """COUNT balls of 80 triangles."""
    rng = np.random.default_rng(0)
    matrices = np.tile(np.eye(4), (COUNT, 1, 1))
    matrices[:, :3, :3] += rng.normal(size=(COUNT, 3, 3)) * 0.2
    matrices[:, :3, 3] = rng.uniform(-90, 90, (COUNT, 3))
    instances = raytracer.Instances(np.zeros(COUNT, np.int32), matrices)
    return raytracer.Scene(meshes=[raytracer.Mesh(*meshes.make_icosphere(1))], instances=instances)


@pytest.mark.parametrize(
    ("make", "kept", "peak"),
    [
        (make_terrain, 160, 270),  # world corners 72, tree 79
        (make_crowd, 210, 370),  # inverse 72, tree 90, the rest of an instance's place
    ],
)
def test_casters_of_large_scenes_take_few_bytes_for_each(
    make: Callable[[], raytracer.Scene], kept: float, peak: float
) -> None:
    raytracer.build(make_terrain()).closest_hit(*RAY)  # what is made once in a process
    scene = make()
    tracemalloc.start()
    try:
        caster = raytracer.build(scene)
        caster.closest_hit(*RAY)
        now, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert now / COUNT < kept
    assert most / COUNT < peak


def test_the_arrays_of_a_single_mesh_are_not_copied() -> None:
    scene = make_terrain()
    geometry = pack_geometry(scene)
    assert np.shares_memory(geometry.positions, scene.meshes[0].positions)
    assert np.shares_memory(geometry.triangles, scene.meshes[0].triangles)
