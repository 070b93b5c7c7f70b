"""Pairs that are good together: each is a net by itself, and two of them leave less than shuffled ones."""

import itertools

import numpy as np
import pytest

from raytracer.sampling.dimensions import FILTER_PAIR, FIRST_WAVE_PAIR, JOINED_WAVES, LENS_PAIR, find_wave_pair
from raytracer.sampling.joined_pairs import MIXING, look_up, make_tables
from raytracer.sampling.sobol import SobolSamples

PAIRS = range(len(MIXING) + 1)


def draw(joined: int | None, count: int, pixels: int, dimension: int, start: int = 0) -> np.ndarray:
    """(samples, pixels, 2)."""
    pixel = np.arange(pixels, dtype=np.uint32)
    return np.stack([SobolSamples(pixel, start + k, 0).uniform_pair(dimension, joined) for k in range(count)])


@pytest.mark.parametrize("joined", PAIRS)
@pytest.mark.parametrize("exponent", [1, 3, 6, 9])
@pytest.mark.parametrize("start", [0, 1])
def test_joined_pair_is_a_net_in_every_aligned_run(joined, exponent, start):
    count = 2**exponent
    pairs = draw(joined, count, 4, joined, start * count)
    for columns in range(exponent + 1):
        boxes = np.floor(pairs * (2**columns, 2 ** (exponent - columns))).astype(np.int64)
        box = boxes[..., 0] * 2 ** (exponent - columns) + boxes[..., 1]
        assert np.array_equal(np.sort(box, axis=0), np.tile(np.arange(count)[:, np.newaxis], 4))


@pytest.mark.parametrize("columns", MIXING)
def test_mixing_maps_aligned_runs_to_themselves(columns):
    """Upper triangular, with ones on the diagonal: column k has bit k, and none above it."""
    assert [column.bit_length() - 1 for column in columns] == list(range(32))


@pytest.mark.parametrize("sample", [0, 1, 77, 4095, 4096, 0xDEADBEEF, 2**32 - 1])
def test_tables_multiply_by_the_matrix(sample):
    for columns in MIXING:
        expected = 0
        for bit in range(32):
            expected ^= columns[bit] * (sample >> bit & 1)
        assert look_up(make_tables(columns), np.array([sample], np.uint32))[0] == expected


def test_joined_pair_is_the_same_for_one_number_and_many():
    pixel = np.arange(5, dtype=np.uint32)
    for sample in (3, 5000):
        many = SobolSamples(pixel, np.full(5, sample, np.uint32), 1).uniform_pair(9, 2)
        assert np.array_equal(SobolSamples(pixel, sample, 1).uniform_pair(9, 2), many)


def measure_edges(first: np.ndarray, second: np.ndarray) -> float:
    """Return the variance that points (samples, pixels, 2) of a pixel and of a light leave of 24 edges of shadows.

    Lit is where b + c a > t, with a across the pixel, b across the light, both from -1 to 1 and even there.
    """
    variances, rng = [], np.random.default_rng(3)
    for c in (0.3, 0.6, 1.2):
        for angles in rng.uniform(0.0, 2.0 * np.pi, (8, 2)):
            across, along = (
                (2.0 * points - 1.0) @ (np.cos(angle), np.sin(angle))
                for points, angle in zip((first, second), angles, strict=True)
            )
            lit = along + c * across > rng.uniform(-0.5, 0.5)
            variances.append(lit.mean(axis=0).var())
    return float(np.mean(variances))


@pytest.mark.parametrize(("one", "other"), list(itertools.combinations(PAIRS, 2)))
def test_two_joined_pairs_leave_less_of_edges_than_shuffled_ones(one, other):
    # Measured 0.91 to 1.08, 0.66 to 0.92 and 0.57 to 0.86; the same pair twice leaves more than shuffled ones.
    for count, most in ((8, 1.1), (32, 1.0), (64, 0.9)):
        shuffled = measure_edges(draw(None, count, 300, 0), draw(None, count, 300, 1))
        joined = measure_edges(draw(one, count, 300, 0), draw(other, count, 300, 1))
        assert joined < most * shuffled


@pytest.mark.parametrize("count", [3, 16])
def test_joined_pairs_are_unbiased(count):
    """Of the product of all four coordinates, 1 / 16, over many pixels; five standard errors."""
    first, second = draw(0, count, 20000, 0), draw(1, count, 20000, 1)
    means = (first.prod(axis=2) * second.prod(axis=2)).mean(axis=0)
    assert abs(means.mean() - 1 / 16) < 5 * means.std() / np.sqrt(len(means))


def test_nobody_shares_a_pair():
    waves = [find_wave_pair(wave) for wave in range(JOINED_WAVES)]
    assert sorted([FILTER_PAIR, LENS_PAIR, *waves]) == list(PAIRS)
    assert waves[0] == FIRST_WAVE_PAIR
    assert find_wave_pair(JOINED_WAVES) is None
