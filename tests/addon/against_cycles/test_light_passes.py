"""Light passes against Cycles: what is diffuse, glossy or transmitted, direct or indirect, and that all adds up."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from addon.compare.cycles.rendering import CYCLES, Request, matched_settings, render_batches, render_both
from addon.properties import ENGINE
from raytracer.film.passes import LIGHT_PARTS, light_pass
from tests.folders import ROOT

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

LIGHT = tuple(light_pass(part, way) for part in LIGHT_PARTS for way in ("Direct", "Indirect", "Color"))
NAMES = ("Combined", *LIGHT, "Environment", "Emission", "Mist")
BATCHES = 6
# Standard errors, known with ten degrees of freedom, that two means may be apart.
APART = 4.0
# Shares of Combined's mean, of which differences are told: what is less is noise of nothing.
LEAST = 1e-6


@pytest.mark.parametrize("name", ["materials", "glass", "cornell_box"])
def test_means_of_light_passes_are_those_of_cycles(name: str) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(ROOT / "blend_scenes" / f"{name}.blend"), load_ui=False)
    scene = bpy.context.scene
    request = Request(24, 16, 8, 8, batches=BATCHES, passes=NAMES, integrator="PATH")
    ours, cycles = (side.passes for side in render_both(scene, scene.view_layers[0], request))
    present = 0
    for passed in NAMES:
        means = [side[passed][..., :3].mean(axis=(1, 2), dtype=np.float64) for side in (ours, cycles)]
        error = np.sqrt(sum(batches.var(axis=0, ddof=1) for batches in means) / BATCHES)
        difference = np.abs(means[0].mean(axis=0) - means[1].mean(axis=0))
        assert (difference <= APART * error + LEAST).all(), (passed, difference, error)
        present += bool(means[1].any())
    assert present >= 6


@pytest.mark.parametrize("name", ["materials", "glass"])
def test_light_passes_of_both_add_up_to_combined(name: str) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(ROOT / "blend_scenes" / f"{name}.blend"), load_ui=False)
    scene = bpy.context.scene
    request = Request(16, 10, 2, 8, passes=NAMES, integrator="PATH")
    for side in render_both(scene, scene.view_layers[0], request):
        total = side.passes["Environment"].astype(float) + side.passes["Emission"]
        for part in LIGHT_PARTS:
            light = side.passes[light_pass(part, "Direct")].astype(float) + side.passes[light_pass(part, "Indirect")]
            total += light * side.passes[light_pass(part, "Color")]
        np.testing.assert_allclose(total, side.passes["Combined"][..., :3], rtol=1e-5, atol=2e-6)


def test_exposure_makes_the_passes_brighter_that_it_does_in_cycles() -> None:
    bpy.ops.wm.open_mainfile(filepath=str(ROOT / "blend_scenes" / "materials.blend"), load_ui=False)
    scene = bpy.context.scene
    request = Request(24, 16, 8, 8, passes=(*NAMES, "Normal"), integrator="PATH")
    factors = []
    for settings, engine, name in (
        (scene.reference_raytracer, ENGINE, "exposure"),
        (scene.cycles, CYCLES, "film_exposure"),
    ):
        with matched_settings(scene, scene.view_layers[0], request):
            plain = render_batches(scene, scene.view_layers[0], engine, request).passes
            setattr(settings, name, 2.0)
            bright = render_batches(scene, scene.view_layers[0], engine, request).passes
        lit = [one for one in request.passes if plain[one].any()]
        factors.append({one: bright[one][..., :3].mean() / plain[one][..., :3].mean() for one in lit})
    ours, cycles = factors
    assert len(set(ours) & set(cycles)) > 8
    for name in set(ours) & set(cycles):
        assert ours[name] == pytest.approx(cycles[name], rel=1e-3), name
