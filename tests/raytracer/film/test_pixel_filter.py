"""Pixel filters: the offsets have the filter as their density."""

import numpy as np
import pytest

from raytracer.film.pixel_filter import (
    BLACKMAN_HARRIS,
    QUANTILES,
    find_filter_density,
    find_reach,
    integrate_blackman_harris,
    sample_pixel_filter,
)


def make_even_pairs(count: int) -> np.ndarray:
    """(count, 2) pairs whose coordinates both run through the midpoints of `count` equal intervals."""
    u = (np.arange(count) + 0.5) / count
    return np.stack([u, u[::-1]], axis=1)


def test_integral_of_the_window_is_its_sum():
    """Against the midpoint rule, which errs by h^2 / 24 times the change of the derivative (and higher orders)."""
    count = 1000
    x = (np.arange(count) + 0.5) / (count / 2) - 1
    window = sum(a * np.cos(k * np.pi * (x + 1)) for k, a in enumerate(BLACKMAN_HARRIS))
    steepest = sum(k * np.pi * abs(a) for k, a in enumerate(BLACKMAN_HARRIS))
    bound = (2 / count) ** 2 / 24 * 2 * steepest / (2 * BLACKMAN_HARRIS[0])
    for index in (0, 1, 250, 500, 700, count):
        share = window[:index].sum() / window.sum()
        assert abs(integrate_blackman_harris(np.array(2 * index / count - 1)) - share) < bound


@pytest.mark.parametrize("width", [1.5, 0.01])
def test_blackman_harris_offsets_are_distributed_as_its_integral(width):
    count = 10007  # a prime: no multiple of the table
    offset = sample_pixel_filter(make_even_pairs(count), "blackman_harris", width)
    assert np.abs(offset).max() <= width
    for axis in (0, 1):
        share = integrate_blackman_harris(np.sort(offset[:, axis]) / width)
        expected = (np.arange(count) + 0.5) / count
        assert np.abs(share - expected).max() <= 1 / QUANTILES


def test_blackman_harris_is_symmetric():
    pair = make_even_pairs(1000)
    offset = sample_pixel_filter(pair, "blackman_harris", 1.0)
    # Where the window is lowest, at its ends, the inverse is steepest and enlarges the rounding of the integral.
    steepest = 2 * BLACKMAN_HARRIS[0] / sum(BLACKMAN_HARRIS)
    assert np.allclose(offset[:, 0], -offset[:, 1], rtol=0, atol=8 * np.finfo(np.float64).eps * steepest)


def test_box_offsets_fill_the_box():
    pair = np.array([[0.0, 0.5], [0.25, 0.75]])
    assert np.array_equal(sample_pixel_filter(pair, "box", 2.0), [[-1.0, 0.0], [-0.5, 0.5]])


@pytest.mark.parametrize("pixel_filter", ["box", "blackman_harris"])
def test_width_zero_is_the_centre(pixel_filter):
    assert not sample_pixel_filter(make_even_pairs(100), pixel_filter, 0.0).any()


@pytest.mark.parametrize(("pixel_filter", "width"), [("blackman_harris", 1.5), ("blackman_harris", 0.7), ("box", 2.5)])
def test_the_density_is_that_of_the_offsets(pixel_filter, width):
    """Of 2^16 even offsets in each of 50 parts of the reach, and nothing beyond it."""
    offset = np.abs(sample_pixel_filter(make_even_pairs(1 << 16), pixel_filter, width)[:, 0])
    reach = find_reach(pixel_filter, width)
    counts, edges = np.histogram(offset, 50, (0.0, reach))
    assert counts.sum() == 1 << 16
    fine = (np.arange(50 * 64) + 0.5) / 64 * edges[1]
    share = 2.0 * find_filter_density(fine, pixel_filter, width).reshape(50, 64).mean(axis=1) * edges[1]
    np.testing.assert_allclose(counts / (1 << 16), share, atol=1e-4)  # a few offsets at either end, and midpoints
    assert find_filter_density(np.array([-1.01, 1.01]) * reach, pixel_filter, width).tolist() == [0.0, 0.0]
