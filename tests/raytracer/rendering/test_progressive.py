"""Pictures that refine: coarse pixels lie where the fine ones do, and the last picture is `render`'s own."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from raytracer import build, render
from raytracer.film.camera import locate_on_film
from raytracer.rendering.progressive import (
    COARSEST,
    FEWEST_PIXELS,
    FIRST_SECONDS,
    Picture,
    Target,
    coarsen,
    list_factors,
    measure_part,
    refine,
)
from raytracer.scene.camera import Camera
from raytracer.scene.lights import PointLight
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Mesh

# A chain of some ten operations on numbers of the film's size.
ROUNDING = 16 * np.finfo(np.float64).eps

SCENE = Scene(
    meshes=[Mesh([(-2.0, -2.0, -4.0), (2.0, -2.0, -4.0), (0.0, 2.0, -3.0)], [(0, 1, 2)])],
    lights=[PointLight((1.0, 1.0, 0.0), (50.0, 50.0, 50.0), radius=0.3)],
)
SETTINGS = {"integrator": "path", "pixel_filter": "box", "filter_width": 1.0}


def collect(target: Target, **options: Any) -> list[Picture]:
    pictures: list[Picture] = []
    refine(SCENE, build(SCENE), target, pictures.append, options.pop("is_cancelled", lambda: False), **options)
    return pictures


@pytest.mark.parametrize("factor", [2, 8, 16])
@pytest.mark.parametrize("size", [(640, 480), (101, 333), (7, 5)])
@pytest.mark.parametrize("fit", ["auto", "horizontal", "vertical"])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_coarse_pixels_cover_the_fine_ones(factor: int, size: tuple[int, int], fit: str, projection: str) -> None:
    camera = Camera(
        np.eye(4), projection, sensor_fit=fit, shift_x=0.3, shift_y=-0.7, pixel_aspect=1.5, sensor_height=20.0
    )
    coarse = coarsen(camera, *size, factor)
    corners = np.array([(0.0, 0.0), (1.0, 2.0), (-(-size[0] // factor), -(-size[1] // factor))])
    expected = locate_on_film(camera, *size, *(corners * factor).T)
    found = locate_on_film(coarse, -(-size[0] // factor), -(-size[1] // factor), *corners.T)
    scale = np.abs(expected).max() * max(1.0, factor / min(size))
    assert np.abs(found - expected).max() <= ROUNDING * scale


def test_the_last_picture_is_that_of_render() -> None:
    camera = Camera(np.eye(4))
    target = Target(camera, 60, 40, samples=3, settings=SETTINGS)
    pictures = collect(target)
    expected = render(Scene(**{**vars(SCENE), "camera": camera}), 60, 40, 3, **SETTINGS)["Combined"]
    np.testing.assert_array_equal(pictures[-1].pixels[::-1], expected)
    assert (pictures[-1].samples, pictures[-1].total) == (3, 3)


def test_pictures_get_finer_and_then_gain_samples() -> None:
    pictures = collect(Target(Camera(np.eye(4)), 200, 120, samples=4, settings=SETTINGS))
    widths = [picture.pixels.shape[1] for picture in pictures]
    assert widths == sorted(widths)
    assert widths[0] < 200
    samples = [picture.samples for picture in pictures]
    assert samples[0] == 0
    assert samples == sorted(samples)
    assert samples[-1] == 4
    assert all((picture.samples > 0) == (picture.pixels.shape[1] == 200) for picture in pictures)


def test_a_border_shows_the_same_pixels_as_the_whole_picture() -> None:
    camera, border = Camera(np.eye(4)), (11, 7, 50, 33)
    whole = collect(Target(camera, 60, 40, samples=2, settings=SETTINGS))[-1]
    part = collect(Target(camera, 60, 40, border=border, samples=2, settings=SETTINGS))[-1]
    assert (part.left, part.bottom, part.right, part.top) == border
    np.testing.assert_array_equal(part.pixels, whole.pixels[7:33, 11:50])


def test_coarse_pictures_of_a_border_touch_all_of_it() -> None:
    for picture in collect(Target(Camera(np.eye(4)), 300, 200, border=(33, 17, 290, 190), samples=1)):
        assert picture.left <= 33
        assert picture.bottom <= 17
        assert picture.right >= 290
        assert picture.top >= 190


def test_pixel_size_is_the_finest_that_is_drawn() -> None:
    pictures = collect(Target(Camera(np.eye(4)), 100, 60, pixel_size=4, samples=2, settings=SETTINGS))
    assert pictures[-1].pixels.shape == (15, 25, 4)
    assert (pictures[-1].right, pictures[-1].top, pictures[-1].samples) == (100, 60, 2)


@pytest.mark.parametrize("pace", [0.0, 1e3, 1e5, 1e7, 1e12])
@pytest.mark.parametrize("size", [(1, 1), (40, 30), (1920, 1080), (7680, 4320)])
@pytest.mark.parametrize("pixel_size", [1, 2, 8])
def test_factors_halve_down_to_the_finest(pace: float, size: tuple[int, int], pixel_size: int) -> None:
    target = Target(Camera(np.eye(4)), *size, pixel_size=pixel_size)
    factors = list(list_factors(target, pace))
    assert factors[-1] == pixel_size
    assert all(coarse == 2 * fine for coarse, fine in itertools.pairwise(factors))
    assert factors[0] <= COARSEST * pixel_size
    pixels = measure_part(target)[0] * measure_part(target)[1] / factors[0] ** 2
    if len(factors) > 1:
        assert pixels >= FEWEST_PIXELS
    if pace > 0 and factors[0] < COARSEST * pixel_size and pixels >= 4 * FEWEST_PIXELS:
        assert pixels <= pace * FIRST_SECONDS


def test_a_cancelled_target_shows_nothing_more() -> None:
    shown: list[Picture] = []
    target = Target(Camera(np.eye(4)), 200, 120, samples=64, settings=SETTINGS)
    refine(SCENE, build(SCENE), target, shown.append, lambda: len(shown) >= 2)
    assert len(shown) == 2
