"""Area lights that an uneven scale of their parents has sheared."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from numpy.testing import assert_allclose

from addon.extract.scene import extract_scene

pytestmark = pytest.mark.blender


@pytest.fixture
def lamp(scene_with_camera: Any) -> Any:
    """Return an area light that is turned under a parent that is wider than high."""
    data = bpy.data.lights.new("Light", "AREA")
    data.energy, data.size, data.size_y = 8, 2, 1
    lamp, parent = bpy.data.objects.new("Light", data), bpy.data.objects.new("Parent", None)
    lamp.parent, lamp.rotation_euler.z, parent.scale.x = parent, 0.6, 2.0
    for thing in (lamp, parent):
        scene_with_camera.collection.objects.link(thing)
    return lamp


@pytest.mark.parametrize("shape", ["RECTANGLE", "ELLIPSE"])
def test_sheared_area_light_keeps_its_area_at_right_angles(lamp: Any, shape: str) -> None:
    lamp.data.shape = shape
    extraction = extract_scene(bpy.context.evaluated_depsgraph_get())
    light: Any = extraction.scene.lights[0]
    across, up, _, _ = np.array(lamp.matrix_world).T[:, :3] * [[2], [1], [1], [1]]
    assert abs(across @ up) > 0.1
    assert_allclose(light.axis_u @ light.axis_v, 0, atol=1e-12)
    assert_allclose(np.cross(light.axis_u, light.axis_v), np.cross(across, up), atol=1e-12)
    if shape == "RECTANGLE":
        (warning,) = extraction.warnings
        assert (warning.object, "sheared" in warning.text) == ("Light", True)
        return
    assert not extraction.warnings  # for a sheared ellipse is another ellipse
    turns = np.arange(12)
    border = np.outer(np.cos(turns), across) + np.outer(np.sin(turns), up)
    local = [border @ axis / (axis @ axis) for axis in (light.axis_u, light.axis_v)]
    assert_allclose(local[0] ** 2 + local[1] ** 2, 1, rtol=1e-12)


def test_light_whose_axis_leans_shines_straight_from_its_face(lamp: Any) -> None:
    """Cycles lets it shine along its leaning axis."""
    lamp.rotation_euler = (0, 0.6, 0)
    extraction = extract_scene(bpy.context.evaluated_depsgraph_get())
    light: Any = extraction.scene.lights[0]
    across, up, axis, _ = np.array(lamp.matrix_world).T[:, :3]
    assert abs(across @ axis) > 0.1
    assert_allclose(across @ up, 0, atol=1e-6)
    assert_allclose((light.axis_u, light.axis_v), (2 * across, 2 * up), rtol=1e-12)
    (warning,) = extraction.warnings
    assert "shines straight from its face" in warning.text
