"""The film: sums, orientation, what comes from the pixel's centre."""

import tracemalloc

import numpy as np
import pytest

from raytracer.film.film import Film
from raytracer.film.passes import PASSES, select_passes


def test_passes_are_those_asked_for_only():
    film = Film(3, 2, ("Combined", "Depth"))
    assert {name: values.shape for name, values in film.passes.items()} == {"Combined": (2, 3, 4), "Depth": (2, 3, 1)}
    assert all(values.dtype == np.float32 for values in film.passes.values())
    with pytest.raises(KeyError, match=r"no pass 'Normal'; it has Combined, Depth"):
        film["Normal"]


def test_passes_are_made_one_at_a_time():
    """A large film leaves no room for all of them beside its sums."""
    film = Film(64, 64, ("Combined", "Normal", "Depth", "Position", "UV"))
    pass_bytes = 64 * 64 * 4 * 4
    tracemalloc.start()
    shapes = {name: values.shape[-1] for name, values in film.passes.items()}
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert shapes == {name: PASSES[name].channels for name in film.names}
    # The one before is let go when the next is there.
    assert peak < 2.5 * pass_bytes
    assert sum(shapes.values()) * 64 * 64 * 4 > 3 * pass_bytes


def test_mean_is_that_of_each_pixels_own_samples():
    film = Film(2, 1, ("Normal",))
    film.add(slice(0, 2), {"Normal": np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])}, 0)
    film.add(slice(0, 1), {"Normal": np.array([[3.0, 4.0, 5.0]])}, 0)
    assert np.array_equal(film["Normal"], [[[2.0, 3.0, 4.0], [4.0, 5.0, 6.0]]])


def test_pixels_without_samples_are_zero():
    assert not Film(2, 2, ("Combined",))["Combined"].any()


def test_first_row_is_the_top_of_the_picture():
    film = Film(2, 3, ("Depth",))
    film.set_centre(slice(0, 6), {"Depth": np.arange(6.0)[:, np.newaxis]})
    assert np.array_equal(film["Depth"][..., 0], [[4.0, 5.0], [2.0, 3.0], [0.0, 1.0]])


def test_centre_passes_are_stored_not_summed():
    film = Film(1, 1, ("Combined", "Depth"))
    film.set_centre(slice(0, 1), {"Depth": np.array([[7.0]])})
    for _ in range(4):
        film.add(slice(0, 1), {"Combined": np.ones((1, 4))}, 0)
    assert film["Depth"] == 7.0
    assert np.array_equal(film["Combined"], np.ones((1, 1, 4)))


def test_sums_do_not_depend_on_how_pixels_are_divided():
    """Sums of numbers whose addition rounds: equal bit for bit, because each pixel adds its samples in order."""
    samples = np.random.default_rng(0).random((50, 12, 4)) ** 9
    whole, parts = Film(4, 3, ("Combined",)), Film(4, 3, ("Combined",))
    for values in samples:
        whole.add(slice(0, 12), {"Combined": values}, 0)
    for run in (slice(0, 5), slice(5, 12)):
        for values in samples:
            parts.add(run, {"Combined": values[run]}, 0)
    assert np.array_equal(whole["Combined"], parts["Combined"])


def test_reading_the_film_leaves_it_alone():
    film = Film(1, 1, ("Combined", "Depth"))
    film.add(slice(0, 1), {"Combined": np.ones((1, 4))}, 0)
    for values in film.passes.values():
        values[:] = 5.0
    film.add(slice(0, 1), {"Combined": np.zeros((1, 4))}, 0)
    assert np.array_equal(film["Combined"], np.full((1, 1, 4), 0.5))
    assert film["Depth"] == 0.0


def test_select_passes_divides_the_table():
    centre, mean = select_passes(PASSES, from_centre=True), select_passes(PASSES, from_centre=False)
    assert set(centre) == {"Depth", "Position", "Vector", "Object Index", "Material Index"}
    assert set(centre) | set(mean) == set(PASSES) - {"Error", "Sample Count", "Shadow Catcher"}


def test_what_is_too_large_for_a_picture_is_its_largest_number():
    film = Film(2, 1, ("Combined",))
    film.add(slice(0, 2), {"Combined": np.array([(1e39, -1e39, np.inf, 1.0), (0.5, 0.0, 1e38, 1.0)])}, 0)
    largest = np.finfo(np.float32).max
    expected = np.array([[(largest, -largest, largest, 1.0), (0.5, 0.0, 1e38, 1.0)]], np.float32)
    np.testing.assert_array_equal(film["Combined"], expected)
