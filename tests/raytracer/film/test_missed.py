"""What pictures lack of small light that none of their samples has met, told from probes, against closed forms."""

import numpy as np
import pytest

from raytracer.film.film import Film
from raytracer.film.missed import FIELDS, SWEEPS, measure_missed, select_sweep, sort_probes

LIGHT = 50.0


def make_probes(rng, chances, count):
    """Return probes of pixels in a row, whose samples meet LIGHT with some probabilities, `count` for each sweep."""
    total = chances.sum()
    column = rng.choice(len(chances), size=(SWEEPS, count), p=chances / total)
    rows = [
        (sweep, number, column[sweep, number], 0, total / count, LIGHT, LIGHT, LIGHT)
        for sweep in range(SWEEPS)
        for number in range(count)
    ]
    return np.array(rows, dtype=float)


def test_squares_are_without_bias_and_have_an_upper_end(rng):
    """sum (p L)^2 of 20 pixels, of which 16 probes for each sweep see one or two; 400 estimates."""
    chances = rng.uniform(0.0, 0.02, 20)
    truth = (chances**2).sum() * LIGHT**2
    found = []
    for _ in range(400):
        probes = make_probes(rng, chances, 16)
        found.append(measure_missed(probes, probes[:, 2].astype(int), np.zeros((len(probes), 3)), 1.0, 8))
    squares, upper = np.array(found).T
    assert abs(squares.mean() - truth) < 4 * squares.std() / np.sqrt(400)
    assert squares.std() < 0.2 * truth
    assert (upper > truth).mean() > 0.95


def test_what_the_picture_shows_is_not_missing(rng):
    """Nothing where probes see what samples do, or a sample stands out half as far; else what they see beyond it."""
    probes = make_probes(rng, np.full(1, 0.1), 4)
    pixel = np.zeros(len(probes), int)
    for shown, largest, expected in ((LIGHT, 0.0, 0.0), (0.0, LIGHT / 2, 0.0), (20.0, 1.0, (0.1 * 30.0) ** 2)):
        found = measure_missed(probes, pixel, np.full((len(probes), 3), shown), largest, 4)
        assert found[0] == pytest.approx(expected)


def test_one_sweep_alone_tells_nothing(rng):
    """Its probes are no independent estimates: in a moving scene all of them stand still."""
    probes = make_probes(rng, np.full(1, 0.1), 4)[:4]
    assert measure_missed(probes, np.zeros(4, int), np.zeros((4, 3)), 1.0, 1) == (0.0, 0.0)


def test_probes_of_sweeps_that_are_not_finished_are_left_out(rng):
    """Those of tiles with more samples than the others, or of a film that is ahead."""
    probes = make_probes(rng, np.full(1, 0.1), 4)
    first = probes[probes[:, 0] < 2]
    expected = measure_missed(first, np.zeros(len(first), int), np.zeros((len(first), 3)), 1.0, 2)
    assert measure_missed(probes, np.zeros(len(probes), int), np.zeros((len(probes), 3)), 1.0, 2) == expected


def test_probes_have_one_order_wherever_they_come_from(rng):
    probes = make_probes(rng, np.full(5, 0.1), 6)
    shuffled = tuple(rng.permutation(probes).ravel().tolist())
    np.testing.assert_array_equal(sort_probes(shuffled), probes)
    assert np.reshape(select_sweep(shuffled, 2), (-1, FIELDS))[:, 0].tolist() == [2.0] * 6


def test_light_that_no_sample_has_met_is_said_and_widens_the_interval(rng):
    """Of a quiet picture, where 0.1 of the samples of one pixel would meet it: sqrt((0.1 L)^2 / pixels) / level."""
    film, plain = Film(24, 16, ("Combined",)), Film(24, 16, ("Combined",))
    for number in range(4):
        values = {"Combined": np.repeat(rng.normal(1.0, 0.01, (384, 1)), 4, axis=1)}
        for one in (film, plain):
            one.add(slice(0, 384), values, replication=number % 2)
            one.samples += 1
    probes = make_probes(rng, np.full(1, 0.1), 200)
    probes[:, 3] = 2.0
    film.probes = tuple(probes.ravel().tolist())
    told, without = film.measure_error(), plain.measure_error()
    assert told.note == "no sample has met a small light that is in sight: the error can be underestimated"
    assert (told.is_missed, without.note) == (True, "")
    assert (told.error, told.interval[0]) == (without.error, without.interval[0])
    expected = 0.1 * (LIGHT - 1.0) / np.sqrt(384)
    assert expected < told.interval[1] < 1.1 * expected  # 800 probes: an upper end of (1 + 1 / sqrt(800))^2
