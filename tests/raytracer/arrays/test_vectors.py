"""Unit vectors: of any size, of none, of whole numbers, and in stacks."""

import numpy as np
import pytest

from raytracer.arrays.vectors import normalize
from raytracer.lecture import length


@pytest.mark.parametrize("size", [1e-300, 1.0, 1e300])
def test_vectors_of_any_size_have_a_length_of_one(rng, size):
    vectors = size * rng.normal(size=(50, 3))
    unit = normalize(vectors)
    np.testing.assert_allclose(length(unit), 1.0, rtol=4e-16)
    np.testing.assert_allclose(unit * length(vectors / size)[:, np.newaxis], vectors / size, rtol=2e-15)


def test_vectors_of_zeros_stay_zero_and_of_nan_stay_nan():
    unit = normalize(np.array([[0.0, -0.0, 0.0], [np.nan, 1.0, 0.0], [0.0, 3.0, -4.0]]))
    np.testing.assert_array_equal(unit[0], 0.0)
    assert np.isnan(unit[1, 0])
    np.testing.assert_allclose(unit[2], [0.0, 0.6, -0.8], rtol=2e-16)


def test_one_vector_whole_numbers_and_stacks_are_normalized_alike(rng):
    stack = rng.integers(1, 9, size=(4, 5, 3))
    unit = normalize(stack)
    np.testing.assert_array_equal(unit[2, 3], normalize(stack[2, 3].astype(float)))
    np.testing.assert_array_equal(normalize(np.array([0, 3, 4])), [0.0, 0.6, 0.8])
    assert normalize(np.zeros((0, 3))).shape == (0, 3)
