"""Materials and worlds: what the nodes say in constants, and one clear warning for what they say otherwise."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from addon import versions
from addon.extract import Extraction, extract_scene
from addon.extract.nodes import LUMINANCE
from raytracer import Closure, Material
from raytracer.environment import find_environment, make_environment
from raytracer.programs import Register
from raytracer.sites import LightPath

pytestmark = pytest.mark.blender

# Sockets store float32.
STORED = float(np.finfo(np.float32).eps)


@pytest.fixture
def shown(scene_with_camera: Any) -> Any:
    """Return an object of one triangle, without material."""
    mesh = bpy.data.meshes.new("Mesh")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    triangle = bpy.data.objects.new("Object", mesh)
    scene_with_camera.collection.objects.link(triangle)
    return triangle


@pytest.fixture
def tree(shown: Any) -> Any:
    """Return the nodes of a new material on the object: an output, nothing else."""
    return give_nodes(shown, "Material")


def give_nodes(shown: Any, name: str) -> Any:
    material = bpy.data.materials.new(name)
    shown.data.materials.append(material)
    return clear_nodes(material)


def clear_nodes(owner: Any, output: str = "ShaderNodeOutputMaterial") -> Any:
    if versions.VERSION < (5, 0):
        owner.use_nodes = True
    owner.node_tree.nodes.clear()
    owner.node_tree.nodes.new(output)
    return owner.node_tree


def add(tree: Any, kind: str, **values: Any) -> Any:
    """Add a node, set its sockets by name (spaces as underscores), and link its first output to the tree's output."""
    node = tree.nodes.new(kind)
    for name, value in values.items():
        node.inputs[name.replace("_", " ")].default_value = value
    tree.links.new(node.outputs[0], tree.nodes[0].inputs[0])
    return node


def extract() -> Extraction:
    return extract_scene(bpy.context.evaluated_depsgraph_get())


def extract_material() -> Material:
    (material,) = extract().scene.materials
    return material


def extract_closure() -> Closure:
    (closure,) = extract_material().closures
    return closure


def texts() -> list[str]:
    return [str(warning) for warning in extract().warnings]


def test_object_without_material_is_grey_as_in_cycles(shown: Any) -> None:
    closure = extract_closure()
    assert closure.kind == ("principled" if versions.VERSION >= (5, 0) else "diffuse")
    assert_array_equal(closure.color, 0.8)
    assert not texts()


def test_principled_constants(tree: Any) -> None:
    values = {"Base_Color": (0.1, 0.2, 0.3, 1), "Metallic": 0.25, "Roughness": 0.375, "IOR": 1.25, "Alpha": 0.75}
    values |= {"Transmission_Weight": 0.5, "Specular_IOR_Level": 0.625, "Specular_Tint": (0.5, 0.25, 1, 1)}
    add(tree, "ShaderNodeBsdfPrincipled", **values, Emission_Color=(1, 0.5, 0.25, 1), Emission_Strength=3)
    closure = extract_closure()
    assert closure.kind == "principled"
    assert_allclose(closure.color, (0.1, 0.2, 0.3), rtol=STORED)
    assert (closure.metallic, closure.roughness, closure.ior, closure.alpha) == (0.25, 0.375, 1.25, 0.75)
    assert (closure.transmission, closure.specular) == (0.5, 0.625)
    assert_array_equal(closure.specular_tint, (0.5, 0.25, 1))
    assert_array_equal(closure.emission, (3, 1.5, 0.75))
    assert not texts()


@pytest.mark.parametrize(
    ("node", "kind", "values"),
    [
        ("ShaderNodeBsdfDiffuse", "diffuse", {}),
        ("ShaderNodeBsdfGlossy", "glossy", {"Roughness": 0.25}),
        ("ShaderNodeBsdfGlass", "glass", {"Roughness": 0.25, "IOR": 1.25}),
        ("ShaderNodeBsdfRefraction", "refraction", {"Roughness": 0.25, "IOR": 1.25}),
        ("ShaderNodeBsdfTransparent", "transparent", {}),
    ],
)
def test_shader_constants(tree: Any, node: str, kind: str, values: dict[str, float]) -> None:
    made = add(tree, node, Color=(0.5, 0.25, 0.125, 1), **values)
    if hasattr(made, "distribution"):
        made.distribution = "GGX"
    closure = extract_closure()
    assert closure.kind == kind
    assert_array_equal(closure.color, (0.5, 0.25, 0.125))
    for name, value in values.items():
        assert getattr(closure, name.lower()) == value
    assert not texts()


def test_emission_strength_scales_its_color(tree: Any) -> None:
    add(tree, "ShaderNodeEmission", Color=(1, 0.5, 0.25, 1), Strength=4)
    assert_array_equal(extract_closure().color, (4, 2, 1))


def test_mix_and_add_fold_into_weights(tree: Any) -> None:
    diffuse, glossy = add(tree, "ShaderNodeBsdfDiffuse"), add(tree, "ShaderNodeBsdfGlossy")
    mix, total = add(tree, "ShaderNodeMixShader", Fac=0.25), add(tree, "ShaderNodeAddShader")
    tree.links.new(diffuse.outputs[0], mix.inputs[1])
    tree.links.new(glossy.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], total.inputs[0])
    tree.links.new(diffuse.outputs[0], total.inputs[1])
    weights = [(closure.kind, closure.weight) for closure in extract_material().closures]
    assert weights == [("diffuse", 0.75), ("glossy", 0.25), ("diffuse", 1.0)]


def test_shader_with_weight_zero_is_neither_used_nor_named(tree: Any) -> None:
    mix = add(tree, "ShaderNodeMixShader", Fac=0.0)
    tree.links.new(add(tree, "ShaderNodeBsdfDiffuse").outputs[0], mix.inputs[1])
    tree.links.new(add(tree, "ShaderNodeBsdfTranslucent").outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], tree.nodes[0].inputs[0])
    assert extract_closure().kind == "diffuse"
    assert not texts()


def test_constants_pass_through_reroutes_and_convert(tree: Any) -> None:
    principled = add(tree, "ShaderNodeBsdfPrincipled")
    color, value = tree.nodes.new("ShaderNodeRGB"), tree.nodes.new("ShaderNodeValue")
    color.outputs[0].default_value, value.outputs[0].default_value = (0.5, 0.25, 0.125, 1), 0.375
    for source, socket in ((color, "Roughness"), (value, "Base Color")):
        reroute = tree.nodes.new("NodeReroute")
        tree.links.new(source.outputs[0], reroute.inputs[0])
        tree.links.new(reroute.outputs[0], principled.inputs[socket])
    closure = extract_closure()
    assert_array_equal(closure.color, 0.375)
    assert closure.roughness == LUMINANCE @ (0.5, 0.25, 0.125)
    assert not texts()


def test_muted_shader_and_muted_link_are_skipped(tree: Any) -> None:
    mix, diffuse = add(tree, "ShaderNodeMixShader"), add(tree, "ShaderNodeBsdfDiffuse", Color=(0.25, 0.5, 1, 1))
    tree.links.new(diffuse.outputs[0], mix.inputs[1])
    tree.links.new(mix.outputs[0], tree.nodes[0].inputs[0])
    mix.mute = True
    color = tree.nodes.new("ShaderNodeRGB")
    tree.links.new(color.outputs[0], diffuse.inputs["Color"]).is_muted = True
    closure = extract_closure()
    assert (closure.kind, closure.weight) == ("diffuse", 1.0)
    assert_array_equal(closure.color, (0.25, 0.5, 1))


def make_group(name: str) -> tuple[Any, Any, Any]:
    """Return a node group that takes a color and gives a shader: the tree, its input node, its output node."""
    group = bpy.data.node_groups.new(name, "ShaderNodeTree")
    group.interface.new_socket("Tint", in_out="INPUT", socket_type="NodeSocketColor")
    group.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    return group, group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")


def add_group(tree: Any, group: Any) -> Any:
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    return node


def test_nested_node_groups_are_entered_and_left_again(tree: Any) -> None:
    inner, inner_start, inner_end = make_group("Inner")
    diffuse = inner.nodes.new("ShaderNodeBsdfDiffuse")
    inner.links.new(inner_start.outputs[0], diffuse.inputs["Color"])
    inner.links.new(diffuse.outputs[0], inner_end.inputs[0])
    outer, outer_start, outer_end = make_group("Outer")
    nested = add_group(outer, inner)
    outer.links.new(outer_start.outputs[0], nested.inputs[0])
    outer.links.new(nested.outputs[0], outer_end.inputs[0])
    first, second = add_group(tree, outer), add_group(tree, outer)
    first.inputs[0].default_value = (1, 0, 0, 1)
    blue = tree.nodes.new("ShaderNodeRGB")
    blue.outputs[0].default_value = (0, 0, 1, 1)
    tree.links.new(blue.outputs[0], second.inputs[0])
    total = add(tree, "ShaderNodeAddShader")
    for group, socket in zip((first, second), total.inputs, strict=True):
        tree.links.new(group.outputs[0], socket)
    assert [closure.color.tolist() for closure in extract_material().closures] == [[1, 0, 0], [0, 0, 1]]
    assert not texts()


def test_unknown_node_is_replaced_by_the_sockets_value_and_named_once(tree: Any, shown: Any) -> None:
    principled = add(tree, "ShaderNodeBsdfPrincipled", Base_Color=(0.25, 0.5, 1, 1))
    bevel = tree.nodes.new("ShaderNodeBevel")
    tree.links.new(bevel.outputs[0], principled.inputs["Base Color"])
    twin = bpy.data.objects.new("Twin", shown.data)
    bpy.context.scene.collection.objects.link(twin)
    assert_array_equal(extract_closure().color, (0.25, 0.5, 1))
    (warning,) = extract().warnings
    assert (warning.material, warning.object) == ("Material", "Object")
    assert "node 'Bevel' (Bevel) is not supported" in warning.text
    assert "'Base Color' of node 'Principled BSDF' keeps its own value" in warning.text


def test_a_color_on_a_shader_socket_shines(tree: Any) -> None:
    add(tree, "ShaderNodeRGB").outputs[0].default_value = (0.25, 0.5, 1, 1)
    closure = extract_closure()
    assert closure.kind == "emission"
    assert_array_equal(closure.color, (0.25, 0.5, 1))
    assert not texts()


@pytest.mark.parametrize(
    ("node", "kind", "color_input"),
    [
        ("ShaderNodeSubsurfaceScattering", "diffuse", "Color"),
        ("ShaderNodeBsdfHair", "diffuse", "Color"),
        ("ShaderNodeBsdfHairPrincipled", "diffuse", "Color"),
        ("ShaderNodeEeveeSpecular", "diffuse", "Base Color"),
        ("ShaderNodeVolumePrincipled", "diffuse", None),
    ],
)
def test_unknown_shader_gets_a_stand_in_and_is_named(tree: Any, node: str, kind: str, color_input: str | None) -> None:
    made = add(tree, node)
    if color_input:
        made.inputs[color_input].default_value = (0.25, 0.5, 1, 1)
    closure = extract_closure()
    assert closure.kind == kind
    assert_array_equal(closure.color, (0.25, 0.5, 1) if color_input else (0.8, 0.8, 0.8))
    (text,) = texts()
    assert f"'{made.name}'" in text
    assert "'Material'" in text
    assert "'Object'" in text


def test_unsupported_inputs_are_named_only_where_used(tree: Any) -> None:
    add(tree, "ShaderNodeBsdfPrincipled", Subsurface_Weight=0.5, Thin_Film_Thickness=0.0)
    (text,) = texts()
    assert "Subsurface Weight is not supported, rendered as diffuse" in text


def test_principled_layers(tree: Any) -> None:
    values = {"Coat_Weight": 0.5, "Coat_Roughness": 0.25, "Coat_IOR": 1.75, "Coat_Tint": (0.5, 0.25, 1, 1)}
    values |= {"Sheen_Weight": 0.75, "Sheen_Roughness": 0.125, "Sheen_Tint": (0.25, 0.5, 1, 1)}
    add(tree, "ShaderNodeBsdfPrincipled", **values)
    closure = extract_closure()
    assert (closure.coat_weight, closure.coat_roughness, closure.coat_ior) == (0.5, 0.25, 1.75)
    assert (closure.sheen_weight, closure.sheen_roughness) == (0.75, 0.125)
    assert_array_equal(closure.coat_tint, (0.5, 0.25, 1))
    assert_array_equal(closure.sheen_tint, (0.25, 0.5, 1))
    assert not texts()


def test_what_bends_the_base_does_not_bend_its_coat(tree: Any) -> None:
    node = add(tree, "ShaderNodeBsdfPrincipled", Coat_Weight=0.5)
    assert extract_closure().coat_normal is None
    bend = tree.nodes.new("ShaderNodeNormalMap")
    bend.inputs["Color"].default_value = (0.75, 0.5, 0.9, 1.0)
    tree.links.new(bend.outputs["Normal"], node.inputs["Normal"])
    closure = extract_closure()
    assert isinstance(closure.normal, Register)
    assert_array_equal(closure.coat_normal, np.zeros(3))


def test_layers_that_are_off_are_not_read(tree: Any) -> None:
    add(tree, "ShaderNodeBsdfPrincipled", Coat_Roughness=0.25, Sheen_Roughness=0.125, Anisotropic_Rotation=0.5)
    closure = extract_closure()
    assert (closure.coat_roughness, closure.sheen_roughness, closure.rotation) == (0.03, 0.5, 0.0)
    assert closure.tangent is None
    assert extract_material().program is None


def test_emission_under_a_coat_is_named(tree: Any) -> None:
    add(tree, "ShaderNodeBsdfPrincipled", Coat_Weight=0.5, Emission_Strength=2.0)
    assert ["do not dim its emission" in text for text in texts()] == [True]


@pytest.mark.parametrize("node", ["Principled", "Anisotropic"])
def test_anisotropy_follows_the_tangent_around_z(tree: Any, node: str) -> None:
    amount, turn = ("Anisotropic", "Anisotropic_Rotation") if node == "Principled" else ("Anisotropy", "Rotation")
    add(tree, f"ShaderNodeBsdf{node}", **{amount: 0.5, turn: 0.25})
    closure, program = extract_closure(), extract_material().program
    assert (closure.anisotropy, closure.rotation) == (0.5, 0.25)
    assert closure.tangent == Register(0, "Tangent")
    assert [step.operation for step in program.steps] == ["TANGENT RADIAL"]
    assert not texts()


@pytest.mark.parametrize(
    ("choice", "distribution", "multiscatter"),
    [("BECKMANN", "beckmann", 0.0), ("GGX", "ggx", 0.0), ("MULTI_GGX", "ggx", 1.0)],
)
def test_distributions(tree: Any, choice: str, distribution: str, multiscatter: float) -> None:
    add(tree, "ShaderNodeBsdfGlass").distribution = choice
    closure = extract_closure()
    assert (closure.distribution, closure.multiscatter) == (distribution, multiscatter)


def test_unknown_distribution_is_named(tree: Any) -> None:
    add(tree, "ShaderNodeBsdfAnisotropic").distribution = "ASHIKHMIN_SHIRLEY"
    assert ["distribution ASHIKHMIN_SHIRLEY is not supported, GGX is used" in text for text in texts()] == [True]


@pytest.mark.parametrize(
    ("node", "properties", "kind", "inputs"),
    [
        ("Translucent", {}, "translucent", {}),
        ("Sheen", {"distribution": "MICROFIBER"}, "sheen", {"Roughness": 0.25}),
        ("Sheen", {"distribution": "ASHIKHMIN"}, "velvet", {"Roughness": 0.25}),
        ("Toon", {"component": "DIFFUSE"}, "toon", {"Size": 0.25, "Smooth": 0.5}),
        ("Toon", {"component": "GLOSSY"}, "glossy_toon", {"Size": 0.25, "Smooth": 0.5}),
    ],
)
def test_kinds_of_diffuse_shaders(
    tree: Any, node: str, properties: dict[str, str], kind: str, inputs: dict[str, float]
) -> None:
    made = add(tree, f"ShaderNodeBsdf{node}", Color=(0.5, 0.25, 0.125, 1), **inputs)
    for name, value in properties.items():
        setattr(made, name, value)
    closure = extract_closure()
    assert closure.kind == kind
    assert_array_equal(closure.color, (0.5, 0.25, 0.125))
    assert {name: getattr(closure, name.lower()) for name in inputs} == inputs
    assert not texts()


def test_rough_diffuse_gives_lost_light_back_since_4_3(tree: Any) -> None:
    add(tree, "ShaderNodeBsdfDiffuse", Roughness=0.5)
    closure = extract_closure()
    assert (closure.diffuse_roughness, closure.multiscatter) == (0.5, float(versions.VERSION >= (4, 3)))


@pytest.mark.skipif(versions.VERSION < (4, 3), reason="there is no Metallic BSDF before Blender 4.3")
def test_metallic_shader(tree: Any) -> None:
    node = add(tree, "ShaderNodeBsdfMetallic", Base_Color=(0.5, 0.25, 0.125, 1), Edge_Tint=(0.25, 1, 0.5, 1))
    closure = extract_closure()
    assert closure.kind == "metal"
    assert_array_equal(closure.specular_tint, (0.25, 1, 0.5))
    node.fresnel_type = "PHYSICAL_CONDUCTOR"
    node.inputs["IOR"].default_value, node.inputs["Extinction"].default_value = (0.5, 0.25, 1), (2, 4, 8)
    closure = extract_closure()
    assert closure.kind == "conductor"
    assert_array_equal(closure.color, (0.5, 0.25, 1))
    assert_array_equal(closure.extinction, (2, 4, 8))
    assert not texts()


def test_values_out_of_range_are_clamped_as_in_cycles(tree: Any) -> None:
    values = {"Metallic": 3.0, "Roughness": -1.0, "IOR": 0.0, "Base_Color": (-1, float("nan"), 2, 1)}
    node = add(tree, "ShaderNodeBsdfPrincipled")
    value = {}
    for name, wanted in values.items():
        source = tree.nodes.new("ShaderNodeRGB" if name == "Base_Color" else "ShaderNodeValue")
        source.outputs[0].default_value = wanted
        value[name] = source
        tree.links.new(source.outputs[0], node.inputs[name.replace("_", " ")])
    closure = extract_closure()
    assert (closure.metallic, closure.roughness) == (1.0, 0.0)
    assert closure.ior > 0
    assert_array_equal(closure.color, (0, 0, 2))


def test_material_without_output_or_shader_is_black(tree: Any) -> None:
    assert extract_material().closures == ()
    tree.nodes.clear()
    assert extract_material().closures == ()
    assert ["no output node" in text for text in texts()] == [True]


def test_volume_alone_leaves_a_transparent_surface(tree: Any) -> None:
    volume = tree.nodes.new("ShaderNodeVolumePrincipled")
    tree.links.new(volume.outputs[0], tree.nodes[0].inputs["Volume"])
    assert extract_closure().kind == "transparent"
    assert ["Volume" in text for text in texts()] == [True]


def test_cycles_output_comes_before_eevees(tree: Any) -> None:
    add(tree, "ShaderNodeBsdfGlossy")
    tree.nodes[0].target = "EEVEE"
    second = tree.nodes.new("ShaderNodeOutputMaterial")
    second.target = "CYCLES"
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(diffuse.outputs[0], second.inputs[0])
    assert extract_closure().kind == "diffuse"


@pytest.mark.skipif(versions.VERSION >= (5, 0), reason="materials always have nodes since Blender 5.0")
def test_material_without_nodes_is_diffuse_of_its_color(shown: Any) -> None:
    material = bpy.data.materials.new("Material")
    material.diffuse_color = (0.25, 0.5, 1, 1)
    shown.data.materials.append(material)
    closure = extract_closure()
    assert closure.kind == "diffuse"
    assert_array_equal(closure.color, (0.25, 0.5, 1))


def test_slots_of_faces_become_materials_of_triangles(shown: Any) -> None:
    mesh = bpy.data.meshes.new("Quads")
    mesh.from_pydata(
        [(x, y, 0) for x in range(5) for y in range(2)],
        [],
        [(2 * x, 2 * x + 2, 2 * x + 3, 2 * x + 1) for x in range(4)],
    )
    for name in ("first", "unused", "last"):
        mesh.materials.append(bpy.data.materials.new(name))
    mesh.materials.append(None)
    mesh.polygons.foreach_set("material_index", [2, 0, 3, 2])
    shown.data = mesh
    scene = extract().scene
    names = [scene.materials[index].name for index in scene.meshes[0].material]
    assert names == ["last"] * 2 + ["first"] * 2 + ["default"] * 2 + ["last"] * 2
    assert "unused" not in [material.name for material in scene.materials]


def test_slot_number_beyond_the_last_means_the_last(shown: Any) -> None:
    shown.data.materials.append(bpy.data.materials.new("first"))
    shown.data.materials.append(bpy.data.materials.new("last"))
    shown.data.attributes.new("material_index", "INT", "FACE").data[0].value = 7
    scene = extract().scene
    assert [material.name for material in scene.materials] == ["last"]


def test_material_override_of_the_view_layer(tree: Any) -> None:
    bpy.context.view_layer.material_override = bpy.data.materials.new("Override")
    assert extract_material().name == "Override"


def test_transparent_shadows_are_the_materials_choice(tree: Any) -> None:
    material = bpy.data.materials["Material"]
    for choice in (True, False):
        material.use_transparent_shadow = choice
        assert extract_material().transparent_shadow == choice


def test_no_world_is_black(shown: Any) -> None:
    assert bpy.context.scene.world is None
    assert extract().scene.world is None


@pytest.fixture
def world_tree(shown: Any) -> Any:
    bpy.context.scene.world = bpy.data.worlds.new("World")
    return clear_nodes(bpy.context.scene.world, "ShaderNodeOutputWorld")


def test_world_is_background_color_times_strength(world_tree: Any) -> None:
    add(world_tree, "ShaderNodeBackground", Color=(1, 0.5, 0.25, 1), Strength=2)
    assert_array_equal(extract().scene.world.color, (2, 1, 0.5))
    assert not texts()


def test_world_without_shader_is_black(world_tree: Any) -> None:
    assert extract().scene.world is None


def test_world_that_varies_has_a_program(world_tree: Any) -> None:
    background = add(world_tree, "ShaderNodeBackground", Strength=2)
    coordinate = world_tree.nodes.new("ShaderNodeTexCoord")
    world_tree.links.new(coordinate.outputs["Generated"], background.inputs["Color"])
    world = extract().scene.world
    assert [step.operation for step in world.program.steps] == ["ATTRIBUTE Vector", "VECT_MATH Vector"]
    assert world.color == Register(1, "Vector")
    assert not texts()


def test_world_hidden_from_the_camera_is_black_to_it(world_tree: Any) -> None:
    add(world_tree, "ShaderNodeBackground", Color=(0.25, 0.5, 1, 1))
    bpy.context.scene.world.cycles_visibility.camera = False
    environment = make_environment(extract().scene.world, None, (4, 3))
    up = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    found = find_environment(environment, up, LightPath({"camera": np.array([1.0, 0.0])}))
    assert_array_equal(found, [(0, 0, 0), (0.25, 0.5, 1)])


def test_sky_is_replaced_by_the_sockets_color_and_named(world_tree: Any) -> None:
    background = add(world_tree, "ShaderNodeBackground", Color=(0.25, 0.5, 1, 1))
    sky = world_tree.nodes.new("ShaderNodeTexSky")
    sky.sky_type = "PREETHAM"
    world_tree.links.new(sky.outputs[0], background.inputs["Color"])
    assert_array_equal(extract().scene.world.color, (0.25, 0.5, 1))
    (text,) = texts()
    assert text.startswith("world 'World': node 'Sky Texture'")


@pytest.mark.skipif(versions.VERSION >= (5, 0), reason="worlds always have nodes since Blender 5.0")
def test_world_without_nodes_has_its_color(shown: Any) -> None:
    bpy.context.scene.world = bpy.data.worlds.new("World")
    bpy.context.scene.world.color = (0.25, 0.5, 1)
    assert_array_equal(extract().scene.world.color, (0.25, 0.5, 1))
