"""Lights and camera: Blender's fields, and Cycles as the judge of what exposure, temperature and normalize mean."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from numpy.testing import assert_allclose, assert_array_equal

import raytracer
from addon import versions
from addon.extract.scene import Extraction, extract_scene
from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL

pytestmark = pytest.mark.blender

STORED = 4 * float(np.finfo(np.float32).eps)  # a few roundings of what Blender stores in float32


def extract() -> Extraction:
    return extract_scene(bpy.context.evaluated_depsgraph_get())


def extract_light() -> Any:
    (light,) = extract().scene.lights
    return light


@pytest.fixture
def add_light(scene_with_camera: Any) -> Callable[..., Any]:
    """Return a function that adds a light object: kind, world matrix, fields of its data."""

    def add(kind: str, matrix: Matrix | None = None, **fields: Any) -> Any:
        data = bpy.data.lights.new("Light", kind)
        for name, value in fields.items():
            setattr(data, name, value)
        light = bpy.data.objects.new("Light", data)
        light.matrix_world = matrix or Matrix()
        scene_with_camera.collection.objects.link(light)
        return light

    return add


def test_point_light(add_light: Callable[..., Any]) -> None:
    fields = {"energy": 8, "color": (1, 0.5, 0.25), "shadow_soft_size": 0.5, "use_soft_falloff": False}
    add_light("POINT", Matrix.Translation((1, 2, 3)) @ Matrix.Scale(2, 4), **fields, use_shadow=False)
    light = extract_light()
    assert type(light) is raytracer.PointLight
    assert_array_equal(light.position, (1, 2, 3))
    assert_array_equal(light.power, (8, 4, 2))
    assert (light.radius, light.soft_falloff, light.cast_shadow, light.name) == (0.5, False, False, "Light")


def test_spot_light_keeps_its_scale(add_light: Callable[..., Any]) -> None:
    matrix = Matrix.Rotation(0.5, 4, "X") @ Matrix.Diagonal((1, 2, 3, 1))
    add_light("SPOT", matrix, energy=8, spot_size=1.25, spot_blend=0.25, shadow_soft_size=0)
    light = extract_light()
    assert type(light) is raytracer.SpotLight
    assert_allclose(light.world_from_light, np.array(matrix)[:3, :3], rtol=0, atol=3 * STORED)
    assert (light.spot_size, light.spot_blend, light.radius) == (1.25, 0.25, 0)


def test_sun_points_to_where_it_stands(add_light: Callable[..., Any]) -> None:
    add_light("SUN", Matrix.Rotation(np.pi / 2, 4, "Y") @ Matrix.Scale(5, 4), energy=3, angle=0.25)
    light = extract_light()
    assert type(light) is raytracer.SunLight
    assert_allclose(light.direction, (1, 0, 0), rtol=0, atol=STORED)
    assert_array_equal(light.strength, 3)
    assert light.angle == 0.25


@pytest.mark.parametrize(
    ("shape", "outline", "height"),
    [("SQUARE", "rectangle", 2), ("RECTANGLE", "rectangle", 3), ("DISK", "ellipse", 2), ("ELLIPSE", "ellipse", 3)],
)
def test_area_light_takes_shape_and_scale(
    add_light: Callable[..., Any], shape: str, outline: str, height: float
) -> None:
    add_light("AREA", Matrix.Diagonal((2, 0.5, 1, 1)), energy=8, shape=shape, size=2, size_y=3, spread=1.5)
    light = extract_light()
    assert light.shape == outline
    assert_array_equal(light.axis_u, (4, 0, 0))
    assert_array_equal(light.axis_v, (0, 0.5 * height, 0))
    assert (light.spread, light.power.tolist()) == (1.5, [8, 8, 8])


def test_mirrored_area_light_still_shines_along_its_axis(add_light: Callable[..., Any]) -> None:
    matrix = Matrix.Rotation(0.5, 4, "X") @ Matrix.Diagonal((-1, 1, 1, 1))
    add_light("AREA", matrix, energy=8)
    light = extract_light()
    front = -np.cross(light.axis_u, light.axis_v)
    assert front @ -np.array(matrix)[:3, 2] > 0


def test_lights_in_collection_instances_stand_where_the_instances_do(
    add_light: Callable[..., Any], scene_with_camera: Any
) -> None:
    collection = bpy.data.collections.new("Collection")
    collection.objects.link(add_light("POINT", energy=1))
    instancer = bpy.data.objects.new("Instancer", None)
    instancer.instance_type, instancer.instance_collection = "COLLECTION", collection
    instancer.location = (5, 0, 0)
    scene_with_camera.collection.objects.link(instancer)
    assert sorted(light.position.tolist() for light in extract().scene.lights) == [[0, 0, 0], [5, 0, 0]]


def test_dark_lights_and_portals_are_left_out(add_light: Callable[..., Any]) -> None:
    add_light("POINT", energy=0)
    add_light("AREA", energy=8).data.cycles.is_portal = True
    extraction = extract()
    assert extraction.scene.lights == ()
    assert not extraction.warnings


@pytest.mark.parametrize(
    ("kind", "fields", "scale", "words"),
    [
        ("AREA", {"energy": 1, "size": 0}, 1, "without area"),
        ("SUN", {"energy": 1}, 0, "scaled to zero"),
        ("SPOT", {"energy": 1}, 0, "scaled to zero"),
        ("AREA", {"energy": 1}, (1, 1, 0), "scaled to zero"),
    ],
)
def test_light_that_cannot_be_is_named(
    add_light: Callable[..., Any], kind: str, fields: dict[str, float], scale: Any, words: str
) -> None:
    add_light(kind, Matrix.Diagonal((*np.broadcast_to(scale, 3), 1)), **fields)
    extraction = extract()
    assert extraction.scene.lights == ()
    (warning,) = extraction.warnings
    assert warning.object == "Light"
    assert words in warning.text


@pytest.mark.parametrize("kind", ["POINT", "SUN", "SPOT", "AREA"])
def test_light_below_0_takes_light_away(add_light: Callable[..., Any], kind: str) -> None:
    add_light(kind, energy=-2.0)
    extraction = extract()
    (light,) = extraction.scene.lights
    assert (getattr(light, "strength" if kind == "SUN" else "power") < 0).all()
    assert not extraction.warnings


def test_light_is_hidden_from_some_rays(add_light: Callable[..., Any]) -> None:
    light = add_light("POINT", energy=1)
    assert extract_light().seen_by == SEEN_BY_ALL - SEEN_BY["camera"]
    light.visible_glossy, light.visible_camera = False, True
    assert extract_light().seen_by == SEEN_BY_ALL - SEEN_BY["glossy"]


def test_nodes_of_a_light_scale_it(add_light: Callable[..., Any]) -> None:
    data = add_light("POINT", energy=8).data
    if versions.VERSION < (5, 1):
        data.use_nodes = True
    emission = next(node for node in data.node_tree.nodes if node.type == "EMISSION")
    emission.inputs["Color"].default_value, emission.inputs["Strength"].default_value = (1, 0.5, 0.25, 1), 2
    assert_array_equal(extract_light().power, (16, 8, 4))


def find_nodes(data: Any) -> tuple[Any, Any]:
    """Return the nodes of a light, and the one that shines."""
    if versions.VERSION < (5, 1):
        data.use_nodes = True
    return data.node_tree, next(node for node in data.node_tree.nodes if node.type == "EMISSION")


def test_quadratic_falloff_that_is_not_smoothed_is_a_constant(add_light: Callable[..., Any]) -> None:
    tree, emission = find_nodes(add_light("POINT", energy=2).data)
    falloff = tree.nodes.new("ShaderNodeLightFalloff")
    falloff.inputs["Strength"].default_value = 100
    tree.links.new(falloff.outputs["Quadratic"], emission.inputs["Strength"])
    light = extract_light()
    assert_array_equal(light.power, (200, 200, 200))
    assert light.nodes is None
    falloff.inputs["Smooth"].default_value = 1
    light = extract_light()
    assert_array_equal(light.power, (2, 2, 2))
    assert [step.operation for step in light.nodes.program.steps][:1] == ["LIGHT_FALLOFF Quadratic"]


def test_nodes_that_vary_become_a_program_that_knows_the_object(add_light: Callable[..., Any]) -> None:
    shown = add_light("SPOT", Matrix.Translation((1, 2, 3)), energy=2)
    shown.color, shown.pass_index = (0.1, 0.2, 0.3, 0.4), 5
    tree, emission = find_nodes(shown.data)
    texture, place = tree.nodes.new("ShaderNodeTexImage"), tree.nodes.new("ShaderNodeTexCoord")
    texture.image = bpy.data.images.new("Gobo", 2, 2)
    tree.links.new(place.outputs["Normal"], texture.inputs["Vector"])
    tree.links.new(texture.outputs["Color"], emission.inputs["Color"])
    extraction = extract()
    (light,) = extraction.scene.lights
    assert not extraction.warnings
    assert "TEX_IMAGE" in {step.operation for step in light.nodes.program.steps}
    placed = light.nodes.placed
    assert_array_equal(placed.world_from_object[0, :3, 3], (1, 2, 3))
    assert_array_equal(placed.pass_index, [5])
    assert_allclose(placed.color, [(0.1, 0.2, 0.3, 0.4)], rtol=1e-6)
    assert 0.0 < placed.random[0] < 1.0


@pytest.mark.parametrize(("kind", "name"), [("OBJECT", "tint"), ("INSTANCER", "tint"), ("OBJECT", "nothing")])
def test_nodes_of_a_light_know_the_properties_of_its_object(
    add_light: Callable[..., Any], kind: str, name: str
) -> None:
    shown = add_light("POINT", energy=2)
    shown["tint"] = (0.25, 0.5, 0.75)
    tree, emission = find_nodes(shown.data)
    attribute = tree.nodes.new("ShaderNodeAttribute")
    attribute.attribute_type, attribute.attribute_name = kind, name
    tree.links.new(attribute.outputs["Color"], emission.inputs["Color"])
    extraction = extract()
    (light,) = extraction.scene.lights
    assert not extraction.warnings
    ((_, values),) = light.nodes.placed.properties.items()
    assert_allclose(values, [(0.25, 0.5, 0.75, 1) if name == "tint" else (0, 0, 0, 0)])


def test_shaders_of_a_light_that_do_not_shine_give_nothing(add_light: Callable[..., Any]) -> None:
    _, emission = find_nodes(add_light("POINT", energy=2).data)
    emission.mute = True
    assert extract().scene.lights == ()


@pytest.fixture
def cycles_pixel(scene_with_camera: Any, tmp_path: Path) -> Callable[[], Any]:
    """Return a function that renders a white floor from above with Cycles, and gives the mean linear color."""
    scene = scene_with_camera
    scene.camera.location = (0, 0, 4)
    mesh = bpy.data.meshes.new("Floor")
    mesh.from_pydata([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [], [(0, 1, 2, 3)])
    scene.collection.objects.link(bpy.data.objects.new("Floor", mesh))
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 16, False
    scene.cycles.max_bounces, scene.cycles.use_adaptive_sampling = 0, False
    scene.render.resolution_x = scene.render.resolution_y = 8
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(tmp_path / "out.exr")

    def render() -> Any:
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        pixels = np.empty(8 * 8 * 4, dtype=np.float32)
        image.pixels.foreach_get(pixels)
        bpy.data.images.remove(image)
        return pixels.reshape(-1, 4)[:, :3].mean(axis=0, dtype=np.float64)

    return render


HAS_NEW_FIELDS = "exposure" in bpy.types.Light.bl_rna.properties


@pytest.mark.skipif(not HAS_NEW_FIELDS, reason="exposure, temperature and normalize came after Blender 4.2")
@pytest.mark.parametrize(
    ("kind", "fields"),
    [
        ("POINT", {"shadow_soft_size": 0.5}),
        ("POINT", {"shadow_soft_size": 0.0}),
        ("SPOT", {"shadow_soft_size": 0.5, "spot_size": 2.0}),
        ("SUN", {"angle": 0.5}),
        ("SUN", {"angle": 0.0}),
        ("AREA", {"shape": "RECTANGLE", "size": 0.5, "size_y": 2.0}),
        ("AREA", {"shape": "ELLIPSE", "size": 0.5, "size_y": 2.0}),
    ],
)
def test_extracted_power_means_to_cycles_what_the_fields_mean(
    add_light: Callable[..., Any], cycles_pixel: Callable[[], Any], kind: str, fields: dict[str, Any]
) -> None:
    matrix = Matrix.Translation((0, 0, 2)) @ Matrix.Diagonal((2, 1.5, 1, 1))
    data = add_light(kind, matrix, energy=3, color=(1, 0.5, 0.25), **fields).data
    data.exposure, data.use_temperature, data.temperature, data.normalize = 1.5, True, 3000, False
    expected = cycles_pixel()
    light = extract_light()
    power = light.strength if kind == "SUN" else light.power
    data.exposure, data.use_temperature, data.normalize = 0, False, True
    data.energy, data.color = power.max(), power / power.max()
    assert expected.min() > 0
    # The same samples in both renders: only float32 rounding differs, over sums of positive numbers.
    assert_allclose(cycles_pixel(), expected, rtol=64 * np.finfo(np.float32).eps)


def test_camera_fields(scene_with_camera: Any) -> None:
    data = scene_with_camera.camera.data
    data.lens, data.sensor_width, data.sensor_height, data.sensor_fit = 35, 30, 20, "VERTICAL"
    data.shift_x, data.shift_y, data.clip_start, data.clip_end, data.ortho_scale = 0.25, -0.5, 0.5, 64, 3
    scene_with_camera.render.pixel_aspect_x, scene_with_camera.render.pixel_aspect_y = 1.5, 2
    camera = extract().scene.camera
    assert (camera.projection, camera.focal_length, camera.sensor_fit) == ("perspective", 35, "vertical")
    assert (camera.sensor_width, camera.sensor_height, camera.ortho_scale) == (30, 20, 3)
    assert (camera.shift_x, camera.shift_y, camera.clip_start, camera.clip_end) == (0.25, -0.5, 0.5, 64)
    assert camera.pixel_aspect == 0.75
    data.type = "ORTHO"
    assert extract().scene.camera.projection == "orthographic"


def test_camera_matrix_loses_its_scale(scene_with_camera: Any) -> None:
    scene_with_camera.camera.matrix_world = (
        Matrix.Translation((1, 2, 3)) @ Matrix.Rotation(0.5, 4, "X") @ Matrix.Diagonal((2, 3, 4, 1))
    )
    matrix = extract().scene.camera.world_from_camera
    assert_allclose(matrix, Matrix.Translation((1, 2, 3)) @ Matrix.Rotation(0.5, 4, "X"), rtol=0, atol=STORED)
    assert_allclose(np.linalg.norm(matrix[:3, :3], axis=0), 1, rtol=4 * np.finfo(np.float64).eps)


def test_scene_without_camera_is_refused_by_name(empty_scene: Any) -> None:
    with pytest.raises(ValueError, match="Scene 'Scene' has no camera"):
        extract()


@pytest.mark.parametrize("scale", [(0, 2, 2), (1, 0, 1), (1, 1, 0), (0, 0, 0)])
def test_camera_scaled_to_zero_is_named_with_what_to_do(scene_with_camera: Any, scale: tuple[float, ...]) -> None:
    """Cycles renders what is behind all objects then, and nothing else."""
    scene_with_camera.camera.scale = scale
    says = rf"Camera 'Camera' has a scale of \({', '.join(map(str, scale))}\) and sees nothing so: set the scale"
    with pytest.raises(ValueError, match=says):
        extract()


def test_limit_of_bounces_of_a_light_is_read(add_light: Callable[..., Any], scene_with_camera: Any) -> None:
    add_light("POINT", energy=1)
    add_light("POINT", energy=1).data.cycles.max_bounces = 3
    extraction = extract()
    assert [light.max_bounces for light in extraction.scene.lights] == [None, 3]
    assert not extraction.warnings


def test_camera_without_depth_of_field_is_a_pinhole(scene_with_camera: Any) -> None:
    scene_with_camera.camera.data.dof.aperture_fstop = 0.5
    assert extract().scene.camera.aperture_radius == 0.0


@pytest.mark.parametrize(("kind", "radius"), [("PERSP", 0.05 / 4), ("ORTHO", 1 / 4)])
def test_aperture_is_focal_length_over_twice_the_stop(kind: str, radius: float, scene_with_camera: Any) -> None:
    camera = scene_with_camera.camera.data
    camera.type, camera.lens = kind, 50.0
    dof = camera.dof
    dof.use_dof, dof.aperture_fstop, dof.focus_distance, dof.aperture_blades = True, 2.0, 3.5, 5
    dof.aperture_rotation, dof.aperture_ratio = 0.25, 1.5
    found = extract().scene.camera
    assert (found.focus_distance, found.aperture_blades) == (3.5, 5)
    assert (found.aperture_rotation, found.aperture_ratio) == (0.25, 1.5)
    assert np.isclose(found.aperture_radius, radius, rtol=STORED)


def test_focus_follows_an_object_along_the_view_axis(scene_with_camera: Any) -> None:
    camera = scene_with_camera.camera
    camera.location, camera.rotation_euler, camera.scale = (0, 0, 10), (0, 0, 0), (2, 2, 2)
    target = bpy.data.objects.new("Target", None)
    target.location = (3, 1, 4)
    scene_with_camera.collection.objects.link(target)
    camera.data.dof.use_dof, camera.data.dof.focus_object = True, target
    assert extract().scene.camera.focus_distance == 6.0


def test_camera_may_be_a_spot_light(add_light: Callable[..., Any], scene_with_camera: Any) -> None:
    scene_with_camera.camera = add_light("SPOT", energy=1, spot_size=np.pi / 2)
    camera = extract().scene.camera
    assert camera.focal_length == pytest.approx(16, rel=STORED)  # the cone's tangent is 1
    assert camera.clip_end == 1e5


HIDES_LIGHTS = pytest.mark.skipif(
    not versions.hides_lights_like_objects(), reason="only their own switches hide lights"
)


@HIDES_LIGHTS
def test_a_light_of_an_indirect_only_collection_is_not_seen(add_light: Callable[..., Any]) -> None:
    light, scene = add_light("AREA", energy=1), bpy.context.scene
    collection = bpy.data.collections.new("Lights")
    scene.collection.children.link(collection)
    collection.objects.link(light)
    scene.collection.objects.unlink(light)
    light.visible_camera = True
    assert extract().scene.lights[0].seen_by == SEEN_BY_ALL
    bpy.context.view_layer.layer_collection.children["Lights"].indirect_only = True
    assert extract().scene.lights[0].seen_by == SEEN_BY_ALL - SEEN_BY["camera"]


@HIDES_LIGHTS
def test_an_instancer_hides_the_lights_that_it_shows(add_light: Callable[..., Any]) -> None:
    light, scene = add_light("AREA", energy=1), bpy.context.scene
    light.visible_camera = True
    instancer = bpy.data.objects.new("Instancer", None)
    scene.collection.objects.link(instancer)
    instancer.instance_type, instancer.instance_collection = "COLLECTION", bpy.data.collections.new("Lights")
    instancer.instance_collection.objects.link(light)
    scene.collection.objects.unlink(light)
    instancer.visible_glossy = False
    assert extract().scene.lights[0].seen_by == SEEN_BY_ALL - SEEN_BY["glossy"]


@pytest.mark.parametrize("kind", ["POINT", "SPOT", "SUN", "AREA"])
@pytest.mark.parametrize("energy", [np.nan, np.inf])
def test_a_light_of_no_number_is_left_out_and_named(add_light: Callable[..., Any], kind: str, energy: float) -> None:
    add_light("POINT", energy=1)
    add_light(kind, energy=energy)
    extraction = extract()
    assert len(extraction.scene.lights) == 1
    (warning,) = extraction.warnings
    assert warning.text.startswith("light left out: ")
