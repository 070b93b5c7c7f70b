"""The panels of motion blur: what they draw, with Cycles' add-on and without it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import bpy
import pytest

from addon.panels import motion_blur
from addon.properties import ENGINE
from tests.addon.panels.panel_fixtures import draw

pytestmark = pytest.mark.usefixtures("registered_addon")


def test_the_shutter_is_drawn_as_blender_and_cycles_have_it(empty_scene: Any) -> None:
    names = draw(motion_blur.RAYTRACER_RENDER_PT_motion_blur).names
    own = ["use_motion_blur", "motion_blur_position", "motion_blur_shutter"]
    assert names == [*own, "rolling_shutter_type", "rolling_shutter_duration"]
    assert draw(motion_blur.RAYTRACER_RENDER_PT_motion_blur_curve).names == ["motion_blur_shutter_curve"]
    without = SimpleNamespace(render=empty_scene.render)
    assert draw(motion_blur.RAYTRACER_RENDER_PT_motion_blur, scene=without).names == own


def test_objects_that_can_be_blurred_have_cycles_settings(shown: Any) -> None:
    panel = motion_blur.RAYTRACER_OBJECT_PT_motion_blur
    hair = bpy.data.objects.new("Hair", bpy.data.hair_curves.new("Hair"))
    points = bpy.data.objects.new("Points", bpy.data.pointclouds.new("Points"))
    for thing in (shown, bpy.context.scene.camera, hair, points):
        assert panel.poll(SimpleNamespace(engine=ENGINE, object=thing))
    assert not panel.poll(SimpleNamespace(engine=ENGINE, object=bpy.data.objects.new("Empty", None)))
    assert not panel.poll(SimpleNamespace(engine="CYCLES", object=shown))
    assert draw(panel, object=shown).names == ["use_motion_blur", "motion_steps", "use_deform_motion"]
    assert draw(panel, object=bpy.context.scene.camera).names == ["use_motion_blur", "motion_steps"]
