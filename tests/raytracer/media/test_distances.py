"""Distances in even media: densities integrate to one, weights are what they say, emission is a limit of both."""

from __future__ import annotations

import numpy as np
import pytest

from raytracer.media.distances import (
    find_angle_density,
    find_density,
    find_transmittance,
    measure_angles,
    sample_angles,
    sample_distances,
    sum_emission,
    weigh_channels,
)

EXTINCTION = np.array([[0.5, 2.0, 0.0]])
SCATTERING = np.array([[0.4, 0.5, 0.0]])
THROUGHPUT = np.array([[1.0, 0.3, 0.7]])


def repeat(values: np.ndarray, count: int) -> np.ndarray:
    return np.repeat(values, count, axis=0)


def test_scattering_and_what_gets_through_come_to_one() -> None:
    channels = weigh_channels(EXTINCTION, SCATTERING, THROUGHPUT)
    assert channels.sum() == pytest.approx(1.0)
    distance = (np.arange(400_000) + 0.5) / 400_000 * 3.0
    density = find_density(repeat(EXTINCTION, len(distance)), repeat(channels, len(distance)), distance)
    through = (channels * find_transmittance(EXTINCTION, np.array([3.0]))).sum()
    assert density.mean() * 3.0 + through == pytest.approx(1.0, abs=1e-9)


def test_weights_make_up_for_the_density() -> None:
    """Means over samples: the light scattered on the way, and what gets through, of each channel."""
    count, rng = 1 << 16, np.random.default_rng(3)
    channels = repeat(weigh_channels(EXTINCTION, SCATTERING, THROUGHPUT), count)
    extinction, scattering = repeat(EXTINCTION, count), repeat(SCATTERING, count)
    found = sample_distances(extinction, scattering, channels, np.full(count, 1.5), rng.random((count, 2)))
    left = find_transmittance(EXTINCTION, np.array([1.5]))[0]
    lost = np.divide(SCATTERING[0] * (1 - left), EXTINCTION[0], out=np.zeros(3), where=EXTINCTION[0] > 0)
    for expected, chosen in ((lost, found.scattered), (left, ~found.scattered)):
        values = found.weight * chosen[:, None]
        error = values.std(axis=0) / np.sqrt(count)
        assert (np.abs(values.mean(axis=0) - expected) <= 4 * error + 1e-12).all()
    # No sample weighs more than the rarest channel is chosen seldom.
    assert found.weight.max() <= 1.0 / channels.min() + 1e-9


@pytest.mark.parametrize("reach", [2.0, np.inf])
@pytest.mark.parametrize("light", [(0.3, 0.5, 0.0), (1.0, -3.0, 0.2), (0.0, 1.0, 0.0)])
def test_angles_are_sampled_evenly(light: tuple[float, float, float], reach: float) -> None:
    """The density's integral up to a sampled distance is the number that it was sampled by."""
    number = np.linspace(0.02, 0.98, 7)
    start, direction = np.zeros((7, 3)), np.broadcast_to((0.0, 1.0, 0.0), (7, 3))
    angles = measure_angles(start, direction, np.full(7, reach), np.array(light))
    distance = sample_angles(angles, number)
    assert (distance <= reach).all()
    # On a scale on which the light's own place is no peak.
    edges = np.unique(
        np.concatenate([[0.0], distance, light[1] + np.geomspace(1e-7, 5, 4000) * [[-1], [1]]], axis=None)
    )
    edges = edges[(edges >= 0) & (edges <= distance.max())]
    nodes, weights = np.polynomial.legendre.leggauss(8)
    points = edges[:-1, None] + np.diff(edges)[:, None] * (nodes + 1) / 2
    one = angles.select(np.zeros(points.size, np.intp))
    density = find_angle_density(one, points.ravel()).reshape(points.shape)
    share = np.concatenate([[0.0], np.cumsum((density * weights).sum(axis=1) * np.diff(edges) / 2)])
    np.testing.assert_allclose(np.interp(distance, edges, share), number, atol=1e-4)


def test_emission_has_its_limits() -> None:
    extinction = np.array([[0.0, 1e-12, 3.0], [0.0, 1e-300, 1.0]])
    found = sum_emission(extinction, np.full((2, 3), 0.5), np.array([2.0, np.inf]))
    np.testing.assert_allclose(found[0], [1.0, 1.0, 0.5 * -np.expm1(-6.0) / 3.0], rtol=1e-11)
    assert found[1, 0] == 0.0
    assert found[1, 2] == pytest.approx(0.5)
