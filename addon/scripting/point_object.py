"""Points as an object of Blender: a mesh of vertices with attributes, shown as spheres if wanted."""

from __future__ import annotations

from typing import Any, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats

# The node group that shows vertices as spheres, shared by all scans of a file.
NODE_GROUP = "Scan Points"


class Attribute(NamedTuple):
    """A value for each point: name, Blender's type, and (k,) or (k, 3) numbers."""

    name: str
    data_type: str
    values: NDArray[Any]


FIELDS = {"FLOAT": ("value", np.float32), "INT": ("value", np.intc), "FLOAT_VECTOR": ("vector", np.float32)}


def make_point_object(
    name: str, location: Floats, attributes: list[Attribute], names: dict[str, str], radius: float, scene: Any
) -> Any:
    """Return a new object of points (k, 3) in the world, linked to the scene's collection."""
    if radius > 0:
        attributes = [*attributes, Attribute("radius", "FLOAT", np.full(len(location), radius))]
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(location))
    mesh.vertices.foreach_set("co", np.ascontiguousarray(location, dtype=np.float32).ravel())
    for attribute in attributes:
        field, dtype = FIELDS[attribute.data_type]
        values = np.ascontiguousarray(attribute.values, dtype=dtype).ravel()
        mesh.attributes.new(attribute.name, attribute.data_type, "POINT").data.foreach_set(field, values)
    mesh["objects"] = names
    mesh.update()
    points = bpy.data.objects.new(name, mesh)
    scene.original.collection.objects.link(points)
    if radius > 0:
        show_spheres(points)
    return points


def show_spheres(points: Any) -> None:
    """Show vertices as spheres of the radius that their attribute says, by a modifier."""
    group = bpy.data.node_groups.get(NODE_GROUP)
    if group is None or not any(node.bl_idname == "GeometryNodeMeshToPoints" for node in group.nodes):
        group = make_node_group()  # or one that the user has called so
    points.modifiers.new(NODE_GROUP, "NODES").node_group = group


def make_node_group() -> Any:
    """Return the node group: Mesh to Points, with the attribute `radius`."""
    group = bpy.data.node_groups.new(NODE_GROUP, "GeometryNodeTree")
    for in_out in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=in_out, socket_type="NodeSocketGeometry")
    start, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    radius, to_points = group.nodes.new("GeometryNodeInputNamedAttribute"), group.nodes.new("GeometryNodeMeshToPoints")
    radius.data_type = "FLOAT"
    radius.inputs["Name"].default_value = "radius"
    group.links.new(start.outputs["Geometry"], to_points.inputs["Mesh"])
    group.links.new(radius.outputs["Attribute"], to_points.inputs["Radius"])
    group.links.new(to_points.outputs[0], end.inputs["Geometry"])
    for node, place in ((start, (0, 0)), (radius, (0, -100)), (to_points, (200, 0)), (end, (400, 0))):
        node.location = place
    return group
