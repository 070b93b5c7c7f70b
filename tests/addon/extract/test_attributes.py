"""Attributes of meshes as materials read them: of edges, and of types that no socket of a shader node has."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from numpy.testing import assert_allclose

from addon.extract.scene import extract_scene
from tests.addon.extract.shaders.shader_trees import add

pytestmark = pytest.mark.blender


def extract_attribute(tree: Any, name: str) -> Any:
    """Return what a material that shines with an attribute is given of the only mesh."""
    attribute = tree.nodes.new("ShaderNodeAttribute")
    attribute.attribute_name = name
    tree.links.new(attribute.outputs["Color"], add(tree, "ShaderNodeEmission").inputs["Color"])
    (mesh,) = extract_scene(bpy.context.evaluated_depsgraph_get()).scene.meshes
    return mesh.attributes[name]


def test_edges_give_vertices_their_mean(shown: Any, tree: Any) -> None:
    shown.data.edges.add(1)
    shown.data.vertices.add(2)
    shown.data.edges[3].vertices = (0, 3)  # loose, and vertex 4 has no edge at all
    given = shown.data.attributes.new("given", "FLOAT", "EDGE")
    ends = [tuple(edge.vertices) for edge in shown.data.edges]
    values = np.array([1.0, 2.0, 4.0, 8.0])
    given.data.foreach_set("value", values.astype(np.float32))
    means = [np.mean([v for v, pair in zip(values, ends, strict=True) if n in pair] or [0]) for n in range(5)]
    assert_allclose(extract_attribute(tree, "given"), np.array(means)[:, np.newaxis])


def test_rotations_are_colors_with_alpha(shown: Any, tree: Any) -> None:
    """As in Cycles: w, x, y and z."""
    turn = shown.data.attributes.new("turn", "QUATERNION", "POINT")
    for item in turn.data:
        item.value = (0.5, -0.5, 0.1, 0.7)
    assert_allclose(extract_attribute(tree, "turn"), [(0.5, -0.5, 0.1, 0.7)] * 3, rtol=1e-6)
