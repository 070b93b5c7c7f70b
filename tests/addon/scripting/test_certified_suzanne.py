"""Certified hits equal exact arithmetic on Blender's monkey, subdivided, mirrored and far away."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from addon.extract.scene import extract_scene
from tests import meshes
from tests.oracle.certifying_oracle import judge_many
from tests.oracle.exact_oracle import crossings, pack_scene
from tests.oracle.judging import build_with, judge_hits

pytestmark = pytest.mark.blender


@pytest.mark.parametrize("location", [(0.0, 0.0, 0.0), (1e6, -1e6, 1e6)], ids=["near", "far"])
def test_hits_of_subdivided_suzanne_equal_exact_arithmetic(empty_scene: Any, location: tuple[float, ...]) -> None:
    bpy.ops.mesh.primitive_monkey_add(location=location, rotation=(0.3, 0.2, 0.1), scale=(1, -1.5, 0.5))
    bpy.context.object.modifiers.new("Subdivision", "SUBSURF").levels = 1
    scene = extract_scene(bpy.context.evaluated_depsgraph_get(), ("Combined",), geometry_only=True).scene
    tree, generator, corners = build_with("bvh", scene), np.random.default_rng(9), pack_scene(scene).corners
    assert len(corners) > 3000
    origins, directions = meshes.random_rays(generator, 2000)
    judge_many(tree, origins + location, directions)
    few = corners[generator.integers(len(corners), size=100)]
    for targets in (few[:, 0], few[:, 0] * 0.5 + few[:, 1] * 0.5):
        rays = meshes.aim(np.round(origins[:100] * 64) / 64 + location, targets)
        judge_hits(tree, tree.closest_hit(*rays), *rays)
        np.testing.assert_array_equal(tree.crossings(*rays), crossings(*rays, corners))
