"""Light groups: all together are Combined, each is the picture of its lights alone, and nobody else pays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raytracer
from raytracer.film.passes import LIGHT_GROUP
from tests.forbidding import forbid
from tests.raytracer.integrator.test_light_passes import make_scene

NAMES = ("key", "rim", "sky")
PASSES = tuple(LIGHT_GROUP + name for name in NAMES)
LAMPS = [
    raytracer.PointLight((2, -3, 4), 300.0, radius=0.3),
    raytracer.SunLight((0.3, 0.2, 1.0), (1.0, 0.5, 0.25), 0.1),
    raytracer.AreaLight((-3, 0, 3), (1, 0, 0), (0, 1, 0), (40.0, 60.0, 80.0)),
]
WORLD = raytracer.World((0.3, 0.4, 0.5))


def make_grouped(lights: Any, objects: Any, world: int, lamps: Any = LAMPS) -> raytracer.Scene:
    """The stage of the light passes with an emissive mesh, number 2 of its objects, lamps and a world."""
    scene = make_scene(shining=True, lights=lamps, world=WORLD)
    groups = raytracer.LightGroups(NAMES, lights, objects, world)
    return replace(scene, light_groups=groups)


def see(scene: raytracer.Scene, passes: tuple[str, ...] = ("Combined", *PASSES), **settings: Any) -> raytracer.Film:
    return raytracer.render(scene, 24, 16, 4, passes=passes, **{"integrator": "path", **settings})


def add_up(film: raytracer.Film, names: tuple[str, ...] = PASSES) -> np.ndarray:
    return np.sum([film[name].astype(float) for name in names], axis=0)


EVERYTHING = {"lights": [0, 1, 1], "objects": [-1, -1, 1, -1], "world": 2}


@pytest.mark.parametrize("settings", [{}, {"integrator": "direct"}, {"clamp_direct": 0.3, "clamp_indirect": 0.1}])
def test_groups_add_up_to_combined(settings: dict[str, Any]) -> None:
    film = see(make_grouped(**EVERYTHING), **settings)
    combined = film["Combined"][..., :3].astype(float)
    assert all(film[name].any() for name in PASSES)
    np.testing.assert_allclose(add_up(film), combined, rtol=1e-6, atol=1e-6)


def test_group_is_the_same_whatever_else_is_grouped_and_the_rest_is_what_is_left() -> None:
    """What is in no group is that which a group of its own would show."""
    whole = see(make_grouped(**EVERYTHING))
    part = see(make_grouped([0, -1, -1], [-1, -1, -1, -1], 2))
    for name in (PASSES[0], PASSES[2]):
        np.testing.assert_array_equal(part[name], whole[name])
    assert not part[PASSES[1]].any()
    rest = part["Combined"][..., :3].astype(float) - add_up(part)
    np.testing.assert_allclose(rest, whole[PASSES[1]], rtol=1e-6, atol=2e-6)


def test_groups_of_many_lights_add_up_too() -> None:
    """More than are all aimed at: a few are picked for each point, of any group."""
    lamps = [raytracer.PointLight((0.2 * x - 4, -4, 3), 5.0 + x, radius=0.05) for x in range(40)]
    film = see(make_grouped([x % 2 for x in range(40)], [-1] * 4, 2, lamps=lamps))
    emitted = film["Combined"][..., :3].astype(float) - add_up(film)
    assert film[PASSES[0]].any()
    assert film[PASSES[1]].any()
    shining = see(make_grouped([-1] * 40, [0, 0, 0, 0], -1, lamps=lamps))[PASSES[0]]
    np.testing.assert_allclose(emitted, shining, rtol=1e-6, atol=2e-6)


def test_group_of_one_light_is_the_picture_of_that_light() -> None:
    """A point over a floor, which nothing else changes: the same samples, but for the others."""
    film = see(make_grouped([0, -1, -1], [-1] * 4, -1), integrator="direct")
    alone = see(make_grouped([0, -1, -1], [-1] * 4, -1), integrator="direct", passes=("Combined", PASSES[0]))
    np.testing.assert_array_equal(film[PASSES[0]], alone[PASSES[0]])
    lit = make_scene(lights=LAMPS[:1])
    single = see(lit, ("Combined",), integrator="direct")["Combined"][..., :3]
    assert film[PASSES[0]].mean() == pytest.approx(single.mean(), rel=0.05)


def test_world_left_out_of_the_picture_is_in_its_group() -> None:
    """As in Cycles, which shows it in Environment as well."""
    film = see(make_grouped(**EVERYTHING), ("Combined", *PASSES, "Environment"), transparent=True)
    solid = see(make_grouped(**EVERYTHING))
    np.testing.assert_allclose(film[PASSES[2]], solid[PASSES[2]], rtol=1e-6, atol=1e-6)
    difference = add_up(film) - film["Combined"][..., :3]
    np.testing.assert_allclose(difference, film["Environment"], rtol=1e-6, atol=2e-6)


def test_groups_change_no_other_pass_and_cost_nothing_where_nobody_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = make_grouped(**EVERYTHING)
    names = ("Combined", "Normal", "Diffuse Direct")
    grouped = see(scene, (*names, *PASSES))
    forbid(monkeypatch, "group_source", "find_number")
    plain = see(scene, names)
    for name in names:
        np.testing.assert_array_equal(grouped[name], plain[name])


def test_groups_stay_with_scenes_and_films(tmp_path: Path) -> None:
    raytracer.save(make_grouped(**EVERYTHING), tmp_path / "scene.npz")
    scene = raytracer.load(tmp_path / "scene.npz")
    half = raytracer.render(scene, 8, 6, 2, passes=PASSES)
    raytracer.save_film(half, tmp_path / "film.npz")
    film = raytracer.render(scene, 8, 6, 4, passes=PASSES, film=raytracer.load_film(tmp_path / "film.npz"))
    whole = raytracer.render(make_grouped(**EVERYTHING), 8, 6, 4, passes=PASSES)
    tiles = [raytracer.render(scene, 8, 6, 4, passes=PASSES, tile=(number, 2)) for number in (1, 2)]
    merged = raytracer.merge(tiles)
    for name in PASSES:
        np.testing.assert_array_equal(film[name], whole[name])
        np.testing.assert_array_equal(merged[name], whole[name])


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"names": ()}, "LightGroups: names: expected"),
        ({"names": ("a", "a")}, "LightGroups: names: expected"),
        ({"names": ("a",), "lights": [1]}, "LightGroups: lights: expected"),
        ({"names": ("a",), "objects": [[0]]}, "LightGroups: objects: expected"),
        ({"names": ("a",), "world": -2}, "LightGroups: world: expected"),
    ],
)
def test_bad_groups_are_refused_by_name(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}"):
        raytracer.LightGroups(**fields)
    with pytest.raises(ValueError, match=r"^Scene: light_groups: lights: expected 0 numbers, got 1"):
        raytracer.Scene(light_groups=raytracer.LightGroups(("a",), [0]))
