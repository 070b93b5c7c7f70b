"""Attributes that materials read: uv maps, colors, any named attribute, Generated coordinates; of meshes and points.

Each is read from an evaluated mesh as (v, k) per vertex or (t, 3, k) per corner of the triangles; values per face
become values at corners, values per edge their means at vertices. Those of point clouds are (s, k), one value per
point.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.shading.site_tables import UNDEFORMED, UNDISPLACED
from raytracer.textures.noise import LARGEST_WORD, hash_words

from .displacing import SMOOTH, VERTEX_NORMAL
from .meshes import Geometry, Points, read_array, read_attribute, read_corners
from .pointiness import read_pointiness
from .shaders.node_settings import DEFAULT_COLOR, DEFAULT_UV, GENERATED, ISLAND, POINTINESS

Values = NDArray[Any]

# Blender's types of attributes: the field of their values, NumPy's type, and numbers per value.
ATTRIBUTE_TYPES: dict[str, tuple[str, type, int]] = {
    "FLOAT": ("value", np.float32, 1),
    "INT": ("value", np.intc, 1),
    "INT8": ("value", np.intc, 1),
    "BOOLEAN": ("value", np.bool_, 1),
    "FLOAT2": ("vector", np.float32, 2),
    "FLOAT_VECTOR": ("vector", np.float32, 3),
    "FLOAT_COLOR": ("color", np.float32, 4),
    "BYTE_COLOR": ("color", np.float32, 4),
}
# What materials read besides: w, x, y and z of a rotation as a color and its alpha, as in Cycles.
READ_TYPES = {**ATTRIBUTE_TYPES, "QUATERNION": ("value", np.float32, 4)}
# What only meshes have, under names of our own.
UNNAMED = {DEFAULT_COLOR, DEFAULT_UV, GENERATED, ISLAND, POINTINESS, SMOOTH, UNDEFORMED, UNDISPLACED, VERTEX_NORMAL}


def read_mesh_attribute(mesh: Any, geometry: Geometry, name: str) -> Values | None:
    """Return a mesh's attribute for the triangles of its Geometry, or None where it has none of that name and of a
    kind that materials read."""
    if name == GENERATED:
        return read_generated(mesh)
    if name == ISLAND:
        return read_islands(mesh, geometry)
    if name == POINTINESS:
        return read_pointiness(mesh)
    if name == VERTEX_NORMAL:
        return read_array(mesh.vertex_normals, "vector", np.float32, 3)
    if name == SMOOTH:
        sharp = read_attribute(mesh, "sharp_face", "value", np.bool_)
        smooth = np.ones(len(geometry.polygons)) if sharp is None else 1.0 - sharp[geometry.polygons]
        return np.repeat(smooth, 3).reshape(-1, 3, 1)
    if name == UNDEFORMED:  # wanted only in place of coordinates
        return None if len(mesh.uv_layers) else read_array(mesh.vertices, "undeformed_co", np.float32, 3)
    if name == DEFAULT_UV:
        attribute = next((layer for layer in mesh.uv_layers if layer.active_render), None)
        name = "" if attribute is None else attribute.name
    elif name == DEFAULT_COLOR:
        index = mesh.color_attributes.render_color_index
        name = mesh.color_attributes[index].name if 0 <= index < len(mesh.color_attributes) else ""
    attribute = mesh.attributes.get(name) if name else None
    if attribute is None:
        return None
    values = read_values(attribute)
    if values is not None and attribute.domain == "EDGE":
        return average_edges(mesh, values, attribute.data_type)
    return None if values is None else to_triangles(mesh, geometry, attribute.domain, values)


def read_point_attributes(cloud: Any, points: Points, names: Iterable[str]) -> dict[str, Values]:
    """Return by name the attributes of the points (s, k) that a point cloud has, of kinds that materials read.

    References
    ----------
    Blender, intern/cycles/blender/pointcloud.cpp, copy_attributes: all are there by name, and none without one.
    """
    found = {name: cloud.attributes.get(name) for name in sorted(set(names) - UNNAMED)}
    values = {name: read_values(attribute) for name, attribute in found.items() if attribute is not None}
    return {name: of_all[points.kept].astype(np.float64) for name, of_all in values.items() if of_all is not None}


def read_values(attribute: Any) -> Values | None:
    """Return an attribute's values (k, width), 0 for those that are NaN, or None for a kind that materials cannot
    read."""
    if attribute.data_type not in READ_TYPES:
        return None
    field, dtype, width = READ_TYPES[attribute.data_type]
    return np.nan_to_num(read_array(attribute.data, field, dtype, width).reshape(-1, width).astype(np.float32))


def read_islands(mesh: Any, geometry: Geometry) -> Values:
    """Return Cycles' random number of the island of each triangle (t, 3, 1), 0 to 1: a hash of one of its vertices.

    Which one follows from the order of the edges: sets joined by rank (util/disjoint_set.h, blender/mesh.cpp).
    """
    edges: NDArray[np.intc] = np.empty(2 * len(mesh.edges), dtype=np.intc)
    mesh.attributes[".edge_verts"].data.foreach_get("value", edges)
    parents, ranks = list(range(len(mesh.vertices))), [0] * len(mesh.vertices)

    def find(vertex: int) -> int:
        while parents[vertex] != vertex:
            parents[vertex] = vertex = parents[parents[vertex]]
        return vertex

    for first, second in edges.reshape(-1, 2).tolist():
        high, low = find(first), find(second)
        if high == low:
            continue
        if ranks[high] < ranks[low]:
            high, low = low, high
        parents[low] = high
        ranks[high] += ranks[high] == ranks[low]
    corners = geometry.mesh.triangles[:, 0].tolist()
    roots = np.array([find(vertex) for vertex in corners], dtype=np.uint32)
    random = hash_words(roots).astype(np.float64) / LARGEST_WORD
    return np.repeat(random.astype(np.float32), 3).reshape(-1, 3, 1)


def to_triangles(mesh: Any, geometry: Geometry, domain: str, values: Values) -> Values | None:
    """Return values of a domain at vertices (v, k) or at the corners of triangles (t, 3, k); None for other domains."""
    if domain == "POINT":
        return values
    if domain == "CORNER":
        corners = read_corners(mesh)
        return values[corners if geometry.kept is None else corners[geometry.kept]]
    if domain == "FACE":
        return np.repeat(values[geometry.polygons][:, np.newaxis], 3, axis=1)
    return None


def average_edges(mesh: Any, values: Values, kind: str) -> Values:
    """Return at each vertex (v, k) what its edges (e, k) have, as Blender carries it there: the mean, of whole numbers
    a whole one, of truth values whether any is true; 0 without edges.

    References
    ----------
    Blender, source/blender/blenkernel/intern/mesh_attributes.cc: adapt_mesh_domain_edge_to_point.
    """
    ends, count = read_array(mesh.attributes[".edge_verts"].data, "value", np.intc, 2).ravel(), len(mesh.vertices)
    sums = np.stack([np.bincount(ends, np.repeat(column, 2), minlength=count) for column in values.T], axis=1)
    degree = np.bincount(ends, minlength=count)[:, np.newaxis]
    mean = np.divide(sums, degree, out=np.zeros_like(sums), where=degree > 0)
    if kind == "BOOLEAN":
        mean = np.ceil(mean)
    elif kind in ("INT", "INT8"):
        mean = np.copysign(np.floor(np.abs(mean) + 0.5), mean)  # halves go away from 0
    return mean.astype(np.float32)


def read_generated(mesh: Any) -> Values:
    """Return Generated coordinates (v, 3): 0 to 1 over the mesh's texture space, of the undeformed vertices."""
    size = np.array(mesh.texspace_size, dtype=np.float32)
    location = np.array(mesh.texspace_location, dtype=np.float32)
    scale = np.divide(0.5, size, out=np.zeros_like(size), where=size != 0)
    undeformed = read_array(mesh.vertices, "undeformed_co", np.float32, 3)
    return (undeformed - location) * scale + np.float32(0.5)
