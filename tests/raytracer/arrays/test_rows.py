"""Selections and reductions of rows: NumPy's own results, bit for bit."""

import numpy as np
import pytest

from raytracer.arrays.rows import all_columns, any_column, largest_column, mean_column, sum_columns, take_rows


@pytest.mark.parametrize("shape", [(0, 3), (1, 3), (50, 1), (50, 3), (50, 4)])
def test_reductions_are_numpys(rng, shape):
    values = rng.normal(size=shape)
    np.testing.assert_array_equal(any_column(values > 1), (values > 1).any(axis=1))
    np.testing.assert_array_equal(all_columns(values > -1), (values > -1).all(axis=1))
    np.testing.assert_array_equal(sum_columns(values), values.sum(axis=1))
    np.testing.assert_array_equal(mean_column(values), values.mean(axis=1))
    np.testing.assert_array_equal(largest_column(values), values.max(axis=1))
    before = values.copy()
    largest_column(values)[:] = np.nan
    np.testing.assert_array_equal(values, before)


@pytest.mark.parametrize("shape", [(9,), (9, 3), (9, 2, 2)])
def test_selections_are_numpys(rng, shape):
    values = rng.normal(size=shape)
    for rows in (slice(2, 5), np.array([3, 3, 0, -1]), rng.random(9) < 0.5, np.zeros(0, np.intp)):
        np.testing.assert_array_equal(take_rows(values, rows), values[rows])


def test_counts_stay_whole():
    assert sum_columns(np.ones((2, 3), np.int32)).dtype == np.int32
