"""Trees of shader nodes for the scene scripts: opening one, adding nodes by the names that Blender shows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy


def open_tree(owner: bpy.types.Material | bpy.types.World) -> bpy.types.NodeTree:
    """Return the shader tree of a material or a world."""
    if owner.node_tree is None:  # always there from Blender 5.0 on
        owner.use_nodes = True
    return owner.node_tree


def add_node(
    tree: bpy.types.NodeTree, kind: str, inputs: Mapping[str | int, Any] | None = None, **properties: Any
) -> bpy.types.Node:
    """Add a node, set its properties, then inputs by name or number: values, or outputs that feed them."""
    node = tree.nodes.new(kind)
    for name, value in properties.items():
        setattr(node, name, value)
    for key, value in (inputs or {}).items():
        named = [socket for socket in node.inputs if socket.name == key and socket.enabled]
        socket = named[0] if named else node.inputs[key]
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, socket)
        else:
            socket.default_value = value
    return node


def make_material(name: str) -> tuple[bpy.types.Material, bpy.types.NodeTree]:
    """Return a material and its tree, which has an output and nothing else."""
    material = bpy.data.materials.new(name)
    tree = open_tree(material)
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    return material, tree


def connect(tree: bpy.types.NodeTree, node: bpy.types.Node, socket: str = "Surface") -> None:
    """Let a node's first output be the surface of a material, or its volume."""
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs[socket])
