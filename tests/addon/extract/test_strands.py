"""Hair from Blender: Curves objects and particles, as Cycles is given them."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from numpy.testing import assert_allclose, assert_array_equal

from addon.extract import strands
from addon.extract.kept import Changes, Kept
from addon.extract.scene import Extraction, extract_scene
from addon.extract.strands import DEFAULT_RADIUS, find_radii
from raytracer.shading.nodes.strands import INTERCEPT, LENGTH, RANDOM
from raytracer.textures.noise import hash_words

from .shaders.shader_trees import add, give_nodes
from .test_instances import add_instancer

pytestmark = pytest.mark.blender

POINTS = np.array([(0, 0, 0), (0, 0, 1), (0, 3, 1), (1, 0, 0), (1, 0, 2)], dtype=np.float32)


def extract(kept: Kept | None = None) -> Extraction:
    return extract_scene(bpy.context.evaluated_depsgraph_get(), kept=kept)


def add_curves(scene: Any, counts: tuple[int, ...] = (3, 2), points: Any = POINTS) -> Any:
    data = bpy.data.hair_curves.new("Curves")
    data.add_curves(counts)
    data.attributes["position"].data.foreach_set("vector", np.ravel(points))
    shown = bpy.data.objects.new("Curves", data)
    scene.collection.objects.link(shown)
    return shown


def set_radii(shown: Any, radii: list[float]) -> None:
    shown.data.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", radii)


def add_furry_square(scene: Any, count: int = 7, **settings: Any) -> Any:
    """A square with particle hair, one metre long."""
    mesh = bpy.data.meshes.new("Square")
    mesh.from_pydata([(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)], [], [(0, 1, 2, 3)])
    mesh.uv_layers.new(name="Map").uv.foreach_set("vector", [0, 0, 1, 0, 1, 1, 0, 1])
    shown = bpy.data.objects.new("Square", mesh)
    scene.collection.objects.link(shown)
    add_system(shown, count, **settings)
    return shown


def add_system(shown: Any, count: int, **settings: Any) -> Any:
    found = shown.modifiers.new("Hair", "PARTICLE_SYSTEM").particle_system.settings
    found.type, found.count, found.hair_length, found.display_step = "HAIR", count, 1.0, 3
    for name, value in settings.items():
        setattr(found, name, value)
    return found


def read_outputs(shown: Any, *names: str) -> None:
    """Give an object a material that reads outputs of Curves Info, or attributes."""
    tree = give_nodes(shown, "Reads")
    emission = add(tree, "ShaderNodeEmission")
    info, total = tree.nodes.new("ShaderNodeHairInfo"), emission.inputs["Color"]
    for name in names:
        further = tree.nodes.new("ShaderNodeVectorMath")
        tree.links.new(further.outputs[0], total)
        if name in info.outputs:
            tree.links.new(info.outputs[name], further.inputs[0])
        else:
            attribute = tree.nodes.new("ShaderNodeAttribute")
            attribute.attribute_name = name
            tree.links.new(attribute.outputs["Vector"], further.inputs[0])
        total = further.inputs[1]


# Curves objects ------------------------------------------------------------------------------------------------------


def test_curves_are_placed_in_the_world(scene_with_camera: Any) -> None:
    shown = add_curves(scene_with_camera)
    set_radii(shown, [0.1, 0.2, 0.3, 0.0, -1.0])
    matrix = Matrix.Translation((1, 2, 3)) @ Matrix.Rotation(0.5, 4, "X") @ Matrix.Scale(2.0, 4)
    shown.matrix_world, shown.pass_index = matrix, 5
    extraction = extract()
    (curves,) = extraction.scene.curves
    world = np.array(matrix)
    assert_allclose(curves.points, POINTS @ world[:3, :3].T + world[:3, 3], atol=1e-6)
    assert_allclose(curves.radii, [0.2, 0.4, 0.6, 0.0, 0.0], rtol=1e-6)
    assert_array_equal(curves.strands, [0, 3, 5])
    assert (curves.shape, curves.pass_index, curves.name) == ("ribbon", 5, "Curves")
    assert [key.name for key in extraction.objects] == ["Curves"]
    assert not extraction.warnings


def test_curves_without_radii_have_blenders(scene_with_camera: Any) -> None:
    add_curves(scene_with_camera)
    (curves,) = extract().scene.curves
    assert_array_equal(curves.radii, np.float32(DEFAULT_RADIUS))


@pytest.mark.parametrize(("shape", "expected"), [("RIBBONS", "ribbon"), ("THICK", "thick")])
def test_the_scene_says_whether_strands_are_round(scene_with_camera: Any, shape: str, expected: str) -> None:
    scene_with_camera.cycles_curves.shape = shape
    add_curves(scene_with_camera)
    assert extract().scene.curves[0].shape == expected


def test_what_materials_read_of_curves(scene_with_camera: Any) -> None:
    """Names of points and of strands; how far up a point lies, how long a strand is, and Cycles' random number."""
    shown = add_curves(scene_with_camera)
    shown.data.attributes.new("color", "FLOAT_COLOR", "POINT").data.foreach_set("color", np.arange(20.0))
    shown.data.attributes.new("tint", "FLOAT", "CURVE").data.foreach_set("value", [5.0, 6.0])
    shown.data.attributes.new("place", "FLOAT2", "CURVE").data.foreach_set("vector", [0.1, 0.2, 0.3, 0.4])
    shown.data.attributes.new("unread", "FLOAT", "CURVE")
    read_outputs(shown, "Intercept", "Length", "Random", "color", "tint")
    (curves,) = extract().scene.curves
    assert set(curves.attributes) == {INTERCEPT, "color"}
    assert set(curves.strand_attributes) == {LENGTH, RANDOM, "tint"}
    assert_allclose(curves.attributes[INTERCEPT][:, 0], [0, 0.25, 1, 0, 1], rtol=1e-6)
    assert_allclose(curves.strand_attributes[LENGTH][:, 0], [4, 2], rtol=1e-6)
    expected = hash_words(np.arange(2, dtype=np.uint32), 0) / (2**32 - 1)
    assert_allclose(curves.strand_attributes[RANDOM][:, 0], expected)
    assert_array_equal(curves.attributes["color"], np.arange(20.0).reshape(5, 4))
    assert curves.uvs is None


def test_the_first_pair_of_numbers_of_strands_is_their_uv(scene_with_camera: Any) -> None:
    shown = add_curves(scene_with_camera)
    shown.data.attributes.new("place", "FLOAT2", "CURVE").data.foreach_set("vector", [0.1, 0.2, 0.3, 0.4])
    tree = give_nodes(shown, "Uv")
    surface = add(tree, "ShaderNodeBsdfPrincipled")
    tree.links.new(tree.nodes.new("ShaderNodeUVMap").outputs[0], surface.inputs["Base Color"])
    assert_allclose(extract().scene.curves[0].uvs, [(0.1, 0.2), (0.3, 0.4)], rtol=1e-6)


def test_broken_strands_are_named_and_left_out(scene_with_camera: Any) -> None:
    points = POINTS.copy()
    points[1, 2] = np.nan
    add_curves(scene_with_camera, points=points)
    extraction = extract()
    (curves,) = extraction.scene.curves
    assert_array_equal(curves.points, POINTS[3:])
    assert ["1 strands are NaN" in warning.text for warning in extraction.warnings] == [True]


def test_instances_of_curves_stand_where_they_are_put(scene_with_camera: Any) -> None:
    collection = bpy.data.collections.new("Collection")
    shown = add_curves(scene_with_camera)
    scene_with_camera.collection.objects.unlink(shown)
    collection.objects.link(shown)
    for x in (10, 20):
        add_instancer(scene_with_camera, collection, Matrix.Translation((x, 0, 0)))
    found = extract().scene.curves
    assert [curves.points[0, 0] for curves in found] == [10, 20]


def test_a_view_layer_without_strands_shows_none(scene_with_camera: Any) -> None:
    add_curves(scene_with_camera)
    add_furry_square(scene_with_camera)
    bpy.context.view_layer.use_strand = False
    extraction = extract()
    assert not extraction.scene.curves
    assert not extraction.warnings


# Particles -----------------------------------------------------------------------------------------------------------


def test_particles_are_strands_on_their_emitter(scene_with_camera: Any) -> None:
    """Straight up one metre, with the points that the settings ask for; their radii are scaled with the object."""
    shown = add_furry_square(scene_with_camera, radius_scale=0.1, root_radius=1.0, tip_radius=0.5)
    shown.matrix_world = Matrix.Translation((5, 0, 0)) @ Matrix.Scale(2.0, 4)
    extraction = extract()
    (curves,) = extraction.scene.curves
    assert [key.name for key in extraction.objects] == ["Square", "Square"]
    assert len(curves) == 7
    points = curves.points.reshape(7, 9, 3)
    assert points[:, 0, 2] == pytest.approx(0.0, abs=1e-5)
    assert (points[:, :, 0] >= 5).all()
    assert_allclose(points[:, -1] - points[:, 0], np.tile((0, 0, 1.0), (7, 1)), atol=1e-4)
    assert_allclose(curves.radii.reshape(7, 9)[:, [0, -1]], np.tile((0.1, 0.0), (7, 1)), atol=1e-6)


@pytest.mark.parametrize("scale", [(0, 0, 0), (1, 2, 0)])
def test_hair_on_what_is_scaled_to_nothing_is_as_flat(scene_with_camera: Any, scale: tuple[float, ...]) -> None:
    """Things that grow from nothing are keyed so; a matrix without inverse must not end the render."""
    shown = add_furry_square(scene_with_camera)
    shown.location, shown.scale = (1, 2, 3), scale
    (curves,) = extract().scene.curves
    system = shown.evaluated_get(bpy.context.evaluated_depsgraph_get()).particle_systems[0]
    expected = [system.co_hair(shown, particle_no=number, step=step) for number in range(7) for step in range(9)]
    assert_allclose(curves.points, expected, atol=1e-6)
    assert_array_equal(curves.radii, 0.0)


def test_children_stand_for_their_parents(scene_with_camera: Any) -> None:
    add_furry_square(scene_with_camera, child_type="SIMPLE", child_percent=3, use_close_tip=False, tip_radius=0.5)
    (curves,) = extract().scene.curves
    assert len(curves) == 21
    assert (curves.radii > 0).all()


def test_an_emitter_may_be_hidden_behind_its_hair(scene_with_camera: Any) -> None:
    shown = add_furry_square(scene_with_camera)
    shown.show_instancer_for_viewport = False
    extraction = extract()
    assert len(extraction.scene.curves) == 1
    assert not extraction.scene.meshes


def test_two_systems_have_their_materials_and_go_on_counting(scene_with_camera: Any) -> None:
    shown = add_furry_square(scene_with_camera, count=2)
    add_system(shown, 3).material = 2
    read_outputs(shown, "Random")
    read_outputs(shown, "Random", "Length")
    first, second = extract().scene.curves
    assert first.material != second.material
    random = np.concatenate([each.strand_attributes[RANDOM][:, 0] for each in (first, second)])
    assert_allclose(random, hash_words(np.arange(5, dtype=np.uint32), 0) / (2**32 - 1))
    assert LENGTH in second.strand_attributes
    assert LENGTH not in first.strand_attributes


def test_roots_tell_the_surfaces_coordinates(scene_with_camera: Any) -> None:
    shown = add_furry_square(scene_with_camera)
    read_outputs(shown, "Map", "generated")
    (curves,) = extract().scene.curves
    roots = curves.points.reshape(7, 9, 3)[:, 0]
    assert_allclose(curves.strand_attributes["Map"], roots[:, :2] / 2.0, atol=1e-4)
    assert_allclose(curves.strand_attributes["generated"][:, :2], roots[:, :2] / 2.0, atol=1e-4)


@pytest.mark.parametrize(("shape", "expected"), [(0.0, 0.5), (-0.5, 0.5**0.5), (0.5, 0.25), (1.0, 0.0)])
def test_the_radius_falls_as_the_shape_says(shape: float, expected: float) -> None:
    class Settings:
        root_radius, tip_radius, radius_scale = 2.0, 0.0, 1.0

    settings: Any = Settings()
    settings.shape = shape
    assert_allclose(find_radii(settings, np.array([0.0, 0.5, 1.0])), [1.0, expected, 0.0])


def test_hair_is_read_again_only_where_it_changed(scene_with_camera: Any, monkeypatch: Any) -> None:
    shown = add_furry_square(scene_with_camera)
    kept, read = Kept(), []
    before = strands.read_paths

    def read_paths(*arguments: Any) -> Any:
        read.append(arguments)
        return before(*arguments)

    monkeypatch.setattr(strands, "read_paths", read_paths)
    extract(kept)
    kept.changes = Changes()
    first = extract(kept).scene.curves[0]
    assert len(read) == 1
    kept.changes = Changes(ids=frozenset({shown.particle_systems[0].settings.session_uid}))
    second = extract(kept).scene.curves[0]
    assert len(read) == 2
    assert_array_equal(first.points, second.points)
