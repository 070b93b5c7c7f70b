"""Shader trees for tests of extraction, and what becomes of them."""

from __future__ import annotations

from typing import Any

import bpy

from addon import versions
from addon.extract.scene import Extraction, extract_scene
from raytracer import Closure, Material


def give_nodes(shown: Any, name: str) -> Any:
    material = bpy.data.materials.new(name)
    shown.data.materials.append(material)
    return clear_nodes(material)


def clear_nodes(owner: Any, output: str = "ShaderNodeOutputMaterial") -> Any:
    if versions.VERSION < (5, 0):
        owner.use_nodes = True
    owner.node_tree.nodes.clear()
    owner.node_tree.nodes.new(output)
    return owner.node_tree


def add(tree: Any, kind: str, **values: Any) -> Any:
    """Add a node, set its sockets by name (spaces as underscores), and link its first output to the tree's output."""
    node = tree.nodes.new(kind)
    for name, value in values.items():
        node.inputs[name.replace("_", " ")].default_value = value
    tree.links.new(node.outputs[0], tree.nodes[0].inputs[0])
    return node


def extract() -> Extraction:
    return extract_scene(bpy.context.evaluated_depsgraph_get())


def extract_material() -> Material:
    (material,) = extract().scene.materials
    return material


def extract_closure() -> Closure:
    (closure,) = extract_material().closures
    return closure


def texts() -> list[str]:
    return [str(warning) for warning in extract().warnings]
