"""Sample points: exact net properties, independence of how they are asked for, and the error they leave."""

import itertools

import numpy as np
import pytest

from raytracer.sampling.sobol import (
    SobolSamples,
    _first_coordinate,
    _second_coordinate,
    join_numbers,
    split_numbers,
)
from raytracer.sampling.warps import sample_cosine_hemisphere, sample_disk

PIXEL_COUNT = 16
BINS = 64


def draw_pairs(sample_count: int, pixel_count: int = PIXEL_COUNT, dimension: int = 0, seed: int = 0) -> np.ndarray:
    """(samples, pixels, 2)."""
    pixel = np.arange(pixel_count, dtype=np.uint32)
    return np.stack([SobolSamples(pixel, sample, seed).uniform_pair(dimension) for sample in range(sample_count)])


def sobol_pair_by_matrix(index: int) -> tuple[int, int]:
    """Sobol's first two dimensions from their direction numbers, one bit of the index at a time."""
    first = second = 0
    number_first = number_second = 1 << 31
    while index:
        if index & 1:
            first ^= number_first
            second ^= number_second
        number_first >>= 1
        number_second ^= number_second >> 1
        index >>= 1
    return first, second


def test_uniform_pair_without_scrambling_is_sobol(monkeypatch):
    monkeypatch.setattr("raytracer.sampling.sobol._scramble_reversed", lambda bits, key: bits)
    # Both coordinates are linear in the bits of the index, so its 32 bits decide; the other numbers test linearity.
    for sample in (0, *(1 << bit for bit in range(32)), 3, 5, 77, 0xDEADBEEF, 2**32 - 1):
        pair = SobolSamples(np.zeros(1, np.uint32), sample, 0).uniform_pair(0)[0] * 2.0**32
        assert tuple(pair.astype(np.int64)) == sobol_pair_by_matrix(sample)


@pytest.mark.parametrize("exponent", [1, 2, 3, 4, 5, 6, 8])
@pytest.mark.parametrize("start", [0, 1])
def test_uniform_pair_is_a_net_in_every_aligned_run(exponent, start):
    count = 2**exponent
    pairs = draw_pairs((start + 1) * count)[start * count :]
    for columns in range(exponent + 1):
        boxes = np.floor(pairs * (2**columns, 2 ** (exponent - columns))).astype(np.int64)
        box = boxes[..., 0] * 2 ** (exponent - columns) + boxes[..., 1]
        assert np.array_equal(np.sort(box, axis=0), np.tile(np.arange(count)[:, np.newaxis], PIXEL_COUNT))


def test_both_coordinates_of_a_pair_are_scrambled_independently():
    """Sobol's point 0 is the origin: what is left of it is the scrambling alone."""
    keys = np.random.default_rng(2).integers(0, 2**32, 2**14, dtype=np.uint32)
    first = _first_coordinate(np.zeros_like(keys), keys).astype(np.float64)
    second = _second_coordinate(np.zeros_like(keys), keys).astype(np.float64)
    assert abs(np.corrcoef(first, second)[0, 1]) < 5 / np.sqrt(len(keys))


def test_uniform_is_the_first_of_its_pair():
    samples = SobolSamples(np.arange(100, dtype=np.uint32), 11, 3)
    for dimension in (0, 1, 1000):
        assert np.array_equal(samples.uniform(dimension), samples.uniform_pair(dimension)[:, 0])


def test_uniform_lies_in_the_half_open_unit_interval():
    values = SobolSamples(np.arange(2**16, dtype=np.uint32), 5, 0).uniform_pair(0)
    assert values.dtype == np.float64
    assert values.min() >= 0.0
    assert values.max() < 1.0


def test_values_do_not_depend_on_blocks_or_selection():
    whole = SobolSamples(np.arange(1000, dtype=np.uint32), 9, 42)
    pairs = whole.uniform_pair(7)
    for block in (slice(0, 1), slice(1, 18), slice(333, 1000)):
        part = SobolSamples(np.arange(1000, dtype=np.uint32)[block], 9, 42)
        assert np.array_equal(part.uniform_pair(7), pairs[block])
    index = np.array([999, 3, 3, 500])
    assert np.array_equal(whole.select(index).uniform_pair(7), pairs[index])
    chosen = pairs[:, 0] > 0.5
    assert np.array_equal(whole.select(chosen).uniform_pair(7), pairs[chosen])


def test_values_leave_the_pixel_indices_alone():
    pixel = np.arange(10, dtype=np.uint32)
    pixel.flags.writeable = False
    SobolSamples(pixel, 1, 1).uniform_pair(1)


@pytest.mark.parametrize("change", [{"seed": 1}, {"dimension": 1}, {"dimension": 2**20}, {"seed": 2**32 - 1}])
def test_streams_of_other_seeds_and_dimensions_are_uncorrelated(change):
    """Correlation of independent streams has standard deviation 1/sqrt(count); five of them is 1 in 2 million."""
    count = 2**14
    base = draw_pairs(1, count)[0]
    other = draw_pairs(1, count, **change)[0]
    for first, second in itertools.product(range(2), range(2)):
        assert abs(np.corrcoef(base[:, first], other[:, second])[0, 1]) < 5 / np.sqrt(count)


def test_pixels_are_uniform_and_uncorrelated_with_their_neighbours():
    count = 2**14
    pair = draw_pairs(1, count)[0]
    for values in pair.T:
        expected = count / BINS
        chi_squared = ((np.histogram(values, BINS, (0, 1))[0] - expected) ** 2 / expected).sum()
        # Chi squared of 63 degrees of freedom: mean 63, standard deviation sqrt(126); five of them.
        assert abs(chi_squared - (BINS - 1)) < 5 * np.sqrt(2 * (BINS - 1))
        assert abs(np.corrcoef(values[:-1], values[1:])[0, 1]) < 5 / np.sqrt(count)


def fit_error_slope(pairs: np.ndarray) -> float:
    """Slope of log RMSE against log N of the mean of a smooth product whose integral is 1."""
    values = np.prod(np.pi / 2 * np.sin(np.pi * pairs), axis=2)
    counts = 2 ** np.arange(2, 11)
    errors = [np.sqrt(np.mean((values[:count].mean(axis=0) - 1.0) ** 2)) for count in counts]
    return np.polyfit(np.log(counts), np.log(errors), 1)[0]


def test_integration_error_falls_faster_than_random():
    """Owen-scrambled nets: RMSE near N^-1.5 for smooth integrands; independent points N^-0.5."""
    random = np.random.default_rng(1).random((1024, 256, 2))
    assert fit_error_slope(random) > -0.6
    assert fit_error_slope(draw_pairs(1024, 256)) < -0.75


def test_padding_is_no_worse_than_random_in_four_dimensions():
    """The indicator of u0, u1, v0, v1 > 1/2, scaled to mean 1, has variance 15: N random points leave 15 / N.

    Two nets of 16 points have 4 points each in that quadrant; shuffled independently they share 1 +- sqrt(0.6) of them.
    The same index in both pairs would make that 0 or 4, with variance 3.
    """
    count, pixels = 16, 4096
    first, second = draw_pairs(count, pixels, 0), draw_pairs(count, pixels, 1)
    inside = (first > 0.5).all(axis=2) & (second > 0.5).all(axis=2)
    errors = 16 * inside.mean(axis=0) - 1
    assert abs(errors.mean()) < 5 * np.sqrt(15 / (count * pixels))
    assert np.mean(errors**2) < 15 / count


def test_disk_is_uniform_and_keeps_the_centre():
    count = 2**14
    disk = sample_disk(draw_pairs(1, count)[0])
    radius_squared = (disk**2).sum(axis=1)
    assert radius_squared.max() <= 1.0 + 4 * np.finfo(np.float64).eps  # cos^2 + sin^2, rounded
    angle = np.arctan2(disk[:, 1], disk[:, 0]) / (2 * np.pi) + 0.5
    for values in (radius_squared, angle):
        expected = count / BINS
        chi_squared = ((np.histogram(np.minimum(values, 1.0), BINS, (0, 1))[0] - expected) ** 2 / expected).sum()
        assert abs(chi_squared - (BINS - 1)) < 5 * np.sqrt(2 * (BINS - 1))
    assert np.array_equal(sample_disk(np.array([[0.5, 0.5]])), [[0.0, 0.0]])


def test_cosine_hemisphere_has_its_moments():
    """Density z/pi: E[z] = 2/3, E[z^2] = 1/2, E[x] = E[y] = 0; bounds are five standard deviations of the mean."""
    count = 2**14
    direction = sample_cosine_hemisphere(draw_pairs(1, count)[0])
    assert np.allclose((direction**2).sum(axis=1), 1.0, rtol=0, atol=8 * np.finfo(np.float64).eps)
    x, y, z = direction.T
    for values, mean in ((x, 0.0), (y, 0.0), (z, 2 / 3), (z * z, 1 / 2)):
        assert abs(values.mean() - mean) < 5 * values.std() / np.sqrt(count)


def integrate_replications(count: int, pixel_count: int) -> np.ndarray:
    """(2, pixels): means of a smooth function over `count` samples of each of two replications; the truth is 1 / 4."""
    number = np.arange(2 * count, dtype=np.uint32)
    pixel, number = (a.ravel() for a in np.meshgrid(np.arange(pixel_count, dtype=np.uint32), number))
    sample, replication = split_numbers(number)
    pairs = SobolSamples(pixel, sample, 0, replication=replication).uniform_pair(3)
    return pairs.prod(axis=1).reshape(count, 2, pixel_count).mean(axis=0)


@pytest.mark.parametrize("count", [1, 3, 16])
def test_replications_tell_the_error_of_their_mean(count):
    """E (A - B)^2 / 4 is the variance of (A + B) / 2, and A and B do not correlate; five standard deviations."""
    pixels = 1 << 14
    first, second = integrate_replications(count, pixels) - 0.25
    assert abs(np.corrcoef(first, second)[0, 1]) < 5 / np.sqrt(pixels)
    told, true = ((first - second) ** 2 / 4).mean(), ((first + second) ** 2 / 4).mean()
    # Both estimate one variance, v, each with a standard deviation of at most sqrt(4 / n) v: kurtosis 5 or less.
    assert told == pytest.approx(true, rel=5 * np.sqrt(8 / pixels))


def test_samples_of_one_sequence_would_not_tell_their_error():
    """What replications are for: even and odd samples of one sequence avoid each other, and seem far more wrong."""
    pixel, sample = (a.ravel() for a in np.meshgrid(np.arange(4096, dtype=np.uint32), np.arange(32, dtype=np.uint32)))
    means = SobolSamples(pixel, sample, 0).uniform_pair(3).prod(axis=1).reshape(16, 2, 4096).mean(axis=0) - 0.25
    first, second = means
    assert ((first - second) ** 2).mean() > 2 * ((first + second) ** 2).mean()


def test_first_replication_is_the_sequence_without_any():
    pixel = np.arange(9, dtype=np.uint32)
    plain, other = SobolSamples(pixel, 5, 1), SobolSamples(pixel, 5, 1, replication=1)
    assert np.array_equal(plain.uniform(2), SobolSamples(pixel, 5, 1, None, np.zeros(9, np.uint32)).uniform(2))
    assert (plain.uniform(2) != other.uniform(2)).all()


def test_numbers_of_samples_are_split_and_joined():
    number = np.arange(9, dtype=np.uint32)
    sample, replication = split_numbers(number)
    assert list(zip(sample.tolist(), replication.tolist(), strict=True))[:4] == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert np.array_equal(join_numbers(sample, replication), number)
