"""Evaluated meshes as rays need them: triangles and their polygons, and whether they changed since they were last read.

A mesh is told to be the same by its content, never by its address or by Blender's messages: addresses are given anew
after undo, and not every change is announced. To compare costs a millisecond for 250,000 triangles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import raytracer

from ..extract.meshes import find_finite_triangles, read_array, read_attribute
from ..extract.warnings import WarningList

# A polygon's vertices in order, and how many triangles each polygon has, fix the triangles that Blender divides it
# into, given the positions. The last is there in edit mode only, where rays pass hidden faces.
Content = tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.int32], NDArray[np.bool_] | None]


@dataclass(frozen=True, eq=False)
class Shape:
    """One evaluated mesh.

    content : what it was made from
    mesh : its triangles, object space
    polygons : (t,) int32, the Blender polygon of each triangle
    rows : (t,) which of Blender's triangles each is; None = all are there, in their order
    """

    content: Content
    mesh: raytracer.Mesh
    polygons: NDArray[np.int32]
    rows: NDArray[np.intp] | None = None


def make_shape(mesh: Any, is_edited: bool, last: Shape | None) -> Shape | None:
    """Return an evaluated mesh, `last` itself if nothing changed; None where there is nothing to hit."""
    if not len(mesh.polygons):
        return None
    mesh.calc_loop_triangles()
    content = read_content(mesh, is_edited)
    if last is not None and is_same(content, last.content):
        return last
    positions, _, polygons, hidden = content
    # Vertex indices are not negative: uintc is what Blender copies without converting.
    triangles = read_array(mesh.loop_triangles, "vertices", np.uintc, 3).view(np.intc)  # (t, 3)
    kept = find_finite_triangles(positions, triangles, mesh.name, WarningList())  # (t,) or None
    if hidden is not None:
        kept = ~hidden[polygons] if kept is None else kept & ~hidden[polygons]
    rows = None
    if kept is not None:
        rows, triangles, polygons = np.flatnonzero(kept), triangles[kept], polygons[kept]
        positions = np.where(np.isfinite(positions), positions, 0.0)
    return Shape(content, raytracer.Mesh(positions, triangles), polygons, rows) if len(triangles) else None


def read_content(mesh: Any, is_edited: bool) -> Content:
    """Return positions, corner vertices, the polygon of each triangle, and which polygons are hidden."""
    positions = read_attribute(mesh, "position", "vector", np.float32, 3)
    corners = read_attribute(mesh, ".corner_vert", "value", np.intc)
    assert positions is not None
    assert corners is not None
    polygons = read_array(mesh.loop_triangle_polygons, "value", np.intc)
    return positions, corners, polygons, read_attribute(mesh, ".hide_poly", "value", np.bool_) if is_edited else None


def is_same(content: Content, last: Content) -> bool:
    """Return True where both hold the same bytes; a NaN is the same as itself."""
    return all(
        (one is None) == (other is None)
        and (one is None or other is None or np.array_equal(one.view(np.uint8), other.view(np.uint8)))
        for one, other in zip(content, last, strict=True)
    )
