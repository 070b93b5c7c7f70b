"""Light that media scatter, against furnaces and quadrature; `test_media` says how exact."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from raytracer import (
    AreaLight,
    Closure,
    Material,
    PointLight,
    Scene,
    SpotLight,
    SunLight,
    VolumeClosure,
    World,
)
from tests.raytracer.integrator.media_scenes import (
    ABSORPTION,
    DENSITY,
    GREY,
    INTEGRATORS,
    RISING,
    SCATTERING,
    WHITE,
    assert_close,
    fill,
    look,
    make_box,
    measure,
    sum_midpoints,
    turn,
)

# Furnaces: an even world of 1 around a medium that absorbs nothing is seen as 1 ---------------------------------------

WHITE_MEDIA = {
    "even": fill(VolumeClosure("scatter", color=1.0, density=1.0)),
    "anisotropic": fill(VolumeClosure("scatter", color=1.0, density=2.0, anisotropy=0.8)),
    "colored": fill(VolumeClosure("coefficients", scattering=(0.2, 1.0, 3.0), phase="rayleigh")),
    "mixed": fill(
        VolumeClosure("scatter", color=1.0, phase="mie", diameter=5.0),
        VolumeClosure("scatter", color=(0.1, 1.0, 0.5), phase="draine", anisotropy=-0.5),
    ),
    "varying": fill(VolumeClosure("scatter", color=1.0, density=DENSITY), program=RISING),
    "varying colors": fill(VolumeClosure("scatter", color=(1.0, 0.3, 0.1), density=DENSITY), program=RISING),
    "overlapping": fill(
        VolumeClosure("scatter", color=1.0, density=DENSITY, anisotropy=0.5),
        VolumeClosure("scatter", color=1.0, density=0.5),
        program=RISING,
    ),
}


@pytest.mark.parametrize("name", WHITE_MEDIA)
def test_a_white_furnace_is_white(name: str) -> None:
    scene = Scene(meshes=make_box(1.0), materials=WHITE_MEDIA[name], camera=look(), world=WHITE)
    found = measure(scene, 64, max_bounces=256)
    assert (found[1] < 0.03).all()
    assert_close(found, 1.0)


def test_a_white_furnace_is_white_with_surfaces_and_two_media() -> None:
    """White matte walls, seen through a medium in a medium, reflect all as well."""
    boxes = [make_box(1.0), make_box(0.5, (0, 0, 0.2), 1), make_box((0.2, 0.2, 2.0), (0, 0.3, 0), 2)]
    materials = [
        fill(VolumeClosure("scatter", color=1.0, density=0.8)),
        fill(VolumeClosure("scatter", color=1.0, density=2.0, anisotropy=0.6)),
        Material((Closure("diffuse", color=1.0),)),
    ]
    scene = Scene(meshes=boxes, materials=materials, camera=look(), world=WHITE)
    found = measure(scene, 64, max_bounces=256)
    assert (found[1] < 0.03).all()
    assert_close(found, 1.0)


# Single scattering ----------------------------------------------------------------------------------------------------


@INTEGRATORS
def test_a_slab_scatters_a_suns_light_once(integrator: str) -> None:
    """Light from above comes to the ray through 1 m, at a right angle."""
    scene = Scene(meshes=make_box(1.0), materials=GREY, camera=look(), lights=SunLight((0, 0, 1), 1.0))
    x = SCATTERING + ABSORPTION
    expected = sum_midpoints(lambda y: np.exp(-x * (y + 1.0)) * SCATTERING * turn(0.0) * np.exp(-x))
    found = measure(scene, 64, max_bounces=0, integrator=integrator)
    assert (found[1] < 0.005 * expected).all()
    assert_close(found, expected)


LAMPS = {
    "near": (0.05, 0.2, 0.0),
    "far": (0.0, 0.3, 6.0),
}


@INTEGRATORS
@pytest.mark.parametrize("name", LAMPS)
def test_a_slab_scatters_a_lamps_light_once(name: str, integrator: str) -> None:
    """Inside of the box, next to the ray, and above it, from where the light comes through the box's top."""
    place = np.array(LAMPS[name])
    scene = Scene(meshes=make_box(1.0), materials=GREY, camera=look(), lights=PointLight(place, 10.0))
    x = SCATTERING + ABSORPTION

    def see(y: Any) -> Any:
        way = place - np.stack([0.0 * y, y, 0.0 * y], axis=1)
        distance = np.sqrt((way**2).sum(axis=1))
        within = distance * np.minimum(1.0, 1.0 / np.maximum(place[2], 1.0))
        light = 10.0 / (4.0 * np.pi * distance**2) * np.exp(-x * within)
        # Light comes along -way and goes on to the camera, along -y.
        return np.exp(-x * (y + 1.0)) * SCATTERING * turn(way[:, 1] / distance) * light

    expected = sum_midpoints(see)
    found = measure(scene, 64, max_bounces=0, integrator=integrator)
    assert (found[1] < 0.005 * expected).all()
    assert_close(found, expected)


@pytest.mark.parametrize(
    "light",
    [
        PointLight((0.3, 0.0, 2.0), 10.0, radius=0.5),
        PointLight((0.3, 0.0, 2.0), 10.0, radius=0.5, soft_falloff=False),
        PointLight((0.3, 0.0, 2.0), 10.0, radius=0.5, soft_falloff=False, blockers=1),
        SpotLight((0.3, 0.0, 2.0), 10.0, radius=0.2, spot_size=1.0),
        AreaLight((0.3, 0.0, 2.0), (1, 0, 0), (0, 1, 0), 10.0),
        SunLight((0.1, 0.2, 1.0), 1.0, angle=0.5),
    ],
    ids=["disk", "ball", "ball with blockers", "spot", "area", "sun"],
)
def test_direct_and_path_see_the_same_light_of_lamps_with_extent(light: Any) -> None:
    """By light samples alone, and with scattered rays that meet the light: the same, at no further scattering."""
    scene = Scene(meshes=make_box(1.0), materials=GREY, camera=look(), lights=light)
    one = measure(scene, 64, seed=1, integrator="direct", max_bounces=0)
    other = measure(scene, 64, seed=2, integrator="path", max_bounces=0)
    error = np.hypot(one[1], other[1])
    assert (error < 0.02 * one[0]).all()
    assert (np.abs(one[0] - other[0]) < 4 * error).all()


def test_direct_and_path_see_the_same_light_of_emissive_geometry_and_a_world() -> None:
    lamp = Material((Closure("emission", color=30.0),))
    panel = make_box((0.3, 0.3, 0.01), (0, 0, 2.0), 1)
    scene = Scene(meshes=[make_box(1.0), panel], materials=[GREY, lamp], camera=look(), world=World(0.2))
    one = measure(scene, 128, seed=1, integrator="direct", max_bounces=0)
    other = measure(scene, 128, seed=2, integrator="path", max_bounces=0)
    error = np.hypot(one[1], other[1])
    assert (error < 0.02 * one[0]).all()
    assert (np.abs(one[0] - other[0]) < 4 * error).all()
