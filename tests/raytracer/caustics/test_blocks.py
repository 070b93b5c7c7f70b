"""Systems of 2 x 2 blocks against NumPy's own solver."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from raytracer.caustics.blocks import Blocks, invert, solve


def make_system(rng, count, size):
    """Return blocks of systems, and their whole matrices (n, 2 k, 2 k)."""
    before, own, after = (list(rng.normal(size=(size, count, 2, 2))) for _ in range(3))
    whole = np.zeros((count, 2 * size, 2 * size))
    for row in range(size):
        for column, part in ((row - 1, before), (row, own), (row + 1, after)):
            if 0 <= column < size:
                whole[:, 2 * row : 2 * row + 2, 2 * column : 2 * column + 2] = part[row]
    return Blocks(before, own, after), whole


@pytest.mark.parametrize("width", [(2,), (2, 2)])
@pytest.mark.parametrize("size", [1, 2, 5])
def test_solution_is_that_of_the_whole_matrix(size, width):
    rng = np.random.default_rng(size)
    blocks, whole = make_system(rng, 40, size)
    values = list(rng.normal(size=(size, 40, *width)))
    found, solvable = solve(blocks, values)
    assert solvable.all()
    right = np.concatenate(values, axis=1).reshape(40, 2 * size, -1)
    assert_allclose(np.concatenate(found, axis=1).reshape(right.shape), np.linalg.solve(whole, right), rtol=1e-8)


def test_what_has_no_solution_is_told():
    flat = np.array([[[1.0, 2.0], [2.0, 4.0]], [[1.0, 2.0], [2.0, 5.0]], [[1e-9, 0.0], [0.0, 1e-9]]])
    inverse, regular = invert(flat)
    assert_array_equal(regular, [False, True, True])
    assert_array_equal(inverse[0], 0.0)
    _, solvable = solve(Blocks([flat], [flat], [flat]), [np.ones((3, 2))])
    assert_array_equal(solvable, regular)
