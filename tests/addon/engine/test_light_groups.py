"""Light groups of what instancers show, and their passes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from addon.engine.light_groups import give_groups
from addon.extract.scene import extract_scene
from addon.versions import VERSION
from raytracer.film.passes import LIGHT_GROUP
from tests.addon.engine.engine_fixtures import HEIGHT, WIDTH, add_plane, make_stage, render_channels

pytestmark = pytest.mark.blender


@pytest.mark.parametrize("own", ["", "fill", "another"])
def test_what_is_in_no_group_is_in_its_instancer_s(scene_with_camera: Any, own: str) -> None:
    """As in Cycles; a group that the view layer does not name is one all the same."""
    collection, instancer = bpy.data.collections.new("Set"), bpy.data.objects.new("Instancer", None)
    scene_with_camera.collection.objects.link(instancer)
    instancer.instance_type, instancer.instance_collection, instancer.lightgroup = "COLLECTION", collection, "key"
    mesh, light = bpy.data.meshes.new("Mesh"), bpy.data.lights.new("Light", "POINT")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    light.energy = 1.0
    for data in (mesh, light):
        thing = bpy.data.objects.new(data.name, data)
        thing.lightgroup = own
        collection.objects.link(thing)
    extraction = extract_scene(bpy.context.evaluated_depsgraph_get())
    scene = give_groups(extraction.scene, extraction, None, (LIGHT_GROUP + "key", LIGHT_GROUP + "fill"))
    expected = {"": 0, "fill": 1, "another": -1}[own]
    assert (scene.light_groups.lights.tolist(), scene.light_groups.objects.tolist()) == ([expected], [expected])


@pytest.mark.parametrize(
    "name",
    ["x" * 60, "\N{CJK UNIFIED IDEOGRAPH-5149}" * 19, "a" + "\N{GREEK SMALL LETTER PHI}" * 30],
    ids=["of ASCII", "cut off between letters", "cut off in a letter"],
)
@pytest.mark.skipif(VERSION < (5, 0), reason="before, Blender cut off the names of channels in files as well")
def test_groups_may_have_long_names(empty_scene: Any, registered_addon: None, tmp_path: Path, name: str) -> None:
    """Blender cuts the names of passes off: the pass was black, or the render ended where a letter was cut."""
    make_stage(empty_scene)
    half = add_plane(empty_scene.collection, "Half", (0.0, 0.5, 0.25), (0.0, WIDTH), (-HEIGHT, HEIGHT))
    empty_scene.view_layers[0].lightgroups.add(name=name)
    half.lightgroup = name
    channels = render_channels(empty_scene, tmp_path / "picture.exr")
    (green,) = [pixels for channel, pixels in channels.items() if ".Combined_" in channel and channel.endswith(".G")]
    np.testing.assert_array_equal(green[:, WIDTH // 2 :], 0.5)
    assert not green[:, : WIDTH // 2].any()
