"""Verdicts on pictures of known distribution: how often equal ones are called different, and different ones found."""

import math

import numpy as np
import pytest

from addon.compare.cycles import metrics, verdict
from addon.compare.cycles.power import POWER
from addon.compare.verdicts import AGREES, DIFFERS, UNDECIDED

SIGMAS = 4.0
# Standard deviations of both sides: alike, and one that is nearly without noise, so that the other alone is estimated.
NOISES = [(0.1, 0.1), (0.1, 0.01), (0.04, 0.1)]
WIDTH = 150


def draw_sides(rng, noises, shape, level=1.0, batches=8):
    return [level + sigma * rng.standard_normal((batches, *shape)) for sigma in noises]


def bound_rate(rate, count):
    """Return by how much a rate of `count` tests may be off."""
    return SIGMAS * math.sqrt(rate * (1 - rate) / count)


@pytest.mark.parametrize("noises", NOISES)
@pytest.mark.parametrize("tolerated", [0.0, 0.001])
def test_equal_tiles_are_called_different_as_seldom_as_stated(rng, noises, tolerated):
    """The level is far above the noise, and what is tolerated far below. One tile is one pixel."""
    rate, count = 0.01, WIDTH**2
    ours, theirs = draw_sides(rng, noises, (WIDTH, WIDTH, 1), level=100.0)
    found = verdict.find_bias(ours, theirs, 1, rate, tolerated / 100.0).bias > tolerated / 100.0
    assert found.mean() <= rate + bound_rate(rate, count)
    assert found.mean() >= 0.3 * rate if tolerated == 0 else True


@pytest.mark.parametrize("noises", NOISES)
@pytest.mark.parametrize("rate", [0.01, 1e-4])
def test_the_smallest_difference_is_found_as_often_as_stated(rng, noises, rate):
    """Each tile is given the very difference that is stated for it; not much less is found as often."""
    shape, tolerated, level = (WIDTH, WIDTH, 1), 2e-4, 100.0
    ours, theirs = draw_sides(rng, noises, shape, level)
    stated = verdict.find_bias(ours, theirs, 1, rate, tolerated).detectable * level
    found = [
        (verdict.find_bias(ours + part * stated, theirs, 1, rate, tolerated).bias > tolerated).mean()
        for part in (1.0, 0.6)
    ]
    assert found[0] >= POWER - bound_rate(POWER, WIDTH**2)
    assert found[1] < 0.75


def test_pictures_that_are_equal_are_seldom_called_different(monkeypatch):
    """4 tiles, the whole picture, 3 channels: one family, whose probability of any false alarm is that stated."""
    monkeypatch.setattr(verdict, "judge_pixels", lambda *_: (0.0, 0.0))
    rng, rate, count = np.random.default_rng(11), 0.2, 200
    alarms = 0
    for _ in range(count):
        judged = verdict.judge_pictures(*draw_sides(rng, NOISES[0], (32, 32, 3)), to=1e-9, significance=rate)
        alarms += max(judged.tile.bias, judged.picture.bias) > verdict.TOLERATED * judged.to
    # Each tile's and the picture's means hang together, so the tests are fewer than they are taken for.
    assert 0.3 * rate <= alarms / count <= rate + bound_rate(rate, count)


def test_what_noise_hides_is_undecided_and_more_samples_decide_it(rng):
    shape, off = (48, 64, 3), 0.03
    few = verdict.judge_pictures(*draw_sides(rng, (0.1, 0.1), shape))
    word, reason = verdict.decide(few, {}, 64)
    assert word == UNDECIDED
    assert verdict.show_share(few.tile.detectable) in reason
    # So many batches as are said to be needed find it, though fewer do: their noise is known better.
    batches = math.ceil(8 * verdict.measure_shortage(few))
    ours, theirs = draw_sides(rng, (0.1, 0.1), shape, batches=batches)
    assert verdict.decide(verdict.judge_pictures(ours, theirs), {}, 64)[0] == AGREES
    assert verdict.decide(verdict.judge_pictures(ours + off, theirs), {}, 64)[0] == DIFFERS
    assert few.pixel_detectable > 16 * few.tile.detectable / 2


def test_the_whole_picture_shows_what_no_tile_does(rng):
    ours, theirs = draw_sides(rng, (0.3, 0.3), (256, 256, 3))
    judged = verdict.judge_pictures(ours * 1.01, theirs, to=0.01)
    assert judged.tile.bias == 0.0
    assert 0.0025 < judged.picture.bias < 0.01
    assert verdict.decide(judged, {}, 8) == (DIFFERS, verdict.find_differences(judged, {})[0])
    assert "the whole picture" in verdict.find_differences(judged, {})[0]


def test_the_tile_that_differs_is_named_by_its_corner(rng):
    ours, theirs = draw_sides(rng, (0.01, 0.01), (40, 56, 3))
    theirs[:, 16:32, 48:, 2] *= 1.5
    reasons = verdict.find_differences(verdict.judge_pictures(ours, theirs), {"Depth": 0.002, "UV": 0.001})
    assert any("the tile at (48, 16) from the upper left" in reason for reason in reasons)
    assert reasons[-1] == "Depth differs in 0.2% of the pixels"


def test_a_level_is_that_of_the_brighter_side_and_may_be_negative():
    """A light of -1 for one of 1 is off by twice its level, no light for some by all of it; black agrees with black."""
    shape = (8, 16, 16, 3)
    for ours, theirs, share in ((-1.0, 1.0, 2.0), (0.0, 0.3, 1.0), (0.3, 0.0, 1.0), (0.0, 0.0, 0.0)):
        judged = verdict.judge_pictures(np.full(shape, ours), np.full(shape, theirs))
        assert judged.picture.bias == pytest.approx(share, abs=1e-5)
        assert verdict.decide(judged, {}, 8)[0] == (DIFFERS if share else AGREES)


def test_float32_rounding_is_no_difference():
    flat = np.full((8, 16, 16, 3), 0.7, dtype=np.float32)
    judged = verdict.judge_pictures(flat, np.nextafter(flat, np.float32(1)), to=1e-6)
    assert judged.picture.bias == 0.0
    assert judged.picture.detectable > 1e-6


def test_a_pixel_that_is_no_number_is_a_difference(rng):
    ours, theirs = draw_sides(rng, (0.001, 0.001), (16, 16, 3))
    ours[3, 5, 6, 1] = np.nan
    judged = verdict.judge_pictures(ours, theirs)
    assert judged.strange == pytest.approx(1 / 256)
    assert verdict.decide(judged, {}, 8) == (DIFFERS, "0.39% of the pixels are infinite or no number")


def test_a_tile_that_is_black_beside_the_picture_needs_no_agreement(rng):
    """What is below a screen's first step above black is measured by that step, not by itself."""
    ours, theirs = draw_sides(rng, (1e-6, 1e-6), (32, 32, 3))
    ours[:, :16, :16], theirs[:, :16, :16] = 1e-8, 2e-8
    judged = verdict.judge_pictures(ours, theirs)
    assert judged.tile.bias <= 2e-8 / (0.75 * verdict.DARKEST)
    assert verdict.decide(judged, {}, 8)[0] == AGREES


@pytest.mark.parametrize(("share", "text"), [(0.0123, "1.2%"), (0.5, "50%"), (7.996, "800%"), (0.0, "0%")])
def test_shares_have_two_digits(share, text):
    assert verdict.show_share(share) == text


@pytest.mark.parametrize(("number", "text"), [(5.2, "6"), (487.0, "490"), (123456.0, "130000")])
def test_counts_are_rounded_up_to_two_digits(number, text):
    assert verdict.show_count(number) == text


def test_the_pixels_bar_is_that_of_the_agreement_with_cycles():
    from tests.benchmarks import agreement

    assert (verdict.PIXELS_BAR, verdict.PASSES_BAR) == (agreement.Z_BAR, agreement.PASSES_BAR)
    assert verdict.TOLERATED * verdict.TO <= agreement.TILE_BAR
    assert metrics.TILE == 16
