"""Null collisions: bounds cell by cell, and means that no bound changes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from raytracer.media.majorants import SPARE, Majorants, find_local, make_majorants, place_majorants
from raytracer.media.mixtures import Mixture, make_nothing
from raytracer.media.tracking import Stretches, track
from raytracer.sampling.streams import draw, start_noise

BOX = np.array([[(-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)]])
SHEARED = np.array([[(2.0, 0.5, 0.0, 1.0), (0.0, 1.0, 0.3, 0.0), (0.0, 0.0, 1.5, -2.0), (0.0, 0.0, 0.0, 1.0)]])


def peak(medium: Any, position: Any) -> Mixture:
    """A density that has a peak off the middle, less of it red, half of it scattering, and some light."""
    mixture = make_nothing(len(position), 1)
    density = 4.0 * np.exp(-2.0 * ((position - (0.3, 0.1, 0.0)) ** 2).sum(axis=1))[:, None]
    mixture.extinction[:] = density * (0.5, 1.0, 1.0)
    mixture.scattering[:] = density * (0.25, 0.5, 0.2)
    mixture.emission[:] = density * 0.1
    mixture.lobes.weight[:, 0] = mixture.scattering
    return mixture


def sum_peak(inside: Any, position: Any) -> Mixture:
    return peak(inside[:, 0], position)


PLACED = np.eye(4)[np.newaxis]


def make_peak(matrix: Any = PLACED) -> Majorants:
    return make_majorants(np.zeros(1), np.ones(1, np.bool_), BOX, matrix, peak)


def test_bounds_are_above_what_is_there() -> None:
    majorants, rng = make_peak(), np.random.default_rng(1)
    points = rng.uniform(-1, 1, (5000, 3))
    inside = np.zeros((5000, 1), np.int32)
    rate, _ = find_local(majorants, inside, points, np.tile((0.0, 0.0, 1.0), (5000, 1)), np.zeros(5000))
    largest = peak(None, points).extinction.max(axis=1)
    assert (rate >= largest).all()
    # Where it matters they are not far above it, though they are those of whole cells.
    assert (rate[largest > 1] < 2.0 * SPARE * largest[largest > 1]).all()


@pytest.mark.parametrize("matrix", [PLACED, SHEARED])
def test_a_bound_holds_until_the_next_cell(matrix: Any) -> None:
    """Rays are walked from cell to cell: within each step the cell's number, found anew, is the same."""
    majorants, rng = make_peak(matrix), np.random.default_rng(2)
    local = rng.uniform(-1.5, 1.5, (300, 3))
    origin = local @ matrix[0, :3, :3].T + matrix[0, :3, 3]
    direction = rng.normal(size=(300, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    direction[:20] = (0.0, 0.0, -1.0)
    inside, at, others = np.zeros((300, 1), np.int32), np.zeros(300), 0
    for _ in range(40):
        rate, end = find_local(majorants, inside, origin, direction, at)
        assert (end > at).all()
        for share in (0.01, 0.5, 0.99):
            middle = at + share * (np.minimum(end, at + 10.0) - at)
            again, _ = find_local(majorants, inside, origin, direction, middle)
            others += np.count_nonzero(np.abs(again - rate) > 1e-12 * rate)
        at = np.minimum(end, at + 10.0)
    # Of 36,000: where a step ends within LEAST_STEP of a corner of cells.
    assert others <= 5


def test_bounds_go_with_what_moves() -> None:
    """A medium that varies in its own space has the same bounds wherever it is."""
    moved = place_majorants(make_peak(), SHEARED)

    def evaluate(medium: Any, position: Any) -> Mixture:
        return peak(medium, (position - SHEARED[0, :3, 3]) @ np.linalg.inv(SHEARED[0, :3, :3]).T)

    rng = np.random.default_rng(3)
    local = rng.uniform(-1, 1, (5000, 3))
    points = local @ SHEARED[0, :3, :3].T + SHEARED[0, :3, 3]
    inside, along = np.zeros((5000, 1), np.int32), np.tile((0.0, 0.0, 1.0), (5000, 1))
    rate, _ = find_local(moved, inside, points, along, np.zeros(5000))
    assert (rate >= evaluate(None, points).extinction.max(axis=1)).all()
    still, _ = find_local(make_peak(), inside, local, along, np.zeros(5000))
    assert np.mean(rate == still) > 0.999  # but where rounding decides in which cell a point is


def make_stretches(count: int, seed: int) -> Stretches:
    rng = np.random.default_rng(seed)
    direction = np.tile((0.6, 0.8, 0.0), (count, 1))
    origin = np.tile((-0.6, -0.7, 0.1), (count, 1))
    noise = start_noise(rng.random((count, 2)))
    return Stretches(np.zeros((count, 1), np.int32), origin, direction, np.full(count, 0.1), np.full(count, 1.6), noise)


def integrate() -> tuple[Any, Any, Any]:
    """Return what gets through, is scattered, and shines, of the same stretch, by quadrature."""
    t = 0.1 + 1.5 * (np.arange(100_000) + 0.5) / 100_000
    mixture = peak(None, make_stretches(1, 0).origin + t[:, None] * make_stretches(1, 0).direction)
    step = 1.5 / 100_000
    depth = np.cumsum(mixture.extinction, axis=0) * step - mixture.extinction * step / 2
    left = np.exp(-depth)
    return left[-1], (left * mixture.scattering).sum(axis=0) * step, (left * mixture.emission).sum(axis=0) * step


# The bound as it is found; everywhere the same; and far too low in the middle of the peak.
BOUNDS = {"cells": 1.0, "high": 3.0, "too low": 0.5}


@pytest.mark.parametrize("name", BOUNDS)
def test_means_are_those_of_quadrature_whatever_the_bound(name: str) -> None:
    majorants = make_peak()
    majorants = replace(majorants, values=BOUNDS[name] * majorants.values)
    count = 1 << 15
    through, scattered, shining = integrate()
    for scatters in (True, False):
        stretches = make_stretches(count, 7 + scatters)
        found = track(majorants, sum_peak, stretches, np.ones((count, 3)), np.full(count, scatters))
        passed = found.weight * ~found.scattered[:, None]
        pairs = [(passed, through), (found.emission, shining)]
        if scatters:
            pairs.append((found.weight * found.scattered[:, None], scattered))
        for values, expected in pairs:
            error = values.std(axis=0) / np.sqrt(count)
            assert (error < 0.02).all()
            assert (np.abs(values.mean(axis=0) - expected) < 4 * error).all()


def test_random_numbers_are_even_and_apart() -> None:
    count, rng = 1 << 16, np.random.default_rng(9)
    noise = start_noise(rng.random((count, 2)))
    one, other, third = draw(noise, 0), draw(noise, 1), draw(start_noise(rng.random((count, 2)), 1), 0)
    for numbers in (one, other, third):
        counts = np.histogram(numbers, 64, (0.0, 1.0))[0]
        assert ((counts - count / 64) ** 2 / (count / 64)).sum() < 63 + 4 * np.sqrt(2 * 63)
    assert abs(np.corrcoef(one, other)[0, 1]) < 4 / np.sqrt(count)
    assert abs(np.corrcoef(one, third)[0, 1]) < 4 / np.sqrt(count)
