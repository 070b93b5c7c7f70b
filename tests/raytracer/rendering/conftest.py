"""Fixtures of the tests of rendering."""

import pytest

from raytracer.rendering import allocation


@pytest.fixture
def adaptive_in_any_size(monkeypatch):
    """Pictures have a pilot however few camera rays they take, as tests' do."""
    monkeypatch.setattr(allocation, "ONE_BLOCK", 0)
