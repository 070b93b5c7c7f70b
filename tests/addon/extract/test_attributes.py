"""Attributes of meshes as materials read them: of edges, and of types that no socket of a shader node has."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from numpy.testing import assert_allclose

from addon.extract.custom_properties import find_layer, read_layer_of
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


@pytest.mark.parametrize(
    ("kind", "values", "expected"),
    [
        ("FLOAT", (1.0, 2.0, 4.0, 8.0), (13 / 3, 1.5, 3.0, 8.0, 0.0)),
        ("INT", (1, 2, -3, 8), (2.0, 2.0, -1.0, 8.0, 0.0)),
        ("BOOLEAN", (True, False, False, False), (1.0, 1.0, 0.0, 0.0, 0.0)),
    ],
)
def test_edges_give_vertices_what_blender_carries_there(
    shown: Any, tree: Any, kind: str, values: tuple[Any, ...], expected: tuple[float, ...]
) -> None:
    """The mean, of whole numbers a whole one, or whether any is true; edges join 0 and 1, 1 and 2, 2 and 0, 0 and 3."""
    shown.data.edges.add(1)
    shown.data.vertices.add(2)  # the last has no edge at all
    shown.data.edges.foreach_set("vertices", [0, 1, 1, 2, 2, 0, 0, 3])
    shown.data.loops.foreach_set("edge_index", [0, 1, 2])
    given = shown.data.attributes.new("given", kind, "EDGE")
    given.data.foreach_set("value", values)
    assert_allclose(extract_attribute(tree, "given")[:, 0], expected, rtol=1e-6)


def test_rotations_are_colors_with_alpha(shown: Any, tree: Any) -> None:
    """As in Cycles: w, x, y and z."""
    turn = shown.data.attributes.new("turn", "QUATERNION", "POINT")
    for item in turn.data:
        item.value = (0.5, -0.5, 0.1, 0.7)
    assert_allclose(extract_attribute(tree, "turn"), [(0.5, -0.5, 0.1, 0.7)] * 3, rtol=1e-6)


def test_properties_are_those_of_the_view_layer_that_is_there(empty_scene: Any) -> None:
    """A change of frames may copy it anew: what was freed was read."""
    first, second = empty_scene.view_layers[0], empty_scene.view_layers.new("Second")
    first["glow"], second["glow"] = 0.25, 0.5
    depsgraph = SimpleNamespace(scene_eval=empty_scene, view_layer_eval=first)
    with read_layer_of(depsgraph):
        assert find_layer().find("glow")[0] == 0.25
        depsgraph.view_layer_eval = second
        assert find_layer().find("glow")[0] == 0.5
