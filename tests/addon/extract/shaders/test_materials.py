"""Materials: what node graphs say in constants, and one clear warning for what they say otherwise."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from addon import versions
from addon.extract.shaders.nodes import LUMINANCE
from tests.addon.extract.shaders.shader_trees import add, extract, extract_closure, extract_material, texts

pytestmark = pytest.mark.blender

# Sockets store float32.
STORED = float(np.finfo(np.float32).eps)


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
    assert weights == [("glossy", 0.25), ("diffuse", 1.75)]  # each once, with the sum of its weights


@pytest.mark.parametrize("kind", ["ShaderNodeMixShader", "ShaderNodeAddShader"])
def test_a_shader_that_is_mixed_with_itself_again_and_again_is_read_once(tree: Any, kind: str) -> None:
    """2^60 ways lead from the output to the one shader."""
    shader = add(tree, "ShaderNodeBsdfToon")
    for _ in range(60):
        mix = tree.nodes.new(kind)
        for socket in mix.inputs[-2:]:
            tree.links.new(shader.outputs[0], socket)
        shader = mix
    tree.links.new(shader.outputs[0], tree.nodes[0].inputs[0])
    closure = extract_closure()
    assert closure.weight == (1.0 if kind == "ShaderNodeMixShader" else 2.0**60)


def test_a_mixed_color_shines_by_its_weight(tree: Any) -> None:
    color, mix = tree.nodes.new("ShaderNodeRGB"), add(tree, "ShaderNodeMixShader", Fac=0.25)
    tree.links.new(color.outputs[0], mix.inputs[2])
    assert (extract_closure().kind, extract_closure().weight) == ("emission", 0.25)


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
    assert closure.roughness == (LUMINANCE * (0.5, 0.25, 0.125)).sum()  # BLAS's product is its processor's own
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


def test_groups_of_add_ons_are_entered(tree: Any) -> None:
    class Custom(bpy.types.ShaderNodeCustomGroup):
        bl_idname, bl_label = "CustomGroupOfATest", "Custom"

    bpy.utils.register_class(Custom)
    try:
        group, start, end = make_group("Custom")
        diffuse = group.nodes.new("ShaderNodeBsdfDiffuse")
        group.links.new(start.outputs[0], diffuse.inputs["Color"])
        group.links.new(diffuse.outputs[0], end.inputs[0])
        node = tree.nodes.new(Custom.bl_idname)
        node.node_tree = group
        node.inputs[0].default_value = (0.25, 0.5, 1, 1)
        tree.links.new(node.outputs[0], tree.nodes[0].inputs[0])
        assert_array_equal(extract_closure().color, (0.25, 0.5, 1))
        assert not texts()
    finally:
        bpy.utils.unregister_class(Custom)


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
    squeeze = tree.nodes.new("ShaderNodeSqueeze")
    tree.links.new(squeeze.outputs[0], principled.inputs["Base Color"])
    twin = bpy.data.objects.new("Twin", shown.data)
    bpy.context.scene.collection.objects.link(twin)
    assert_array_equal(extract_closure().color, (0.25, 0.5, 1))
    (warning,) = extract().warnings
    assert (warning.material, warning.object) == ("Material", "Object")
    assert f"node '{squeeze.name}' ({squeeze.bl_label}) is not supported" in warning.text
    assert "'Base Color' of node 'Principled BSDF' keeps its own value" in warning.text


def test_a_color_on_a_shader_socket_shines(tree: Any) -> None:
    add(tree, "ShaderNodeRGB").outputs[0].default_value = (0.25, 0.5, 1, 1)
    closure = extract_closure()
    assert closure.kind == "emission"
    assert_array_equal(closure.color, (0.25, 0.5, 1))
    assert not texts()


def test_a_color_that_a_group_is_given_shines_since_blender_5(tree: Any) -> None:
    group, start, end = make_group("Group")
    group.links.new(start.outputs[0], end.inputs[0])
    node = add_group(tree, group)
    node.inputs[0].default_value = (0.25, 0.5, 1, 1)
    tree.links.new(node.outputs[0], tree.nodes[0].inputs[0])
    found = [(closure.kind, closure.color.tolist()) for closure in extract_material().closures]
    assert found == ([("emission", [0.25, 0.5, 1])] if versions.VERSION >= (5, 0) else [])


@pytest.mark.parametrize("computed", [False, True])
def test_a_color_shines_through_the_shader_sockets_of_a_group(tree: Any, computed: bool) -> None:
    group, start, end = make_group("Group")
    group.links.new(group.nodes.new("ShaderNodeUVMap").outputs[0] if computed else start.outputs[0], end.inputs[0])
    node, mix = add_group(tree, group), add(tree, "ShaderNodeMixShader", Fac=1.0)
    node.inputs[0].default_value = (0.25, 0.5, 1, 1)
    color = tree.nodes.new("ShaderNodeRGB")
    color.outputs[0].default_value = (0.25, 0.5, 1, 1)
    tree.links.new(color.outputs[0], node.inputs[0])
    tree.links.new(node.outputs[0], mix.inputs[2])
    closure = extract_closure()
    assert closure.kind == "emission"
    assert closure.registers.keys() == ({"color"} if computed else set())
    assert computed or closure.color.tolist() == [0.25, 0.5, 1]
    assert not texts()


@pytest.mark.parametrize(
    ("node", "kind", "color_input"),
    [
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


def test_material_without_output_or_shader_is_black(tree: Any) -> None:
    assert extract_material().closures == ()
    tree.nodes.clear()
    assert extract_material().closures == ()
    assert ["no output node" in text for text in texts()] == [True]


def test_volume_alone_leaves_a_transparent_surface(tree: Any) -> None:
    volume = tree.nodes.new("ShaderNodeVolumePrincipled")
    tree.links.new(volume.outputs[0], tree.nodes[0].inputs["Volume"])
    assert extract_closure().kind == "transparent"
    assert not texts()


def test_a_surface_that_a_group_leaves_empty_is_none(tree: Any) -> None:
    group, _, end = make_group("Smoke")
    group.interface.new_socket("Volume", in_out="OUTPUT", socket_type="NodeSocketShader")
    group.links.new(group.nodes.new("ShaderNodeVolumeScatter").outputs[0], end.inputs["Volume"])
    node = add_group(tree, group)
    tree.links.new(node.outputs["Shader"], tree.nodes[0].inputs["Surface"])
    tree.links.new(node.outputs["Volume"], tree.nodes[0].inputs["Volume"])
    material = extract_material()
    assert [closure.kind for closure in material.closures] == ["transparent"]
    assert material.only_volume
    assert not texts()


def test_a_volume_behind_a_muted_link_is_none(tree: Any) -> None:
    volume = tree.nodes.new("ShaderNodeVolumePrincipled")
    tree.links.new(volume.outputs[0], tree.nodes[0].inputs["Volume"]).is_muted = True
    material = extract_material()
    assert (material.closures, material.volume) == ((), None)


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


def test_bump_map_correction_is_the_materials_choice(tree: Any) -> None:
    material = bpy.data.materials["Material"]
    for choice in (True, False):
        material.cycles.use_bump_map_correction = choice
        assert extract_material().fades_bumps == choice


def test_transparent_shadows_are_the_materials_choice(tree: Any) -> None:
    material = bpy.data.materials["Material"]
    for choice in (True, False):
        material.use_transparent_shadow = choice
        assert extract_material().transparent_shadow == choice


@pytest.mark.skipif(versions.VERSION < (5, 0), reason="files have one working space")
def test_a_working_space_of_other_primaries_is_named(tree: Any) -> None:
    bpy.ops.wm.set_working_color_space(working_space="ACEScg", convert_colors=False)
    try:
        (text,) = texts()
        assert text.startswith("working space 'ACEScg' is not supported")
    finally:
        bpy.ops.wm.set_working_color_space(working_space="Linear Rec.709", convert_colors=False)
