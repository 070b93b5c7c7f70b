"""Numbers of samples by runs of pixels, against one number for each."""

import numpy as np
import pytest

from raytracer.film import counts as module
from raytracer.film.counts import SampleCounts, is_run

PIXELS = 40


def draw_pixels(rng):
    """Return some pixels as a slice, or as a list of them, a run or not."""
    start, stop = sorted(rng.integers(0, PIXELS + 1, 2).tolist())
    kind = rng.integers(4)
    if kind < 2:
        return slice(start, stop) if kind else slice(start, None)
    return np.arange(start, stop) if kind == 2 else np.flatnonzero(rng.random(PIXELS) < 0.3)


@pytest.mark.parametrize("most", [1, 6, 256])
def test_numbers_are_those_of_each_pixel_by_itself(rng, monkeypatch, most):
    monkeypatch.setattr(module, "MOST_RUNS", most)
    kept = set()
    for _ in range(60):
        counts, expected = SampleCounts(PIXELS), np.zeros((PIXELS, 2), dtype=np.int32)
        for _ in range(rng.integers(1, 12)):
            pixels, replication = draw_pixels(rng), int(rng.integers(2))
            if rng.random() < 0.7:
                is_slice = isinstance(pixels, slice) or rng.random() < 0.1
                counts.add(pixels, replication, repeated=not is_slice)
                expected[pixels, replication] += 1
            else:
                given = np.repeat(rng.integers(0, 3, (PIXELS, 2), dtype=np.int32), 5, axis=0)
                given = given[: len(expected[pixels])]
                counts.put(pixels, given)
                expected[pixels] = given
            seen = draw_pixels(rng)
            np.testing.assert_array_equal(counts.read(seen), expected[seen])
            columns = counts.read_columns(seen)
            np.testing.assert_array_equal(np.broadcast_to(columns, expected[seen].T.shape), expected[seen].T)
        kept.add(counts.is_by_runs)
        assert counts.find_most() == (expected.sum(axis=1).max(), expected.max())
        if counts.is_by_runs:
            again = SampleCounts(PIXELS)
            again.set_runs(counts.list_runs())
            np.testing.assert_array_equal(again.read(slice(None)), expected)
        left = int(rng.integers(PIXELS))
        counts.cut_off(left)
        np.testing.assert_array_equal(counts.read(slice(None)), expected[:left])
        assert counts.read(slice(None)).dtype == np.int32
    assert kept == {True, False} or most == 1


def test_sweeps_in_blocks_are_one_run_after_each():
    counts = SampleCounts(PIXELS)
    for sweep in range(6):
        for start in range(0, PIXELS, 7):
            counts.add(slice(start, min(start + 7, PIXELS)), sweep % 2)
            assert len(counts.list_runs()) <= 2
        assert len(counts.list_runs()) == 1
    assert counts.list_runs().tolist() == [[PIXELS, 3, 3]]


def test_a_pixel_that_is_there_several_times_counts_as_often():
    counts = SampleCounts(3)
    counts.add(np.array([2, 0, 2, 2]), 1, repeated=True)
    assert counts.read(slice(None)).tolist() == [[0, 1], [0, 0], [0, 3]]


@pytest.mark.parametrize("runs", [[], [[3, 1, 1]], [[5, 1, 1]], [[2, 1, 1], [2, 0, 1], [4, 1, 1]], [[4, -1, 1]]])
def test_runs_of_other_pixels_are_refused(runs):
    with pytest.raises(ValueError, match="do not make 4"):
        SampleCounts(4).set_runs(np.array(runs, dtype=np.int64).reshape(-1, 3))


def test_only_pixels_one_after_the_other_are_a_run():
    assert is_run(np.array([4, 5, 6]))
    assert not is_run(np.array([4, 6, 7]))
    assert not is_run(np.array([], dtype=int))
