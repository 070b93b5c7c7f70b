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
        show_spheres(points, radius)
    return points


def show_spheres(points: Any, radius: float) -> None:
    """Show vertices as spheres of a radius in metres, by a modifier."""
    modifier = points.modifiers.new(NODE_GROUP, "NODES")
    group = bpy.data.node_groups.get(NODE_GROUP)
    if group is None or find_radius(group) is None:  # or one that the user has called so
        group = make_node_group()
    modifier.node_group = group
    modifier[find_radius(group)] = radius


def find_radius(group: Any) -> str | None:
    """Return the identifier of a node group's input Radius, or None."""
    sockets = (item for item in group.interface.items_tree if item.item_type == "SOCKET" and item.in_out == "INPUT")
    return next((socket.identifier for socket in sockets if socket.name == "Radius"), None)


def make_node_group() -> Any:
    """Return the node group: Mesh to Points with a radius, and the object's first material."""
    group = bpy.data.node_groups.new(NODE_GROUP, "GeometryNodeTree")
    group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    radius = group.interface.new_socket("Radius", in_out="INPUT", socket_type="NodeSocketFloat")
    radius.subtype, radius.min_value = "DISTANCE", 0.0
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    start, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    to_points = group.nodes.new("GeometryNodeMeshToPoints")
    group.links.new(start.outputs["Geometry"], to_points.inputs["Mesh"])
    group.links.new(start.outputs["Radius"], to_points.inputs["Radius"])
    group.links.new(to_points.outputs[0], end.inputs["Geometry"])
    for place, node in enumerate((start, to_points, end)):
        node.location = (200 * place, 0)
    return group
