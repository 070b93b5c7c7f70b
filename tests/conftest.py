"""Fixtures of all tests."""

import contextlib

import numpy as np
import pytest

# Absent where the add-on is tested in a bare Blender.
with contextlib.suppress(ImportError):
    from hypothesis import settings

    # The same examples every time, whatever else keeps the machine busy.
    settings.register_profile("repeatable", deadline=None, derandomize=True)
    settings.load_profile("repeatable")


@pytest.fixture
def rng():
    """A random generator with a fixed seed."""
    return np.random.default_rng(20260421)
