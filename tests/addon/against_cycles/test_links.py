"""What nodes take where links lead nowhere, and what moves a texture's coordinates: our engine and Cycles of the same
Blender."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from addon.versions import VERSION
from tests.addon.against_cycles import node_fixtures
from tests.addon.against_cycles.node_fixtures import add_node
from tests.addon.against_cycles.node_sources import (
    CENTRED,
    PACKED_NORMALS,
    SMOOTH,
    STEEP,
    assert_agreement,
    attribute,
    make,
)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]


def loose(kind: str) -> Any:
    """Return what makes an output that hands nothing on: of a reroute, or of a muted node."""

    def build(tree: Any) -> Any:
        node = tree.nodes.new(kind)
        node.mute = kind != "NodeReroute"
        return node.outputs[0]

    return build


def through_group(kind: str, socket: str, hides: bool, **properties: Any) -> Any:
    """Return what makes a group around a node whose input is the group's, to which nothing is linked."""

    def build(tree: Any) -> Any:
        group = bpy.data.node_groups.new("Group", "ShaderNodeTree")
        group.interface.new_socket("In", in_out="INPUT", socket_type="NodeSocketVector").hide_value = hides
        group.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketColor")
        start, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
        node = add_node(group, kind, {socket: start.outputs[0]}, **properties)
        group.links.new(node.outputs[0], end.inputs[0])
        return add_node(tree, "ShaderNodeGroup", node_tree=group).outputs[0]

    return build


def make_image() -> Any:
    image = bpy.data.images.new("Image", 4, 4, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    image.pixels.foreach_set(np.random.default_rng(1).random(64).astype(np.float32))
    return image


LOOSE = ("NodeReroute", "ShaderNodeGamma", "ShaderNodeMapping", "ShaderNodeUVMap")


@pytest.mark.skipif(VERSION < (5, 0), reason="Cycles took black from muted nodes before Blender joined groups itself")
def test_what_hands_nothing_on_is_as_if_nothing_were_linked(empty_scene: Any, record_property: Any) -> None:
    shown = {
        "color": lambda source: make("ShaderNodeGamma", inputs={"Color": source, "Gamma": 0.5}),
        "number": lambda source: make("ShaderNodeMath", inputs={"Value": source, "Value_001": 0.25}, operation="ADD"),
        "checker": lambda source: make("ShaderNodeTexChecker", inputs={"Vector": source}),
        "gradient": lambda source: make("ShaderNodeTexGradient", inputs={"Vector": source}),
    }
    configurations = {f"{name} of {kind}": build(loose(kind)) for name, build in shown.items() for kind in LOOSE}
    assert_agreement(configurations, SMOOTH, record_property)


def through_numbers(source: Any) -> Any:
    """Return what makes a group that hands on what `source` makes, by sockets of numbers."""

    def build(tree: Any) -> Any:
        group = bpy.data.node_groups.new("Group", "ShaderNodeTree")
        for name, side in (("In", "INPUT"), ("Out", "OUTPUT")):
            group.interface.new_socket(name, in_out=side, socket_type="NodeSocketFloat")
        start, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
        group.links.new(start.outputs[0], end.inputs[0])
        node = add_node(tree, "ShaderNodeGroup", node_tree=group)
        tree.links.new(source(tree), node.inputs[0])
        return node.outputs[0]

    return build


def muted(kind: str, socket: str, source: Any) -> Any:
    def build(tree: Any) -> Any:
        node = add_node(tree, kind, {socket: source(tree)})
        node.mute = True
        return node.outputs[0]

    return build


def test_what_passes_sockets_of_another_kind_agrees(empty_scene: Any, record_property: Any) -> None:
    color = attribute("Col")
    sources = {
        "color": color,
        "vector": CENTRED,
        "constant": make("ShaderNodeRGB"),
        "computed before": make("ShaderNodeCombineXYZ", inputs={"X": 0.9, "Y": 0.4, "Z": -1.7}),
    }
    configurations = {name: through_numbers(source) for name, source in sources.items()}
    configurations["twice"] = through_numbers(through_numbers(color))
    configurations["number"] = make("ShaderNodeMath", inputs={"Value": through_numbers(color)}, operation="ADD")
    configurations["muted"] = muted("ShaderNodeRGBToBW", "Color", color)
    configurations["muted number"] = muted("ShaderNodeMath", "Value", CENTRED)
    assert_agreement(configurations, STEEP, record_property)


def test_inputs_of_groups_that_nothing_is_linked_to_agree(empty_scene: Any, record_property: Any) -> None:
    nodes = {
        "image": ("ShaderNodeTexImage", "Vector", {"image": make_image()}),
        "gradient": ("ShaderNodeTexGradient", "Vector", {}),
        "facing": ("ShaderNodeLayerWeight", "Normal", {}),
    }
    configurations = {
        f"{name}, {'hidden' if hides else 'shown'}": through_group(kind, socket, hides, **properties)
        for name, (kind, socket, properties) in nodes.items()
        for hides in (False, True)
    }
    assert_agreement(configurations, PACKED_NORMALS, record_property)


def offer_alpha(is_read: bool) -> Any:
    """Return what makes a group of an image whose alpha it offers besides the color."""

    def build(tree: Any) -> Any:
        group = bpy.data.node_groups.new("Group", "ShaderNodeTree")
        group.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
        group.interface.new_socket("Alpha", in_out="OUTPUT", socket_type="NodeSocketFloat")
        pixels = np.random.default_rng(3).random((16, 4))
        image = bpy.data.images.new("Image", 4, 4, alpha=True)
        image.pixels.foreach_set(pixels.astype(np.float32).ravel())
        node, end = add_node(group, "ShaderNodeTexImage", image=image), group.nodes.new("NodeGroupOutput")
        group.links.new(node.outputs["Color"], end.inputs["Color"])
        group.links.new(node.outputs["Alpha"], end.inputs["Alpha"])
        shown = add_node(tree, "ShaderNodeGroup", node_tree=group)
        total = add_node(tree, "ShaderNodeVectorMath", {"Vector": shown.outputs["Color"]}, operation="ADD")
        if is_read:
            tree.links.new(shown.outputs["Alpha"], total.inputs[1])
        return total.outputs[0]

    return build


def test_colors_are_divided_by_alpha_for_shaders_that_read_it(empty_scene: Any, record_property: Any) -> None:
    assert_agreement({f"read {is_read}": offer_alpha(is_read) for is_read in (False, True)}, 1e-3, record_property)


def mapped(kind: str, **mapping: Any) -> Any:
    """Return what makes a texture with a mapping of its own."""

    def build(tree: Any) -> Any:
        node = add_node(tree, kind, {"Vector": CENTRED(tree)})
        if kind == "ShaderNodeTexImage":
            node.image = make_image()
        for name, value in mapping.items():
            setattr(node.texture_mapping, name, value)
        return node.outputs[0]

    return build


def test_a_texture_s_own_mapping_agrees(empty_scene: Any, record_property: Any) -> None:
    moved = {"translation": (0.1, -0.2, 0.3), "rotation": (0.3, 0.5, -0.7), "scale": (1.5, 0.7, 2.0)}
    kinds = ("POINT", "TEXTURE", "VECTOR", "NORMAL")
    mappings = {kind: {"vector_type": kind, **moved} for kind in kinds}
    mappings["axes"] = {"mapping_x": "Z", "mapping_y": "NONE", "mapping_z": "X"}
    mappings["both"] = {**moved, **mappings["axes"]}
    configurations = {
        f"{texture} {name}": mapped(texture, **mapping)
        for texture in ("ShaderNodeTexGradient", "ShaderNodeTexImage")
        for name, mapping in mappings.items()
    }
    assert_agreement(configurations, 1e-4, record_property)


def test_attributes_of_edges_and_rotations_agree(
    empty_scene: Any, record_property: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    kinds = {"FLOAT": ("value", 1), "FLOAT_VECTOR": ("vector", 3), "FLOAT_COLOR": ("color", 4)}
    whole = {"INT": (np.intc, 9), "BOOLEAN": (np.bool_, 2)}
    plain = node_fixtures.make_tilted_plane

    def make_plane(name: str) -> Any:
        mesh, random = plain(name), np.random.default_rng(2)
        for kind, (field, width) in kinds.items():
            values = random.random(len(mesh.edges) * width).astype(np.float32)
            mesh.attributes.new(kind, kind, "EDGE").data.foreach_set(field, values)
        for kind, (dtype, below) in whole.items():
            values = random.integers(0, below, len(mesh.edges)).astype(dtype)
            mesh.attributes.new(kind, kind, "EDGE").data.foreach_set("value", values)
        turns = mesh.attributes.new("QUATERNION", "QUATERNION", "POINT")
        turns.data.foreach_set("value", random.random(4 * len(mesh.vertices)).astype(np.float32))
        return mesh

    monkeypatch.setattr(node_fixtures, "make_tilted_plane", make_plane)
    configurations = {
        f"{name} {output}": attribute(name, output)
        for name in (*kinds, *whole, "QUATERNION")
        for output in ("Color", "Fac", "Alpha")
    }
    assert_agreement(configurations, SMOOTH, record_property)
