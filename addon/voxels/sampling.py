"""Grids of an OpenVDB file as arrays: geometry nodes sample them at each voxel, in a Blender of its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

# Voxels that are sampled at a time: numbers of points up to here are exact in the nodes' float32, and so are the
# coordinates that follow from them.
SLAB = 2**22
# Voxels of a grid's box at most: 0.5 GB of them.
MOST_VOXELS = 2**27
# Blender's types of grids, as nodes know them, and numbers of a value.
GRID_TYPES = {"FLOAT": ("FLOAT", 1), "INT": ("INT", 1), "VECTOR_FLOAT": ("VECTOR", 3)}
ATTRIBUTE = {"FLOAT": ("FLOAT", "value"), "INT": ("INT", "value"), "VECTOR": ("FLOAT_VECTOR", "vector")}


class Voxels(NamedTuple):
    """values : (x, y, z) or (x, y, z, 3) float32, around which there is 0; object_from_index : (4, 4) float64"""

    values: NDArray[np.float32]
    object_from_index: NDArray[np.float64]


def carry_out(folder: Path, number: str, *names: str) -> None:
    """Read grids of the file FOLDER/NUMBER.vdb into FOLDER/NUMBER.npz, for `own_blender.child`."""
    grids = read_file(folder / f"{number}.vdb", names)
    arrays = {
        f"{field}_{names.index(name)}": array for name, grid in grids.items() for field, array in grid._asdict().items()
    }
    np.savez(folder / f"{number}.npz", **arrays)


def read_file(path: Path, names: Sequence[str]) -> dict[str, Voxels]:
    """Return the grids of a file by name; those of a type that nodes do not know are left out.

    Raises
    ------
    ValueError
        If a grid is too large, or the file cannot be read.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    experimental = bpy.context.preferences.experimental
    if hasattr(experimental, "use_new_volume_nodes"):  # Blender up to 4.5
        experimental.use_new_volume_nodes = True
    volume = bpy.data.volumes.new("Volume")
    volume.filepath = str(path)
    if not volume.grids.load():
        raise ValueError(f"its file cannot be read: {volume.grids.error_message}")
    shown = bpy.data.objects.new("Volume", volume)
    bpy.context.scene.collection.objects.link(shown)
    bpy.context.view_layer.update()
    corners = np.array(shown.evaluated_get(bpy.context.evaluated_depsgraph_get()).bound_box, dtype=np.float64)
    wanted = [grid for grid in volume.grids if grid.name in names and grid.data_type in GRID_TYPES]
    return {grid.name: read_grid(shown, grid, corners) for grid in wanted}


def read_grid(shown: Any, grid: Any, corners: NDArray[np.float64]) -> Voxels:
    """Return a grid of a volume object.

    corners : (8, 3) of a box, in object space, outside of which no grid of the object has voxels
    """
    object_from_index = np.array(grid.matrix_object, dtype=np.float64)
    index_from_object = np.linalg.inv(object_from_index)
    places = corners @ index_from_object[:3, :3].T + index_from_object[:3, 3]  # (8, 3)
    low, high = np.floor(places.min(axis=0)).astype(int), np.ceil(places.max(axis=0)).astype(int)
    size = high - low + 1
    if np.prod(size, dtype=np.float64) > MOST_VOXELS:
        box = " x ".join(map(str, size))
        raise ValueError(f"the box of its grid '{grid.name}' has {box} voxels, more than {MOST_VOXELS}")
    values = Sampler(shown, grid.name, GRID_TYPES[grid.data_type][0]).sample(low, size)
    first, values = trim(values)
    shift = np.eye(4)
    shift[:3, 3] = low + first
    return Voxels(values, object_from_index @ shift)


def trim(values: NDArray[np.float32]) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Return the first corner of the box (x, y, z) or (x, y, z, 3) that holds all values but 0, and the box: one voxel
    at least."""
    used = values != 0 if values.ndim == 3 else (values != 0).any(axis=3)
    if not used.any():
        return np.zeros(3, dtype=np.intp), np.ascontiguousarray(values[:1, :1, :1])
    along = [np.flatnonzero(used.any(axis=tuple({0, 1, 2} - {axis}))) for axis in range(3)]
    first = np.array([places[0] for places in along])
    last = np.array([places[-1] for places in along])
    box = tuple(slice(start, stop + 1) for start, stop in zip(first, last, strict=True))
    return first, np.ascontiguousarray(values[box])


class Sampler:
    """A mesh whose vertices hold the values of a grid, one each, by a modifier of nodes.

    The vertex with number p stands for the voxel at low + (x, y, z), where z = p mod n_z, y = (p div n_z) mod n_y and
    x = p div (n_y n_z).
    """

    def __init__(self, shown: Any, name: str, kind: str) -> None:
        self._kind = kind
        self._tree = bpy.data.node_groups.new("Sample", "GeometryNodeTree")
        self._tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
        self._count, self._size, self._low = self._build(shown, name)
        self._mesh = bpy.data.objects.new("Samples", bpy.data.meshes.new("Samples"))
        bpy.context.scene.collection.objects.link(self._mesh)
        self._mesh.modifiers.new("Sample", "NODES").node_group = self._tree

    def _add(self, kind: str, links: dict[Any, Any] | None = None, **properties: Any) -> Any:
        """Add a node, set properties, and link or set inputs by name or number."""
        node = self._tree.nodes.new(kind)
        for name, value in properties.items():
            setattr(node, name, value)
        for key, value in (links or {}).items():
            found = [socket for socket in node.inputs if socket.enabled and socket.name == key]
            socket = found[0] if found else node.inputs[key]
            if hasattr(value, "is_output"):
                self._tree.links.new(value, socket)
            else:
                socket.default_value = value
        return node

    def _compute(self, operation: str, first: Any, second: Any = 0.0) -> Any:
        return self._add("ShaderNodeMath", {0: first, 1: second}, operation=operation).outputs[0]

    def _build(self, shown: Any, name: str) -> tuple[Any, list[Any], list[Any]]:
        """Make the nodes; return the input that counts points, and the outputs that hold the size and the first voxel
        of what is sampled."""
        size, low = ([self._add("ShaderNodeValue").outputs[0] for _ in range(3)] for _ in range(2))
        number = self._add("GeometryNodeInputIndex").outputs[0]
        row = self._compute("FLOOR", self._compute("DIVIDE", number, size[2]))
        inside = (
            self._compute("FLOOR", self._compute("DIVIDE", row, size[1])),
            self._compute("MODULO", row, size[1]),
            self._compute("MODULO", number, size[2]),
        )
        place = [self._compute("ADD", first, each) for first, each in zip(low, inside, strict=True)]
        geometry = self._add("GeometryNodeObjectInfo", {"Object": shown}).outputs["Geometry"]
        found = self._add("GeometryNodeGetNamedGrid", {"Volume": geometry, "Name": name}, data_type=self._kind)
        grid = next(output for output in found.outputs if output.name == "Grid" and output.enabled)
        sampled = self._add(
            "GeometryNodeSampleGridIndex",
            {"Grid": grid, **dict(zip("XYZ", place, strict=True))},
            data_type=self._kind,
        )
        value = next(output for output in sampled.outputs if output.enabled)
        points = self._add("GeometryNodePoints", {"Count": 1})
        stored = self._add(
            "GeometryNodeStoreNamedAttribute",
            {"Geometry": points.outputs[0], "Name": "value", "Value": value},
            data_type=ATTRIBUTE[self._kind][0],
            domain="POINT",
        )
        vertices = self._add("GeometryNodePointsToVertices", {0: stored.outputs[0]})
        self._add("NodeGroupOutput", {0: vertices.outputs[0]})
        return points.inputs["Count"], size, low

    def sample(self, low: NDArray[Any], size: NDArray[Any]) -> NDArray[np.float32]:
        """Return the values (x, y, z) or (x, y, z, 3) of the voxels from `low` on, `size` of them along each axis."""
        rows = max(1, SLAB // int(size[1] * size[2]))
        slabs = [
            self._sample_slab(low + np.array((start, 0, 0)), np.array((min(rows, size[0] - start), *size[1:])))
            for start in range(0, size[0], rows)
        ]
        return np.concatenate(slabs)

    def _sample_slab(self, low: NDArray[Any], size: NDArray[Any]) -> NDArray[np.float32]:
        for socket, number in zip((*self._size, *self._low), (*size, *low), strict=True):
            socket.default_value = float(number)
        self._count.default_value = int(np.prod(size))
        bpy.context.view_layer.update()
        attribute = self._mesh.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.attributes["value"]
        width = 3 if self._kind == "VECTOR" else 1
        flat = np.empty(len(attribute.data) * width, dtype=np.intc if self._kind == "INT" else np.float32)
        attribute.data.foreach_get(ATTRIBUTE[self._kind][1], flat)
        shape = tuple(size) if width == 1 else (*size, width)
        return flat.reshape(shape).astype(np.float32)
