"""Memory that is allocated and not set yet holds what no code may read.

`np.empty` gives whatever was there before: on one machine zeros, on another the bits of a signalling NaN. A test that
reads it by mistake passes or fails by luck. Here it is filled with what is noticed: floats are signalling NaNs, which
raise "invalid value" in any arithmetic, integers point far out of every array, and booleans are true.

References
----------
IEEE 754-2019, 6.2: operations on signalling NaNs signal the invalid operation exception.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

SIGNALLING_NAN = {np.dtype(np.float32): (np.uint32, 0x7F800001), np.dtype(np.float64): (np.uint64, 0x7FF0000000000001)}
FAR_OUT = 7


def spoil(array: np.ndarray) -> np.ndarray:
    """Fill in what must not be read; arrays of other kinds, and of other classes, are left alone."""
    if type(array) is not np.ndarray or not array.flags.writeable:
        return array
    if array.dtype in SIGNALLING_NAN:
        integer, bits = SIGNALLING_NAN[array.dtype]
        array.view(integer)[...] = bits
    elif array.dtype.kind == "i":
        array[...] = np.iinfo(array.dtype).min + FAR_OUT
    elif array.dtype.kind == "u":
        array[...] = np.iinfo(array.dtype).max - FAR_OUT
    elif array.dtype.kind == "b":
        array[...] = True
    return array


def spoiling(allocate: Callable[..., np.ndarray]) -> Callable[..., np.ndarray]:
    """Return the allocator that spoils what it gives."""

    def allocate_spoiled(*positions: Any, **names: Any) -> np.ndarray:
        return spoil(allocate(*positions, **names))

    return allocate_spoiled
