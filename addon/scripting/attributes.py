"""Attributes and materials at hits, read when they are asked for: nothing of them is kept with the hits.

The walk over the depsgraph is done again, as it was when rays were cast; so the meshes of generated instances, which no
object has, can be read as well. A mesh that has changed since is told by its content.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats, Indices, Integers
from raytracer.surfaces.surface_tables import interpolate

from ..extract.attributes import ATTRIBUTE_TYPES
from ..extract.meshes import read_array, read_corners
from .held import View
from .placements import Key, Placement, ShapeTable, list_placements
from .shapes import Shape

# More of Blender's types than materials read: the field of their values, NumPy's type, and numbers per value.
TYPES = {
    **ATTRIBUTE_TYPES,
    "INT16_2D": ("value", np.intc, 2),
    "INT32_2D": ("value", np.intc, 2),
    "QUATERNION": ("value", np.float32, 4),
    "FLOAT4X4": ("value", np.float32, 16),
}


@dataclass(frozen=True, eq=False)
class HitPlaces:
    """Where things were hit, one row for each hit or miss.

    view : what was cast into
    shapes : by key, and shape_of_placement : as the caster has them
    placement, primitive : (m,) int32; -1 for a miss
    weights : (m, 2) float64, of corners 1 and 2
    shape : of arrays with a value for each
    """

    view: View
    shapes: dict[Key, Shape]
    shape_of_placement: tuple[Shape, ...]
    placement: Integers
    primitive: Integers
    weights: Floats
    shape: tuple[int, ...]


class AttributeTable(ShapeTable):
    """Reads an attribute of each shape that is hit, at its hits.

    rows : by key, the hits of each shape
    found : by key, the values at those, (k, width)
    names : what the shapes have instead
    """

    def __init__(self, places: HitPlaces, name: str, describe: Any = None) -> None:
        super().__init__(places.shapes, describe)
        self.places, self.name = places, name
        self.rows = find_rows(places)
        self.found: dict[Key, Floats] = {}
        self.names: set[str] = set()

    def visit(self, key: Key, shown: Any, mesh: Any) -> None:
        """Read the attribute of a shape that is hit."""
        if key not in self.rows:
            return
        shape, rows = self.places.shapes[key], self.rows[key]
        if self.shapes[key] is not shape:
            raise ValueError(f"attribute: the mesh of '{shown.name}' has changed since the rays were cast")
        primitive, weights = self.places.primitive[rows], self.places.weights[rows]
        if self.name in mesh.attributes:
            self.found[key] = sample(mesh.attributes[self.name], mesh, shape, primitive, weights)
        elif self.name in shown.vertex_groups:
            group = shown.vertex_groups[self.name].index
            corners = shape.mesh.triangles[primitive]  # (k, 3)
            self.found[key] = mix(read_group(mesh, group, corners), weights)
        else:
            names = (*mesh.attributes.keys(), *shown.vertex_groups.keys())
            self.names |= {name for name in names if not name.startswith(".")}


def find_rows(places: HitPlaces) -> dict[Key, Indices]:
    """Return the rows of the hits of each shape that is hit, by its key."""
    keys = list(places.shapes)
    number = {id(shape): row for row, shape in enumerate(places.shapes.values())}
    of_placement = np.array([*(number[id(shape)] for shape in places.shape_of_placement), -1], dtype=np.int64)
    shape = of_placement[places.placement]  # (m,); -1 for a miss
    order = np.argsort(shape, kind="stable")
    starts = np.searchsorted(shape[order], np.arange(len(keys) + 1))
    return {
        key: order[start:stop] for key, start, stop in zip(keys, starts[:-1], starts[1:], strict=True) if stop > start
    }


def sample(attribute: Any, mesh: Any, shape: Shape, primitive: Integers, weights: Floats) -> Floats:
    """Return the values (k, width) of an attribute on triangles of a shape.

    Raises
    ------
    ValueError
        If its values are no numbers, or belong to edges.
    """
    if attribute.data_type not in TYPES or attribute.domain not in ("POINT", "CORNER", "FACE"):
        kind = f"{attribute.data_type} of {attribute.domain}"
        raise ValueError(f"name: expected an attribute of numbers on vertices, corners or faces, got {kind}")
    field, dtype, width = TYPES[attribute.data_type]
    values = read_array(attribute.data, field, dtype, width).reshape(-1, width)
    if attribute.domain == "FACE":
        return values[shape.polygons[primitive]].astype(np.float64)
    if attribute.domain == "POINT":
        return mix(values[shape.mesh.triangles[primitive]], weights)
    rows = primitive if shape.rows is None else shape.rows[primitive]
    return mix(values[read_corners(mesh)[rows]], weights)


def mix(corners: NDArray[Any], weights: Floats) -> Floats:
    """Return the mean (k, width) of values at corners (k, 3, width)."""
    a, b, c = np.moveaxis(corners.astype(np.float64), 1, 0)
    return interpolate(weights, a, b, c)


def read_group(mesh: Any, group: int, corners: Integers) -> Floats:
    """Return the weights (k, 3, 1) of a vertex group at vertices (k, 3); 0 for those that are not in it.

    Blender has no fast way to read them: only the vertices that are asked for are.
    """
    vertices, place = np.unique(corners, return_inverse=True)
    weights = [
        next((member.weight for member in mesh.vertices[vertex].groups if member.group == group), 0.0)
        for vertex in vertices.tolist()
    ]
    return np.array(weights)[place].reshape(*corners.shape, 1)


def read_attribute(places: HitPlaces, name: str, depsgraph: Any = None) -> Floats:
    """Return an attribute at hits, see `RayCastResult.attribute`."""
    if not isinstance(name, str) or not name:
        raise ValueError(f"name: expected the name of an attribute or a vertex group, got {name!r}")
    table = AttributeTable(places, name)
    walk(table, places, depsgraph)
    if table.rows and not table.found:
        known = ", ".join(sorted(table.names)) or "none"
        raise ValueError(
            f"name: expected an attribute or a vertex group of the meshes that are hit ({known}), got {name!r}"
        )
    widths = {values.shape[1] for values in table.found.values()} or {1}
    if len(widths) > 1:
        raise ValueError(
            f"name: {name!r} has {min(widths)} numbers on some meshes that are hit and {max(widths)} on others"
        )
    width = widths.pop()
    result = np.full((len(places.placement), width), np.nan)
    for key, values in table.found.items():
        result[table.rows[key]] = values
    return result.reshape(places.shape if width == 1 else (*places.shape, width))


def read_materials(places: HitPlaces) -> tuple[tuple[Any, ...], Integers]:
    """Return the materials that are hit, and the index of each hit's (m,), -1 where there is none."""
    table = AttributeTable(places, "material_index", list_slots)
    placements = walk(table, places, None)
    slot = np.zeros(len(places.placement), dtype=np.int64)
    for key, values in table.found.items():
        slot[table.rows[key]] = values[:, 0]
    if tuple(placement.shape for placement in placements) != places.shape_of_placement:
        raise ValueError("material: the scene has changed since the rays were cast")
    number: dict[Any, int] = {None: -1}
    result = np.full(len(slot), -1, dtype=np.int32)
    hit = np.flatnonzero(places.placement >= 0)
    pairs, place = np.unique(np.stack([places.placement[hit], slot[hit]], axis=1), axis=0, return_inverse=True)
    chosen = [find_material(placements[one].detail, which) for one, which in pairs.tolist()]
    for material in chosen:
        number.setdefault(material, len(number) - 1)
    result[hit] = np.array([number[material] for material in chosen], dtype=np.int32)[place.ravel()]
    return tuple(number)[1:], result.reshape(places.shape)


def list_slots(shown: Any) -> list[Any]:
    """Return the original material of each slot of an evaluated object, or None."""
    return [slot.material.original if slot.material else None for slot in shown.material_slots]


def find_material(slots: Sequence[Any], slot: int) -> Any:
    """Return the material of a slot; beyond the last, that of the last, as in renders."""
    return slots[min(max(slot, 0), len(slots) - 1)] if slots else None


def walk(table: ShapeTable, places: HitPlaces, depsgraph: Any) -> list[Placement]:
    """Go again over what was cast into."""
    return list_placements(depsgraph or find_depsgraph(places.view), table, places.view[3])


def find_depsgraph(view: View) -> Any:
    """Return the depsgraph of a view, up to date.

    Raises
    ------
    ValueError
        If it is that of a render, which cannot be found again, or its scene or view layer is gone.
    """
    scene_id, layer_name, mode, _ = view
    if mode != "VIEWPORT":
        raise ValueError("depsgraph: expected the one that was cast into, which is a render's, got None")
    scene = next((scene for scene in bpy.data.scenes if scene.session_uid == scene_id), None)
    layer = scene.view_layers.get(layer_name) if scene else None
    if layer is None or layer.depsgraph is None:
        raise ValueError(f"depsgraph: the view layer '{layer_name}' that was cast into is gone")
    layer.depsgraph.update()
    return layer.depsgraph
