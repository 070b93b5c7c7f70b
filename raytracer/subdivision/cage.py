"""The polygons that a subdivision surface starts from, and the quadrilaterals that the first step makes of them.

Each corner of a polygon becomes one quadrilateral: from the corner (u, v) = (0, 0) to the middle of the edge that
follows, (1, 0), to the middle of the polygon, (1, 1), and to the middle of the edge before, (0, 1). So a quadrilateral
has the number of its corner, and values at corners are bilinear in it (over the whole polygon, if that has four).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats, Indices

Corners = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Polygons:
    """Polygons by their corners.

    vertex : (c,) of each corner, polygon after polygon, counter-clockwise seen from the front
    start : (f + 1,) the first corner of each polygon, and c
    """

    vertex: Corners
    start: Corners

    @cached_property
    def face(self) -> Corners:
        """(c,) The polygon of each corner."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    @cached_property
    def following(self) -> Corners:
        """(c,) The next corner of the polygon."""
        corner = np.arange(len(self.vertex)) + 1
        corner[self.start[1:] - 1] = self.start[:-1]
        return corner

    @cached_property
    def previous(self) -> Corners:
        """(c,) The corner before in the polygon."""
        corner = np.arange(len(self.vertex)) - 1
        corner[self.start[:-1]] = self.start[1:] - 1
        return corner

    @cached_property
    def sides(self) -> tuple[Corners, Corners]:
        """(e, 2) The vertices of all edges, lower first, and (c,) the edge from each corner to the next."""
        ends = np.sort(np.stack([self.vertex, self.vertex[self.following]], axis=1), axis=1)
        found, edge = unique_pairs(ends)
        return found, edge


@dataclass(frozen=True, eq=False)
class Cage:
    """What a subdivision surface is made of, but for the values at its vertices.

    polygons : its polygons
    count : of its vertices
    creases : (n, 2) the vertices of edges that are sharper than others, and crease_sharpness (n,): for so many
        refinements they are creases; those of a border, and from `INFINITE` on, for ever
    vertex_sharpness : (v,) the same of vertices
    keeps_corners : True where vertices of one polygon alone are sharp
    """

    polygons: Polygons
    count: int
    creases: Corners
    crease_sharpness: Floats
    vertex_sharpness: Floats
    keeps_corners: bool = False


# From here on an edge stays sharp for ever.
INFINITE = 10.0


def unique_pairs(pairs: Corners) -> tuple[Corners, Corners]:
    """Return the different rows of (n, 2) whole numbers, sorted, and (n,) the row among them that each is."""
    if not len(pairs):
        return pairs.astype(np.intp), np.zeros(0, np.intp)
    factor = int(pairs[:, 1].max()) + 1
    keys, place = np.unique(pairs[:, 0].astype(np.int64) * factor + pairs[:, 1], return_inverse=True)
    return np.stack([keys // factor, keys % factor], axis=1).astype(np.intp), place.reshape(-1)


def number_quads(cage: Cage) -> tuple[Indices, int]:
    """Return (c, 4) the vertices of the quadrilaterals, and how many there are: vertices of the cage, then middles of
    edges, then of polygons."""
    polygons = cage.polygons
    edges, edge = polygons.sides
    middle = cage.count + edge
    centre = cage.count + len(edges) + polygons.face
    quads = np.stack([polygons.vertex, middle, centre, middle[polygons.previous]], axis=1)
    return quads, cage.count + len(edges) + len(polygons.start) - 1


def sum_by(index: Corners, values: Floats, count: int) -> Floats:
    """Return (count, k) sums of the rows of values (n, k) by an index (n,), in their order."""
    columns = [np.bincount(index, weights=column, minlength=count) for column in values.T]
    return np.stack(columns, axis=1) if columns else np.zeros((count, 0))


def mean_of_polygons(polygons: Polygons, corner_values: Floats) -> Floats:
    """Return (f, k) the mean of values at corners (c, k), of each polygon."""
    faces = len(polygons.start) - 1
    return sum_by(polygons.face, corner_values, faces) / np.diff(polygons.start)[:, np.newaxis]


def interpolate_corners(polygons: Polygons, corner_values: Floats, quad: Indices, uv: Floats) -> Floats:
    """Return values (n, k) at places (u, v) (n, 2) of quadrilaterals (n,), bilinear in values at corners (c, k)."""
    u, v = uv[:, :1], uv[:, 1:]
    here = corner_values[quad]
    after = 0.5 * (here + corner_values[polygons.following[quad]])
    before = 0.5 * (here + corner_values[polygons.previous[quad]])
    centre = mean_of_polygons(polygons, corner_values)[polygons.face[quad]]
    return (1.0 - v) * ((1.0 - u) * here + u * after) + v * ((1.0 - u) * before + u * centre)
