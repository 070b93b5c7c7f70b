"""Properties that Attribute nodes read of objects, instancers and view layers, against Cycles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest

from tests.addon.against_cycles.node_fixtures import (
    CELL,
    LOWEST,
    add_node,
    make_material,
    make_sheet,
    render_centres,
    render_cycles,
)
from tests.addon.against_cycles.test_instances import COLUMNS, WAYS, instance_by_nodes, instance_collections, shown

__all__ = ["shown"]  # a fixture
pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

# Cycles holds values, and the color v - LOWEST that shines, in float32: a few roundings of numbers up to 16.
TOLERANCE = 16 * 4 * float(np.finfo(np.float32).eps)
# Names of properties, as an Attribute node has them.
NAMES = (
    *("number", "whole", "yes", "pair", "triple", "four", "wholes", "five", "text", "missing", "a.b"),
    *('["triple"]', '["triple"][1]', "location", "location.x", "location[1]", "color", "pass_index", "hide_render"),
    *("of the data", "both", "rotation_mode", "data", "lock_location", "color.a", "flags", "bound_box", ""),
)
OUTPUTS = ("Color", "Fac", "Alpha")


def set_properties(owner: Any) -> None:
    """Give a data-block one custom property of each kind."""
    owner["number"], owner["whole"], owner["yes"], owner["text"] = 0.7, 3, True, "text"
    owner["pair"], owner["triple"], owner["four"] = [0.1, 0.6], [0.2, 0.5, 0.9], [0.3, 0.4, 0.8, 0.6]
    owner["wholes"], owner["five"], owner["flags"], owner["a.b"] = [1, 2, 3], [0.5] * 5, [True, False], 0.35
    owner["both"] = 0.15


def read(name: str, kind: str, output: str) -> Callable[[Any], Any]:
    return lambda tree: add_node(tree, "ShaderNodeAttribute", attribute_type=kind, attribute_name=name).outputs[output]


def compare(columns: int, rows: int, names: list[str]) -> None:
    """Assert that both engines see the same color in each cell."""
    size = columns * CELL, rows * CELL
    ours, warnings = render_centres(*size)
    assert not warnings
    cycles = render_cycles(*size)
    differing = []
    for number, name in enumerate(names):
        row, column = divmod(number, columns)
        place = row * CELL + CELL // 2, column * CELL + CELL // 2
        if np.abs(ours[place] - cycles[place]).max() > TOLERANCE:
            differing.append(f"{name}: {ours[place] + LOWEST}, Cycles {cycles[place] + LOWEST}")
    assert not differing, "\n".join(differing)


@pytest.mark.parametrize("kind", ["OBJECT", "VIEW_LAYER", "INSTANCER"])
def test_properties_are_those_of_cycles(empty_scene: Any, kind: str) -> None:
    """Of objects, then of their data; of the view layer, then of the scene, then of the world."""
    table = {f"{name} {output}": read(name, kind, output) for name in NAMES for output in OUTPUTS}
    columns, rows = make_sheet(empty_scene, table)
    world = empty_scene.world = bpy.data.worlds.new("World")
    owners = [bpy.context.view_layer] if kind == "VIEW_LAYER" else [bpy.data.objects[name] for name in table]
    seconds = [empty_scene] if kind == "VIEW_LAYER" else [bpy.data.objects[next(iter(table))].data]
    world["of the data"] = 0.45
    for owner in owners:
        set_properties(owner)
    for owner in seconds:
        owner["of the data"], owner["both"] = [0.25, 0.75], 0.95
    empty_scene.update_tag()
    for item in bpy.data.objects:
        item.update_tag()
    compare(columns, rows, list(table))


def show(shown: Any, make: Callable[[Any], Any]) -> None:
    shown.data.materials[0] = make_material("Shown", make)


def agree() -> np.ndarray:
    """Return what our engine sees, as a color, after comparing it with Cycles."""
    for item in bpy.data.objects:
        item.update_tag()
    size = COLUMNS * CELL
    ours, warnings = render_centres(size, size)
    assert not warnings
    cycles = render_cycles(size, size)
    np.testing.assert_allclose(ours, cycles, atol=TOLERANCE)
    return ours + LOWEST


GIVEN = {
    "Generated": lambda tree: add_node(tree, "ShaderNodeTexCoord", from_instancer=True).outputs["Generated"],
    "UV": lambda tree: add_node(tree, "ShaderNodeTexCoord", from_instancer=True).outputs["UV"],
    "UV Map": lambda tree: add_node(tree, "ShaderNodeUVMap", from_instancer=True).outputs["UV"],
}


@pytest.mark.parametrize("given", GIVEN)
@pytest.mark.parametrize("way", WAYS)
def test_coordinates_from_instancers_are_those_of_cycles(empty_scene: Any, shown: Any, way: str, given: str) -> None:
    show(shown, GIVEN[given])
    WAYS[way](empty_scene, shown)
    for mesh in bpy.data.meshes:  # particles lie on a ground with coordinates
        if len(mesh.polygons):
            mesh.uv_layers.new(name="UVMap")
    agree()


@pytest.mark.parametrize("given", GIVEN)
def test_what_is_no_instance_has_no_coordinates_from_an_instancer(empty_scene: Any, shown: Any, given: str) -> None:
    show(shown, GIVEN[given])
    shown.location = (3.0, 3.0, 0.0)
    agree()


@pytest.mark.parametrize("name", ["grade", "tint", "spot", "flag", "whole", "own", "shared"])
@pytest.mark.parametrize("is_nested", [False, True])
@pytest.mark.parametrize("with_ids", [False, True])
def test_attributes_of_instances_by_nodes_are_those_of_cycles(
    empty_scene: Any, shown: Any, name: str, is_nested: bool, with_ids: bool
) -> None:
    """What the instances lack, the instancer may have, and what that lacks, the object."""
    show(shown, read(name, "INSTANCER", "Color"))
    instance_by_nodes(empty_scene, shown)
    points = bpy.data.objects["Points"]
    store_attributes(points, is_nested, with_ids)
    shown["own"], points["shared"], shown["shared"], points["grade"] = 0.25, 0.75, 0.5, 0.1
    values = agree()
    if name in ("grade", "tint", "spot", "whole"):
        assert len(np.unique(values.round(5))) > COLUMNS


def store_attributes(points: Any, is_nested: bool, with_ids: bool) -> None:
    """Store named attributes on the instances that geometry nodes make; nested ones lie in an instance of their own."""
    tree = points.modifiers[0].node_group
    output = next(node for node in tree.nodes if node.type == "GROUP_OUTPUT")
    made = output.inputs[0].links[0].from_socket
    index = tree.nodes.new("GeometryNodeInputIndex").outputs[0]
    kinds = {"grade": "FLOAT", "tint": "FLOAT_COLOR", "spot": "FLOAT_VECTOR", "flag": "BOOLEAN", "whole": "INT"}
    for name, kind in kinds.items():
        value = add_node(tree, "ShaderNodeMath", operation="MULTIPLY")
        tree.links.new(index, value.inputs[0])
        value.inputs[1].default_value = 0.02 if name != "whole" else 0.2
        made = store(tree, made, name, kind, value.outputs[0])
    if with_ids:
        turned = add_node(tree, "ShaderNodeMath", operation="SUBTRACT")
        turned.inputs[0].default_value = 100.0
        tree.links.new(index, turned.inputs[1])
        chosen = tree.nodes.new("GeometryNodeSetID")
        tree.links.new(made, chosen.inputs["Geometry"])
        tree.links.new(turned.outputs[0], chosen.inputs["ID"])
        made = chosen.outputs[0]
    if is_nested:
        outer = tree.nodes.new("GeometryNodeGeometryToInstance")
        tree.links.new(made, outer.inputs[0])
        made = store(tree, outer.outputs[0], "grade", "FLOAT", None)
    tree.links.new(made, output.inputs[0])


def store(tree: Any, geometry: Any, name: str, kind: str, value: Any) -> Any:
    """Store an attribute on instances, its value linked or as it is."""
    node = add_node(tree, "GeometryNodeStoreNamedAttribute", data_type=kind, domain="INSTANCE")
    node.inputs["Name"].default_value = name
    tree.links.new(geometry, node.inputs["Geometry"])
    if value is not None:
        tree.links.new(value, next(socket for socket in node.inputs if socket.name == "Value" and socket.enabled))
    return node.outputs[0]


@pytest.mark.parametrize("name", ["own", "shared", "data's", "missing"])
def test_properties_of_collection_instances_are_those_of_cycles(empty_scene: Any, shown: Any, name: str) -> None:
    show(shown, read(name, "INSTANCER", "Color"))
    instance_collections(empty_scene, shown)
    shown["own"], shown["shared"], shown.data["data's"] = 0.25, 0.5, [0.1, 0.6]
    for number, item in enumerate(item for item in bpy.data.objects if item.name.startswith("Instancer")):
        item["shared"] = [0.02 * number, 0.5, 0.01 * number]
    values = agree()
    assert (len(np.unique(values.round(5))) > COLUMNS) == (name == "shared")


def test_properties_of_particles_are_those_of_cycles(empty_scene: Any, shown: Any) -> None:
    show(shown, read("size", "INSTANCER", "Color"))
    WAYS["particles"](empty_scene, shown)
    bpy.data.particles[0]["size"], shown["size"] = 0.625, 0.5
    bpy.data.particles[0].update_tag()
    assert 0.625 in agree()


def read_info(output: str) -> Callable[[Any], Any]:
    return lambda tree: tree.nodes.new("ShaderNodeObjectInfo").outputs[output]


READS = {
    "random": read_info("Random"),
    "color": read_info("Color"),
    "property": read("grade", "OBJECT", "Color"),
    "given": read("shared", "INSTANCER", "Color"),
    "generated": GIVEN["Generated"],
}


@pytest.mark.parametrize("reads", READS)
def test_point_clouds_read_of_instances_what_they_do_in_cycles(empty_scene: Any, shown: Any, reads: str) -> None:
    bpy.ops.object.pointcloud_random_add()
    points = bpy.context.object
    count = len(points.data.points)
    points.data.attributes["position"].data.foreach_set("vector", np.zeros(3 * count, np.float32))
    points.data.attributes["radius"].data.foreach_set("value", np.full(count, 0.3, np.float32))
    points.data.materials.append(make_material("Points", READS[reads]))
    empty_scene.collection.objects.unlink(shown)
    points.color, points["grade"] = (0.25, 0.5, 0.75, 0.5), [0.1, 0.6, 0.3]
    instance_collections(empty_scene, points)
    for number, item in enumerate(item for item in bpy.data.objects if item.name.startswith("Instancer")):
        item["shared"], item.color = 0.02 * number, (0.01 * number, 0.5, 0.25, 1.0)
    size = COLUMNS * CELL
    ours, warnings = render_centres(size, size)
    assert not warnings
    middle = np.s_[CELL // 2 :: CELL, CELL // 2 :: CELL]
    np.testing.assert_allclose(ours[middle], render_cycles(size, size)[middle], atol=TOLERANCE)
    assert (ours[middle] > 0).all()


def test_colors_of_collection_instances_are_those_of_cycles(empty_scene: Any, shown: Any) -> None:
    """They are the instancer's, not the object's own."""
    show(shown, read_info("Color"))
    shown.color = (0.25, 0.5, 0.75, 0.5)
    instance_collections(empty_scene, shown)
    for number, item in enumerate(item for item in bpy.data.objects if item.name.startswith("Instancer")):
        item.color = (0.02 * number, 0.5, 0.01 * number, 1.0)
    agree()
