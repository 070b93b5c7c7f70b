"""What denoisers take, against Cycles: on wide and narrow surfaces, in mirrors, behind panes and sheets, and beside."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from addon.compare.cycles.rendering import Request, render_both
from addon.passes import DENOISING_DATA, enabled_passes, switch
from raytracer.film.passes import GUIDES
from tests.folders import ROOT

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

BATCHES = 6
# Standard errors, known with ten degrees of freedom, that two means may be apart; and shares of the largest value, of
# which nothing is told: albedos are read from tables.
APART, LEAST = 4.0, 2e-3


def open_scene(name: str) -> Any:
    bpy.ops.wm.open_mainfile(filepath=str(ROOT / "blend_scenes" / f"{name}.blend"), load_ui=False)
    return bpy.context.scene


@pytest.mark.parametrize("name", ["materials", "glass", "facing_mirrors", "cornell_box", "hdri", "panorama"])
def test_means_are_those_of_cycles(name: str) -> None:
    scene = open_scene(name)
    request = Request(24, 16, 8, 8, batches=BATCHES, passes=("Combined", *GUIDES), integrator="PATH")
    ours, cycles = (side.passes for side in render_both(scene, scene.view_layers[0], request))
    for guide in GUIDES:
        means = [side[guide].mean(axis=(1, 2), dtype=np.float64) for side in (ours, cycles)]
        error = np.sqrt(sum(batches.var(axis=0, ddof=1) for batches in means) / BATCHES)
        difference = np.abs(means[0].mean(axis=0) - means[1].mean(axis=0))
        allowed = APART * error + LEAST * np.abs(cycles[guide]).mean()
        assert (difference <= allowed).all(), (guide, means[0].mean(axis=0), means[1].mean(axis=0), error)
        assert means[1].any()


def test_one_option_of_cycles_asks_for_all(empty_scene: Any) -> None:
    layer = empty_scene.view_layers[0]
    switch(layer, DENOISING_DATA, True)
    assert enabled_passes(layer) == ("Combined", *GUIDES)
