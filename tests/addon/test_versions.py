"""Version differences against the Blender that runs the test."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import bpy
import pytest

from addon import versions
from addon.passes import switch as switch_on

pytestmark = pytest.mark.blender

SWITCHES = {
    "use_pass_object_index": "Object Index",
    "use_pass_material_index": "Material Index",
    "use_pass_diffuse_direct": "Diffuse Direct",
    "use_pass_diffuse_indirect": "Diffuse Indirect",
    "use_pass_diffuse_color": "Diffuse Color",
    "use_pass_glossy_direct": "Glossy Direct",
    "use_pass_glossy_indirect": "Glossy Indirect",
    "use_pass_glossy_color": "Glossy Color",
    "use_pass_transmission_direct": "Transmission Direct",
    "use_pass_transmission_indirect": "Transmission Indirect",
    "use_pass_transmission_color": "Transmission Color",
    "cycles.use_pass_volume_direct": "Volume Direct",
    "cycles.use_pass_volume_indirect": "Volume Indirect",
    "use_pass_emit": "Emission",
    "use_pass_environment": "Environment",
    "use_pass_ambient_occlusion": "Ambient Occlusion",
    "use_pass_z": "Depth",
    "use_pass_position": "Position",
    "use_pass_normal": "Normal",
    "use_pass_uv": "UV",
}


def test_pass_names_are_those_of_cycles(empty_scene: Any) -> None:
    from cycles.engine import list_render_passes  # Blender's own add-on, importable once bpy is

    empty_scene.cycles.use_denoising = False
    view_layer = empty_scene.view_layers[0]
    for switch in SWITCHES:
        switch_on(view_layer, switch, True)
    names = {name for name, _, _ in list_render_passes(empty_scene, view_layer)}
    assert {versions.blender_pass_name(name) for name in SWITCHES.values()} <= names


def test_node_tree_in_use_is_found_without_warning() -> None:
    light = bpy.data.lights.new("Light", "POINT")
    material, world = bpy.data.materials.new("Material"), bpy.data.worlds.new("World")
    always = versions.VERSION >= (5, 0)
    assert [versions.find_node_tree(owner) is not None for owner in (material, world)] == [always, always]
    assert (versions.find_node_tree(light) is not None) == (versions.VERSION >= (5, 1))


@pytest.mark.parametrize(("version", "passages"), [((4, 2, 0), 3), ((4, 5, 0), 3), ((5, 0, 0), 2), ((5, 2, 3), 2)])
def test_paths_pass_one_surface_more_before_blender_5(version: tuple[int, ...], passages: int) -> None:
    assert versions.count_passages(2, version) == passages


# Of Blender's panels those that ours may hang below: the wheel of 4.2.0 has all. Others are for `versions` to choose.
PANELS_OF_THE_OLDEST = {"OBJECT_PT_visibility", "DATA_PT_EEVEE_light", "DATA_PT_lens"}

LIST_PARENTS = """
from addon import versions
versions.SHADING_PANEL = "OBJECT_PT_visibility"
from addon.panels.registration import CLASSES
print(*{c.bl_parent_id for c in CLASSES if hasattr(c, "bl_parent_id")} - {c.__name__ for c in CLASSES})
"""


def test_panels_hang_below_panels_that_the_oldest_blender_has() -> None:
    """A parent that is missing ends the registration of the add-on with a RuntimeError."""
    listed = subprocess.run([sys.executable, "-c", LIST_PARENTS], capture_output=True, text=True, check=True)
    assert set(listed.stdout.split()) == PANELS_OF_THE_OLDEST
