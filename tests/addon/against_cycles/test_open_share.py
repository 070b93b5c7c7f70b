"""Ambient Occlusion against Cycles: as far as the world says, ten metres where there is none."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from addon.compare.cycles.rendering import Request, render_both
from tests.folders import ROOT

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

NAME = "Ambient Occlusion"
BATCHES = 6
# Standard errors, known with ten degrees of freedom, that two means may be apart; of the share itself, what the rim of
# a mesh is off.
APART, LEAST = 4.0, 1e-3


@pytest.mark.parametrize("distance", [10.0, 0.3, None])
@pytest.mark.parametrize("name", ["materials", "glass", "character"])
def test_means_are_those_of_cycles(name: str, distance: float | None) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(ROOT / "blend_scenes" / f"{name}.blend"), load_ui=False)
    scene = bpy.context.scene
    if distance is None:
        scene.world = None
    else:
        scene.world.light_settings.distance = distance
    request = Request(24, 16, 8, 2, batches=BATCHES, passes=("Combined", NAME), integrator="PATH")
    ours, cycles = (side.passes[NAME] for side in render_both(scene, scene.view_layers[0], request))
    means = [side.mean(axis=(1, 2), dtype=np.float64) for side in (ours, cycles)]
    error = np.sqrt(sum(batches.var(axis=0, ddof=1) for batches in means) / BATCHES)
    difference = np.abs(means[0].mean(axis=0) - means[1].mean(axis=0))
    assert (difference <= APART * error + LEAST).all(), (means[0].mean(axis=0), means[1].mean(axis=0), error)
