"""What view layers leave out and replace, against Cycles: through the same points, in every combination."""

from __future__ import annotations

from itertools import product
from typing import Any

import bpy
import numpy as np
import pytest
from numpy.testing import assert_allclose

from addon.extract.scene import Extraction, extract_scene
from addon.versions import find_node_tree
from tests.addon.against_cycles.node_fixtures import render_centres, render_cycles
from tests.addon.extract.shaders.shader_trees import give_nodes

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

SIZE = 24
# Cycles adds what shines in float32.
COLOR_TOLERANCE = 16 * float(np.finfo(np.float32).eps)


def shine(tree: Any, color: tuple[float, float, float]) -> None:
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Color"].default_value = (*color, 1.0)
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    tree.links.new(emission.outputs[0], output.inputs["Surface"])


def add_points(scene: Any, color: tuple[float, float, float]) -> Any:
    """Add a cube beside the middle whose vertices geometry nodes turn into points."""
    mesh = bpy.data.meshes.new("Points")
    mesh.from_pydata([(x, y, 0.0) for x in (1, 1.5) for y in (-1, 0, 1)], [], [])
    shown = bpy.data.objects.new("Points", mesh)
    scene.collection.objects.link(shown)
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    given, made = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    points, worn = tree.nodes.new("GeometryNodeMeshToPoints"), tree.nodes.new("GeometryNodeSetMaterial")
    points.inputs["Radius"].default_value = 0.3
    tree.links.new(given.outputs[0], points.inputs[0])
    tree.links.new(points.outputs[0], worn.inputs["Geometry"])
    tree.links.new(worn.outputs[0], made.inputs[0])
    shine(give_nodes(shown, "Points"), color)
    worn.inputs["Material"].default_value = bpy.data.materials["Points"]
    shown.modifiers.new("Nodes", "NODES").node_group = tree
    return shown


@pytest.fixture
def filled(empty_scene: Any) -> Any:
    """Return the view layer of a scene with a world, a plane and points, which shine in colors of their own."""
    world = bpy.data.worlds.new("World")
    empty_scene.world = world
    tree = find_node_tree(world)
    if tree is None:
        world.use_nodes = True
        tree = world.node_tree
    background = next(node for node in tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = (0.1, 0.2, 0.3, 1.0)
    mesh = bpy.data.meshes.new("Plane")
    mesh.from_pydata([(-2, -1, 0), (0, -1, 0), (0, 1, 0), (-2, 1, 0)], [], [(0, 1, 2, 3)])
    plane = bpy.data.objects.new("Plane", mesh)
    empty_scene.collection.objects.link(plane)
    shine(give_nodes(plane, "Plane"), (0.5, 0.0, 0.0))
    add_points(empty_scene, (0.0, 0.7, 0.0))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", 5.0, (0.0, 0.0, 5.0)
    empty_scene.collection.objects.link(camera)
    empty_scene.camera = camera
    return empty_scene.view_layers[0]


def extract(geometry_only: bool = False) -> Extraction:
    return extract_scene(bpy.context.evaluated_depsgraph_get(), geometry_only=geometry_only)


@pytest.mark.parametrize(("use_sky", "use_solid", "use_override"), list(product((True, False), repeat=3)))
def test_filters_and_override_show_what_cycles_shows(
    filled: Any, use_sky: bool, use_solid: bool, use_override: bool
) -> None:
    """Surfaces are meshes: points stay where they are left out."""
    filled.use_sky, filled.use_solid = use_sky, use_solid
    filled.material_override = bpy.data.materials["Points"] if use_override else None
    ours, warnings = render_centres(SIZE, SIZE)
    assert not warnings
    assert_allclose(ours, render_cycles(SIZE, SIZE), atol=COLOR_TOLERANCE)


def test_layer_without_sky_has_no_world_to_sample(filled: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    filled.use_sky = False
    monkeypatch.setattr("raytracer.integrator.prepare.make_environment", lambda *_: pytest.fail("a world was made"))
    assert extract().scene.world is None
    render_centres(4, 4)


def test_layer_without_surfaces_reads_no_mesh(filled: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    filled.use_solid = False
    monkeypatch.setattr("addon.extract.mesh_table.extract_geometry", lambda *_: pytest.fail("a mesh was read"))
    scene = extract().scene
    assert not scene.meshes
    assert len(scene.spheres) == 1


def test_casts_heed_no_filter(filled: Any) -> None:
    """Scene.ray_cast does not either."""
    filled.use_solid = False
    assert len(extract(geometry_only=True).scene.meshes) == 1


@pytest.mark.parametrize(("option", "kind"), [("use_volumes", "volumes")])
def test_what_the_layer_leaves_out_needs_no_warning(filled: Any, option: str, kind: str) -> None:
    data = getattr(bpy.data, kind).new("Left out")
    if kind == "volumes":
        data.filepath = "//missing.vdb"
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Left out", data))
    assert [warning.object for warning in extract().warnings] == ["Left out"]
    setattr(filled, option, False)
    assert not extract().warnings
