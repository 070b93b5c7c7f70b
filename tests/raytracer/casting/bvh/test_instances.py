"""Inverses of instances' matrices: what is said of their residuals holds in fractions, however bad the matrix is."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from raytracer.casting.bvh import instances
from raytracer.casting.bvh.instances import WORST_RESIDUAL, invert


def find_residual(inverse: np.ndarray, linear: np.ndarray) -> Fraction:
    """||X M - I||, the largest sum of a row, exactly."""
    x, m = ([[Fraction(float(value)) for value in row] for row in matrix] for matrix in (inverse, linear))
    product = [[sum(x[i][k] * m[k][j] for k in range(3)) - (i == j) for j in range(3)] for i in range(3)]
    return max(sum(abs(value) for value in row) for row in product)


def draw_rotations(rng: np.random.Generator, count: int) -> np.ndarray:
    return np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]


def make_matrices(linear: np.ndarray) -> np.ndarray:
    matrices = np.tile(np.eye(4), (len(linear), 1, 1))
    matrices[:, :3, :3] = linear
    return matrices


def draw_kinds(rng: np.random.Generator, count: int) -> dict[str, np.ndarray]:
    """Linear parts (count, 3, 3) of several kinds."""
    turned, again = draw_rotations(rng, count), draw_rotations(rng, count)
    mirrored = turned * np.array([1.0, -1.0, 1.0])
    stretched = turned * 10.0 ** rng.uniform(-3, 3, (count, 1, 3))  # along the object's own axes
    flattened = again @ (np.array([[1.0], [1.0], [1e-5]]) * turned)  # along the world's: the columns nearly depend
    thin = again @ (np.array([[1.0], [1e-6], [1e-6]]) * turned)
    return {
        "turned": turned,
        "mirrored": mirrored,
        "stretched": stretched,
        "tiny": turned * 1e-100,
        "huge": turned * 1e150,
        "any": rng.normal(size=(count, 3, 3)),
        "flattened": flattened,
        "thin": thin,
    }


@pytest.mark.parametrize("kind", draw_kinds(np.random.default_rng(0), 1))
def test_residuals_of_inverses_hold_in_fractions(rng: np.random.Generator, kind: str) -> None:
    linear = draw_kinds(rng, 60)[kind]
    inverse, residual = invert(make_matrices(linear))
    assert (residual < WORST_RESIDUAL).all()
    for row in range(len(linear)):
        assert find_residual(inverse[row], linear[row]) <= Fraction(float(residual[row]))


@pytest.mark.parametrize("kind", ["turned", "mirrored", "stretched", "tiny", "huge"])
def test_turned_and_stretched_instances_are_inverted_without_lapack(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.setattr(np.linalg, "inv", lambda matrices: pytest.fail("it was asked"))
    _, residual = invert(make_matrices(draw_kinds(rng, 500)[kind]))
    assert residual.max() < WORST_RESIDUAL


def test_what_cofactors_cannot_invert_well_elimination_does(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two stretches with a turn between: cofactors lose the square of 1e6, elimination the number itself."""
    matrices = make_matrices(draw_kinds(rng, 500)["thin"])
    _, residual = invert(matrices)
    monkeypatch.setattr(instances, "WELL_INVERTED", np.inf)
    _, by_cofactors = invert(matrices)
    assert residual.max() < WORST_RESIDUAL < np.median(by_cofactors)


def test_singular_matrices_have_no_inverse() -> None:
    underflowing = np.eye(3) * 1e-150
    linear = np.array([np.zeros((3, 3)), np.ones((3, 3)), np.diag([1.0, 1.0, 0.0]), underflowing])
    _, residual = invert(make_matrices(linear))
    assert (residual == np.inf).all()


def test_more_matrices_than_a_block_are_inverted_as_one(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    matrices = make_matrices(np.concatenate(list(draw_kinds(rng, 20).values())))
    expected = invert(matrices)
    monkeypatch.setattr(instances, "BLOCK", 7)
    for ours, theirs in zip(invert(matrices), expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)
