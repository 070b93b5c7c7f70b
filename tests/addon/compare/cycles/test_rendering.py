"""Rendering a scene with two engines."""

from __future__ import annotations

from typing import Any

import bpy
import pytest

from addon.compare.cycles.comparison import compare_with_cycles

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]


def test_a_comparison_says_that_cycles_is_off(without_cycles: None, scene_with_camera: Any) -> None:
    """It was an error about an attribute."""
    with pytest.raises(RuntimeError, match="Cycles is switched off"):
        compare_with_cycles(scene_with_camera, bpy.context.view_layer, 4, 4, 1)
