"""Each shader node that Blender has, in each of its modes, either renders or is named in a warning: a node that a new
version brings and that does neither turns this test red."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import pytest

from addon.extract.shaders.closures import CLOSURE_READERS
from addon.extract.shaders.programs import CONSTANT_NODES, find_operation
from addon.extract.shaders.volumes import VOLUME_READERS

from .shader_trees import give_nodes, texts

pytestmark = pytest.mark.blender

# What is read otherwise than by an operation or a reader of closures: outputs, groups, and what mixes closures.
STRUCTURE = {
    *("ADD_SHADER", "MIX_SHADER", "GROUP", "OUTPUT_MATERIAL", "OUTPUT_WORLD", "OUTPUT_LIGHT", "OUTPUT_AOV"),
    "OUTPUT_LINESTYLE",
}
ABSTRACT = ("ShaderNode", "ShaderNodeTree", "ShaderNodeCustomGroup")


def list_kinds() -> list[str]:
    return [name for name in sorted(dir(bpy.types)) if name.startswith("ShaderNode") and name not in ABSTRACT]


def set_each_choice(node: Any) -> Iterator[str]:
    """Set each property of a node to each of its choices in turn; yield what is set."""
    yield "defaults"
    inherited = set(bpy.types.ShaderNode.bl_rna.properties.keys())
    for item in node.bl_rna.properties:
        if item.type != "ENUM" or item.identifier in inherited or item.is_readonly:
            continue
        before = getattr(node, item.identifier)
        for choice in item.enum_items:
            try:
                setattr(node, item.identifier, choice.identifier)
            except TypeError:  # not on offer here
                continue
            yield f"{item.identifier} {choice.identifier}"
        setattr(node, item.identifier, before)


def list_missing(node: Any) -> set[str]:
    """Return the enabled outputs of a node that neither an operation nor a reader of closures makes."""
    if node.type in STRUCTURE or node.type in CONSTANT_NODES:
        return set()
    return {
        output.identifier
        for output in node.outputs
        if output.enabled
        and output.type != "CUSTOM"  # where more sockets come from
        and (
            node.type not in (CLOSURE_READERS | VOLUME_READERS)
            if output.type == "SHADER"
            else find_operation(node, output.identifier) is None
        )
    }


def link(node: Any, identifier: str, tree: Any) -> None:
    """Link an output of a node to the tree's output, numbers as what shines."""
    source = next(one for one in node.outputs if one.identifier == identifier)
    output = tree.nodes[0]
    if source.type == "SHADER":
        tree.links.new(source, output.inputs["Volume" if "VOLUME" in node.type else "Surface"])
        return
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(source, emission.inputs["Strength"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])


def test_nodes_render_or_are_named(scene_with_camera: Any) -> None:
    silent, named = [], set()
    mesh = bpy.data.meshes.new("Triangle")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    shown = bpy.data.objects.new("Object", mesh)
    scene_with_camera.collection.objects.link(shown)
    tree = give_nodes(shown, "Material")
    for kind in list_kinds():
        node = tree.nodes.new(kind)
        for choice in set_each_choice(node):
            missing = list_missing(node)
            if not missing:
                continue
            link(node, min(missing), tree)
            named.add(kind)
            if not any(node.name in text for text in texts()):
                silent.append(f"{kind} {choice}")
        tree.nodes.remove(node)
    assert not silent
    assert "ShaderNodeShaderToRGB" in named, "which is Eevee's alone"
