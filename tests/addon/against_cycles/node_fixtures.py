"""What the tests of nodes against Cycles share: a sheet of small planes, one for each configuration of nodes, rendered
through the same points by both engines in one picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

import raytracer
from addon.compare.cycles.rendering import CYCLES, Request, matched_settings, render_batches
from addon.extract.scene import extract_scene
from addon.versions import VERSION, find_node_tree
from raytracer.film.camera import primary_rays
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.sampling.sobol import SobolSamples

CELL = 8  # pixels of a plane, each side
# Cycles takes the place within the pixel from a table of 1024 steps, whose middle lies so much, in pixels, beside it.
CYCLES_OFFSET = 1 / 2048
LOWEST = -8.0  # values below are cut
Make = Callable[[Any], Any]


def make_material(name: str, make: Make) -> Any:
    """Return a material that shines with what `make` returns: an output socket of the tree that it is given."""
    material = bpy.data.materials.new(name)
    if VERSION < (5, 0):
        material.use_nodes = True
    tree = find_node_tree(material)
    tree.nodes.clear()
    emission, output = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    # Closures take no negative colors: what shines is v - LOWEST.
    inputs = {"Vector": make(tree), "Vector_001": [LOWEST] * 3}
    raised = add_node(tree, "ShaderNodeVectorMath", inputs, operation="MAXIMUM")
    shown = add_node(tree, "ShaderNodeVectorMath", {"Vector": raised.outputs[0]}, operation="SUBTRACT")
    shown.inputs[1].default_value = [LOWEST] * 3
    tree.links.new(shown.outputs[0], emission.inputs["Color"])
    return material


def add_node(tree: Any, kind: str, inputs: Mapping[str, Any] | None = None, **properties: Any) -> Any:
    """Add a node, set properties, then inputs by identifier: values, or sockets to link."""
    node = tree.nodes.new(kind)
    for name, value in properties.items():
        setattr(node, name, value)
    for identifier, value in (inputs or {}).items():
        socket = next(socket for socket in node.inputs if socket.identifier == identifier)
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, socket)
        else:
            socket.default_value = value
    return node


def make_tilted_plane(name: str) -> Any:
    """Return a mesh of 1 m x 1 m seen from above, whose z varies, with uvs, colors and smooth, uneven normals."""
    mesh = bpy.data.meshes.new(name)
    columns, rows = (-0.5, -0.19, 0.127, 0.5), (-0.5, -0.113, 0.231, 0.5)  # no edge runs through a pixel's centre
    vertices = [(x, y, 0.3 * x - 0.5 * y + 0.2 * x * y) for y in rows for x in columns]
    faces = [(4 * j + i, 4 * j + i + 1, 4 * j + i + 5, 4 * j + i + 4) for j in range(3) for i in range(3)]
    mesh.from_pydata(vertices, [], faces)
    mesh.polygons.foreach_set("use_smooth", [True] * len(faces))
    corners = np.array([mesh.vertices[loop.vertex_index].co for loop in mesh.loops])
    for layer, turned in (("UVMap", False), ("Second", True)):
        uv = mesh.uv_layers.new(name=layer)
        u, v = corners[:, 0] + 0.5, corners[:, 1] + 0.5
        uv.uv.foreach_set("vector", np.stack([v, 1.5 * u] if turned else [u, v], axis=1).astype(np.float32).ravel())
    values = np.concatenate([0.5 + corners * (0.9, 0.7, 0.5), 0.75 + corners[:, :1] * 0.4], axis=1)
    for name, kind in (("Col", "FLOAT_COLOR"), ("Bytes", "BYTE_COLOR")):
        colors = mesh.color_attributes.new(name, kind, "CORNER")
        colors.data.foreach_set("color", np.clip(values, 0, 1).astype(np.float32).ravel())
    number = mesh.attributes.new("number", "FLOAT", "POINT")
    number.data.foreach_set("value", np.linspace(0.1, 0.9, len(vertices)).astype(np.float32))
    face = mesh.attributes.new("face", "FLOAT_VECTOR", "FACE")
    face.data.foreach_set("vector", np.linspace(0.0, 1.0, 3 * len(faces)).astype(np.float32))
    mesh.update()
    return mesh


def make_sheet(scene: Any, configurations: Mapping[str, Make], behind: bool = False) -> tuple[int, int]:
    """Lay a plane for each configuration under an orthographic camera; return columns and rows of planes.

    behind : True shows the camera their backs
    """
    columns = int(np.ceil(np.sqrt(len(configurations))))
    rows = -(-len(configurations) // columns)
    mesh = make_tilted_plane("Plane")
    if behind:
        mesh.flip_normals()
    mesh.materials.append(None)
    for number, (name, make) in enumerate(configurations.items()):
        plane = bpy.data.objects.new(name, mesh)
        plane.location = (number % columns + 0.5, rows - number // columns - 0.5, 0.0)
        plane.scale = (1.0, 1.0, 0.8)
        scene.collection.objects.link(plane)
        plane.material_slots[0].link = "OBJECT"
        plane.material_slots[0].material = make_material(name, make)
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale, camera.clip_end = "ORTHO", max(columns, rows), 100.0
    holder = bpy.data.objects.new("Camera", camera)
    holder.location = (columns / 2, rows / 2, 10.0)
    scene.collection.objects.link(holder)
    scene.camera = holder
    return columns, rows


def render_centres(width: int, height: int) -> tuple[NDArray[np.float64], tuple[Any, ...]]:
    """Return what our engine sees through the points of Cycles' first sample, (h, w, 3), row 0 at the top, and its
    warnings."""
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = width, height, 100
    extraction = extract_scene(bpy.context.evaluated_depsgraph_get())
    caster = raytracer.build(extraction.scene)
    integrator = prepare(extraction.scene, caster, raytracer.Settings(max_bounces=0), (width, height))
    y, x = np.divmod(np.arange(width * height), width)
    samples = SobolSamples(np.arange(width * height, dtype=np.uint32), 0, 0)
    x, y = x + 0.5 + CYCLES_OFFSET, height - y - 0.5 + CYCLES_OFFSET
    rays = primary_rays(extraction.scene.camera, width, height, x, y)
    return trace(integrator, rays, samples)["Combined"][:, :3].reshape(height, width, 3), extraction.warnings


def render_cycles(width: int, height: int) -> NDArray[np.float64]:
    """Return what Cycles sees through the pixels' centres, (h, w, 3)."""
    scene, view_layer = bpy.context.scene, bpy.context.view_layer
    request = Request(width, height, 1, 0, through_centre=True)
    with matched_settings(scene, view_layer, request):
        return render_batches(scene, view_layer, CYCLES, request).passes["Combined"][0, ..., :3].astype(np.float64)


def measure_differences(
    scene: Any, configurations: Mapping[str, Make], behind: bool = False
) -> tuple[dict[str, float], dict[str, NDArray[np.float64]], tuple[Any, ...]]:
    """Return the largest difference of each configuration, as a share of 1 + |value|, and both pictures of it."""
    columns, rows = make_sheet(scene, configurations, behind)
    ours, warnings = render_centres(columns * CELL, rows * CELL)
    cycles = render_cycles(columns * CELL, rows * CELL)
    differences, pictures = {}, {}
    for number, name in enumerate(configurations):
        row, column = divmod(number, columns)
        cell = np.s_[row * CELL : (row + 1) * CELL, column * CELL : (column + 1) * CELL]
        pair = np.stack([ours[cell], cycles[cell]]) + LOWEST
        pictures[name] = pair
        differences[name] = float((np.abs(pair[0] - pair[1]) / (1.0 + np.abs(pair[1]))).max())
    return differences, pictures, warnings
