"""Bake by Blender's own operator: what arrives in the pixels of the texture."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from tests.addon.engine.engine_fixtures import make_emission

pytestmark = pytest.mark.usefixtures("registered_addon")

SIZE = 16
RED, GREEN = (0.75, 0.125, 0.5), (0.0, 0.5, 0.25)
# What Blender adds to a baked normal, so that 0.5 does not become 127 of 255, and a little more for float32.
BIAS = 1.1e-5


@pytest.fixture
def plane(empty_scene: Any) -> Any:
    """Return a plane of 4 x 2 m at (1, 2, 3) that fills its texture and emits RED; no camera, no light."""
    empty_scene.render.engine = "REFERENCE_RAYTRACER"
    empty_scene.reference_raytracer.samples = 4
    bpy.ops.mesh.primitive_plane_add(size=2, location=(1, 2, 3))
    thing = bpy.context.object
    thing.scale = (2, 1, 1)
    thing.data.materials.append(make_emission("Red", RED))
    add_texture(thing.data.materials[0], "Texture")
    return thing


def add_texture(material: Any, name: str) -> Any:
    """Give a material an image that bakes go to."""
    image = bpy.data.images.new(name, SIZE, SIZE, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    material.node_tree.nodes.active = node
    return image


def bake(kind: str, name: str = "Texture", **options: Any) -> np.ndarray:
    """Bake; return the image (h, w, 4), row 0 at the bottom as v runs."""
    assert bpy.ops.object.bake(type=kind, margin=0, **options) == {"FINISHED"}
    return read(name)


def read(name: str) -> np.ndarray:
    """Return an image (h, w, 4)."""
    pixels = np.empty(SIZE * SIZE * 4, np.float32)
    bpy.data.images[name].pixels.foreach_get(pixels)
    return pixels.reshape(SIZE, SIZE, 4)


def test_emission_fills_the_texture(plane: Any) -> None:
    np.testing.assert_allclose(bake("EMIT"), np.broadcast_to((*RED, 1.0), (SIZE, SIZE, 4)), rtol=1e-6)
    np.testing.assert_allclose(bake("COMBINED")[..., :3], np.broadcast_to(RED, (SIZE, SIZE, 3)), rtol=1e-6)


def test_a_layer_that_leaves_surfaces_out_bakes_them(plane: Any) -> None:
    """As in Cycles: otherwise there is nothing to bake."""
    bpy.context.view_layer.use_solid = False
    np.testing.assert_allclose(bake("EMIT"), np.broadcast_to((*RED, 1.0), (SIZE, SIZE, 4)), rtol=1e-6)


def test_positions_are_in_their_pixels(plane: Any) -> None:
    """u runs along x, v along y: the middle of pixel i lies at (i + 0.5) / 16 of the side."""
    fractions = (np.arange(SIZE) + 0.5) / SIZE
    expected = np.empty((SIZE, SIZE, 3))
    expected[..., 0] = 1 + 2 * (2 * fractions - 1)
    expected[..., 1] = (2 + (2 * fractions - 1))[:, np.newaxis]
    expected[..., 2] = 3
    # Blender moves pixels by a thousandth, off the edges of triangles.
    np.testing.assert_allclose(bake("POSITION")[..., :3], expected, atol=4 / SIZE * 1e-2)
    uv = bake("UV")
    np.testing.assert_allclose(uv[..., 0], np.broadcast_to(fractions, (SIZE, SIZE)), atol=1e-3)
    np.testing.assert_allclose(uv[..., 1], np.broadcast_to(fractions[:, np.newaxis], (SIZE, SIZE)), atol=1e-3)


def test_normals_are_in_the_space_asked_for(plane: Any) -> None:
    plane.rotation_euler = (0.0, np.pi / 2, 0.0)  # the plane's z is the world's x
    flat = bake("NORMAL", normal_space="TANGENT")[..., :3]
    np.testing.assert_allclose(flat, np.broadcast_to((0.5, 0.5, 1.0), flat.shape), atol=BIAS)
    own = bake("NORMAL", normal_space="OBJECT")[..., :3]
    np.testing.assert_allclose(own, np.broadcast_to((0.5, 0.5, 1.0), own.shape), atol=BIAS)


def test_nothing_occludes_an_open_plane(plane: Any) -> None:
    np.testing.assert_array_equal(bake("AO"), 1.0)


def test_contributions_choose_the_light(plane: Any) -> None:
    nothing = bake("COMBINED", pass_filter={"DIFFUSE", "DIRECT"})
    np.testing.assert_array_equal(nothing[..., :3], 0.0)
    only = bake("COMBINED", pass_filter={"EMIT"})
    np.testing.assert_allclose(only[..., :3], np.broadcast_to(RED, (SIZE, SIZE, 3)), rtol=1e-6)


def test_diffuse_color_is_that_of_the_material(plane: Any) -> None:
    tree = plane.data.materials[0].node_tree
    shader = tree.nodes.new("ShaderNodeBsdfDiffuse")
    shader.inputs["Color"].default_value = (*RED, 1.0)
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    baked = bake("DIFFUSE", pass_filter={"COLOR"})
    np.testing.assert_allclose(baked[..., :3], np.broadcast_to(RED, (SIZE, SIZE, 3)), rtol=1e-6)
    world = bpy.data.worlds.new("White")
    bpy.context.scene.world = world
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    background = next(node for node in world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground")
    background.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    light = bake("DIFFUSE", pass_filter={"DIRECT", "INDIRECT"})  # of a white furnace, without the color: 1
    np.testing.assert_allclose(light[..., :3], 1.0, rtol=1e-5)


def test_each_material_has_its_own_texture(plane: Any) -> None:
    """Two halves of two materials bake into two images, and the modifier's triangles into the right ones."""
    plane.data.materials.append(make_emission("Green", GREEN))
    add_texture(plane.data.materials[1], "Other")
    plane.modifiers.new("Subdivide", "SUBSURF").subdivision_type = "SIMPLE"
    plane.modifiers["Subdivide"].render_levels = 1
    bpy.ops.object.modifier_apply(modifier="Subdivide")
    for polygon in plane.data.polygons:
        polygon.material_index = int(polygon.center.x > 0)
    first, second = bake("EMIT"), read("Other")
    left, right = slice(0, SIZE // 2), slice(SIZE // 2, SIZE)
    np.testing.assert_allclose(first[:, left, :3], np.broadcast_to(RED, (SIZE, SIZE // 2, 3)), rtol=1e-6)
    np.testing.assert_allclose(second[:, right, :3], np.broadcast_to(GREEN, (SIZE, SIZE // 2, 3)), rtol=1e-6)
    assert not first[:, right, :3].any()
    assert not second[:, left, :3].any()


def test_selected_objects_bake_into_the_active_one(plane: Any) -> None:
    """A green plane 1 m above it is what the red one gets."""
    bpy.ops.mesh.primitive_plane_add(size=8, location=(1, 2, 4))
    above = bpy.context.object
    above.data.materials.append(make_emission("Green", GREEN))
    plane.select_set(True)
    bpy.context.view_layer.objects.active = plane
    baked = bake("EMIT", use_selected_to_active=True, cage_extrusion=2.0)
    np.testing.assert_allclose(baked[..., :3], np.broadcast_to(GREEN, (SIZE, SIZE, 3)), rtol=1e-6)


def test_a_copy_by_an_instancer_is_not_mistaken_for_the_object(plane: Any) -> None:
    """An array of instances of the same mesh stands elsewhere; positions are the object's own."""
    empty = bpy.data.objects.new("Instances", None)
    shown = bpy.data.collections.new("Shown")
    shown.objects.link(plane)
    empty.instance_type, empty.instance_collection = "COLLECTION", shown
    empty.location = (50, 0, 0)
    bpy.context.scene.collection.objects.link(empty)
    assert bake("POSITION")[..., 0].max() < 4


def test_color_attributes_are_baked(plane: Any) -> None:
    plane.data.color_attributes.new("Color", "FLOAT_COLOR", "CORNER")
    assert bpy.ops.object.bake(type="EMIT", target="VERTEX_COLORS") == {"FINISHED"}
    colors = np.empty(4 * 4, np.float32)
    plane.data.color_attributes["Color"].data.foreach_get("color", colors)
    np.testing.assert_allclose(colors.reshape(4, 4)[:, :3], np.broadcast_to(RED, (4, 3)), rtol=1e-6)


def test_workers_and_one_process_bake_the_same(plane: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from addon.engine import worker_pool

    bpy.ops.object.light_add(type="POINT", location=(1, 2, 5))
    for thing in bpy.context.view_layer.objects:
        thing.select_set(thing == plane)
    bpy.context.view_layer.objects.active = plane
    bpy.context.scene.reference_raytracer.workers = 1
    alone = bake("COMBINED")
    monkeypatch.setattr(worker_pool, "SMALLEST_PICTURE", 1)
    bpy.context.scene.reference_raytracer.workers = 2
    np.testing.assert_array_equal(bake("COMBINED"), alone)
    workers = worker_pool._Session.workers
    assert workers is not None
    assert list(workers.run([0])) == [None]  # no scene is left in them


def test_what_a_bake_does_not_honour_is_said_once(plane: Any, capfd: pytest.CaptureFixture[str]) -> None:
    """Halves of two materials bake into two textures."""
    green = make_emission("Green", GREEN)
    add_texture(green, "Other")
    plane.data.materials.append(green)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.subdivide()
    bpy.ops.object.mode_set(mode="OBJECT")
    plane.data.polygons[0].material_index = 1
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "AREA"))
    lamp.scale = (0, 0, 0)
    bpy.context.scene.collection.objects.link(lamp)
    capfd.readouterr()
    bake("EMIT")
    assert capfd.readouterr().out.count("an area light without area is left out") == 1


def test_what_cannot_be_baked_is_said(plane: Any) -> None:
    with pytest.raises(RuntimeError, match="baking Roughness is not supported: expected Combined, Ambient Occlusion"):
        bpy.ops.object.bake(type="ROUGHNESS", margin=0)
    plane.data.vertices.add(3)
    for vertex in list(plane.data.vertices)[-3:]:
        vertex.co = (np.nan, 0, 0)
    plane.data.polygons.add(1)
    plane.data.loops.add(3)
    plane.data.polygons[-1].loop_start = 4
    for corner, loop in enumerate(list(plane.data.loops)[-3:]):
        loop.vertex_index = 4 + corner
    with pytest.raises(RuntimeError, match="has vertices that are not finite, and cannot be baked"):
        bpy.ops.object.bake(type="EMIT", margin=0)
