"""The Ambient Occlusion pass: the share of a cosine-weighed hemisphere that is open, in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import raytracer
from tests.forbidding import forbid

NAME = "Ambient Occlusion"
HEIGHT = 5.0
# The standard error of 12 pixels of 256 independent samples; those of a sequence have less.
NOISE = 0.5 / (12 * 256) ** 0.5
ABOVE = np.eye(4)
ABOVE[2, 3] = 4.0


def make_layer(height: float, material: int) -> raytracer.Mesh:
    corners = [(x, y, height) for x, y in ((-999, -999), (999, -999), (999, 999), (-999, 999))]
    return raytracer.Mesh(corners, [(0, 1, 2), (0, 2, 3)], material=material)


def see(*layers: tuple[float, raytracer.Closure], samples: int = 256, **settings: Any) -> raytracer.Film:
    """Render layers, floor first, by a camera 4 m above the floor."""
    scene = raytracer.Scene(
        meshes=[make_layer(height, number) for number, (height, _) in enumerate(layers)],
        materials=[raytracer.Material([closure]) for _, closure in layers],
        camera=raytracer.Camera(ABOVE, "orthographic"),
    )
    return raytracer.render(scene, 4, 3, samples, passes=(NAME,), **settings)


FLOOR = (0.0, raytracer.Closure("diffuse"))


@pytest.mark.parametrize("reach", [4.0, 5.5, 10.0, 100.0])
def test_floor_under_a_ceiling_is_open_beside_the_cone_that_reaches_it(reach: float) -> None:
    """Rays within cos a > h / d meet a ceiling h above in less than d, of which the share is sin^2 a."""
    expected = min(HEIGHT / reach, 1.0) ** 2
    film = see(FLOOR, (HEIGHT, raytracer.Closure("diffuse")), occlusion_distance=reach)
    assert film[NAME].mean() == pytest.approx(expected, abs=NOISE)


def test_what_is_transparent_lets_its_color_through() -> None:
    tint = np.array([0.75, 0.5, 0.25])
    film = see(FLOOR, (HEIGHT, raytracer.Closure("transparent", color=tint)), occlusion_distance=10.0)
    np.testing.assert_allclose(film[NAME].mean(axis=(0, 1)), 1.0 - 0.75 * (1.0 - tint), atol=NOISE)


def test_surfaces_count_by_what_they_cover() -> None:
    """A sheet in front of the floor, 2 m above it: open itself; the floor behind it is seen, and lit, through it."""
    sheet = (2.0, raytracer.Closure("transparent", color=(0.5, 0.5, 0.5)))
    film = see(FLOOR, sheet, occlusion_distance=1e3, samples=1024)
    assert film[NAME].mean() == pytest.approx(0.5 + 0.5 * 0.5, abs=NOISE)
    assert not see(samples=4)[NAME].any()


def test_mirror_counts_as_what_it_is_not_as_what_it_shows() -> None:
    mirror = (0.0, raytracer.Closure("glossy", roughness=0.0))
    film = see(mirror, (HEIGHT, raytracer.Closure("diffuse")), occlusion_distance=10.0)
    assert film[NAME].mean() == pytest.approx(0.25, abs=NOISE)


def test_ambient_occlusion_changes_no_other_pass_and_costs_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = raytracer.Scene(
        meshes=[make_layer(0.0, 0), make_layer(HEIGHT, 0)],
        materials=[raytracer.Material([raytracer.Closure("principled")])],
        camera=raytracer.Camera(ABOVE),
        lights=[raytracer.PointLight((0, 0, 3), 50.0)],
    )
    for integrator in ("direct", "path"):
        settings = {"integrator": integrator, "samples": 3}
        asked = raytracer.render(scene, 6, 4, passes=("Combined", NAME), **settings)
        with monkeypatch.context() as patched:
            forbid(patched, "aim_around")
            plain = raytracer.render(scene, 6, 4, **settings)
        np.testing.assert_array_equal(asked["Combined"], plain["Combined"])


@pytest.mark.parametrize("reach", [-1.0, np.nan, np.inf, "far"])
def test_bad_distance_is_refused_by_name(reach: Any) -> None:
    with pytest.raises(ValueError, match=r"^Settings: occlusion_distance: expected"):
        raytracer.Settings(occlusion_distance=reach)
