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
from raytracer.casting.geometry import Geometry, Ids, Kind, instance_corners, split_id, world_corners
from raytracer.predicates.rounding import gamma


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
        corners[first_row[instance] : first_row[instance + 1]] = instance_corners(geometry, instance).reshape(-1, 9)
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
    for mesh in np.unique(geometry.instance_mesh[instances]):
        first, count = geometry.mesh_first[mesh], geometry.mesh_count[mesh]
        if count:
            used = geometry.positions[geometry.triangles[first : first + count].ravel()]
            boxes[mesh] = extremes(used)
    return bound_images(geometry.world_from_object[instances], boxes[geometry.instance_mesh[instances]])


def bound_images(matrix: Floats, box: Floats) -> Floats:
    """Return boxes (k, 2, 3) that hold all points of given boxes (k, 2, 3), transformed by matrices (k, 4, 4) and
    rounded.

    The box of an affine image: centre M c, half size |M| h. Six roundings each at most (Higham's gamma), relative to
    |M| (|c| + h) + |translation|, are added.
    """
    linear, translation = matrix[:, :3, :3], matrix[:, :3, 3]
    centre, half = box.mean(axis=1), (box[:, 1] - box[:, 0]) / 2
    middle = np.einsum("kij,kj->ki", linear, centre) + translation
    size = np.einsum("kij,kj->ki", np.abs(linear), half)
    scale = np.einsum("kij,kj->ki", np.abs(linear), np.abs(box).max(axis=1)) + np.abs(translation)
    reach = size + gamma(16) * scale
    return np.stack([middle - reach, middle + reach], axis=1)


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
