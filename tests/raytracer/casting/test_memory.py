"""What large scenes take to be cast into, in bytes of arrays: kept, and at most while trees are built."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

import raytracer
from raytracer.casting.geometry import pack_geometry
from tests.large_scenes import make_crowd, make_terrain

COUNT = 100_000
# A ray, so that the tree is built.
RAY = ((0.1, 0.2, 9.0), (0.0, 0.0, -1.0))


@pytest.mark.parametrize(
    ("make", "kept", "peak"),
    [
        (partial(make_terrain, COUNT), 160, 270),  # world corners 72, tree 79
        (partial(make_crowd, COUNT, 90.0), 210, 370),  # inverse 72, tree 90, the rest of an instance's place
    ],
)
def test_casters_of_large_scenes_take_few_bytes_for_each(
    make: Callable[[], raytracer.Scene], kept: float, peak: float
) -> None:
    raytracer.build(make_terrain(COUNT)).closest_hit(*RAY)  # what is made once in a process
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
    scene = make_terrain(COUNT)
    geometry = pack_geometry(scene)
    assert np.shares_memory(geometry.positions, scene.meshes[0].positions)
    assert np.shares_memory(geometry.triangles, scene.meshes[0].triangles)
