"""What the C library holds on to can be given back."""

import ctypes
import sys

import numpy as np
import pytest

from raytracer.arrays.memory import keep_freed_memory, release_freed_memory
from tests.portable import read_memory

HAS_TRIM = sys.platform == "linux" and hasattr(ctypes.CDLL(None), "malloc_trim")


@pytest.mark.skipif(not HAS_TRIM, reason="this C library keeps nothing that could be given back")
def test_freed_memory_is_the_systems_again():
    """Of 60 MB in small arrays, below one that is still there, nearly all."""
    keep_freed_memory()
    arrays = [np.ones(1 << 13) for _ in range(1000)]
    del arrays[:-1]
    held = read_memory()[0]
    release_freed_memory()
    assert held - read_memory()[0] > 50
