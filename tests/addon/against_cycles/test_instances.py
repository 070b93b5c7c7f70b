"""What materials read of instances, against Cycles: every way of making instances, rendered through the same points."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from numpy.testing import assert_allclose

from tests.addon.against_cycles.node_fixtures import CELL, make_material, render_centres, render_cycles

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

COLUMNS = 6  # of instances, and rows
# Cycles holds a random number in float32, and so the color that shines.
COLOR_TOLERANCE = 16 * float(np.finfo(np.float32).eps)
# The object itself stands at the origin, out of sight: viewports show those whose parents show them, renders do not.
PLACES = [(column + 1.5, row + 1.5, 0.0) for row in range(COLUMNS) for column in range(COLUMNS)]


def make_points(name: str) -> Any:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(PLACES, [], [])
    return bpy.data.objects.new(name, mesh)


def instance_on_vertices(scene: Any, shown: Any) -> None:
    parent = make_points("Parent")
    parent.instance_type = "VERTS"
    scene.collection.objects.link(parent)
    shown.parent = parent


def instance_collections(scene: Any, shown: Any) -> None:
    collection = bpy.data.collections.new("Collection")
    collection.objects.link(shown)
    scene.collection.objects.unlink(shown)
    for number, place in enumerate(PLACES):
        instancer = bpy.data.objects.new(f"Instancer {number}", None)
        instancer.instance_type, instancer.instance_collection = "COLLECTION", collection
        instancer.matrix_world = Matrix.Translation(place)
        scene.collection.objects.link(instancer)


def instance_by_nodes(scene: Any, shown: Any) -> None:
    points = make_points("Points")
    scene.collection.objects.link(points)
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    given, made = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    spread, chosen = tree.nodes.new("GeometryNodeInstanceOnPoints"), tree.nodes.new("GeometryNodeObjectInfo")
    chosen.inputs["Object"].default_value = shown
    chosen.inputs["As Instance"].default_value = True
    tree.links.new(given.outputs[0], spread.inputs["Points"])
    tree.links.new(chosen.outputs["Geometry"], spread.inputs["Instance"])
    tree.links.new(spread.outputs[0], made.inputs[0])
    points.modifiers.new("Nodes", "NODES").node_group = tree
    scene.collection.objects.unlink(shown)


def instance_particles(scene: Any, shown: Any) -> None:
    ground = bpy.data.meshes.new("Ground")
    last = COLUMNS + 1
    ground.from_pydata([(1, 1, 0), (last, 1, 0), (last, last, 0), (1, last, 0)], [], [(0, 1, 2, 3)])
    emitter = bpy.data.objects.new("Emitter", ground)
    scene.collection.objects.link(emitter)
    emitter.modifiers.new("Particles", "PARTICLE_SYSTEM")
    settings = emitter.particle_systems[0].settings
    settings.distribution, settings.grid_resolution, settings.render_type = "GRID", COLUMNS, "OBJECT"
    settings.physics_type, settings.frame_end, settings.instance_object = "NO", 1, shown
    settings.particle_size, settings.lifetime, settings.use_rotations = 0.7, 100, False
    emitter.show_instancer_for_render = emitter.show_instancer_for_viewport = False
    scene.frame_set(2)


WAYS: dict[str, Callable[[Any, Any], None]] = {
    "vertices": instance_on_vertices,
    "collections": instance_collections,
    "geometry nodes": instance_by_nodes,
    "particles": instance_particles,
}


@pytest.fixture
def shown(empty_scene: Any) -> Any:
    """Return a small plane whose color is its random number, under a camera that sees COLUMNS x COLUMNS metres."""
    mesh = bpy.data.meshes.new("Plane")
    mesh.from_pydata([(-0.4, -0.4, 0), (0.4, -0.4, 0), (0.4, 0.4, 0), (-0.4, 0.4, 0)], [], [(0, 1, 2, 3)])
    mesh.materials.append(
        make_material("Random", lambda tree: tree.nodes.new("ShaderNodeObjectInfo").outputs["Random"])
    )
    plane = bpy.data.objects.new("Plane", mesh)
    empty_scene.collection.objects.link(plane)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", COLUMNS
    camera.location = (COLUMNS / 2 + 1.0, COLUMNS / 2 + 1.0, 10.0)
    empty_scene.collection.objects.link(camera)
    empty_scene.camera = camera
    return plane


@pytest.mark.parametrize("way", WAYS)
def test_random_numbers_of_instances_are_those_of_cycles(empty_scene: Any, shown: Any, way: str) -> None:
    """Half of Blender's numbers have the highest bit of 32 set."""
    WAYS[way](empty_scene, shown)
    words = [item.random_id for item in bpy.context.evaluated_depsgraph_get().object_instances if item.is_instance]
    assert min(words) < 0 < max(words)
    size = COLUMNS * CELL
    ours, warnings = render_centres(size, size)
    assert not warnings
    assert_allclose(ours, render_cycles(size, size), atol=8.0 * COLOR_TOLERANCE)
