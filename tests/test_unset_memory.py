"""Reading memory that was not set is noticed."""

import numpy as np
import pytest

from tests.unset_memory import spoiling


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("allocate", [np.empty, lambda shape, dtype: np.empty_like(np.zeros(shape, dtype))])
def test_arithmetic_with_unset_floats_raises(allocate, dtype):
    array = spoiling(allocate)((3, 5), dtype)
    with pytest.raises(FloatingPointError), np.errstate(invalid="raise"):
        array *= array.dtype.type(2)


@pytest.mark.parametrize("dtype", [np.int32, np.int64, np.uint8, np.uint32])
def test_unset_indices_are_out_of_range(dtype):
    index = spoiling(np.empty)(4, dtype)
    with pytest.raises(IndexError):
        np.zeros(200)[index]


def test_unset_memory_of_other_kinds_is_left_alone():
    assert spoiling(np.empty)(2, dtype=object).tolist() == [None, None]
