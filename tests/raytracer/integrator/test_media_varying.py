"""Media that vary, against integrals along rays; `test_media` says how exact."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import raytracer
from raytracer import (
    Closure,
    Grid,
    Instances,
    Material,
    Mesh,
    PointLight,
    Program,
    Register,
    Scene,
    Step,
    SunLight,
    Volume,
    VolumeClosure,
    World,
)
from tests.raytracer.integrator.media_scenes import (
    COLORS,
    DENSITY,
    RISING,
    WHITE,
    assert_close,
    decay,
    fill,
    look,
    make_box,
    measure,
    sum_midpoints,
)


def test_a_rising_density_lets_through_what_its_integral_says() -> None:
    """The integral of 2 (y + 1) from -1 to 1 is 4; seen through ratio tracking, straight and by shadow rays."""
    smoke = fill(VolumeClosure("absorption", color=COLORS, density=DENSITY), program=RISING)
    scene = Scene(meshes=make_box(1.0), materials=smoke, camera=look(), world=WHITE)
    found = measure(scene, 256)
    assert (found[1] < 0.01).all()
    assert_close(found, decay(4.0))


@pytest.mark.parametrize("scale", [(1.0, 0.0, 1.0), (0.0, 0.0, 0.0)])
def test_a_varying_medium_in_an_object_without_extent_is_nowhere(scale: Any) -> None:
    """As where its scale grows from 0: its matrix has no inverse, which ended the render."""
    smoke = fill(VolumeClosure("absorption", color=COLORS, density=DENSITY), program=RISING)
    placed = Instances([0], [np.diag([*scale, 1.0])])
    scene = Scene(meshes=make_box(1.0), instances=placed, materials=smoke, camera=look(), world=WHITE)
    np.testing.assert_allclose(measure(scene, 4)[0], 1.0)


@pytest.mark.parametrize("sun_first", [True, False])
def test_the_ways_to_a_surface_and_from_there_to_light_are_independent(sun_first: bool) -> None:
    """A wall in the middle: its sight and its light go through the same half of a box, of depth 1, each by chance.

    With the same random numbers for both, light of the first source arrived where sight did: 1.4 times too much of red.
    """
    smoke = fill(VolumeClosure("absorption", color=COLORS, density=DENSITY), program=RISING)
    wall = Mesh(
        positions=[(-0.9, 0, -0.9), (0.9, 0, -0.9), (0.9, 0, 0.9), (-0.9, 0, 0.9)],
        triangles=[(0, 1, 2), (0, 2, 3)],
        material=1,
    )
    lights = [SunLight((0.0, -1.0, 0.0), np.pi), PointLight((0.0, -4.0, 0.0), 4.0 * np.pi**2 * 16.0)]
    scene = Scene(
        meshes=[make_box(1.0), wall],
        materials=[smoke, Material((Closure("diffuse", color=1.0),))],
        lights=lights if sun_first else lights[::-1],
        camera=look(),
    )
    found = measure(scene, 256)
    assert (found[1] < 0.02).all()
    assert_close(found, 2.0 * decay(2.0))


def test_a_rising_density_scatters_a_suns_light_as_quadrature_says() -> None:
    smoke = fill(VolumeClosure("scatter", color=1.0, density=DENSITY), program=RISING)
    sun = SunLight((0, 0, 1), 10.0)
    scene = Scene(meshes=make_box(1.0), materials=smoke, camera=look(), lights=sun)
    expected = sum_midpoints(
        lambda y: np.exp(-((y + 1.0) ** 2)) * 2.0 * (y + 1.0) / (4.0 * np.pi) * 10.0 * np.exp(-2.0 * (y + 1.0))
    )
    found = measure(scene, 256, max_bounces=0, integrator="direct")
    assert (found[1] < 0.02 * expected).all()
    assert_close(found, expected)


def test_a_rising_density_scatters_a_lamps_light_as_quadrature_says() -> None:
    smoke = fill(VolumeClosure("scatter", color=1.0, density=DENSITY), program=RISING)
    scene = Scene(meshes=make_box(1.0), materials=smoke, camera=look(), lights=PointLight((0, 0, 0.1), 10.0))

    def see(y: Any) -> Any:
        distance = np.sqrt(y * y + 0.01)
        depth = distance * (2.0 + y)  # the mean of 2 (y + 1) along a straight way to y = 0
        light = 10.0 / (4.0 * np.pi * distance**2) * np.exp(-depth)
        return np.exp(-((y + 1.0) ** 2)) * 2.0 * (y + 1.0) / (4.0 * np.pi) * light

    expected = sum_midpoints(see)
    found = measure(scene, 256, max_bounces=0, integrator="direct")
    assert (found[1] < 0.02 * expected).all()
    assert_close(found, expected)


def test_a_grid_of_voxels_is_a_density() -> None:
    """Values 0, 1, 2 ... along y, linear between, from the first voxel's middle to the last one's."""
    values = np.broadcast_to(np.arange(5.0)[np.newaxis, :, np.newaxis], (2, 5, 2))
    place = np.diag([2.0, 0.5, 2.0, 1.0])
    place[:3, 3] = -1.0
    smoke = fill(
        VolumeClosure("absorption", color=COLORS, density=Register(0, "Fac")),
        program=Program((Step("ATTRIBUTE Fac", settings={"name": "density"}),)),
    )
    box = make_box(1.0, grids={"density": Grid(values, place)})
    scene = Scene(meshes=box, materials=smoke, camera=look(), world=WHITE)
    assert_close(measure(scene, 256), decay(4.0))


def test_a_varying_emission_is_the_integral_along_the_ray() -> None:
    """2 (y + 1) of light per metre behind an absorption of 1: the integral of 2 (y + 1) exp(-(y + 1)) is 2 - 6 e^-2."""
    color = [Register(3, "Value")]
    glow = VolumeClosure("coefficients", absorption=1.0, emission=color[0])
    scene = Scene(meshes=make_box(1.0), materials=fill(glow, program=RISING), camera=look())
    found = measure(scene, 256)
    assert (found[1] < 0.01).all()
    assert_close(found, 2.0 - 6.0 * np.exp(-2.0))


def test_a_bound_that_is_too_low_costs_noise_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("raytracer.media.majorants.SPARE", 0.4)
    smoke = fill(VolumeClosure("absorption", color=COLORS, density=DENSITY), program=RISING)
    scene = Scene(meshes=make_box(1.0), materials=smoke, camera=look(), world=WHITE)
    assert_close(measure(scene, 1024), decay(4.0))


def test_a_world_that_varies_ends_far_away_and_not_before() -> None:
    """A fog whose density falls with the height, exp(-z) from z = 0 on, seen from there: exp(-1) gets through."""
    height = Program(
        (
            Step("NEW_GEOMETRY Position"),
            Step("SEPXYZ", (Register(0, "Position"),)),
            Step("MATH", (Register(1, "Z"), -1.0, 0.0), {"operation": "MULTIPLY", "use_clamp": False}),
            Step("MATH", (Register(2, "Value"), 0.0, 0.0), {"operation": "MINIMUM", "use_clamp": False}),
            Step("MATH", (Register(3, "Value"), 0.0, 0.0), {"operation": "EXPONENT", "use_clamp": False}),
        )
    )
    fog = Volume(VolumeClosure("absorption", color=0.0, density=Register(4, "Value")), height)
    matrix = np.diag([1.0, -1.0, -1.0, 1.0])
    camera = raytracer.Camera(matrix, projection="orthographic", ortho_scale=1e-3)
    scene = Scene(meshes=make_box(1.0, (9, 0, 1)), camera=camera, world=World(1.0, volume=fog))
    found = measure(scene, 256)
    assert (found[1] < 0.01).all()
    assert_close(found, np.exp(-1.0))
