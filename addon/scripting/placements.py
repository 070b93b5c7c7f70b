"""What Scene.ray_cast sees, in its order: for each object of the view layer first its instances, then itself.

It differs from what a render shows: an object has to be visible in the viewport, whatever its display type, its ray
visibility and its instancer's settings say; point clouds, hair and background scenes are passed. What is to be hit
instead is said by a `Selection`.
Facts: Blender's editors/transform/transform_snap_object.cc, and experiments with 4.2, 5.0 and 5.2.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..extract.meshes import open_mesh
from .selection import Selection, list_shown
from .shapes import Shape, make_shape

# What a mesh is called from call to call: its object's `session_uid`, and which of that object's meshes it is.
Key = tuple[int, int]
# The persistent id of what is no instance.
NO_ID = (0,) * 8


class Placement(NamedTuple):
    """One mesh in one place.

    shape : the mesh
    original : the original object; of an instance, the one that is instanced
    world_from_object : (4, 4) float64
    instancer : the original object that makes the instance; None for an object where it stands
    persistent_id : Blender's eight numbers of the instance
    detail : what was asked for of the object shown
    """

    shape: Shape
    original: Any
    world_from_object: NDArray[np.float64]
    instancer: Any = None
    persistent_id: tuple[int, ...] = NO_ID
    detail: Any = None


class ShapeTable:
    """The shapes of one walk, each read once; `shapes` has them by key, to begin the next walk with."""

    def __init__(self, last: Mapping[Key, Shape], describe: Callable[[Any], Any] | None = None) -> None:
        self.shapes: dict[Key, Shape] = {}
        self.describe = describe
        self._last = last
        self._count: Counter[int] = Counter()
        # Addresses tell meshes apart within a walk, while all of them exist.
        self._known: dict[int, Shape | None] = {}

    def find_shape(self, source: Any, shown: Any) -> Shape | None:
        """Return the mesh of an evaluated object, or None where there is nothing to hit.

        source : the object, or the one that is instanced; shown : the one that has the mesh
        """
        pointer = shown.data.as_pointer()
        if pointer not in self._known:
            identity = source.original.session_uid
            key = identity, self._count[identity]
            self._count[identity] += 1
            with open_mesh(source, shown.data) as mesh:
                shape = make_shape(mesh, shown.data.is_editmode, self._last.get(key))
                if shape is not None:
                    self.shapes[key] = shape
                    self.visit(key, shown, mesh)
            self._known[pointer] = shape
        return self._known[pointer]

    def visit(self, key: Key, shown: Any, mesh: Any) -> None:
        """Look at a mesh while it can be read."""


def list_placements(depsgraph: Any, table: ShapeTable, selection: Selection) -> list[Placement]:
    """Return what rays can hit; what is listed first wins where surfaces coincide, as in Blender."""
    instances = group_instances(depsgraph, table, selection)
    placements: list[Placement] = []
    for original in list_shown(selection, depsgraph.view_layer):
        placements += instances.get(original.session_uid, ())
        if selection.includes(original):
            placements += place_itself(original.evaluated_get(depsgraph), depsgraph.view_layer, table, selection)
    return placements


def group_instances(depsgraph: Any, table: ShapeTable, selection: Selection) -> dict[int, list[Placement]]:
    """Return the instances that each object makes, by the `session_uid` of that object.

    Text, curves, surfaces and metaballs are listed here too: their meshes are instances that they make of themselves.
    """
    groups: defaultdict[int, list[Placement]] = defaultdict(list)
    for instance in depsgraph.object_instances:
        if not instance.is_instance or instance.object.type != "MESH":
            continue
        shown, source, instancer = instance.object, instance.instance_object, instance.parent
        if not selection.includes(source.original, instancer.original):
            continue
        if not selection.sees(shown, source, instancer, depsgraph.view_layer):
            continue
        shape, matrix = table.find_shape(source, shown), np.array(instance.matrix_world, dtype=np.float64)
        if shape is not None and is_placed(matrix):
            detail = table.describe(shown) if table.describe else None
            identity = tuple(instance.persistent_id)
            placement = Placement(shape, source.original, matrix, instancer.original, identity, detail)
            groups[instancer.original.session_uid].append(placement)
    return groups


def place_itself(evaluated: Any, view_layer: Any, table: ShapeTable, selection: Selection) -> list[Placement]:
    """Return an evaluated object where it stands; nothing for one that has no mesh or is not in the depsgraph."""
    if evaluated.type != "MESH" or not evaluated.is_evaluated:
        return []
    if not selection.sees(evaluated, evaluated, evaluated, view_layer):
        return []
    shape, matrix = table.find_shape(evaluated, evaluated), np.array(evaluated.matrix_world, dtype=np.float64)
    if shape is None or not is_placed(matrix):
        return []
    detail = table.describe(evaluated) if table.describe else None
    return [Placement(shape, evaluated.original, matrix, detail=detail)]


def is_placed(matrix: NDArray[np.float64]) -> bool:
    """Return True where a matrix (4, 4) is finite; its last row, where a parent's inverse may hold anything, is set."""
    matrix[3] = (0.0, 0.0, 0.0, 1.0)
    return bool(np.isfinite(matrix).all())
