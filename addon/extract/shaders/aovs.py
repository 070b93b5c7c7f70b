"""AOV Output nodes: what shaders write to the passes that a view layer names.

As in Cycles all of them count, wherever in the tree or in its groups they stand, linked to nothing, muted or not; what
several write to one pass is added.

References
----------
Blender, intern/cycles/scene/svm.cpp: SVMCompiler::find_aov_nodes_and_dependencies.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

import raytracer
from raytracer.film.passes import AOV_COLOR, AOV_VALUE
from raytracer.scene.programs import Program, Register, Value

from .nodes import GROUP_NODES, Groups, find_socket, read_links_once
from .programs import ProgramBuilder


def read_aovs(node_tree: Any, names: Sequence[str], builder: ProgramBuilder) -> raytracer.Aovs | None:
    """Return what a shader's nodes write to the passes `names`; None where they write to none.

    builder : collects the steps of a program of their own
    """
    if node_tree is None or not names:
        return None
    values: dict[str, Value] = {}
    with read_links_once():
        for node, groups in list_aov_nodes(node_tree):
            for start, identifier, kind in ((AOV_VALUE, "Value", "number"), (AOV_COLOR, "Color", "color")):
                name = start + node.aov_name
                if name in names:
                    value = builder.value_of(find_socket(node.inputs, identifier), groups, kind)
                    values[name] = add_values(values[name], value, kind, builder) if name in values else value
    if not values:
        return None
    is_computed = any(isinstance(value, Register) for value in values.values())
    return raytracer.Aovs(values, Program(builder.steps) if is_computed else None)


def add_values(first: Value, second: Value, kind: str, builder: ProgramBuilder) -> Value:
    """Return the sum of two numbers or colors."""
    if kind == "number":
        return builder.sum(first, second)
    return builder.add("VECT_MATH Vector", (first, second, np.zeros(3), 1.0), {"operation": "ADD"})["Vector"]


def list_aov_nodes(node_tree: Any, groups: Groups = ()) -> Iterator[tuple[Any, Groups]]:
    """Yield the AOV Output nodes of a tree and of its groups, each with the group nodes that it lies in."""
    for node in node_tree.nodes:
        if node.type == "OUTPUT_AOV":
            yield node, groups
        elif node.type in GROUP_NODES and node.node_tree is not None and not node.mute:
            yield from list_aov_nodes(node.node_tree, (*groups, node))
