"""The shader nodes of a material, a world or a light: its own, or what Blender makes of them.

Repeat zones, closures, bundles and menus (Blender 5.0 and later) are resolved by Blender itself, for other engines and
for this one: what it hands out is a tree of shader nodes alone, without groups, which is gone when nobody holds it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextvars import ContextVar
from typing import Any

from ... import versions
from .nodes import GROUP_NODES

# Nodes of any tree, that leave no trace in shaders; those of a type that is not known there are named later.
PLAIN_NODES = ("NodeReroute", "NodeFrame", "NodeGroupInput", "NodeGroupOutput", "NodeUndefined")
OTHER_NODES = ("Node", "GeometryNode", "FunctionNode")

# While a scene is extracted: what Blender made, by the address of its owner; by thread, as it renders.
_held: ContextVar[dict[int, Any] | None] = ContextVar("held", default=None)


@contextlib.contextmanager
def hold_trees() -> Iterator[None]:
    """Keep inside the block what `find_tree` returns."""
    token = _held.set({})
    try:
        yield
    finally:
        _held.reset(token)


def find_tree(owner: Any) -> Any:
    """Return the nodes in use by an evaluated material, world or light, or None where it has or uses none."""
    node_tree, held = versions.find_node_tree(owner), _held.get()
    if node_tree is None or held is None or not has_other_nodes(node_tree):
        return node_tree
    key = owner.as_pointer()
    if key not in held:
        held[key] = versions.inline_nodes(owner)
    return node_tree if held[key] is None else held[key].node_tree


def has_other_nodes(node_tree: Any) -> bool:
    """Return whether a tree or one of its groups has nodes that are no shader nodes."""
    waiting, known = [node_tree], {node_tree.as_pointer()}
    while waiting:
        for node in waiting.pop().nodes:
            name = node.bl_idname
            if node.type in GROUP_NODES:
                inner = node.node_tree
                if inner is not None and inner.as_pointer() not in known:
                    known.add(inner.as_pointer())
                    waiting.append(inner)
            elif name.startswith(OTHER_NODES) and name not in PLAIN_NODES:
                return True
    return False
