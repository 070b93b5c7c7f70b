"""Passes that shaders write against Cycles: which nodes count, what they write, and what lies behind."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from numpy.testing import assert_allclose

from addon.compare.cycles.rendering import Request, render_both
from addon.extract.scene import extract_scene
from addon.passes import enabled_passes
from addon.versions import find_node_tree
from raytracer.film.passes import AOV_COLOR, AOV_VALUE
from tests.addon.engine.engine_fixtures import add_plane, make_stage

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

VALUE, COLOR = AOV_VALUE + "mask", AOV_COLOR + "tint"
# The widest that a sample lies beside its pixel's centre, pixels of 1 m.
CENTRE_WIDTH = 0.01


@pytest.fixture
def layer(empty_scene: Any) -> Any:
    """Return the view layer, with a pass of each type, of a scene of one plane that covers the picture's middle."""
    make_stage(empty_scene)
    add_plane(empty_scene.collection, "Plane", (0.5, 0.5, 0.5), (-9.0, 9.0), (-6.0, 6.0))
    layer = empty_scene.view_layers[0]
    for name, kind in (("mask", "VALUE"), ("tint", "COLOR")):
        aov = layer.aovs.add()
        aov.name, aov.type = name, kind
    return layer


def find_tree(name: str = "Plane") -> Any:
    return find_node_tree(bpy.data.materials[name])


def write(tree: Any, name: str, source: Any = None, **values: Any) -> Any:
    """Add an AOV Output node with values of sockets, or linked to an output."""
    node = tree.nodes.new("ShaderNodeOutputAOV")
    node.aov_name = name
    for socket, value in values.items():
        node.inputs[socket].default_value = value
    if source is not None:
        tree.links.new(source, node.inputs["Value" if name == "mask" else "Color"])
    return node


def compare(layer: Any, samples: int = 1, centre: bool = True) -> tuple[Any, Any]:
    width = {"pixel_filter": "BLACKMAN_HARRIS", "filter_width": CENTRE_WIDTH} if centre else {}
    request = Request(24, 16, samples, 2, passes=("Combined", VALUE, COLOR), through_centre=centre, **width)
    ours, cycles = (side.passes for side in render_both(bpy.context.scene, layer, request))
    return ({name: side[name][0] for name in (VALUE, COLOR)} for side in (ours, cycles))


def test_view_layer_asks_for_its_aovs(layer: Any) -> None:
    assert enabled_passes(layer)[-2:] == (VALUE, COLOR)
    layer.aovs[0].name = layer.aovs[1].name  # Blender makes them differ, or says that they do not
    assert len(set(enabled_passes(layer))) == len(enabled_passes(layer))


def test_constants_and_computed_values_are_those_of_cycles(layer: Any) -> None:
    tree = find_tree()
    geometry, noise = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeTexNoise")
    tree.links.new(geometry.outputs["Position"], noise.inputs["Vector"])
    noise.inputs["Scale"].default_value = 0.2
    write(tree, "tint", geometry.outputs["Position"])
    write(tree, "mask", noise.outputs[0])
    write(tree, "another", Value=99.0)
    ours, cycles = compare(layer)
    assert cycles[COLOR].min() < -8
    for name in (VALUE, COLOR):
        assert_allclose(ours[name], cycles[name], rtol=0.0, atol=CENTRE_WIDTH, err_msg=name)


def test_all_nodes_of_a_tree_count(layer: Any) -> None:
    """Twice the same name, in a group that is linked to nothing, muted; but not in a muted group."""
    tree = find_tree()
    write(tree, "mask", Value=2.0)
    write(tree, "mask", Value=4.0)
    write(tree, "mask", Value=8.0).mute = True
    for value, muted in ((16.0, False), (32.0, True)):
        group = bpy.data.node_groups.new("Group", "ShaderNodeTree")
        write(group, "mask", Value=value)
        node = tree.nodes.new("ShaderNodeGroup")
        node.node_tree, node.mute = group, muted
    ours, cycles = compare(layer)
    assert cycles[VALUE].max() == 30.0
    np.testing.assert_array_equal(ours[VALUE], cycles[VALUE])


def test_world_and_what_is_seen_through_a_sheet_are_added_as_in_cycles(layer: Any) -> None:
    scene = bpy.context.scene
    sheet = add_plane(scene.collection, "Sheet", (1, 1, 1), (-99.0, 0.0), (-99.0, 99.0))
    sheet.location.z = 1.0
    tree = find_tree("Sheet")
    tree.nodes.clear()
    clear, output = tree.nodes.new("ShaderNodeBsdfTransparent"), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(clear.outputs[0], output.inputs["Surface"])
    scene.world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0):
        scene.world.use_nodes = True
    write(scene.world.node_tree, "mask", Value=0.25)
    write(tree, "mask", Value=1.0)
    write(tree, "tint", Color=(0.5, 0.25, 0.125, 1.0))
    write(find_tree(), "mask", Value=2.0)
    write(find_tree(), "tint", Color=(1.0, 2.0, 4.0, 1.0))
    ours, cycles = compare(layer)
    assert set(np.unique(cycles[VALUE])) == {0.25, 1.25, 2.0, 3.0}
    for name in (VALUE, COLOR):
        np.testing.assert_array_equal(ours[name], cycles[name], err_msg=name)


def test_nodes_are_read_where_a_pass_asks_and_read_again_where_others_do(layer: Any) -> None:
    from addon.extract.kept import Changes, Kept

    write(find_tree(), "mask", Value=2.0)
    graph, kept = bpy.context.evaluated_depsgraph_get(), Kept()
    for passes, expected in ((("Combined",), None), (("Combined", VALUE), {VALUE: 2.0}), (("Combined", COLOR), None)):
        (material,) = extract_scene(graph, passes, kept=kept).scene.materials
        assert (material.aovs and dict(material.aovs.values)) == expected
        kept.changes = Changes()
