"""Phase functions: densities over the sphere, sampled as they say, with the means that their parameters name."""

from __future__ import annotations

import numpy as np
import pytest

from raytracer.media.mixtures import Lobes, evaluate_lobes, sample_lobes
from raytracer.media.phases import (
    DRAINE,
    FOURNIER_FORAND,
    HENYEY_GREENSTEIN,
    RAYLEIGH,
    evaluate_phase,
    fit_drops,
    sample_phase,
)

CASES = [
    *((HENYEY_GREENSTEIN, g, 0.0) for g in (-0.8, 0.0, 0.5, 0.95)),
    (RAYLEIGH, 0.0, 0.0),
    *((DRAINE, g, alpha) for g in (0.0, 5e-3, -0.4, 0.8) for alpha in (0.3, 1.0, 250.0)),
    *((FOURNIER_FORAND, ior, share) for ior in (1.05, 1.2, 1.33) for share in (0.1, 0.2, 0.4)),
]
# Integrals over sqrt((1 - c) / 2): what is peaked forward is smooth there; of 16 nodes on each of 256 intervals.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)
# Quadrature and bisection both err far less; the peaks of Fournier and Forand's, infinite, leave this much.
TOLERANCE = 1e-4


def integrate(case: tuple[int, float, float], power: int = 0, to: float = -1.0) -> float:
    """Return the integral of c^power times the density over all directions from straight on to the cosine `to`."""
    last = np.sqrt(0.5 * (1.0 - to))
    edges = last * np.linspace(0.0, 1.0, 257) ** 2
    root = (edges[:-1, None] + np.diff(edges)[:, None] * (NODES + 1) / 2).ravel()
    weight = (np.diff(edges)[:, None] * WEIGHTS / 2).ravel()
    cosine = 1.0 - 2.0 * root**2
    density = evaluate(case, cosine)
    return float((2.0 * np.pi * 4.0 * root * weight * cosine**power * density).sum())


def evaluate(case: tuple[int, float, float], cosine: np.ndarray) -> np.ndarray:
    kind, first, second = (np.full(len(cosine), value) for value in case)
    return evaluate_phase(kind.astype(np.int8), first, second, cosine)


@pytest.mark.parametrize("case", CASES)
def test_a_phase_function_is_a_density(case: tuple[int, float, float]) -> None:
    assert integrate(case) == pytest.approx(1.0, abs=TOLERANCE)


@pytest.mark.parametrize("case", CASES)
def test_cosines_are_sampled_by_the_density(case: tuple[int, float, float]) -> None:
    """The share of light that is turned by less than the sampled angle is 1 - u, or u, of the number u."""
    number = np.array([0.03, 0.2, 0.5, 0.77, 0.98])
    kind, first, second = (np.full(len(number), value) for value in case)
    cosine = sample_phase(kind.astype(np.int8), first, second, number)
    shares = np.array([integrate(case, to=float(value)) for value in cosine])
    either = min(np.abs(shares - number).max(), np.abs(1.0 - shares - number).max())
    assert either < TOLERANCE


@pytest.mark.parametrize("g", [-0.7, 0.0, 0.3, 0.9])
def test_the_mean_cosine_is_the_anisotropy(g: float) -> None:
    assert integrate((HENYEY_GREENSTEIN, g, 0.0), power=1) == pytest.approx(g, abs=TOLERANCE)


def test_special_cases_agree() -> None:
    cosine = np.linspace(-1.0, 1.0, 11)
    np.testing.assert_allclose(evaluate((DRAINE, 0.0, 1.0), cosine), evaluate((RAYLEIGH, 0, 0), cosine), rtol=1e-14)
    np.testing.assert_allclose(
        evaluate((DRAINE, 0.6, 0.0), cosine), evaluate((HENYEY_GREENSTEIN, 0.6, 0), cosine), rtol=1e-14
    )


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_fournier_forand_throws_its_share_back(share: float) -> None:
    assert integrate((FOURNIER_FORAND, 1.33, share), to=0.0) == pytest.approx(1.0 - share, abs=TOLERANCE)


def test_drops_are_fitted_as_published() -> None:
    """Values of the formulas of the supplement, worked out by hand for one diameter of each range."""
    g, draine, alpha, share = fit_drops(np.array([0.05, 1.0, 3.0, 20.0]))
    assert g[0] == pytest.approx(13.8 * 0.0025)
    assert draine[0] == pytest.approx(1.1456 * 0.05 * np.sin(9.29044 * 0.05))
    assert alpha.tolist()[:2] == [250.0, 250.0]
    assert g[1] == pytest.approx(0.862)
    assert share[1] == pytest.approx(0.146209 * np.cos(2.11193) + 0.316072)
    assert g[2] == pytest.approx(0.0604931 * np.log(np.log(3.0)) + 0.940256)
    assert alpha[2] == pytest.approx(7.30354 * np.log(3.0) + 6.31675)
    assert g[3] == pytest.approx(np.exp(-0.0990567 / (20.0 - 1.67154)))
    assert share[3] == pytest.approx(np.exp(-0.599085 / (20.0 - 0.641583) - 0.665888))


def test_a_mixture_is_sampled_by_its_density() -> None:
    """Over many samples value / density integrates to 1 in each channel, though lobes differ in color."""
    count, rng = 4096, np.random.default_rng(5)
    one = Lobes(
        np.array([[HENYEY_GREENSTEIN, RAYLEIGH]], np.int8),
        np.array([[0.6, 0.0]]),
        np.zeros((1, 2)),
        np.array([[(1.0, 0.2, 0.0), (0.5, 0.5, 1.0)]]),
    )
    lobes = one.select(np.zeros(count, np.intp))
    before = np.broadcast_to((0.6, 0.0, 0.8), (count, 3))
    sample = sample_lobes(lobes, before, rng.random(count), rng.random((count, 2)))
    value, density = evaluate_lobes(lobes, before, sample.direction)
    np.testing.assert_allclose(sample.value * density[:, None], value)
    error = sample.value.std(axis=0) / np.sqrt(count)
    assert (np.abs(sample.value.mean(axis=0) - 1.0) < 4 * error + 1e-12).all()
    # The same by quadrature of the density itself, about the way that the light went.
    mean = (sample.direction @ before[0]).mean()
    shares = np.array([1.2 / 3, 2.0 / 3])
    assert mean == pytest.approx(0.6 * shares[0] / shares.sum(), abs=4 * 0.7 / np.sqrt(count))
