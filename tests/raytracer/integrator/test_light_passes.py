"""Light passes: they add up to Combined whatever the scene holds, each part is what its surface sends, and a scene that
is not asked for them pays nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import raytracer
from raytracer.film.passes import LIGHT_PARTS, PASSES, light_pass, select_passes
from raytracer.film.shown import divide_by_color
from tests.forbidding import forbid
from tests.raytracer.integrator.test_negative_light import SOURCES

SPLIT = tuple(light_pass(part, way) for part in LIGHT_PARTS for way in ("Direct", "Indirect"))
COLORS = tuple(light_pass(part, "Color") for part in LIGHT_PARTS)
ALL = ("Combined", *SPLIT, *COLORS, "Environment", "Emission", "Mist")
EYE = np.array([[1, 0, 0, 0], [0, 0, -1, -6], [0, 1, 0, 1.5], [0, 0, 0, 1.0]])
FLOAT32 = float(np.finfo(np.float32).eps)


def make_material(*closures: raytracer.Closure) -> raytracer.Material:
    return raytracer.Material(closures)


# One of each part, some in one material, seen straight and through a half transparent sheet.
MATERIALS = [
    make_material(raytracer.Closure("diffuse", color=(0.8, 0.3, 0.1))),
    make_material(raytracer.Closure("emission", color=(2.0, 1.0, 0.5))),
    make_material(raytracer.Closure("glossy", color=(0.9, 0.7, 0.2), roughness=0.3)),
    make_material(raytracer.Closure("glass", roughness=0.2)),
    make_material(raytracer.Closure("glass", roughness=0.0)),
    make_material(raytracer.Closure("translucent", color=(0.2, 0.6, 0.3))),
    make_material(
        raytracer.Closure("transparent", weight=0.5), raytracer.Closure("diffuse", weight=0.3, color=(0.5, 0.5, 1.0))
    ),
    make_material(raytracer.Closure("principled", color=(0.1, 0.6, 0.6), roughness=0.4)),
    make_material(raytracer.Closure("refraction", roughness=0.3)),
]


def make_scene(**fields: Any) -> raytracer.Scene:
    """Balls of every material on a floor, behind a sheet that half of the picture is seen through."""
    floor = raytracer.Mesh([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2), (0, 2, 3)])
    sheet = raytracer.Mesh([(0, -4, 0), (3, -4, 0), (3, -4, 4), (0, -4, 4)], [(0, 1, 2), (0, 2, 3)], material=6)
    places = [(1.1 * (number % 4) - 1.7, -1.0 + 1.5 * (number // 4), 0.5) for number in range(7)]
    balls = raytracer.Spheres(places, [0.5] * 7, material=[2, 3, 4, 5, 7, 8, 0])
    whole = {"meshes": [floor, sheet], "spheres": [balls], "materials": MATERIALS, "camera": raytracer.Camera(EYE)}
    lamp = raytracer.Mesh([(-1, -1, 4), (1, -1, 4), (1, 1, 4.5), (-1, 1, 4)], [(0, 1, 2), (0, 2, 3)], material=1)
    if fields.pop("shining", False):
        whole["meshes"] = [floor, sheet, lamp]
    return raytracer.Scene(**{**whole, **fields})


LIGHTS = {name: make(1.0) for name, make in SOURCES.items() if {"lights", "world"} & set(make(1.0))}
LIGHTS["mesh"] = {"shining": True}
LIGHTS["mesh and world"] = {"shining": True, "world": raytracer.World((0.3, 0.4, 0.5))}


def add_up(film: raytracer.Film) -> np.ndarray:
    """Return what all passes of light show together."""
    total = film["Environment"].astype(float) + film["Emission"]
    for part in LIGHT_PARTS:
        light = film[light_pass(part, "Direct")].astype(float) + film[light_pass(part, "Indirect")]
        total += light * film[light_pass(part, "Color")]
    return total


@pytest.mark.parametrize("settings", [{"integrator": "direct"}, {"integrator": "path"}])
@pytest.mark.parametrize("name", LIGHTS)
def test_light_passes_add_up_to_combined(name: str, settings: dict[str, Any]) -> None:
    film = raytracer.render(make_scene(**LIGHTS[name]), 24, 16, 4, passes=ALL, **settings)
    combined = film["Combined"][..., :3].astype(float)
    assert combined.any()
    np.testing.assert_allclose(add_up(film), combined, rtol=1e-6, atol=1e-6)


def test_clamped_light_passes_add_up_too() -> None:
    scene = make_scene(**LIGHTS["point"])
    settings = {"integrator": "path", "clamp_direct": 0.3, "clamp_indirect": 0.1, "filter_glossy": 1.0}
    film = raytracer.render(scene, 24, 16, 4, passes=ALL, **settings)
    free = raytracer.render(scene, 24, 16, 4, integrator="path")
    assert not np.allclose(film["Combined"], free["Combined"])
    np.testing.assert_allclose(add_up(film), film["Combined"][..., :3], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_light_passes_change_no_other_pass(integrator: str) -> None:
    scene = make_scene(**LIGHTS["mesh and world"])
    with_passes = raytracer.render(scene, 16, 12, 3, passes=ALL, integrator=integrator)
    without = raytracer.render(scene, 16, 12, 3, passes=("Combined", "Diffuse Color"), integrator=integrator)
    for name in ("Combined", "Diffuse Color"):
        np.testing.assert_array_equal(with_passes[name], without[name])


def test_scene_pays_nothing_for_light_passes_that_nobody_asks_for(monkeypatch: pytest.MonkeyPatch) -> None:
    forbid(monkeypatch, "start_parts", "_split_light", "add_aimed", "add_parts", "sum_lobe_colors", "add_mist")
    raytracer.render(make_scene(**LIGHTS["mesh and world"]), 16, 12, 2, passes=("Combined", "Normal"))


def look_down(material: raytracer.Material, **fields: Any) -> raytracer.Film:
    """Render a floor that fills the picture, seen from 4 m above."""
    above = np.eye(4)
    above[2, 3] = 4.0
    floor = raytracer.Mesh([(-99, -99, 0), (99, -99, 0), (99, 99, 0), (-99, 99, 0)], [(0, 1, 2), (0, 2, 3)])
    scene = raytracer.Scene(meshes=[floor], materials=[material], camera=raytracer.Camera(above), **fields)
    return raytracer.render(scene, 6, 4, 4, passes=ALL, integrator="path")


def test_direct_light_of_a_diffuse_floor_is_the_suns_over_pi() -> None:
    """A sun of the irradiance E, 60 degrees from the normal: L = albedo E cos / pi; the pass leaves the albedo out."""
    sun = raytracer.SunLight((0, np.sqrt(0.75), 0.5), (3.0, 2.0, 1.0))
    film = look_down(make_material(raytracer.Closure("diffuse", color=(0.5, 0.25, 0.0))), lights=[sun])
    expected = np.array([3.0, 2.0, 0.0]) * 0.5 / np.pi
    expected[2] = expected[:2].mean()  # of what the floor does not reflect nothing is known: grey
    np.testing.assert_allclose(film["Diffuse Direct"], np.broadcast_to(expected, (4, 6, 3)), rtol=4 * FLOAT32)
    np.testing.assert_allclose(film["Diffuse Color"], np.broadcast_to((0.5, 0.25, 0.0), (4, 6, 3)), rtol=FLOAT32)
    for name in ("Diffuse Indirect", *SPLIT[2:], *COLORS[1:], "Environment", "Emission"):
        assert not film[name].any(), name


def test_what_a_mirror_shows_of_the_world_is_glossy_and_direct() -> None:
    tint = (0.9, 0.5, 0.2)
    film = look_down(
        make_material(raytracer.Closure("glossy", color=tint, roughness=0.0)), world=raytracer.World((1.0, 2.0, 3.0))
    )
    np.testing.assert_allclose(film["Glossy Direct"], np.broadcast_to((1.0, 2.0, 3.0), (4, 6, 3)), rtol=4 * FLOAT32)
    np.testing.assert_allclose(film["Glossy Color"], np.broadcast_to(tint, (4, 6, 3)), rtol=4 * FLOAT32)
    assert not film["Glossy Indirect"].any()
    assert not film["Diffuse Direct"].any()


def test_what_is_seen_through_a_pane_is_transmitted_and_what_it_mirrors_glossy() -> None:
    """Glass of the same index inside and out: all is transmitted, nothing reflected."""
    film = look_down(
        make_material(raytracer.Closure("refraction", color=(1, 1, 1), ior=1.0, roughness=0.0)),
        world=raytracer.World((1, 1, 1)),
    )
    np.testing.assert_allclose(film["Transmission Direct"], 1.0, rtol=4 * FLOAT32)
    np.testing.assert_allclose(film["Transmission Color"], 1.0, rtol=4 * FLOAT32)
    assert not film["Glossy Direct"].any()


@pytest.mark.parametrize(("power", "share"), [(1.0, 0.25), (2.0, 0.0625), (0.5, 0.5)])
def test_mist_is_a_power_of_the_share_of_its_depth(power: float, share: float) -> None:
    """Of a ball around the camera, 4 m away: 1 m behind where mist starts, of 4 m until it hides everything."""
    ball = raytracer.Spheres([(0, 0, 0)], [4.0])
    scene = raytracer.Scene(spheres=[ball], materials=MATERIALS[:1], camera=raytracer.Camera(np.eye(4)))
    film = raytracer.render(scene, 8, 6, 2, passes=("Mist",), mist=(3.0, 4.0, power))
    np.testing.assert_allclose(film["Mist"], share, rtol=1e-6)
    assert (raytracer.render(scene, 8, 6, 2, passes=("Mist",), mist=(5.0, 4.0, power))["Mist"] == 0).all()
    empty = raytracer.Scene(camera=raytracer.Camera(np.eye(4)))
    assert (raytracer.render(empty, 8, 6, 2, passes=("Mist",))["Mist"] == 1).all()


def test_world_left_out_of_the_picture_is_in_its_own_pass() -> None:
    scene = raytracer.Scene(world=raytracer.World((0.5, 1.0, 1.5)), camera=raytracer.Camera(np.eye(4)))
    film = raytracer.render(scene, 4, 3, 2, passes=("Combined", "Environment"), transparent=True)
    assert not film["Combined"].any()
    np.testing.assert_array_equal(film["Environment"], np.broadcast_to(np.float32((0.5, 1.0, 1.5)), (3, 4, 3)))


def test_light_over_a_color_is_grey_where_the_color_has_no_channel() -> None:
    light, color = (
        np.array([[1.0, 2.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 0.0]]),
        np.array([[0.5, 0.5, 0.0], [1, 0, 0], [0, 0, 0]]),
    )
    np.testing.assert_array_equal(divide_by_color(light, color), [[2.0, 4.0, 3.0], [3.0, 3.0, 3.0], [0.0, 0.0, 0.0]])


def test_a_pass_of_light_keeps_the_color_that_it_is_divided_by() -> None:
    assert select_passes(["Glossy Direct", "Depth"], from_centre=False) == ("Glossy Direct", "Glossy Color")
    assert {PASSES[name].color for name in SPLIT} == set(COLORS)


@pytest.mark.parametrize("mist", [(1.0, 2.0), (-1.0, 2.0, 1.0), (1.0, np.nan, 1.0), "far"])
def test_bad_mist_is_refused_by_name(mist: Any) -> None:
    with pytest.raises(ValueError, match=r"^Settings: mist: expected"):
        raytracer.Settings(mist=mist)


def test_exposure_is_a_factor_of_light_alone() -> None:
    scene = make_scene(**LIGHTS["mesh and world"])
    names = (*ALL, "Normal", "Shadow", "Error")
    plain, bright = (raytracer.render(scene, 12, 8, 4, passes=names, exposure=factor) for factor in (1.0, 2.5))
    for name in names:
        factor = np.where(np.arange(plain[name].shape[2]) < 3, 2.5, 1.0) if PASSES[name].exposed else 1.0
        np.testing.assert_allclose(bright[name], plain[name] * factor, rtol=2 * FLOAT32, err_msg=name)
    assert {name for name in names if PASSES[name].exposed} == {"Combined", *SPLIT, "Environment", "Emission", "Error"}
    assert bright.error == plain.error
