"""What denoisers take: of wide surfaces at once, of mirrors what is seen in them; nothing where nobody asks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import raytracer
from raytracer.film.passes import GUIDES
from tests.forbidding import forbid

FLOAT32 = float(np.finfo(np.float32).eps)
ABOVE = np.eye(4)
ABOVE[2, 3] = 4.0


def make_layer(height: float, material: int, tilt: float = 0.0) -> raytracer.Mesh:
    corners = [(x, y, height + tilt * x) for x, y in ((-99, -99), (99, -99), (99, 99), (-99, 99))]
    return raytracer.Mesh(corners, [(0, 1, 2), (0, 2, 3)], material=material)


def see(*layers: raytracer.Closure, heights: tuple[float, ...] = (0.0,), **fields: Any) -> raytracer.Film:
    """Render layers seen from 4 m above, by an orthographic camera."""
    settings = {name: fields.pop(name) for name in ("transparent", "max_bounces", "samples") if name in fields}
    camera = raytracer.Camera(fields.pop("view", ABOVE), "orthographic", clip_start=0.5)
    scene = raytracer.Scene(
        meshes=[make_layer(height, number, fields.get("tilt", 0.0)) for number, height in enumerate(heights)],
        materials=[raytracer.Material([closure]) for closure in layers],
        camera=camera,
        world=fields.get("world"),
    )
    settings = {"samples": 4, "integrator": "path", **settings}
    return raytracer.render(scene, 4, 3, passes=("Combined", *GUIDES), **settings)


def is_all(values: np.ndarray, expected: Any) -> None:
    np.testing.assert_allclose(values, np.broadcast_to(np.float32(expected), values.shape), rtol=8 * FLOAT32, atol=1e-7)


def test_wide_surface_tells_its_own() -> None:
    """The slope 3/4 to the right: the normal leans left, and z points away from the viewer."""
    film = see(raytracer.Closure("diffuse", color=(0.5, 0.25, 0.75)), tilt=0.75)
    is_all(film["Denoising Albedo"], (0.5, 0.25, 0.75))
    is_all(film["Denoising Normal"], (-0.6, 0.0, -0.8))
    flat = see(raytracer.Closure("diffuse"))
    is_all(flat["Denoising Depth"], 3.5)  # from where the camera begins to see


def test_normal_turns_with_the_camera() -> None:
    turned = ABOVE.copy()
    turned[:3, :3] = ((0, -1, 0), (1, 0, 0), (0, 0, 1))
    film = see(raytracer.Closure("diffuse"), tilt=0.75, view=turned)
    is_all(film["Denoising Normal"], (0.0, 0.6, -0.8))


def test_mirror_shows_what_is_in_it() -> None:
    """A mirror below, a ceiling behind the camera, 5 m above it: 3.5 m, and then as far again and 1.5 m."""
    mirror = raytracer.Closure("glossy", color=(0.5, 1.0, 0.25), roughness=0.0)
    ceiling = raytracer.Closure("diffuse", color=(0.8, 0.4, 0.2))
    film = see(mirror, ceiling, heights=(0.0, 5.0))
    is_all(film["Denoising Albedo"], (0.4, 0.4, 0.05))
    is_all(film["Denoising Normal"], (0.0, 0.0, 1.0))
    share = (0.5 + 1.0 + 0.25) / 3.0
    is_all(film["Denoising Depth"], 3.5 + share * 5.0)


@pytest.mark.parametrize(("roughness", "tells"), [(0.27, False), (0.28, True)])
def test_surface_is_wide_from_an_alpha_of_75_thousandths_on(roughness: float, tells: bool) -> None:
    film = see(raytracer.Closure("glossy", color=(0.5, 0.5, 0.5), roughness=roughness))
    expected = 0.5 if tells else 0.0  # less what gets lost between facets
    np.testing.assert_allclose(film["Denoising Albedo"], expected, rtol=0.01)
    is_all(film["Denoising Normal"], (0, 0, -1) if tells else 0.0)


@pytest.mark.parametrize("transparent", [False, True])
def test_light_that_is_met_counts_as_albedo(transparent: bool) -> None:
    world = raytracer.World((0.25, 0.5, 2.0))
    mirror = raytracer.Closure("glossy", color=(0.5, 1.0, 0.25), roughness=0.0)
    film = see(mirror, world=world, transparent=transparent)
    # As in Cycles, light has been dimmed by the mirror, and is so again.
    is_all(film["Denoising Albedo"], (0.0625, 0.5, 0.125))
    glow = see(raytracer.Closure("emission", color=(3.0, 2.0, 1.0)))
    is_all(glow["Denoising Albedo"], (3.0, 2.0, 1.0))
    assert not glow["Denoising Normal"].any()
    empty = see(heights=(), world=world, transparent=transparent)
    is_all(empty["Denoising Albedo"], (0.25, 0.5, 2.0))


def test_path_that_has_used_up_its_bounces_finds_nothing() -> None:
    mirror = raytracer.Closure("glossy", color=(0.5, 0.5, 0.5), roughness=0.0)
    film = see(mirror, raytracer.Closure("diffuse"), heights=(0.0, 5.0), max_bounces=0)
    assert not film["Denoising Albedo"].any()
    is_all(film["Denoising Depth"], 3.5 + 0.5 * 5.0)


def test_guides_change_no_other_pass() -> None:
    scene = raytracer.Scene(
        meshes=[make_layer(0.0, 0), make_layer(1.0, 1)],
        materials=[
            raytracer.Material([raytracer.Closure("diffuse")]),
            raytracer.Material([raytracer.Closure("glass", roughness=0.1)]),
        ],
        camera=raytracer.Camera(ABOVE),
        world=raytracer.World((0.3, 0.4, 0.5)),
    )
    for integrator in ("direct", "path"):
        plain = raytracer.render(scene, 6, 4, 3, integrator=integrator)
        guided = raytracer.render(scene, 6, 4, 3, integrator=integrator, passes=("Combined", *GUIDES))
        np.testing.assert_array_equal(plain["Combined"], guided["Combined"])


def test_scene_pays_nothing_for_guides_that_nobody_asks_for(monkeypatch: pytest.MonkeyPatch) -> None:
    forbid(monkeypatch, "start_guides", "split_shading", "sum_lobe_colors", "find_camera_axes", "measure_stretch")
    scene = raytracer.Scene(
        meshes=[make_layer(0.0, 0)], camera=raytracer.Camera(ABOVE), world=raytracer.World((0.3, 0.4, 0.5))
    )
    raytracer.render(scene, 6, 4, 2, passes=("Combined", "Normal", "Diffuse Direct"))
