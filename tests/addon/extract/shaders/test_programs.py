"""Node graphs to programs: what is read, folded, left out and named; and the attributes that materials read."""

from __future__ import annotations

import contextlib
import inspect
import sys
from collections.abc import Iterator
from typing import Any

import bpy
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from addon import versions
from addon.extract.kept import Changes, Kept
from addon.extract.scene import Extraction, extract_scene
from addon.extract.shaders.programs import MOST_NESTED_PROGRAMS
from addon.versions import find_node_tree
from raytracer import Closure, Material, Program, Register
from tests.addon.against_cycles.node_fixtures import add_node, make_tilted_plane

pytestmark = pytest.mark.blender


@pytest.fixture
def shown(scene_with_camera: Any) -> Any:
    """Return an object of a plane with uvs, colors and attributes."""
    plane = bpy.data.objects.new("Object", make_tilted_plane("Mesh"))
    scene_with_camera.collection.objects.link(plane)
    return plane


@pytest.fixture
def tree(shown: Any) -> Any:
    """Return the nodes of a new material on the object: an output, and an emission that feeds it."""
    return make_tree(shown, "Material")


def make_tree(shown: Any, name: str) -> Any:
    material = bpy.data.materials.new(name)
    if versions.VERSION < (5, 0):
        material.use_nodes = True
    shown.data.materials.append(material)
    tree = find_node_tree(material)
    tree.nodes.clear()
    output, emission = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new("ShaderNodeEmission")
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    return tree


def show(tree: Any, socket: Any) -> None:
    """Let the emission shine with what a socket gives."""
    tree.links.new(socket, tree.nodes["Emission"].inputs["Color"])


def extract() -> Extraction:
    return extract_scene(bpy.context.evaluated_depsgraph_get())


def extract_material() -> Material:
    return extract().scene.materials[0]


def extract_color() -> Any:
    (closure,) = extract_material().closures
    return closure.color


def operations() -> list[str]:
    program = extract_material().program
    return [] if program is None else [step.operation for step in program.steps]


def texts() -> list[str]:
    return [str(warning) for warning in extract().warnings]


def math(tree: Any, first: Any, second: Any, operation: str = "ADD") -> Any:
    return add_node(tree, "ShaderNodeMath", {"Value": first, "Value_001": second}, operation=operation).outputs[0]


def uv(tree: Any) -> Any:
    return tree.nodes.new("ShaderNodeUVMap").outputs[0]


# Folding -------------------------------------------------------------------------------------------------------------


def test_constants_fold_through_nodes_and_conversions(tree: Any) -> None:
    value = math(tree, math(tree, 1.0, 2.0), 0.5, "MULTIPLY")
    show(tree, add_node(tree, "ShaderNodeGamma", {"Color": value, "Gamma": 2.0}).outputs[0])
    assert_allclose(extract_color(), 2.25)
    assert extract_material().program is None
    assert not texts()


def test_only_what_varies_becomes_steps(tree: Any) -> None:
    constant = add_node(tree, "ShaderNodeRGBToBW", {"Color": (0.5, 0.5, 0.5, 1.0)}).outputs[0]
    show(tree, math(tree, add_node(tree, "ShaderNodeSeparateXYZ", {"Vector": uv(tree)}).outputs[0], constant))
    assert operations() == ["ATTRIBUTE Vector", "SEPXYZ", "MATH", "number to vector"]
    assert_allclose(extract_material().program.steps[2].inputs[1], 0.5, rtol=1e-6)


def test_what_nothing_reads_is_not_visited(tree: Any, shown: Any) -> None:
    """A node beside the graph, an output that nothing uses, a mix of weight 0: no step, no warning, no attribute."""
    tree.nodes.new("ShaderNodeSqueeze")
    attribute = add_node(tree, "ShaderNodeAttribute", attribute_name="number")
    tree.links.new(attribute.outputs["Fac"], tree.nodes.new("ShaderNodeGamma").inputs["Gamma"])
    mix = tree.nodes.new("ShaderNodeMixShader")
    mix.inputs[0].default_value = 0.0
    tree.links.new(tree.nodes["Emission"].outputs[0], mix.inputs[1])
    tree.links.new(tree.nodes.new("ShaderNodeBsdfToon").outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    show(tree, uv(tree))
    assert operations() == ["ATTRIBUTE Vector"]
    assert set(extract().scene.meshes[0].attributes) == {"uv"}
    assert not texts()


def test_a_node_is_computed_once_however_often_it_is_read(tree: Any) -> None:
    noise = tree.nodes.new("ShaderNodeTexNoise").outputs["Fac"]
    show(tree, math(tree, noise, noise, "MULTIPLY"))
    assert operations().count("TEX_NOISE Fac") == 1


@contextlib.contextmanager
def little_stack() -> Iterator[None]:
    """Leave room for few calls: Blender itself takes minutes to build a chain that would need a whole stack."""
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(len(inspect.stack()) + 100)
    try:
        yield
    finally:
        sys.setrecursionlimit(limit)


def test_chains_of_nodes_are_read_without_recursion(tree: Any) -> None:
    """Each of them reads the one before twice, so that 2^200 ways lead to the first."""
    value = add_node(tree, "ShaderNodeNewGeometry").outputs["Backfacing"]
    for _ in range(200):
        value = math(tree, value, value)
    show(tree, value)
    with little_stack():
        assert operations() == ["NEW_GEOMETRY Backfacing", *["MATH"] * 200, "number to vector"]


def test_chains_of_muted_nodes_and_groups_are_read_without_recursion(tree: Any) -> None:
    group, start, end = make_group("Handed on", "NodeSocketVector")
    group.links.new(start.outputs[0], end.inputs[0])
    socket = uv(tree)
    for number in range(200):
        node = tree.nodes.new("ShaderNodeGroup" if number % 2 else "ShaderNodeGamma")
        if number % 2:
            node.node_tree = group
        node.mute = number % 2 == 0
        tree.links.new(socket, node.inputs[0])
        socket = node.outputs[0]
    show(tree, socket)
    with little_stack():
        assert operations() == ["ATTRIBUTE Vector"]


def test_bumps_that_read_one_another_are_nested_so_deep_and_no_deeper(tree: Any) -> None:
    normal = tree.nodes.new("ShaderNodeNewGeometry").outputs["Normal"]
    for _ in range(40):
        normal = add_node(tree, "ShaderNodeBump", {"Height": normal, "Normal": normal}).outputs[0]
    show(tree, normal)
    program, depth = extract_material().program, 0
    while bumps := [step for step in program.steps if step.operation == "BUMP"]:
        program, depth = bumps[-1].settings["height"], depth + 1
    assert depth == 1 + MOST_NESTED_PROGRAMS
    assert any("Height depends on more than 4 others in turn" in text for text in texts())


def test_muted_nodes_reroutes_and_frames_leave_no_trace(tree: Any) -> None:
    reroute, gamma = tree.nodes.new("NodeReroute"), tree.nodes.new("ShaderNodeGamma")
    frame = tree.nodes.new("NodeFrame")
    gamma.mute, gamma.parent = True, frame
    tree.links.new(uv(tree), reroute.inputs[0])
    tree.links.new(reroute.outputs[0], gamma.inputs["Color"])
    show(tree, gamma.outputs[0])
    assert operations() == ["ATTRIBUTE Vector"]


def leave_loose(tree: Any, kind: str) -> Any:
    """Return an output that hands nothing on: of a reroute, or a muted node, to which nothing is linked."""
    node = tree.nodes.new(kind)
    node.mute = kind != "NodeReroute"
    return node.outputs[0]


LOOSE = ("NodeReroute", "ShaderNodeGamma", "ShaderNodeMapping", "ShaderNodeUVMap")


@pytest.mark.parametrize("kind", LOOSE)
def test_what_hands_nothing_on_leaves_an_input_its_own_value(tree: Any, kind: str) -> None:
    """As Blender 5.0 joins groups, and EEVEE before it."""
    tree.nodes["Emission"].inputs["Color"].default_value = (0.25, 0.5, 0.75, 1.0)
    show(tree, leave_loose(tree, kind))
    assert_array_equal(extract_color(), (0.25, 0.5, 0.75))


@pytest.mark.parametrize("kind", LOOSE)
def test_what_hands_nothing_on_leaves_a_texture_its_own_coordinates(tree: Any, kind: str) -> None:
    show(tree, add_node(tree, "ShaderNodeTexChecker", {"Vector": leave_loose(tree, kind)}).outputs[0])
    assert operations() == ["ATTRIBUTE Vector", "TEX_CHECKER"]


def test_a_group_without_an_output_gives_black(tree: Any) -> None:
    """As one whose library is missing; Cycles has it so in all versions."""
    group = bpy.data.node_groups.new("Group", "ShaderNodeTree")
    group.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketFloat")
    tree.nodes["Emission"].inputs["Color"].default_value = (0.25, 0.5, 0.75, 1.0)
    show(tree, add_node(tree, "ShaderNodeGroup", node_tree=group).outputs[0])
    assert_array_equal(extract_color(), (0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("kind", "hides", "is_fed"), [("Vector", True, False), ("Vector", False, True), ("Color", True, True)]
)
def test_a_vector_that_a_group_is_not_given_is_the_texture_s_own(
    tree: Any, kind: str, hides: bool, is_fed: bool
) -> None:
    """Unless the group shows what it takes instead, or that is converted; before Blender 5.0 always."""
    group, start, end = make_group("Group", f"NodeSocket{kind}")
    group.interface.items_tree["In"].hide_value = hides
    image = add_node(group, "ShaderNodeTexImage", {"Vector": start.outputs[0]}, image=bpy.data.images.new("I", 2, 2))
    group.links.new(image.outputs[0], end.inputs[0])
    show(tree, add_node(tree, "ShaderNodeGroup", node_tree=group).outputs[0])
    own = [] if is_fed and versions.VERSION >= (5, 0) else ["ATTRIBUTE Vector"]
    assert operations() == [*own, "TEX_IMAGE"]


def make_group(name: str, kind: str) -> tuple[Any, Any, Any]:
    group = bpy.data.node_groups.new(name, "ShaderNodeTree")
    group.interface.new_socket("In", in_out="INPUT", socket_type=kind)
    group.interface.new_socket("Out", in_out="OUTPUT", socket_type=kind)
    return group, group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")


def test_groups_are_inlined_each_use_with_its_own_inputs(tree: Any) -> None:
    group, start, end = make_group("Group", "NodeSocketFloat")
    group.links.new(math(group, start.outputs[0], 10.0, "MULTIPLY"), end.inputs[0])
    first, second = (add_node(tree, "ShaderNodeGroup", node_tree=group) for _ in range(2))
    first.inputs[0].default_value = 2.0
    tree.links.new(add_node(tree, "ShaderNodeSeparateXYZ", {"Vector": uv(tree)}).outputs[0], second.inputs[0])
    show(tree, math(tree, first.outputs[0], second.outputs[0]))
    assert operations() == ["ATTRIBUTE Vector", "SEPXYZ", "MATH", "MATH", "number to vector"]
    assert extract_material().program.steps[3].inputs[0] == 20.0


def test_sockets_of_groups_convert_what_blender_does_not_join(tree: Any) -> None:
    """A color that passes a socket of numbers is grey afterwards; since Blender 5.0 only one computed before that."""
    group, start, end = make_group("Group", "NodeSocketFloat")
    group.links.new(start.outputs[0], end.inputs[0])
    node = add_node(tree, "ShaderNodeGroup", node_tree=group)
    color = add_node(tree, "ShaderNodeRGB").outputs[0]
    color.default_value = (1.0, 0.0, 0.0, 1.0)
    tree.links.new(color, node.inputs[0])
    show(tree, node.outputs[0])
    assert_allclose(extract_color(), 0.2126 if versions.VERSION < (5, 0) else (1.0, 0.0, 0.0))
    tree.links.new(add_node(tree, "ShaderNodeCombineXYZ", {"X": 0.3}).outputs[0], node.inputs[0])
    assert_allclose(extract_color(), 0.1)


def test_mix_shader_with_a_computed_factor(tree: Any) -> None:
    noise = tree.nodes.new("ShaderNodeTexNoise").outputs["Fac"]
    mix = tree.nodes.new("ShaderNodeMixShader")
    tree.links.new(noise, mix.inputs[0])
    tree.links.new(tree.nodes["Emission"].outputs[0], mix.inputs[1])
    tree.links.new(tree.nodes.new("ShaderNodeBsdfDiffuse").outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    closures = extract_material().closures
    assert [closure.kind for closure in closures] == ["emission", "diffuse"]
    assert all(isinstance(closure.weight, Register) for closure in closures)


def test_every_parameter_of_a_principled_closure_may_be_computed(tree: Any) -> None:
    names = {"Base Color": "color", "Metallic": "metallic", "Roughness": "roughness", "IOR": "ior", "Alpha": "alpha"}
    names |= {"Transmission Weight": "transmission", "Specular IOR Level": "specular", "Normal": "normal"}
    names |= {"Specular Tint": "specular_tint", "Emission Strength": "emission"}
    node = tree.nodes.new("ShaderNodeBsdfPrincipled")
    noise = tree.nodes.new("ShaderNodeTexNoise")
    for name in names:
        tree.links.new(noise.outputs["Color"], node.inputs[name])
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    (closure,) = extract_material().closures
    assert set(closure.registers) == set(names.values())
    assert not texts()


def test_constant_normals_of_zero_are_none(tree: Any) -> None:
    node = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(tree.nodes.new("ShaderNodeCombineXYZ").outputs[0], node.inputs["Normal"])
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    assert isinstance(extract_material().closures[0], Closure)
    assert extract_material().closures[0].normal is None


def test_a_texture_s_own_mapping_moves_its_coordinates(tree: Any) -> None:
    checker = add_node(tree, "ShaderNodeTexChecker", {"Vector": uv(tree)})
    show(tree, checker.outputs[0])
    mapping = checker.texture_mapping
    assert operations() == ["ATTRIBUTE Vector", "TEX_CHECKER"]
    mapping.mapping_x, mapping.mapping_y, mapping.mapping_z = "Y", "NONE", "Z"
    assert operations() == ["ATTRIBUTE Vector", "SEPXYZ", "COMBXYZ", "TEX_CHECKER"]
    steps = extract_material().program.steps
    assert steps[2].inputs == (Register(1, "Y"), 0.0, Register(1, "Z"))
    mapping.vector_type, mapping.scale = "TEXTURE", (2.0, 3.0, 4.0)
    assert operations() == ["ATTRIBUTE Vector", "SEPXYZ", "COMBXYZ", "MAPPING", "TEX_CHECKER"]
    step = extract_material().program.steps[3]
    assert step.settings == {"vector_type": "TEXTURE"}
    assert_array_equal(step.inputs[3], (2.0, 3.0, 4.0))


def test_coordinates_of_an_object_that_is_nowhere_are_zero(tree: Any) -> None:
    nowhere = bpy.data.objects.new("Nowhere", None)
    bpy.context.scene.collection.objects.link(nowhere)
    nowhere.location = (np.nan, 0.0, 0.0)
    show(tree, add_node(tree, "ShaderNodeTexCoord", object=nowhere).outputs["Object"])
    assert_array_equal(extract_material().program.steps[0].settings["object_from_world"], np.zeros((4, 4)))


def split_alpha(tree: Any) -> Any:
    """Return a group of an image whose color shines, and whose alpha is linked to the group's second output."""
    group, _, end = make_group("Group", "NodeSocketColor")
    group.interface.new_socket("Alpha", in_out="OUTPUT", socket_type="NodeSocketFloat")
    image = add_node(group, "ShaderNodeTexImage", image=bpy.data.images.new("Image", 2, 2, alpha=True))
    group.links.new(image.outputs["Color"], end.inputs["Out"])
    group.links.new(image.outputs["Alpha"], end.inputs["Alpha"])
    node = add_node(tree, "ShaderNodeGroup", node_tree=group)
    show(tree, node.outputs["Out"])
    return node


def is_unassociated() -> bool:
    (step,) = (step for step in extract_material().program.steps if step.operation == "TEX_IMAGE")
    return bool(step.settings["unassociate"])


def test_alpha_that_leads_nowhere_leaves_colors_multiplied(tree: Any) -> None:
    """Cycles, too, divides colors by alpha only for shaders that read it: not for a group that merely offers it."""
    node = split_alpha(tree)
    assert not is_unassociated()
    loose = tree.nodes.new("ShaderNodeMath")
    tree.links.new(node.outputs["Alpha"], loose.inputs[0])
    assert not is_unassociated()
    link = tree.links.new(loose.outputs[0], tree.nodes["Emission"].inputs["Strength"])
    assert is_unassociated()
    link.is_muted = True
    assert not is_unassociated()


@pytest.mark.parametrize("kind", ["ShaderNodeOutputAOV", "NodeReroute", "ShaderNodeGroup"])
def test_alpha_is_read_on_whatever_way_it_comes_to_an_output(tree: Any, kind: str) -> None:
    node = split_alpha(tree)
    further = tree.nodes.new(kind)
    if kind == "ShaderNodeGroup":
        further.node_tree, start, end = make_group("Further", "NodeSocketFloat")
        further.node_tree.links.new(start.outputs[0], end.inputs[0])
    tree.links.new(node.outputs["Alpha"], find_value(further.inputs))
    if further.outputs:
        tree.links.new(further.outputs[0], tree.nodes["Emission"].inputs["Strength"])
    assert is_unassociated()


def find_value(sockets: Any) -> Any:
    return next((socket for socket in sockets if socket.name == "Value"), sockets[0])


def test_a_bump_without_height_hands_on_what_is_computed_and_no_constant(tree: Any) -> None:
    given = add_node(tree, "ShaderNodeCombineXYZ", {"X": 1.0})
    bump = add_node(tree, "ShaderNodeBump", {"Normal": given.outputs[0]})
    show(tree, bump.outputs[0])
    assert operations() == ["NEW_GEOMETRY Normal"]
    tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Tangent"], bump.inputs["Normal"])
    assert operations() == ["TANGENT RADIAL"]


def test_bump_runs_its_height_as_a_program_of_its_own(tree: Any) -> None:
    attribute = add_node(tree, "ShaderNodeAttribute", attribute_name="number").outputs["Fac"]
    show(tree, add_node(tree, "ShaderNodeBump", {"Height": attribute}).outputs[0])
    (step,) = [step for step in extract_material().program.steps if step.operation == "BUMP"]
    assert isinstance(step.settings["height"], Program)
    assert [inner.operation for inner in step.settings["height"].steps] == ["ATTRIBUTE Fac"]
    assert set(extract().scene.meshes[0].attributes) == {"number"}


# Warnings ------------------------------------------------------------------------------------------------------------


def test_an_unknown_node_is_named_and_the_rest_goes_on(tree: Any) -> None:
    node = tree.nodes.new("ShaderNodeShaderToRGB")
    total = add_node(tree, "ShaderNodeMath", {"Value": node.outputs["Alpha"], "Value_001": 1.0})
    total.inputs[0].default_value = 0.25
    show(tree, total.outputs[0])
    assert_allclose(extract_color(), 1.25)
    (text,) = texts()
    assert text.startswith(
        "material 'Material', object 'Object': node 'Shader to RGB' (Shader to RGB) is not supported"
    )
    assert "'Value' of node 'Math' keeps its own value" in text


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda tree: add_node(tree, "ShaderNodeAmbientOcclusion", {"Distance": 0.0}).outputs["AO"],
            "treated as unoccluded",
        ),
    ],
)
def test_what_a_node_lacks_is_named(tree: Any, make: Any, words: str) -> None:
    show(tree, make(tree))
    (text,) = texts()
    assert words in text
    assert "material 'Material'" in text


# Attributes ----------------------------------------------------------------------------------------------------------


def read(tree: Any, name: str) -> Any:
    return add_node(tree, "ShaderNodeAttribute", attribute_name=name).outputs["Color"]


def test_attributes_are_read_only_for_materials_that_ask(tree: Any, shown: Any) -> None:
    show(tree, tree.nodes.new("ShaderNodeObjectInfo").outputs["Location"])
    scene = extract().scene
    assert scene.meshes[0].attributes == {}
    assert scene.meshes[0].uvs is None
    assert scene.instances.random is None
    assert scene.instances.color is None
    assert scene.instances.properties == {}


def test_object_color_and_random_are_read_where_asked_for(tree: Any, shown: Any) -> None:
    shown.color = (0.25, 0.5, 0.75, 0.5)
    show(tree, tree.nodes.new("ShaderNodeObjectInfo").outputs["Color"])
    assert_array_equal(extract().scene.instances.color, [(0.25, 0.5, 0.75, 0.5)])


def read_property(tree: Any, kind: str) -> Any:
    return add_node(tree, "ShaderNodeAttribute", attribute_type=kind, attribute_name="grade").outputs["Color"]


def test_properties_of_objects_are_gathered_under_their_kind_and_name(tree: Any, shown: Any) -> None:
    shown["grade"] = [0.25, 0.5]
    show(tree, read_property(tree, "OBJECT"))
    properties = extract().scene.instances.properties
    assert set(properties) == {"OBJECT grade"}
    assert_array_equal(properties["OBJECT grade"], [(0.25, 0.5, 0.0, 1.0)])


def test_properties_are_read_anew_though_nothing_else_changed(tree: Any, shown: Any) -> None:
    """Of what is kept from the last extraction, no property is: of an object or of the view layer."""
    scene = bpy.context.scene
    added = add_node(tree, "ShaderNodeVectorMath", operation="ADD")
    tree.links.new(read_property(tree, "OBJECT"), added.inputs[0])
    tree.links.new(read_property(tree, "VIEW_LAYER"), added.inputs[1])
    show(tree, added.outputs[0])
    kept = Kept()
    for value in (0.25, 0.75):
        shown["grade"] = scene["grade"] = value
        shown.update_tag()
        scene.update_tag()
        found = extract_scene(bpy.context.evaluated_depsgraph_get(), kept=kept).scene
        kept.changes = Changes()
        assert found.instances.properties["OBJECT grade"][0, 0] == value
        (step,) = (step for step in found.materials[0].program.steps if step.operation.startswith("VECT_MATH"))
        assert any(np.array_equal(given, [value] * 3) for given in step.inputs)


@pytest.mark.parametrize(
    ("name", "shape"),
    [("UVMap", (18, 3, 2)), ("Second", (18, 3, 2)), ("Col", (18, 3, 4)), ("number", (16, 1)), ("face", (18, 3, 3))],
)
def test_attributes_come_at_vertices_or_corners(tree: Any, name: str, shape: tuple[int, ...]) -> None:
    show(tree, read(tree, name))
    assert extract().scene.meshes[0].attributes[name].shape == shape


def test_values_at_corners_belong_to_their_vertices(tree: Any) -> None:
    show(tree, read(tree, "UVMap"))
    mesh = extract().scene.meshes[0]
    assert_allclose(mesh.attributes["UVMap"], mesh.positions[mesh.triangles][..., :2] + 0.5, atol=1e-6)


def test_generated_coordinates_span_the_box(tree: Any) -> None:
    show(tree, tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"])
    generated = extract().scene.meshes[0].attributes["generated"]
    assert_allclose(generated.min(axis=0), 0.0, atol=1e-6)
    assert_allclose(generated.max(axis=0), 1.0, atol=1e-6)


def test_left_out_triangles_leave_out_their_values(tree: Any, shown: Any) -> None:
    shown.data.vertices[0].co = (np.nan, 0.0, 0.0)
    show(tree, read(tree, "Second"))
    mesh = extract().scene.meshes[0]
    assert len(mesh.attributes["Second"]) == len(mesh.triangles) < 18


def test_two_materials_on_one_mesh_read_both_their_attributes(tree: Any, shown: Any) -> None:
    show(tree, read(tree, "number"))
    second = make_tree(shown, "Second material")
    show(second, read(second, "face"))
    shown.data.polygons[0].material_index = 1
    assert set(extract().scene.meshes[0].attributes) == {"number", "face"}
