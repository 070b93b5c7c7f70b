"""Who sees what shines, and what programs are told of the rays, against Cycles of the same Blender.

A ball of every kind over a floor, under an emissive mesh, a lamp, an even world or one that varies, each of which, or
the floor, is hidden from one kind of ray.
"""

import bpy
import pytest

from addon import versions
from blend_scenes import building
from tests.addon.against_cycles.test_paths import MATERIALS, assert_agree, list_cases
from tests.addon.against_cycles.test_pictures import SMALL_SIZE

pytestmark = pytest.mark.usefixtures("registered_addon")

KINDS = ("camera", "diffuse", "glossy", "transmission", "shadow")


def make_stage(source, material):
    """Return the scene and what its source can be hidden by: the object or the world's visibility."""
    scene = building.start_scene(*SMALL_SIZE)
    grey = building.make_shader("Grey", "Diffuse", (0.8, 0.6, 0.4))
    building.link_object("Floor", building.make_plane("Floor", 8, 8), materials=[grey])
    building.link_object("Ball", building.make_sphere("Ball", 0.8, 32), (0, 0, 1.2), materials=[MATERIALS[material]()])
    building.add_camera((0, -5, 2.5), (0, 0, 0.8), 40)
    if source == "emissive mesh":
        glow = building.make_shader("Glow", "Emission", (1.0, 0.7, 0.4), strength=6.0)
        return scene, building.link_object(
            "Lamp", building.make_plane("Lamp", 1, 1), (1.4, -0.6, 2.4), materials=[glow]
        )
    if source == "lamp":
        # Where the lamp is hidden from all there is, something shall still be seen.
        building.add_light("Fill", "POINT", 20, (-2, -2, 3), (0, 0, 0))
        return scene, building.add_light("Lamp", "AREA", 60, (1.4, -0.6, 2.6), (0, 0, 1))
    world = bpy.data.worlds.new("World")
    scene.world = world
    if versions.VERSION < (5, 0):
        world.use_nodes = True
    tree = versions.find_node_tree(world)
    background = next(node for node in tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = (0.5, 0.6, 0.7, 1.0)
    if source == "world that varies":
        sky, place = tree.nodes.new("ShaderNodeTexGradient"), tree.nodes.new("ShaderNodeTexCoord")
        tree.links.new(place.outputs["Generated"], sky.inputs["Vector"])
        tree.links.new(sky.outputs["Color"], background.inputs["Color"])
    return scene, world.cycles_visibility


CASES = [
    f"{source}, {kind}"
    for source in ("emissive mesh", "lamp", "world", "world that varies")
    for kind in KINDS
    if kind != "shadow" or source == "emissive mesh"
]


@pytest.mark.parametrize("material", ["diffuse", "glossy"])
@pytest.mark.parametrize("case", list_cases(CASES, ["emissive mesh, diffuse", "world, glossy"]))
def test_what_shines_lights_by_the_rays_that_see_it(case, material):
    source, kind = case.split(", ")
    scene, hidden = make_stage(source, material)
    setattr(hidden, kind if "world" in source else f"visible_{kind}", False)
    assert_agree(scene, max_bounces=1)


@pytest.mark.parametrize("source", ["emissive mesh", "world"])
@pytest.mark.parametrize("kind", list_cases(KINDS, ["diffuse"]))
def test_what_objects_shade_depends_on_the_rays_that_see_them(kind, source):
    scene, _ = make_stage(source, "principled")
    setattr(bpy.data.objects["Floor"], f"visible_{kind}", False)
    assert_agree(scene, max_bounces=2)


OUTPUTS = {
    "Is Camera Ray": 1.0,
    "Is Shadow Ray": 1.0,
    "Is Diffuse Ray": 1.0,
    "Is Reflection Ray": 1.0,
    "Ray Length": 0.1,
    "Ray Depth": 0.4,
    "Diffuse Depth": 0.4,
    "Transparent Depth": 0.5,
}


def link_output(tree, output, scale, socket):
    path, scaled = tree.nodes.new("ShaderNodeLightPath"), tree.nodes.new("ShaderNodeMath")
    scaled.operation = "MULTIPLY"
    scaled.inputs[1].default_value = scale
    tree.links.new(path.outputs[output], scaled.inputs[0])
    tree.links.new(scaled.outputs[0], socket)


@pytest.mark.parametrize("output", list_cases(OUTPUTS, ["Ray Depth"]))
def test_two_sheets_let_through_what_the_path_tells(output):
    """Under a lamp and an even world, one above the other."""
    scene, _ = make_stage("world", "diffuse")
    building.add_light("Lamp", "SUN", 2, (0.3, -0.4, 3), (0, 0, 0))
    sheet = building.make_shader("Sheet", "Diffuse", (0.8, 0.8, 0.8))
    tree = versions.find_node_tree(sheet)
    diffuse, end = (
        next(node for node in tree.nodes if node.type == kind) for kind in ("BSDF_DIFFUSE", "OUTPUT_MATERIAL")
    )
    mixed, clear = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeBsdfTransparent")
    tree.links.new(diffuse.outputs[0], mixed.inputs[1])
    tree.links.new(clear.outputs[0], mixed.inputs[2])
    tree.links.new(mixed.outputs[0], end.inputs["Surface"])
    link_output(tree, output, OUTPUTS[output], mixed.inputs[0])
    for height in (0.2, 2.2):
        building.link_object("Sheet", building.make_plane("Sheet", 2, 2), (0.3, 0, height), materials=[sheet])
    assert_agree(scene, max_bounces=2)


# The world is as far away as numbers go: Ray Length has no value to compare.
@pytest.mark.parametrize("output", list_cases([name for name in OUTPUTS if name != "Ray Length"], ["Is Diffuse Ray"]))
def test_an_even_world_shines_as_the_path_tells(output):
    scene, _ = make_stage("world", "diffuse")
    tree = versions.find_node_tree(scene.world)
    background = next(node for node in tree.nodes if node.type == "BACKGROUND")
    link_output(tree, output, OUTPUTS[output], background.inputs["Strength"])
    building.add_light("Lamp", "SUN", 1, (0.3, -0.4, 3), (0, 0, 0))
    assert_agree(scene, max_bounces=2)


ASKED = ["Is Diffuse Ray", "Is Glossy Ray", "Is Reflection Ray", "Is Transmission Ray", "Ray Depth", "Glossy Depth"]


@pytest.mark.parametrize("integrator", ["PATH", "DIRECT"])
@pytest.mark.parametrize("material", list_cases(["principled", "rough glass"], ["principled"]))
@pytest.mark.parametrize("source", ["emissive mesh", "world that varies"])
@pytest.mark.parametrize("output", list_cases(ASKED, ["Is Reflection Ray"]))
def test_what_varies_shines_as_the_path_tells(output, source, material, integrator):
    """Both engines weigh samples, which are told no kind, and reflected rays, which are. With its light tree, or close
    to a triangle, Cycles has weights that differ from place to place."""
    scene, lamp = make_stage(source, material)
    scene.cycles.use_light_tree = False
    building.add_light("Sun", "SUN", 0.1, (0.3, -0.4, 3), (0, 0, 0))
    if source == "emissive mesh":
        lamp.location.z = 3.6
    shining = bpy.data.materials["Glow"] if source == "emissive mesh" else scene.world
    tree = versions.find_node_tree(shining)
    node = next(node for node in tree.nodes if node.type in ("BACKGROUND", "EMISSION"))
    link_output(tree, output, 6.0 if source == "emissive mesh" else 1.0, node.inputs["Strength"])
    assert_agree(scene, max_bounces=2, integrator=integrator)


@pytest.mark.parametrize("integrator", ["PATH", "DIRECT"])
@pytest.mark.parametrize("kind", list_cases(["diffuse", "glossy", "shadow"], ["shadow"]))
@pytest.mark.parametrize("name", list_cases(["Floor", "Ball"], ["Floor"]))
def test_objects_shade_a_world_that_varies_by_the_rays_that_see_them(name, kind, integrator):
    scene, _ = make_stage("world that varies", "principled")
    setattr(bpy.data.objects[name], f"visible_{kind}", False)
    assert_agree(scene, max_bounces=2, integrator=integrator)


@pytest.mark.parametrize("offset", [0.1, 0.4])
def test_terminators_agree(offset):
    """A coarse smooth ball under a sun from the side. The offset of shading is tested in closed form: Cycles takes its
    arc cosine from a polynomial that is 7e-5 off, which a picture without noise shows."""
    scene, _ = make_stage("world", "diffuse")
    mesh = building.make_sphere("Coarse", 0.8, 8)
    ball = bpy.data.objects["Ball"]
    ball.data = mesh
    for polygon in mesh.polygons:
        polygon.use_smooth = True
    ball.shadow_terminator_geometry_offset = offset
    building.add_light("Lamp", "SUN", 3, (3, -1, 2), (0, 0, 1))
    assert_agree(scene, max_bounces=1)
