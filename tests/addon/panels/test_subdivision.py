"""The panels of adaptive subdivision: what they draw where Blender has it, and where it does not."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import bpy
import pytest

from addon import versions
from addon.panels import subdivision
from addon.properties import ENGINE
from tests.addon.panels.panel_fixtures import draw

pytestmark = pytest.mark.usefixtures("registered_addon")
HAS_IT = versions.VERSION >= (5, 0)


def test_the_scenes_settings_are_cycles(empty_scene: Any) -> None:
    panel = subdivision.RAYTRACER_RENDER_PT_subdivision
    assert panel.poll(SimpleNamespace(engine=ENGINE, scene=empty_scene)) == HAS_IT
    assert not panel.poll(SimpleNamespace(engine=ENGINE, scene=SimpleNamespace()))
    names = ["dicing_rate", "preview_dicing_rate", "offscreen_dicing_scale", "max_subdivisions", "dicing_camera"]
    assert draw(panel).names == names


def test_an_object_has_the_settings_of_its_last_modifier(shown: Any) -> None:
    panel = subdivision.RAYTRACER_OBJECT_PT_subdivision
    assert not panel.poll(SimpleNamespace(engine=ENGINE, object=shown))
    assert not panel.poll(SimpleNamespace(engine=ENGINE, object=None))
    modifier = shown.modifiers.new("Subdivision", "SUBSURF")
    assert panel.poll(SimpleNamespace(engine=ENGINE, object=shown)) == HAS_IT
    assert not panel.poll(SimpleNamespace(engine="CYCLES", object=shown))
    if HAS_IT:
        assert draw(panel, object=shown).names == ["use_adaptive_subdivision", "adaptive_space", "adaptive_pixel_size"]
        modifier.adaptive_space = "OBJECT"
        assert draw(panel, object=shown).names[-1] == "adaptive_object_edge_length"
    bpy.data.objects[shown.name].modifiers.new("Last", "TRIANGULATE")
    assert not panel.poll(SimpleNamespace(engine=ENGINE, object=shown))
