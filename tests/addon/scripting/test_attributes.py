"""Attributes and materials at hits, against closed forms and Blender's own values at vertices."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy
import numpy as np
import pytest

from addon import closest_point, ray_cast
from addon.scripting import attributes
from tests.addon.scripting.ray_cast_fixtures import (
    DOWN,
    aim_down,
    find_depsgraph,
    forget_casters,  # noqa: F401  (a fixture, found by its name)
    link,
    make_collection_instance,
    make_quad,
)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("forget_casters")]


def give_attribute(mesh: Any, name: str, kind: str, domain: str, field: str, values: Any) -> None:
    data = mesh.attributes.new(name, kind, domain).data
    data.foreach_set(field, np.asarray(values).ravel())


@pytest.fixture
def quads(empty_scene: Any) -> Any:
    """Two squares above each other, with an attribute of each kind that says where it is."""
    mesh = make_quad(copies=2)
    corners = np.array([vertex.co for vertex in mesh.vertices])
    uv = mesh.uv_layers.new(name="Map")
    uv.uv.foreach_set("vector", corners[[loop.vertex_index for loop in mesh.loops], :2].ravel())
    give_attribute(mesh, "height", "FLOAT", "POINT", "value", corners[:, 0] + 10 * corners[:, 1])
    give_attribute(mesh, "tint", "FLOAT_COLOR", "CORNER", "color", np.tile([0.25, 0.5, 0.75, 1], (8, 1)))
    give_attribute(mesh, "number", "INT", "FACE", "value", np.array([7, 2**30 + 1], np.intc))
    give_attribute(mesh, "rim", "FLOAT", "EDGE", "value", np.zeros(len(mesh.edges)))
    mesh.attributes.new("label", "STRING", "POINT")
    thing = link("Quads", mesh)
    group = thing.vertex_groups.new(name="Right")
    group.add([vertex.index for vertex in mesh.vertices if vertex.co.x > 0], 0.5, "REPLACE")
    return thing


def test_attributes_are_interpolated_at_every_hit(quads: Any) -> None:
    origins = np.array([(0.25, 0.5, 3), (-0.5, 0.125, 3), (0.75, -0.5, 3), (9, 9, 9)])
    cast = ray_cast(find_depsgraph(), origins, DOWN, hits=2)
    x, y = np.repeat(origins[:3, 0], 2).reshape(3, 2), np.repeat(origins[:3, 1], 2).reshape(3, 2)
    np.testing.assert_allclose(cast.attribute("Map")[:3], np.stack([x, y], axis=-1), atol=1e-15)
    np.testing.assert_allclose(cast.attribute("height")[:3], x + 10 * y, atol=1e-14)
    np.testing.assert_allclose(cast.attribute("tint")[:3], np.tile([0.25, 0.5, 0.75, 1], (3, 2, 1)))
    np.testing.assert_allclose(cast.attribute("Right")[:3], (x + 1) / 4, atol=1e-15)
    assert cast.attribute("number")[:3].tolist() == [[7, 2**30 + 1]] * 3  # exact: no float32
    for name, width in (("Map", (2,)), ("height", ()), ("tint", (4,)), ("Right", ())):
        values = cast.attribute(name)
        assert values.shape == (4, 2, *width)
        assert np.isnan(values[3]).all()


def test_attributes_of_closest_points(quads: Any) -> None:
    closest = closest_point(find_depsgraph(), [(0.25, 0.5, 3), (5, 0.5, 0)])
    np.testing.assert_allclose(closest.attribute("Map"), [(0.25, 0.5), (1, 0.5)], atol=1e-15)


def test_nothing_is_read_until_it_is_asked_for(quads: Any, monkeypatch: Any) -> None:
    asked: list[str] = []
    monkeypatch.setattr(attributes, "sample", lambda *arguments: asked.append("attribute"))
    monkeypatch.setattr(attributes, "list_placements", lambda *arguments: asked.append("walk") or [])
    cast = ray_cast(find_depsgraph(), *aim_down())
    assert cast.matrix.shape
    assert len(cast.persistent_id) == len(cast)
    assert not asked


def test_meshes_without_the_attribute_have_nan(quads: Any) -> None:
    link("Plain", make_quad(), (3, 0, 0))
    cast = ray_cast(find_depsgraph(), [(0.25, 0.5, 3), (3.25, 0.5, 3)], DOWN)
    values = cast.attribute("height")
    assert np.isnan(values).tolist() == [False, True]


def test_triangles_that_are_left_out_do_not_shift_corners(empty_scene: Any) -> None:
    """The first polygon's vertices are not finite, so that it has no triangle."""
    mesh = make_quad(copies=2)
    layer = mesh.uv_layers.new(name="Map")
    layer.uv.foreach_set("vector", np.repeat(np.arange(8.0), 2))
    positions = np.array([vertex.co for vertex in mesh.vertices], dtype=np.float32)
    positions[:4, 0] = np.nan
    mesh.attributes["position"].data.foreach_set("vector", positions.ravel())
    link("Broken", mesh)
    cast = ray_cast(find_depsgraph(), (-1, -1, 3), DOWN)
    assert cast.index.tolist() == [1]
    np.testing.assert_allclose(cast.attribute("Map"), [(4, 4)])


def make_generated(thing: Any) -> Any:
    """Give an object nodes that put cubes on its vertices, each a mesh that no object has."""
    group = bpy.data.node_groups.new("Cubes", "GeometryNodeTree")
    for in_out in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=in_out, socket_type="NodeSocketGeometry")
    start, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    cube, place = group.nodes.new("GeometryNodeMeshCube"), group.nodes.new("GeometryNodeInstanceOnPoints")
    cube.inputs["Size"].default_value = (0.5, 0.5, 0.5)
    store = group.nodes.new("GeometryNodeStoreNamedAttribute")
    store.data_type, store.domain = "FLOAT_VECTOR", "POINT"
    store.inputs["Name"].default_value = "where"
    position = group.nodes.new("GeometryNodeInputPosition")
    paint = group.nodes.new("GeometryNodeSetMaterial")
    paint.inputs["Material"].default_value = bpy.data.materials.new("Generated")
    vector = next(socket for socket in store.inputs if socket.name == "Value" and socket.enabled)
    for one, other in (
        (start.outputs[0], place.inputs["Points"]),
        (cube.outputs["Mesh"], store.inputs["Geometry"]),
        (position.outputs[0], vector),
        (store.outputs[0], paint.inputs["Geometry"]),
        (paint.outputs[0], place.inputs["Instance"]),
        (place.outputs[0], end.inputs[0]),
    ):
        group.links.new(one, other)
    thing.modifiers.new("Cubes", "NODES").node_group = group


def test_generated_instances_have_attributes_and_materials(empty_scene: Any) -> None:
    """No object has their mesh: the one that Scene.ray_cast names has other polygons, or none."""
    thing = link("Thing", make_quad(2))
    make_generated(thing)
    cast = ray_cast(find_depsgraph(), [(2.125, 2.0625, 5), (-1.9375, 2.125, 5)], DOWN)
    assert cast.result.all()
    assert len(thing.evaluated_get(find_depsgraph()).data.polygons) < cast.index.max() + 1 or cast.index.max() < 6
    local = cast.location - cast.matrix[:, :3, 3]
    np.testing.assert_allclose(cast.attribute("where"), local, atol=1e-6)
    assert [cast.materials[number].name for number in cast.material] == ["Generated"] * 2
    assert [cast.instancers[number].name for number in cast.instancer] == ["Thing"] * 2
    assert len({tuple(numbers) for numbers in cast.persistent_id}) == 2


def test_materials_are_those_of_slots(empty_scene: Any) -> None:
    """Of the mesh and of the object, per polygon, beyond the last, and none."""
    red, blue, own = (bpy.data.materials.new(name) for name in ("Red", "Blue", "Own"))
    mesh = make_quad(copies=3)
    for material in (red, blue):
        mesh.materials.append(material)
    for polygon, slot in zip(mesh.polygons, (0, 1, 9), strict=True):
        polygon.material_index = slot
    link("One", mesh)
    two = link("Two", mesh, (3, 0, 0))
    two.material_slots[0].link = "OBJECT"
    two.material_slots[0].material = own
    link("Plain", make_quad(), (6, 0, 0))
    cast = ray_cast(find_depsgraph(), [(x + 0.25, 0.5, 3) for x in (0, 3, 6, 20)], DOWN, hits=3)
    names = [[cast.materials[number].name if number >= 0 else None for number in row] for row in cast.material]
    assert names == [["Red", "Blue", "Blue"], ["Own", "Blue", "Blue"], [None] * 3, [None] * 3]


def test_instances_of_a_collection_have_an_instancer(empty_scene: Any) -> None:
    make_collection_instance()
    itself = link("Itself", make_quad(0.2), (0, 0, 3))
    cast = ray_cast(find_depsgraph(), [(2.25, 0.5, 5), (-1.75, 1.5, 5), (0.1, 0.05, 5), (30, 0, 0)], DOWN)
    names = [cast.instancers[number].name if number >= 0 else None for number in cast.instancer]
    assert names == ["Empty", "Empty.001", None, None]
    assert cast.objects[cast.object[2]] == itself
    ids = {instance.parent.name: tuple(instance.persistent_id) for instance in find_depsgraph().object_instances
           if instance.is_instance}  # fmt: skip
    assert tuple(cast.persistent_id[0]) == ids["Empty"]
    assert not cast.persistent_id[2:].any()


def test_a_mesh_that_changed_since_is_told(quads: Any) -> None:
    cast = ray_cast(find_depsgraph(), (0.25, 0.5, 3), DOWN)
    quads.location.x = 5  # what only moved is as it was
    np.testing.assert_allclose(cast.attribute("Map"), [(0.25, 0.5)], atol=1e-15)
    quads.data.vertices[0].co.z = 0.5
    quads.data.update()
    with pytest.raises(ValueError, match="attribute: the mesh of 'Quads' has changed since the rays were cast"):
        cast.attribute("Map")


def test_attributes_that_are_not_there_are_named(quads: Any) -> None:
    cast = ray_cast(find_depsgraph(), (0.25, 0.5, 3), DOWN)
    with pytest.raises(ValueError, match=r"name: expected .* \(.*Map.*height.*\), got 'Mapp'"):
        cast.attribute("Mapp")
    for name in ("rim", "label"):
        with pytest.raises(ValueError, match="name: expected an attribute of numbers on vertices, corners or faces"):
            cast.attribute(name)
    with pytest.raises(ValueError, match="name: expected the name of an attribute"):
        cast.attribute(3)
    missed = ray_cast(find_depsgraph(), (9, 9, 9), DOWN)
    assert np.isnan(missed.attribute("Map")).all()
    assert missed.material.tolist() == [-1]


def test_attributes_of_two_widths_are_refused(quads: Any) -> None:
    other = make_quad()
    give_attribute(other, "height", "FLOAT_VECTOR", "POINT", "vector", np.zeros((4, 3)))
    link("Other", other, (3, 0, 0))
    cast = ray_cast(find_depsgraph(), [(0.25, 0.5, 3), (3.25, 0.5, 3)], DOWN)
    with pytest.raises(ValueError, match="name: 'height' has 1 numbers on some meshes that are hit and 3 on others"):
        cast.attribute("height")


def test_a_view_layer_that_is_gone_is_told(quads: Any) -> None:
    layer = bpy.context.scene.view_layers.new("Other")
    layer.update()
    cast = ray_cast(layer.depsgraph, (0.25, 0.5, 3), DOWN)
    np.testing.assert_allclose(cast.attribute("Map"), [(0.25, 0.5)], atol=1e-15)
    bpy.context.scene.view_layers.remove(layer)
    with pytest.raises(ValueError, match="depsgraph: the view layer 'Other' that was cast into is gone"):
        cast.attribute("Map")


def test_the_depsgraph_of_a_render_has_to_be_given(quads: Any) -> None:
    cast = ray_cast(find_depsgraph(), (0.25, 0.5, 3), DOWN)
    view = (*cast.places.view[:2], "RENDER", cast.places.view[3])
    rendered = replace(cast, places=replace(cast.places, view=view))
    with pytest.raises(
        ValueError, match="depsgraph: expected the one that was cast into, which is a render's, got None"
    ):
        rendered.attribute("Map")
    np.testing.assert_allclose(rendered.attribute("Map", find_depsgraph()), [(0.25, 0.5)], atol=1e-15)
