"""Selections and reductions of rows: NumPy's own results, bit for bit."""

import numpy as np
import pytest

from raytracer.arrays.rows import (
    MANY_INDICES,
    MANY_ROWS,
    add_rows,
    all_columns,
    any_column,
    divide_where,
    exchange,
    find_mode,
    find_sign,
    join_columns,
    keep_rows,
    largest_column,
    lay_columns,
    lay_rows,
    make_zeros,
    mean_column,
    pick_columns,
    put_rows,
    repeat_column,
    scale_vectors,
    shorten_rows,
    sum_columns,
    take_rows,
)


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


@pytest.mark.parametrize(
    "rows", [np.array([3, 3, 0]), np.arange(12) % 3 == 0, slice(2, 5)], ids=["index", "mask", "slice"]
)
def test_columns_stay_columns(rng, rows):
    values = rng.normal(size=(12, 3))
    for laid in (lay_columns(values), lay_columns(rng.normal(size=(20, 3)))[4:16]):
        taken = take_rows(laid, rows)
        np.testing.assert_array_equal(taken, laid[rows])
        assert taken.strides[0] == taken.itemsize


def test_made_vectors_lie_in_columns(rng):
    x, factors = rng.normal(size=(2, 7))
    for made, expected in (
        (make_zeros(7), np.zeros((7, 3))),
        (join_columns(x, factors), np.stack([x, factors], axis=1)),
        (repeat_column(x), np.repeat(x[:, np.newaxis], 3, axis=1)),
        (scale_vectors(np.array([1.0, 2.0, 3.0]), factors), factors[:, np.newaxis] * (1.0, 2.0, 3.0)),
        (scale_vectors(rng.normal(size=(7, 3)), 0.0 * factors), np.zeros((7, 3))),
    ):
        np.testing.assert_array_equal(made, expected)
        assert made.flags.f_contiguous


def test_all_rows_are_a_slice():
    assert shorten_rows(np.arange(4), 4) == slice(None)
    np.testing.assert_array_equal(shorten_rows(np.array([0, 2]), 4), [0, 2])


@pytest.mark.parametrize("lay", [lay_columns, np.ascontiguousarray])
@pytest.mark.parametrize("rows", [np.array([4, 0, 7]), slice(None), slice(1, 3), np.zeros(0, np.intp)], ids=str)
def test_rows_are_overwritten_as_numpy_does(rng, lay, rows):
    whole = rng.normal(size=(9, 3))
    values = rng.normal(size=whole[rows].shape)
    expected, given = whole.copy(), lay(whole.copy())
    expected[rows] = values
    put_rows(given, rows, lay(values))
    np.testing.assert_array_equal(given, expected)
    expected[rows] += values
    add_rows(given, rows, lay(values))
    np.testing.assert_array_equal(given, expected)
    expected[rows] = 2.5
    put_rows(given, rows, 2.5)
    np.testing.assert_array_equal(given, expected)


@pytest.mark.parametrize("lay", [lay_columns, np.ascontiguousarray])
def test_picked_columns_are_numpys(rng, lay):
    values, columns = rng.normal(size=(50, 4)), rng.integers(-1, 4, 50)
    np.testing.assert_array_equal(pick_columns(lay(values), columns), values[np.arange(50), columns])


def test_sign_of_a_mask():
    np.testing.assert_array_equal(find_sign(np.array([True, False])), [1.0, -1.0])


@pytest.mark.parametrize("count", [0, 3, MANY_ROWS - 1, MANY_ROWS, MANY_ROWS + 1])
@pytest.mark.parametrize("lay", [lay_columns, np.ascontiguousarray, lambda values: values[::2, ::-1]])
def test_lay_rows_keeps_every_value(rng, count, lay):
    values = lay(rng.normal(size=(count, 3)))
    rows = lay_rows(values)
    assert rows.flags.c_contiguous
    np.testing.assert_array_equal(rows, values)


# What `where` keeps to the last bit, and sums and products do not.
ODD = (0.0, -0.0, np.inf, -np.inf, np.nan, -np.nan, 5e-324, -1.5)


def bits_of(values):
    return np.ascontiguousarray(values).view(np.int64)


@pytest.mark.parametrize("chosen", [0.0, 0.5, 1.0])
def test_masks_are_where_bit_for_bit(rng, chosen):
    first, second = rng.choice(ODD, 200), rng.choice(ODD, 200)
    mask = rng.random(200) < chosen
    np.testing.assert_array_equal(bits_of(keep_rows(first, mask)), bits_of(np.where(mask, first, 0.0)))
    for found, (there, else_) in zip(exchange(first, second, mask), ((second, first), (first, second)), strict=True):
        np.testing.assert_array_equal(bits_of(found), bits_of(np.where(mask, there, else_)))


def test_exchanged_columns_may_lie_apart(rng):
    pair, mask = rng.normal(size=(30, 2)), rng.random(30) < 0.5
    left, right = exchange(pair[:, 0], pair[:, 1], mask)
    np.testing.assert_array_equal(left, np.where(mask, pair[:, 1], pair[:, 0]))
    np.testing.assert_array_equal(right, np.where(mask, pair[:, 0], pair[:, 1]))


@pytest.mark.parametrize("zeros", [0, 1, 30])
def test_divided_where_it_is_said(rng, zeros):
    above, below = rng.normal(size=30), rng.normal(size=30)
    below[rng.permutation(30)[:zeros]] = 0.0
    expected = [a / b if b else 7.0 for a, b in zip(above, below, strict=True)]
    np.testing.assert_array_equal(divide_where(above, below, below != 0, elsewhere=7.0), expected)


@pytest.mark.parametrize("wrong", [-1, -MANY_INDICES - 1, MANY_INDICES, 2**62, np.iinfo(np.int64).min + 7])
def test_many_rows_are_checked_together_and_none_missed(rng, wrong):
    values = lay_columns(rng.normal(size=(MANY_INDICES, 3)))
    rows = rng.integers(0, MANY_INDICES, MANY_INDICES)
    assert find_mode(rows, len(values)) == "wrap"
    np.testing.assert_array_equal(take_rows(values, rows), values[rows])
    rows[17] = wrong
    assert find_mode(rows, len(values)) == "raise"
    if wrong == -1:
        np.testing.assert_array_equal(take_rows(values, rows), values[rows])
    else:
        with pytest.raises(IndexError):
            take_rows(values, rows)
