"""Passes that shaders write: what surfaces and the world write, as a closed form; nothing where nobody asks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raytracer
from raytracer.film.film_picture import list_channels
from tests.forbidding import forbid

VALUE, COLOR = "AOV Value mask", "AOV Color tint"
NAMES = (VALUE, COLOR)
FLOAT32 = float(np.finfo(np.float32).eps)
ABOVE = np.eye(4)
ABOVE[2, 3] = 4.0
# The height of a point, as a number.
HEIGHT = raytracer.Program(
    [
        raytracer.Step("NEW_GEOMETRY Position"),
        raytracer.Step("SEPXYZ", [raytracer.Register(0, "Position")]),
    ]
)


def make_layer(height: float, material: int) -> raytracer.Mesh:
    corners = [(-99, -99, height), (99, -99, height), (99, 99, height), (-99, 99, height)]
    return raytracer.Mesh(corners, [(0, 1, 2), (0, 2, 3)], material=material)


def make_scene(*aovs: raytracer.Aovs | None, alpha: float = 1.0, **fields: Any) -> raytracer.Scene:
    """A floor, and one layer above it for each further Aovs, of which all but the floor are `alpha` opaque."""
    closures = [
        (raytracer.Closure("principled", color=(1, 1, 1), alpha=alpha if row else 1.0),) for row in range(len(aovs))
    ]
    materials = [raytracer.Material(closure, aovs=own) for closure, own in zip(closures, aovs, strict=True)]
    layers = [make_layer(float(row), row) for row in range(len(aovs))]
    return raytracer.Scene(meshes=layers, materials=materials, camera=raytracer.Camera(ABOVE), **fields)


def see(scene: raytracer.Scene, passes: tuple[str, ...] = NAMES, samples: int = 4, **settings: Any) -> raytracer.Film:
    return raytracer.render(scene, 6, 4, samples, passes=passes, **settings)


def test_surface_writes_constants_and_what_a_program_makes() -> None:
    film = see(make_scene(raytracer.Aovs({VALUE: -2.5, COLOR: (1.0, -2.0, 3.0)})))
    assert (film[VALUE] == -2.5).all()
    np.testing.assert_array_equal(film[COLOR], np.broadcast_to(np.float32((1, -2, 3, 1)), (4, 6, 4)))
    height = raytracer.Aovs({VALUE: raytracer.Register(1, "Z"), COLOR: raytracer.Register(0, "Position")}, HEIGHT)
    film = see(make_scene(None, None, height))
    np.testing.assert_allclose(film[VALUE], 2.0, rtol=FLOAT32)
    np.testing.assert_allclose(film[COLOR][..., 2], 2.0, rtol=FLOAT32)
    assert film[COLOR][0, 0, 0] < 0 < film[COLOR][0, -1, 0]


@pytest.mark.parametrize("passes", [NAMES, ("Combined", *NAMES)])
@pytest.mark.parametrize(("alpha", "expected"), [(0.25, 5.0 + 0.75 * 2.0), (0.5, 5.0), (0.75, 5.0)])
def test_what_lies_behind_counts_by_what_is_let_through(alpha: float, expected: float, passes: tuple[str, ...]) -> None:
    """Up to the first surface that is half opaque; with light, chance decides which paths go on."""
    lower, upper = (raytracer.Aovs({VALUE: value, COLOR: (value, 0, 0)}) for value in (2.0, 5.0))
    film = see(make_scene(lower, upper, alpha=alpha), passes, samples=256)
    assert film[VALUE].mean() == pytest.approx(expected, rel=0.01)
    assert film[COLOR][..., 0].mean() == pytest.approx(expected, rel=0.01)
    assert film[COLOR][..., 3].mean() == pytest.approx(1.0 if alpha >= 0.5 else 1.75, rel=0.01)


def test_world_writes_where_it_is_seen_and_part_of_the_picture() -> None:
    world = raytracer.World(0.5, aovs=raytracer.Aovs({VALUE: raytracer.Register(1, "Z")}, HEIGHT))
    empty = raytracer.Scene(world=world, camera=raytracer.Camera(ABOVE))
    film = see(empty, samples=64)
    assert film[VALUE].max() == pytest.approx(-0.95, abs=0.06)  # it is a sphere of directions, seen downwards
    assert not see(empty, transparent=True)[VALUE].any()
    assert not see(make_scene(None, world=world))[VALUE].any()


def test_what_is_not_seen_straight_writes_nothing() -> None:
    """Behind a mirror stands the camera; the mirror writes, what it shows does not."""
    materials = [
        raytracer.Material([raytracer.Closure("glossy", roughness=0.0)], aovs=raytracer.Aovs({VALUE: 1.0})),
        raytracer.Material([raytracer.Closure("emission")], aovs=raytracer.Aovs({VALUE: 8.0})),
    ]
    scene = raytracer.Scene(
        meshes=[make_layer(0.0, 0), make_layer(9.0, 1)], materials=materials, camera=raytracer.Camera(ABOVE)
    )
    film = see(scene, ("Combined", VALUE))
    assert film["Combined"][..., :3].any()
    assert (film[VALUE] == 1.0).all()


def test_aovs_change_no_other_pass() -> None:
    """Not even those that cast rays or ask how the ray came."""
    occlusion = raytracer.Program([raytracer.Step("AMBIENT_OCCLUSION", (np.ones(3), 9.0, np.zeros(3)), AO)])
    depth = raytracer.Program([raytracer.Step("LIGHT_PATH Is Camera Ray")])
    aovs = [
        raytracer.Aovs({VALUE: raytracer.Register(0, "AO")}, occlusion),
        raytracer.Aovs({VALUE: raytracer.Register(0, "Is Camera Ray")}, depth),
    ]
    plain, written = make_scene(None, None, alpha=0.4, **LIT), make_scene(*aovs, alpha=0.4, **LIT)
    for integrator in ("direct", "path"):
        names = ("Combined", "Normal", "Diffuse Color")
        with_aovs = see(written, (*names, VALUE), integrator=integrator)
        without = see(plain, names, integrator=integrator)
        for name in names:
            np.testing.assert_array_equal(with_aovs[name], without[name])
        assert (with_aovs[VALUE] >= 1.0).all()  # the upper layer is seen by the camera
        assert with_aovs[VALUE].max() > 1.1  # what is open above the lower one is added


AO = {"samples": 1, "inside": False, "only_local": False}
LIT = {"world": raytracer.World((0.3, 0.4, 0.5)), "lights": [raytracer.PointLight((0, 0, 3), 50.0)]}


def test_scene_pays_nothing_for_aovs_that_nobody_asks_for(monkeypatch: pytest.MonkeyPatch) -> None:
    aovs = raytracer.Aovs({VALUE: raytracer.Register(1, "Z")}, HEIGHT)
    scene = make_scene(aovs, world=raytracer.World(0.5, aovs=aovs))
    forbid(monkeypatch, "list_written", "list_written_by_sky", "make_material_aovs", "make_site_tables", "add_written")
    see(scene, ("Combined", "Normal"))


def test_aovs_stay_with_scenes_and_films(tmp_path: Path) -> None:
    aovs = raytracer.Aovs({VALUE: raytracer.Register(1, "Z"), COLOR: (0.1, 0.2, 0.3)}, HEIGHT)
    scene = make_scene(None, aovs, world=raytracer.World(0.5, aovs=aovs))
    raytracer.save(scene, tmp_path / "scene.npz")
    scene = raytracer.load(tmp_path / "scene.npz")
    half = see(scene, samples=2)
    raytracer.save_film(half, tmp_path / "film.npz")
    film = see(scene, samples=4, film=raytracer.load_film(tmp_path / "film.npz"))
    whole = see(scene, samples=4)
    for name in NAMES:
        np.testing.assert_array_equal(film[name], whole[name])
    assert {"mask.V", "tint.R", "tint.A"} <= dict(list_channels(film)).keys()


def test_color_in_a_pass_of_numbers_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match=r"^Aovs: 'AOV Value mask': expected a number"):
        see(make_scene(raytracer.Aovs({VALUE: (1, 2, 3)})))
    with pytest.raises(ValueError, match=r"^Settings: passes: expected one of .*AOV Value \.\.\."):
        see(make_scene(None), ("AOV Value ",))
    with pytest.raises(ValueError, match=r"^Aovs: 'AOV Value mask': expected a register"):
        raytracer.Aovs({VALUE: raytracer.Register(0, "Z")})
