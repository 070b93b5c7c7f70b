"""Each shader node that Blender has either renders, or is known to be named in a warning: none is left out silently.

A node that a new version brings turns this test red: let it render, or add it to the list of those that warn.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import pytest

from addon.extract.shaders.closures import CLOSURE_READERS
from addon.extract.shaders.programs import CONSTANT_NODES, find_operation

from .shader_trees import clear_nodes, give_nodes, texts

pytestmark = pytest.mark.blender

# Nodes that warn where they are used. Those of volumes and of hair belong to what has no surface.
WARNED = {
    *("BSDF_HAIR", "BSDF_HAIR_PRINCIPLED", "HAIR_INFO"),
    *("PRINCIPLED_VOLUME", "VOLUME_ABSORPTION", "VOLUME_COEFFICIENTS", "VOLUME_INFO", "VOLUME_SCATTER"),
    *("BEVEL", "BSDF_RAY_PORTAL", "ShaderNodeRadialTiling"),
    # Of Eevee, of Freestyle's lines, and of Open Shading Language, which no other engine reads; old ones.
    *("EEVEE_SPECULAR", "SHADERTORGB", "UVALONGSTROKE", "SCRIPT", "SQUEEZE"),
}
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
        and (
            node.type not in CLOSURE_READERS
            if output.type == "SHADER"
            else find_operation(node, output.identifier) is None
        )
    }


def test_all_nodes_render_or_are_known_to_warn(empty_scene: Any) -> None:
    material = bpy.data.materials.new("Material")
    tree = clear_nodes(material)
    missing = {}
    for kind in list_kinds():
        node = tree.nodes.new(kind)
        for choice in set_each_choice(node):
            outputs = list_missing(node)
            if outputs and node.type not in WARNED:
                missing[f"{kind} {choice}"] = outputs
        tree.nodes.remove(node)
    assert not missing


def link(node: Any, tree: Any) -> None:
    """Link the first output of a node to the tree's output, numbers as what shines."""
    source, output = node.outputs[0], tree.nodes[0]
    if source.type == "SHADER":
        tree.links.new(source, output.inputs["Volume" if "VOLUME" in node.type else "Surface"])
        return
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(source, emission.inputs["Strength"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])


def test_nodes_that_do_not_render_are_named(scene_with_camera: Any) -> None:
    silent = []
    mesh = bpy.data.meshes.new("Triangle")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    shown = bpy.data.objects.new("Object", mesh)
    scene_with_camera.collection.objects.link(shown)
    tree = give_nodes(shown, "Material")
    for kind in list_kinds():
        node = tree.nodes.new(kind)
        if node.type in WARNED and node.outputs:
            link(node, tree)
            if not any(node.name in text or "Volume is not" in text for text in texts()):
                silent.append(kind)
        tree.nodes.remove(node)
    assert not silent
