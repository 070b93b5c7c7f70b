"""What Scene.ray_cast sees, in its order: for each object of the view layer first its instances, then itself.

It differs from what a render shows: an object has to be visible in the viewport, whatever its display type, its ray
visibility and its instancer's settings say; point clouds, hair and background scenes are passed.
Facts: Blender's editors/transform/transform_snap_object.cc, and experiments with 4.2, 5.0 and 5.2.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import versions
from .shapes import Shape, read_shape

# What a mesh is called from call to call: its object's `session_uid`, and which of that object's meshes it is.
Key = tuple[int, int]


class Placement(NamedTuple):
    """One mesh in one place.

    shape : the mesh
    original : the original object; of an instance, the one that is instanced
    world_from_object : (4, 4) float64
    """

    shape: Shape
    original: Any
    world_from_object: NDArray[np.float64]


class ShapeTable:
    """The shapes of one walk, each read once; `shapes` has them by key, to begin the next walk with."""

    def __init__(self, last: Mapping[Key, Shape]) -> None:
        self.shapes: dict[Key, Shape] = {}
        self._last = last
        self._count: Counter[int] = Counter()
        # Addresses tell meshes apart within a walk, while all of them exist.
        self._known: dict[int, Shape | None] = {}

    def find_shape(self, source: Any, mesh: Any) -> Shape | None:
        """Return an evaluated object's mesh, or None where there is nothing to hit."""
        pointer = mesh.as_pointer()
        if pointer not in self._known:
            identity = source.original.session_uid
            key = identity, self._count[identity]
            self._count[identity] += 1
            shape = read_shape(source, mesh, self._last.get(key))
            self._known[pointer] = shape
            if shape is not None:
                self.shapes[key] = shape
        return self._known[pointer]


def list_placements(depsgraph: Any, table: ShapeTable) -> list[Placement]:
    """Return what rays can hit; what is listed first wins where surfaces coincide, as in Blender."""
    view_layer = depsgraph.view_layer
    instances = group_instances(depsgraph, table)
    placements: list[Placement] = []
    for original in view_layer.objects:
        if original.visible_get(view_layer=view_layer):
            placements += instances.get(original.session_uid, ())
            placements += place_itself(original.evaluated_get(depsgraph), table)
    return placements


def group_instances(depsgraph: Any, table: ShapeTable) -> dict[int, list[Placement]]:
    """Return the instances that each object makes, by the `session_uid` of that object.

    Text, curves, surfaces and metaballs are listed here too: their meshes are instances that they make of themselves.
    """
    groups: defaultdict[int, list[Placement]] = defaultdict(list)
    for instance in depsgraph.object_instances:
        if instance.is_instance and instance.object.type == "MESH":
            source = instance.instance_object
            if not versions.is_hidden_from_picking(source):
                shape = table.find_shape(source, instance.object.data)
                matrix = np.array(instance.matrix_world, dtype=np.float64)
                groups[instance.parent.original.session_uid] += make_placements(shape, source, matrix)
    return groups


def place_itself(evaluated: Any, table: ShapeTable) -> list[Placement]:
    """Return an evaluated object where it stands; nothing for one that has no mesh or is not in the depsgraph."""
    if evaluated.type != "MESH" or not evaluated.is_evaluated or versions.is_hidden_from_picking(evaluated):
        return []
    shape = table.find_shape(evaluated, evaluated.data)
    return make_placements(shape, evaluated, np.array(evaluated.matrix_world, dtype=np.float64))


def make_placements(shape: Shape | None, source: Any, matrix: NDArray[np.float64]) -> list[Placement]:
    """Return the placement of a shape; none without a shape, or where the matrix is not finite."""
    matrix[3] = (0.0, 0.0, 0.0, 1.0)  # a parent's inverse matrix may hold anything there
    return [Placement(shape, source.original, matrix)] if shape is not None and np.isfinite(matrix).all() else []
