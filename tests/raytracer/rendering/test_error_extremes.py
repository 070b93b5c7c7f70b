"""Errors of pictures that are black, see-through, mostly lens, infinitely bright, or hardly begun.

Numbers or words, and no warning of NumPy, which fails a test.
"""

from dataclasses import replace

import numpy as np
import pytest

from raytracer import Camera, Scene, World
from raytracer.film.film import Film
from raytracer.rendering.render import render
from raytracer.scene.camera import Panorama
from tests.raytracer.rendering.error_scenes import EYE, FLOOR, SCENES

PENUMBRA = SCENES["penumbra"][0]()
PASSES = ("Combined", "Error", "Sample Count")
pytestmark = pytest.mark.usefixtures("adaptive_in_any_size")


@pytest.mark.parametrize("adaptive", [False, True])
@pytest.mark.parametrize("transparent", [False, True])
def test_a_black_picture_has_no_error_and_ends_at_once(adaptive, transparent):
    dark = Scene(meshes=[FLOOR], camera=Camera(EYE))
    options = {"error": 0.01, "adaptive": adaptive, "transparent": transparent, "passes": PASSES}
    film = render(dark, 8, 6, 64, **options)
    told = film.measure_error()
    assert (told.error, told.interval, told.error_p99, told.note) == (0.0, (0.0, 0.0), 0.0, "")
    assert (film.samples, film.ended_by) == (16, "error")
    assert not film["Error"].any()


def test_a_picture_of_nothing_but_a_hole_has_no_error():
    film = render(Scene(world=World(1.0), camera=Camera(EYE)), 8, 6, 32, adaptive=True, error=0.1, transparent=True)
    assert (film.error, film.ended_by) == (0.0, "error")
    assert not film["Combined"].any()


def test_light_that_cancels_out_has_an_error_but_no_relative_one():
    film = Film(2, 1, PASSES)
    for number, value in enumerate((1.0, -1.0)):
        film.add(slice(0, 2), {"Combined": np.full((2, 4), value)}, number)
    told = film.measure_error()
    assert (told.error, told.interval) == (np.inf, (np.inf, np.inf))
    assert (film["Error"] == 1.0).all()


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan, 1e200, 8e307])
def test_light_beyond_what_can_be_squared_leaves_the_error_unknown_or_finite(value):
    film = Film(4, 1, ("Combined", "Error"))
    for number in range(4):
        seen = np.full((4, 4), 0.25 * number)
        seen[1] = value * (number % 2) if np.isfinite(value) else value
        film.add(slice(0, 4), {"Combined": seen}, number % 2)
    told = film.measure_error()
    assert told.error == np.inf or told.error > 0
    assert not np.isnan([told.error, *told.interval, told.error_p99]).any()


@pytest.mark.parametrize("kind", ["fisheye_equidistant", "equirectangular"])
def test_adaptive_panoramas_put_samples_where_noise_is(kind):
    """Outside a fisheye's lens nothing is cast: such pixels cost next to nothing, and have no noise."""
    camera = Camera(EYE, projection="panorama", panorama=Panorama(kind))
    film = render(replace(PENUMBRA, camera=camera), 24, 24, 32, adaptive=True, passes=PASSES)
    counts = film["Sample Count"][..., 0]
    assert counts.max() > 1.5 * counts.min()
    assert 0 < film.error < np.inf


@pytest.mark.parametrize(("samples", "error"), [(1, np.inf), (2, 0.5)])
def test_fewer_samples_than_the_error_is_looked_at_after_are_all_taken(samples, error):
    film = render(PENUMBRA, 8, 6, samples, error=5.0)
    assert (film.samples, film.ended_by) == (samples, "samples")
    assert film.error <= error


def test_least_samples_above_all_of_them_leave_the_error_no_say():
    film = render(PENUMBRA, 8, 6, 20, error=5.0, min_samples=64)
    assert (film.samples, film.ended_by) == (20, "samples")
