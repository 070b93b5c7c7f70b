"""Memory that the ray tracer allocates and does not set is noticed by its tests."""

import numpy as np
import pytest

from tests.unset_memory import spoiling


@pytest.fixture(autouse=True)
def _unset_memory_is_noticed(monkeypatch):
    monkeypatch.setattr(np, "empty", spoiling(np.empty))
    monkeypatch.setattr(np, "empty_like", spoiling(np.empty_like))
