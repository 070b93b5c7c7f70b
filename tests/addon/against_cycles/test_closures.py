"""Closures against Cycles: how much light they send on in a white furnace, and balls of them under lamps.

The bar of the furnace is half a percent of Cycles' value; what chance adds, by the spread of the pixels, comes on top.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from addon.versions import VERSION
from blend_scenes import building
from tests.addon.against_cycles import furnace
from tests.addon.against_cycles.furnace import FURNACE, ROUGHNESS, TINT, measure_furnace, metallic, node, principled
from tests.addon.against_cycles.node_fixtures import render_centres, render_cycles
from tests.addon.against_cycles.test_pictures import (
    ALSO_BY_POINTS,
    CLOSURES,
    add_lamp,
    assert_pictures_agree,
    make_stage,
)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

BAR = 0.005
# For some hundred comparisons of three colors.
STANDARD_ERRORS = 4.5
# Where Cycles shows less than this of a white light, its float32 and its cuts of small weights count.
DARKEST = 0.01


def find_largest_difference(measured: furnace.Furnace) -> np.ndarray:
    """Return (closures, roughnesses) the largest relative difference of a color, less what chance explains."""
    difference = np.abs(measured.ours - measured.cycles) - STANDARD_ERRORS * measured.error
    return (difference / np.maximum(measured.cycles, DARKEST)).max(axis=2)


def assert_furnaces_agree(names: list[str], cosine: float, samples: int, cycles_factor: int, record: Any) -> None:
    measured = measure_furnace(names, ROUGHNESS, cosine, samples, cycles_factor)
    assert measured.ours.max() > 0.5
    excess = find_largest_difference(measured)
    plain = np.abs(measured.ours - measured.cycles).max(axis=2) / np.maximum(measured.cycles.max(axis=2), DARKEST)
    record("difference", {name: plain[row].round(4).tolist() for row, name in enumerate(names)})
    assert {name: excess[row].tolist() for row, name in enumerate(names) if excess[row].max() > BAR} == {}


def test_white_furnaces_agree(record_property: Any) -> None:
    assert_furnaces_agree(list(FURNACE), cosine=0.6, samples=24, cycles_factor=8, record=record_property)


@pytest.mark.slow
@pytest.mark.parametrize("cosine", [0.95, 0.6, 0.25])
def test_white_furnaces_agree_with_many_samples(cosine: float, record_property: Any) -> None:
    assert_furnaces_agree(list(FURNACE), cosine, samples=512, cycles_factor=8, record=record_property)


def test_a_furnace_finds_a_percent_that_is_missing() -> None:
    """The test has teeth: one percent more light fails it."""
    measured = measure_furnace(["diffuse", "principled"], (0.5,), 0.6, 64, 8)
    assert (find_largest_difference(measured) < BAR).all()
    assert (find_largest_difference(measured._replace(ours=measured.ours * 1.01)) > BAR).all()


BALLS = {
    "rough diffuse": node("Diffuse", Roughness=0.8),
    "ggx": node("Anisotropic", Roughness=0.5, distribution="GGX"),
    "beckmann": node("Anisotropic", Roughness=0.5, distribution="BECKMANN"),
    "stretched": node("Anisotropic", Roughness=0.5, Anisotropy=0.7, Rotation=0.1),
    "beckmann glass": node("Glass", Roughness=0.4, IOR=1.45, distribution="BECKMANN"),
    "beckmann refraction": node("Refraction", Roughness=0.4, IOR=1.3),
    "sheen": node("Sheen", Roughness=0.5),
    "velvet": node("Sheen", Roughness=0.6, distribution="ASHIKHMIN"),
    "toon": node("Toon", Size=0.5, Smooth=0.3),
    "coat": principled(Coat_Weight=0.8, Coat_Roughness=0.2, Coat_Tint=TINT),
    "sheen layer": principled(Sheen_Weight=0.8, Sheen_Tint=TINT),
    "stretched metal": principled(Metallic=1.0, Roughness=0.4, Anisotropic=0.8, Anisotropic_Rotation=0.1),
    "stretched plastic": principled(Roughness=0.4, Anisotropic=0.8),
}
if VERSION >= (4, 3):
    BALLS |= {
        "rough base": principled(Diffuse_Roughness=0.7),
        "metallic": metallic(Roughness=0.3, Edge_Tint=TINT, Anisotropy=0.5),
        "conductor": metallic(Roughness=0.3, fresnel_type="PHYSICAL_CONDUCTOR"),
    }
if VERSION >= (5, 0):
    BALLS |= {"film on glass": node("Glass", Roughness=0.2, IOR=1.5, Thin_Film_Thickness=500.0)}
QUICK = ("rough diffuse", "beckmann", "stretched", "sheen", "coat")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in BALLS]
)
def test_a_ball_of_one_closure_without_bounces_agrees(name: str) -> None:
    scene = make_stage()
    add_lamp("AREA", {"shape": "SQUARE", "size": 1.5}, location=(-1.5, -2.5, 3.0))
    add_lamp("POINT", {"shadow_soft_size": 0.0}, location=(2.5, -1.5, 2.0), power=80.0)
    building.set_world((0.2, 0.25, 0.3), 1.0)
    ball = building.make_sphere("Ball", 1.2, 64)
    made = furnace.make_material(BALLS[name])
    building.link_object("Ball", ball, (0, 0.2, 1.2), materials=[made])
    assert_pictures_agree(scene, samples=16)


def test_a_translucent_curtain_agrees() -> None:
    """Lit from behind and from the front; light of the world from behind is found only where paths are traced."""
    scene = make_stage()
    for side in (-1, 1):
        lamp = add_lamp("AREA", {"shape": "SQUARE", "size": 1.0}, location=(0.5, 2.5 * side, 2.0), target=(0, 0, 1))
        lamp.data.color = (1.0, 0.7, 0.4) if side < 0 else (0.3, 0.6, 1.0)
    curtain = building.make_plane("Curtain", 2.5, 2.0)
    made = furnace.make_material(node("Translucent"))
    building.link_object("Curtain", curtain, (0, 0, 1.1), rotation=(80, 0, 10), materials=[made])
    assert_pictures_agree(scene, samples=16)


@pytest.mark.parametrize("name", [*ALSO_BY_POINTS, "glossy", "rough glass", "principled", "half transmission"])
def test_a_ball_of_one_closure_agrees_point_by_point(name: str) -> None:
    """Under a lamp without size nothing is random: what a lobe sends back of light is compared to its last digits."""
    make_stage()
    lamp = add_lamp("POINT", {"shadow_soft_size": 0.0}, location=(2.5, -2.5, 3.0), power=300.0)
    ball = building.make_sphere("Ball", 1.2, 64)
    building.link_object("Ball", ball, (0, 0.2, 1.2), materials=[CLOSURES[name]()])
    for lamp.location.y in (-2.5, 2.5):
        (ours, warnings), cycles = render_centres(96, 72), render_cycles(96, 72)
        assert not warnings
        assert (np.abs(ours - cycles) / (1.0 + cycles)).max() < 2e-3
        assert abs(ours.mean() - cycles.mean()) < 2e-6
