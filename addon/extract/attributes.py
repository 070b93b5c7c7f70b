"""Attributes of meshes that materials read: uv maps, colors, any named attribute, Generated coordinates.

Each is read from an evaluated mesh as (v, k) per vertex or (t, 3, k) per corner of the triangles; values per face or
edge become values at corners.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.shading.site_tables import UNDEFORMED
from raytracer.textures.noise import LARGEST_WORD, hash_words

from .meshes import Geometry, read_array, read_corners
from .shaders.node_settings import DEFAULT_COLOR, DEFAULT_UV, GENERATED, ISLAND

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


def read_mesh_attribute(mesh: Any, geometry: Geometry, name: str) -> Values | None:
    """Return a mesh's attribute for the triangles of its Geometry, or None where it has none of that name and of a
    kind that materials read."""
    if name == GENERATED:
        return read_generated(mesh)
    if name == ISLAND:
        return read_islands(mesh, geometry)
    if name == UNDEFORMED:  # wanted only in place of coordinates
        return None if len(mesh.uv_layers) else read_array(mesh.vertices, "undeformed_co", np.float32, 3)
    if name == DEFAULT_UV:
        attribute = next((layer for layer in mesh.uv_layers if layer.active_render), None)
        name = "" if attribute is None else attribute.name
    elif name == DEFAULT_COLOR:
        index = mesh.color_attributes.render_color_index
        name = mesh.color_attributes[index].name if 0 <= index < len(mesh.color_attributes) else ""
    attribute = mesh.attributes.get(name) if name else None
    if attribute is None or attribute.data_type not in ATTRIBUTE_TYPES:
        return None
    field, dtype, width = ATTRIBUTE_TYPES[attribute.data_type]
    values = read_array(attribute.data, field, dtype, width).reshape(-1, width).astype(np.float32)
    return to_triangles(mesh, geometry, attribute.domain, np.nan_to_num(values))


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
    """Return values of a domain at vertices (v, k) or at the corners of triangles (t, 3, k); None for edges."""
    if domain == "POINT":
        return values
    if domain == "CORNER":
        corners = read_corners(mesh)
        return values[corners if geometry.kept is None else corners[geometry.kept]]
    if domain == "FACE":
        return np.repeat(values[geometry.polygons][:, np.newaxis], 3, axis=1)
    return None


def read_generated(mesh: Any) -> Values:
    """Return Generated coordinates (v, 3): 0 to 1 over the mesh's texture space, of the undeformed vertices."""
    size = np.array(mesh.texspace_size, dtype=np.float32)
    location = np.array(mesh.texspace_location, dtype=np.float32)
    scale = np.divide(0.5, size, out=np.zeros_like(size), where=size != 0)
    undeformed = read_array(mesh.vertices, "undeformed_co", np.float32, 3)
    return (undeformed - location) * scale + np.float32(0.5)
