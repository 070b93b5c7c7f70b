"""Light groups against Cycles: lamps, shining objects and the world, each by the group that Blender says."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from addon.compare.cycles.rendering import Request, render_both
from raytracer.film.passes import LIGHT_GROUP
from tests.folders import ROOT

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

BATCHES = 6
# Standard errors, known with ten degrees of freedom, that two means may be apart.
APART, LEAST = 4.0, 1e-6


def open_grouped(name: str) -> tuple[Any, tuple[str, ...]]:
    """Return a scene whose lamps, shining objects and world are in groups of their own, and the passes of those."""
    bpy.ops.wm.open_mainfile(filepath=str(ROOT / "blend_scenes" / f"{name}.blend"), load_ui=False)
    scene = bpy.context.scene
    names = ("lamps", "objects", "sky")
    for group in names:
        scene.view_layers[0].lightgroups.add(name=group)
    for thing in scene.objects:
        thing.lightgroup = "lamps" if thing.type == "LIGHT" else "objects"
    if scene.world is not None:
        scene.world.lightgroup = "sky"
    return scene, tuple(LIGHT_GROUP + group for group in names)


@pytest.mark.parametrize("name", ["materials", "cornell_box", "interior"])
def test_means_are_those_of_cycles_and_add_up_to_combined(name: str) -> None:
    scene, passes = open_grouped(name)
    request = Request(24, 16, 8, 4, batches=BATCHES, passes=("Combined", *passes), integrator="PATH")
    ours, cycles = (side.passes for side in render_both(scene, scene.view_layers[0], request))
    for side in (ours, cycles):
        total = np.sum([side[one].astype(float) for one in passes], axis=0)
        np.testing.assert_allclose(total, side["Combined"][..., :3], rtol=1e-5, atol=2e-6)
    np.testing.assert_allclose(
        np.sum([ours[one].astype(float) for one in passes], axis=0), ours["Combined"][..., :3], rtol=1e-6, atol=1e-6
    )
    for one in passes:
        means = [side[one].mean(axis=(1, 2), dtype=np.float64) for side in (ours, cycles)]
        error = np.sqrt(sum(batches.var(axis=0, ddof=1) for batches in means) / BATCHES)
        difference = np.abs(means[0].mean(axis=0) - means[1].mean(axis=0))
        assert (difference <= APART * error + LEAST).all(), (one, means[0].mean(axis=0), means[1].mean(axis=0))


def test_what_no_group_names_is_in_none(empty_scene: Any) -> None:
    scene, passes = open_grouped("materials")
    for thing in scene.objects:
        thing.lightgroup = "another"
    request = Request(12, 8, 2, 2, passes=("Combined", *passes), integrator="PATH")
    ours, cycles = (side.passes for side in render_both(scene, scene.view_layers[0], request))
    for side in (ours, cycles):
        assert not side[passes[0]].any()
        assert not side[passes[1]].any()
