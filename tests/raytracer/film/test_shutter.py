"""Times of samples: even, independent between sets and replications, in the shutter's proportions, row by row."""

import numpy as np
import pytest

from raytracer.film.shutter import choose_side, find_middle, open_shutter, sample_times
from raytracer.scene.motion import Motion

WIDTH, HEIGHT = 8, 12
ROW, COLUMN = (part.ravel() for part in np.indices((HEIGHT, WIDTH)))


def list_times(motion, samples, side=2, seed=0):
    """Return (samples, pixels)."""
    return np.array([sample_times(motion, number, seed, side, COLUMN, ROW, HEIGHT) for number in range(samples)])


def test_each_set_of_pixels_has_even_times_of_its_own():
    times = list_times(Motion(), 32)
    key = ROW % 2 * 2 + COLUMN % 2
    for number in range(4):
        assert (times[:, key == number] == times[:, key == number][:, :1]).all()
    for replication in range(2):  # 16 samples of a sequence: one in each sixteenth
        strata = np.sort((times[replication::2] * 16).astype(int), axis=0)
        assert (strata == np.arange(16)[:, np.newaxis]).all()
    sets = np.column_stack([times[:, np.flatnonzero(key == number)[0]] for number in range(4)])
    assert len(np.unique(sets)) == sets.size


def test_replications_and_seeds_are_independent():
    """Means over two replications, of many seeds, of what is seen in a third of the time."""
    errors = np.array([(list_times(Motion(), 8, seed=seed)[:, 0].reshape(4, 2) < 1 / 3).mean(0) for seed in range(400)])
    first, second = (errors - 1 / 3).T
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.2
    assert abs(errors.mean() - 1 / 3) < 0.02


def test_a_time_depends_on_nothing_but_the_pixel_and_the_sample():
    motion = Motion(shutter=[1.0, 3.0], rolling_shutter=0.3)
    whole = sample_times(motion, 5, 1, 4, COLUMN, ROW, HEIGHT)
    some = np.arange(7, 50, 3)
    assert np.array_equal(whole[some], sample_times(motion, 5, 1, 4, COLUMN[some], ROW[some], HEIGHT))


def test_times_follow_how_far_the_shutter_is_open():
    chance = (np.arange(1000) + 0.5) / 1000
    times = open_shutter(Motion(shutter=[0.0, 1.0, 0.0, 3.0, 0.0]), chance)
    assert np.bincount((times * 5).astype(int), minlength=5).tolist() == [0, 250, 0, 750, 0]
    assert np.abs(np.sort(times[times < 0.4]) - (0.2 + 0.2 * (np.arange(250) + 0.5) / 250)).max() < 1e-12
    assert open_shutter(Motion(shutter=[0.0, 1.0, 0.0]), np.array([0.0, 1.0])).tolist() == [1 / 3, 2 / 3]


@pytest.mark.parametrize("shutter", [None, [1.0, 3.0]])
@pytest.mark.parametrize("share", [0.1, 0.35, 1.0])
def test_rows_of_a_rolling_shutter_see_their_part_of_the_time(share, shutter):
    """Row r sees from (1 - r / height) (1 - share) on, for `share`, in the shutter's proportions."""
    motion = Motion(shutter=shutter, rolling_shutter=share)
    times = list_times(motion, 256)
    start = (1.0 - ROW / HEIGHT) * (1.0 - share)
    within = (times - start) / share
    assert within.min() > -1e-12
    assert within.max() < 1 + 1e-12
    later = (within > 0.5).mean(axis=0)
    assert np.abs(later - (0.5 if shutter is None else 0.75)).max() < 0.02


def test_rows_that_see_light_together_share_times():
    times = list_times(Motion(rolling_shutter=0.25), 8)
    for sample in times:
        assert len(np.unique(sample)) <= 4 * 5


def test_a_rolling_shutter_that_is_open_for_no_time_gives_each_row_its_own():
    times = list_times(Motion(rolling_shutter=0.0), 3)
    assert np.array_equal(times, np.broadcast_to(1.0 - ROW / HEIGHT, times.shape))


def test_the_middle_is_that_of_what_a_row_sees():
    assert (find_middle(Motion(), ROW, HEIGHT) == 0.5).all()
    found = find_middle(Motion(rolling_shutter=0.5), np.array([0, HEIGHT // 2]), HEIGHT)
    assert found.tolist() == [0.75, 0.5]


def test_large_pictures_have_more_times_but_where_those_are_dear():
    assert choose_side(512 * 512, 0) == 4
    assert choose_side(512 * 511, 0) == 2
    assert choose_side(1920 * 1080, 500_000) == 4
    assert choose_side(640 * 480, 500_000) == 2
