"""What the tests of comparisons share: a scene whose rays need rounding."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import pytest

import addon
from tests.addon.engine.engine_fixtures import add_plane, make_stage


@pytest.fixture
def stage(empty_scene: Any) -> Iterator[Any]:
    """A plane of one color over half of the picture, tilted by thirds so that rays need rounding."""
    addon.register()
    make_stage(empty_scene)
    plane = add_plane(empty_scene.collection, "Plane", (0.75, 0.125, 0.0), (-9.0, 0.1), (-7.0, 7.0))
    plane.rotation_euler = (0.1, 0.2, 0.3)
    bpy.context.view_layer.update()
    yield empty_scene
    addon.unregister()
