"""World-space primitives by id: corners of triangles, centres and radii of spheres.

Instances whose triangles are few enough are flattened: their world corners are computed once, when the caster is
built. The others share their mesh's geometry, and the corners of a candidate are computed when it is tested, by the
same formula (`geometry.transform_points`), so that both give the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats
from raytracer.casting.geometry import Geometry, Ids, Kind, fill_corners, list_meshes, split_id, world_corners
from raytracer.predicates.rounding import gamma

# Instances whose boxes are found together: what they need stays within the cache.
BLOCK = 1 << 13


@dataclass(frozen=True, eq=False)
class Primitives:
    """The primitives that candidates refer to.

    corners : (f, 9) world corners a, b, c of the flattened instances' triangles, in the precision's dtype
    flattened : (i,) bool
    row_shift : (i,) int64, add to a primitive id of a flattened instance to get its row in `corners`
    bounds : (2, 3) float64, a box around all triangles; the origin where there are none
    """

    geometry: Geometry
    precision: str
    corners: NDArray
    flattened: Booleans
    row_shift: Ids
    bounds: Floats

    @property
    def dtype(self) -> np.dtype:
        return self.corners.dtype


def make_primitives(geometry: Geometry, precision: str, flattened: Booleans) -> Primitives:
    """Compute the world corners of the instances marked in `flattened`, (i,) bool."""
    counts = np.diff(geometry.first_id)[: len(flattened)]
    first_row = np.concatenate([[0], np.cumsum(np.where(flattened, counts, 0))]).astype(np.int64)
    corners = np.empty((first_row[-1], 9), np.float32 if precision == "float32" else np.float64)
    for instance in np.flatnonzero(flattened):  # one array operation per instance, when the caster is built
        fill_corners(geometry, instance, corners[first_row[instance] : first_row[instance + 1]].reshape(-1, 3, 3))
    points = corners.reshape(-1, 3)
    placed = instance_bounds(geometry, np.flatnonzero(~flattened)).reshape(-1, 3)
    everything = np.concatenate([extremes(points), placed])
    row_shift = first_row[:-1] - geometry.first_id[: len(flattened)]
    bounds = extremes(everything) if len(everything) else np.zeros((2, 3))
    return Primitives(geometry, precision, corners, flattened, row_shift, bounds)


def extremes(points: NDArray) -> NDArray:
    """(2, 3) lowest and highest coordinates; empty where there are no points."""
    if not len(points):
        return np.zeros((0, 3))
    # Column by column: a reduction over the rows of three columns takes fifteen times as long.
    return np.array([[column.min() for column in points.T], [column.max() for column in points.T]])


def instance_bounds(geometry: Geometry, instances: NDArray) -> Floats:
    """Return world boxes (k, 2, 3) that hold every rounded world corner of the given instances."""
    boxes = np.zeros((len(geometry.mesh_first), 2, 3))
    for mesh in list_meshes(geometry, instances):
        first, count = geometry.mesh_first[mesh], geometry.mesh_count[mesh]
        if count:
            used = geometry.positions[geometry.triangles[first : first + count].ravel()]
            boxes[mesh] = extremes(used)
    mesh, bounds = geometry.instance_mesh, np.empty((len(instances), 2, 3))
    for start in range(0, len(instances), BLOCK):
        part = instances[start : start + BLOCK]
        bounds[start : start + BLOCK] = bound_images(geometry.world_from_object[part], boxes.take(mesh[part], axis=0))
    return bounds


def bound_images(matrix: Floats, box: Floats) -> Floats:
    """Return boxes (k, 2, 3) that hold all points of given boxes (k, 2, 3), transformed by matrices (k, 4, 4) and
    rounded.

    The box of an affine image: centre M c, half size |M| h. Six roundings each at most (Higham's gamma), relative to
    |M| (|c| + h) + |translation|, are added.
    """
    x, y, z, translation = np.ascontiguousarray(matrix[:, :3].transpose(2, 1, 0))  # (3, k) each: columns
    low, high = np.ascontiguousarray(box.transpose(1, 2, 0))  # (3, k) each
    centre, half, largest = (low + high) / 2, (high - low) / 2, np.maximum(np.abs(low), np.abs(high))
    middle = x * centre[0] + y * centre[1] + z * centre[2] + translation
    x, y, z, translation = (np.abs(column) for column in (x, y, z, translation))
    size = x * half[0] + y * half[1] + z * half[2]
    scale = x * largest[0] + y * largest[1] + z * largest[2] + translation
    reach = size + gamma(16) * scale
    return np.stack([middle - reach, middle + reach]).transpose(2, 0, 1)


def find_rows(primitives: Primitives, primitive_id: Ids) -> Ids:
    """Return the rows of `corners` that hold triangles of flattened instances."""
    if primitives.flattened.all():
        return primitive_id
    instance, _ = split_id(primitives.geometry, primitive_id)
    return primitive_id + primitives.row_shift[instance]


def name_rows(primitives: Primitives, row: Ids) -> Ids:
    """Return the primitive ids of rows of `corners`."""
    if primitives.flattened.all():
        return row
    flat = np.flatnonzero(primitives.flattened)
    first_row = primitives.geometry.first_id[flat] + primitives.row_shift[flat]
    return row - primitives.row_shift[flat[np.searchsorted(first_row, row, side="right") - 1]]


def gather_corners(primitives: Primitives, primitive_id: Ids, turn: Sequence[int] = (0, 1, 2)) -> NDArray:
    """Return the (9, k) planes of world corners of triangle ids, each corner's coordinates in the order `turn`."""
    rows = _gather_rows(primitives, primitive_id)
    planes = np.empty((9, len(rows)), rows.dtype)
    for corner in (0, 3, 6):
        for place, coordinate in enumerate(turn):
            planes[corner + place] = rows[:, corner + coordinate]
    return planes


def find_corners(primitives: Primitives, primitive_id: Ids) -> tuple[NDArray, Ids]:
    """Return numbers, of which each nine are world corners a, b, c, and which nines are those of triangle ids (k,)."""
    if primitives.flattened.all():
        return primitives.corners.reshape(-1), primitive_id
    return _gather_rows(primitives, primitive_id).reshape(-1), np.arange(len(primitive_id))


def _gather_rows(primitives: Primitives, primitive_id: Ids) -> NDArray:
    """(k, 9) world corners of triangle ids."""
    if primitives.flattened.all():
        return primitives.corners.take(primitive_id, axis=0)
    instance, primitive = split_id(primitives.geometry, primitive_id)
    flat = primitives.flattened[instance]
    rows = np.empty((len(primitive_id), 9), primitives.dtype)
    rows[flat] = primitives.corners[primitive_id[flat] + primitives.row_shift[instance[flat]]]
    if not flat.all():
        placed = ~flat
        rows[placed] = np.concatenate(world_corners(primitives.geometry, instance[placed], primitive[placed]), axis=1)
    return rows


def gather_spheres(primitives: Primitives, primitive_id: Ids) -> tuple[NDArray, NDArray]:
    """Return the (3, k) centres and (k,) radii of sphere ids."""
    row = primitives.geometry.find_rows(primitive_id, Kind.SPHERE)
    centre = np.ascontiguousarray(primitives.geometry.centres[row].T, dtype=primitives.dtype)
    return centre, primitives.geometry.radii[row].astype(primitives.dtype)
