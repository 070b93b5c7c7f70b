"""Arrays by what they hold: short names for annotations; docstrings give the shapes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
# The same by shape, where a record says what it holds: (n,), (n, 2), (n, 3), and linear RGB (n, 3).
Numbers = NDArray[np.float64]
Pairs = NDArray[np.float64]
Vectors = NDArray[np.float64]
Colors = NDArray[np.float64]
Integers = NDArray[np.int32]
Booleans = NDArray[np.bool_]
# Rows of arrays, as NumPy's own functions return them.
Indices = NDArray[np.intp]
Counts = NDArray[np.int32]
# Sets and flags, a bit each.
Masks = NDArray[np.uint8]
Kinds = NDArray[np.uint8]
# What is alike, by number.
Keys = NDArray[np.int32]
# Bits of hashes.
Words = NDArray[np.uint32]
