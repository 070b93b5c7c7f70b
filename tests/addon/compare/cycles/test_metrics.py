"""Errors and statistical tests of pictures: closed forms, and their behaviour on pictures of known distribution."""

import math

import numpy as np
import pytest

from addon.compare.cycles import metrics
from addon.compare.cycles.chance import BACKGROUND_DEPTH, Answer, find_doubtful, find_seen
from addon.compare.cycles.comparison import compare_pass, join_answer


def draw_batches(rng, mean, deviation, batches=8, shape=(48, 64, 3)):
    return mean + deviation * rng.standard_normal((batches, *shape))


def test_root_mean_square_error_is_the_norm_of_the_difference():
    image, reference = np.full((2, 2, 3), 3.0), np.full((2, 2, 3), 1.0)
    image[0, 0] = 1.0
    assert metrics.root_mean_square_error(image, reference) == pytest.approx(math.sqrt(4 * 9 / 12), rel=1e-15)
    assert metrics.root_mean_square_error(image, image) == 0.0


def test_relative_mean_square_error_divides_by_the_reference():
    image, reference = np.full((4, 4, 3), 1.5), np.full((4, 4, 3), 1.0)
    assert metrics.relative_mean_square_error(image, reference) == pytest.approx(0.25 / 1.01, rel=1e-15)
    assert metrics.relative_mean_square_error(image, np.zeros((4, 4, 3))) == pytest.approx(2.25 / 0.01, rel=1e-15)


def test_tiles_cover_pictures_that_are_no_multiple_of_the_tile():
    image = np.arange(20 * 35 * 3, dtype=float).reshape(20, 35, 3)
    tiles = metrics.average_tiles(image)
    assert tiles.shape == (2, 3, 3)
    np.testing.assert_allclose(tiles[0, 0], image[:16, :16].mean(axis=(0, 1)), rtol=1e-14)
    np.testing.assert_allclose(tiles[1, 2], image[16:, 32:].mean(axis=(0, 1)), rtol=1e-14)


def test_measured_tiles_tell_noise_from_bias(rng):
    """Known noise: the standard error is known; a bias of 20 of them shows as what lies beyond some."""
    batches, sigma, level = 64, 0.32, 2.0
    sides = [level + rng.normal(0, sigma, (batches, 32, 32, 1)) for _ in range(2)]
    expected = sigma / 16 * np.sqrt(2 / batches)
    noise_alone = metrics.measure_tiles(*sides)
    means = [side.mean(axis=0) for side in sides]
    assert noise_alone.error == pytest.approx(metrics.largest_tile_difference(*means), rel=1e-9)
    # The estimate of a standard deviation from n numbers is off by about 1 / sqrt(2 n).
    assert noise_alone.noise == pytest.approx(expected, rel=4 / np.sqrt(2 * batches))
    assert noise_alone.bias == 0.0
    sides[0][:, 16:, :16] += 20 * expected
    explained = metrics.student_quantile(metrics.correct_significance(4), 2 * batches - 2)
    biased = metrics.measure_tiles(*sides)
    assert biased.bias == pytest.approx((20 - explained) * expected / level, rel=0.3)
    assert metrics.measure_tiles(np.zeros((2, 4, 4, 3)), np.zeros((2, 4, 4, 3))).bias == 0.0
    assert metrics.measure_tiles(np.ones((2, 4, 4, 3)), np.zeros((2, 4, 4, 3))).bias == np.inf


@pytest.mark.parametrize(("probability", "degrees", "quantile"), [(0.01, 14, 2.9768), (0.05, 2, 4.3027), (0.5, 1, 1.0)])
def test_quantiles_are_those_of_tables(probability, degrees, quantile):
    """Abramowitz and Stegun, table 26.10."""
    assert metrics.student_quantile(probability, degrees) == pytest.approx(quantile, abs=1e-4)


def test_tile_difference_finds_a_local_bias():
    image = np.zeros((64, 64, 3))
    image[16:32, 48:64, 1] = 0.25
    assert metrics.largest_tile_difference(image, np.zeros_like(image)) == 0.25


# Two-sided critical values of Student's t (Abramowitz and Stegun, table 26.10).
@pytest.mark.parametrize(
    ("degrees", "statistic", "tail"),
    [(1, 12.706, 0.05), (2, 4.303, 0.05), (5, 4.032, 0.01), (7, 3.499, 0.01), (10, 4.587, 0.001), (30, 3.646, 0.001)],
)
def test_student_tail_matches_the_printed_table(degrees, statistic, tail):
    # The table prints three decimals; |d tail / d statistic| is below 2 tail at these places.
    assert metrics.student_tail(np.array(statistic), np.array(degrees)) == pytest.approx(
        tail, abs=2 * tail * 5e-4 + 1e-6
    )


def test_student_tail_with_many_degrees_is_the_normal_tail():
    statistic = np.linspace(0, 4, 9)
    normal = np.array([math.erfc(value / math.sqrt(2)) for value in statistic])
    # The first term of the expansion in 1 / n: (t^3 + t) / (4 n) times the density, below 1 / n throughout.
    np.testing.assert_allclose(metrics.student_tail(statistic, np.array(2000)), normal, atol=1 / 2000)


def test_p_values_of_equal_means_are_uniform():
    rng = np.random.default_rng(3)
    p_value = metrics.compare_means(draw_batches(rng, 1.0, 0.2), draw_batches(rng, 1.0, 0.5))
    # Kolmogorov: the empirical distribution of n values stays within 1.95 / sqrt(n) with probability 0.999. Welch's
    # approximation and whole degrees of freedom only push values up.
    ranks = (np.arange(p_value.size) + 1) / p_value.size
    assert (ranks - np.sort(p_value.ravel())).max() < 1.95 / math.sqrt(p_value.size)


def test_pictures_with_equal_means_pass():
    rng = np.random.default_rng(4)
    ours, theirs = draw_batches(rng, 0.5, 0.1), draw_batches(rng, 0.5, 0.3)
    assert metrics.share_failing_pixels(ours, theirs) <= 0.0025
    assert metrics.share_failing_tiles(ours, theirs) == 0.0


def test_pixels_with_another_mean_fail():
    rng = np.random.default_rng(5)
    ours, theirs = draw_batches(rng, 0.5, 0.01), draw_batches(rng, 0.5, 0.01)
    ours[:, 10:20, 10:20] += 0.5
    failing = metrics.find_failing(ours, theirs)
    assert failing[10:20, 10:20].all()
    assert failing.sum() == 100


def test_tiles_show_a_bias_hidden_in_the_noise_of_every_pixel():
    rng = np.random.default_rng(6)
    ours, theirs = draw_batches(rng, 0.52, 0.1), draw_batches(rng, 0.5, 0.1)
    assert metrics.share_failing_pixels(ours, theirs) == 0.0
    assert metrics.share_failing_tiles(ours, theirs) == 1.0


def test_pictures_without_noise_pass_within_float32_rounding_only():
    flat = np.full((4, 8, 8, 3), 0.7, dtype=np.float32)
    assert metrics.share_failing_pixels(flat, np.nextafter(flat, np.float32(1))) == 0.0
    assert metrics.share_failing_pixels(flat, flat * np.float32(1.0001)) == 1.0
    # A thousand samples added up in float32 may be off by 1e3 * 6e-8.
    assert metrics.share_failing_pixels(flat, flat * np.float32(1.00003), summed=1000) == 0.0


def test_the_neighbourhood_speaks_for_pixels_that_missed_a_rare_event():
    rng = np.random.default_rng(8)
    # One batch in fifty finds a bright sliver: most pixels never see it, and their own spread says there is none.
    ours, theirs = (np.where(rng.random((8, 40, 40, 1)) < 0.02, 25.0, 0.5) for _ in range(2))
    assert metrics.find_failing(ours[:, :, :, :], theirs + 1e-3).mean() > 0.5
    assert metrics.share_failing_pixels(ours, theirs + 1e-3) <= 0.0025


def test_a_single_batch_is_refused():
    flat = np.zeros((1, 2, 2, 3))
    with pytest.raises(ValueError, match="at least 2 batches"):
        metrics.compare_means(flat, flat)


def test_corrected_significance_keeps_the_probability_of_any_failure():
    level = metrics.correct_significance(6144, 0.01)
    assert 1 - (1 - level) ** 6144 == pytest.approx(0.01, rel=1e-9)


@pytest.mark.parametrize(
    "name", ["Depth", "Position", "Normal", "UV", "Diffuse Color", "Emission", "Alpha", "Object Index"]
)
def test_a_single_wrong_pixel_of_a_pass_is_found(rng, name):
    """Among pixels of the right values, each the same in every batch, and also where chance decides further off."""
    ours = np.tile(np.round(rng.uniform(1, 3, size=(12, 16, 1)), 1), (8, 1, 1, 1))
    ours[:, :, 10:] += rng.normal(0, 0.1, size=(8, 12, 6, 1))
    cycles = ours.copy()
    cycles[:, :, 10:] = np.roll(ours, 1, axis=0)[:, :, 10:]
    assert compare_pass(name, ours, cycles).share == 0.0
    cycles[:, 5, 4] += 1.0
    assert np.argwhere(compare_pass(name, ours, cycles).differing).tolist() == [[5, 4]]


def foggy(rng):
    """Return the depth (1, 12, 16, 1) of a wall, and eight batches that show it or, half of the time, the background;
    pixel (2, 3) is never seen."""
    wall = np.linspace(5, 6, 12 * 16).reshape(1, 12, 16, 1)
    fog = rng.random((8, 12, 16, 1)) < 0.5
    fog[0], fog[1] = True, False
    fog[:, 2, 3] = True
    return wall, np.where(fog, BACKGROUND_DEPTH, wall)


def test_what_chance_hides_now_and_then_is_compared_where_it_is_seen(rng):
    wall, cycles = foggy(rng)
    ours = np.repeat(wall, 8, axis=0)
    assert not compare_pass("Depth", ours, cycles, (find_seen(ours), find_seen(cycles))).differing[5, 4]
    ours[:, 5, 4] *= 1.01
    difference = compare_pass("Depth", ours, cycles, (find_seen(ours), find_seen(cycles)))
    assert [5, 4] in np.argwhere(difference.differing).tolist()
    assert set(map(tuple, np.argwhere(difference.differing))) <= {(5, 4), (2, 3)}


def test_what_is_never_seen_is_in_doubt_until_it_is_shown(rng):
    wall, cycles = foggy(rng)
    ours = np.repeat(wall, 8, axis=0)
    seen = find_seen(ours), find_seen(cycles)
    doubtful = find_doubtful(*seen)
    assert np.argwhere(doubtful).tolist() == [[2, 3]]
    for depth, agrees in ((wall, True), (wall * 1.01, False)):
        shown = Answer({"Depth": depth}, doubtful[np.newaxis])
        assert join_answer("Depth", ours, cycles, *seen, shown).differing.any() != agrees
    never = Answer({"Depth": wall}, np.zeros_like(doubtful)[np.newaxis])
    assert np.argwhere(join_answer("Depth", ours, cycles, *seen, never).differing).tolist() == [[2, 3]]


def test_without_chance_there_is_no_doubt(rng):
    wall, _ = foggy(rng)
    hole = np.where(np.arange(16)[:, np.newaxis] < 8, wall, BACKGROUND_DEPTH)
    assert not find_doubtful(find_seen(wall), find_seen(hole)).any()
