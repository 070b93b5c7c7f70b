"""The closest primitive of each point: boxes that lie farther away than another lies in whole are left out.

All points go down together, level by level: at a distance D boxes of size s that may hold the closest primitive lie
within about s of the foot, because the farthest corner of the box at the foot is D + s^2 / 2 D away, no more. Pairs
(point, node) are opened in blocks, so that memory stays bounded however many boxes are equally far, as at the center of
a sphere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytracer.arrays.checks import as_array
from raytracer.arrays.rows import take_rows
from raytracer.arrays.types import Booleans, Floats, Indices, Integers, Numbers, Pairs, Vectors
from raytracer.casting.inside import as_points
from raytracer.casting.nearest.distances import Measured, measure_spheres, measure_triangles
from raytracer.casting.nearest.forest import Forest
from raytracer.casting.primitives import Primitives, gather_corners
from raytracer.lecture import length

# Pairs opened at a time, and points per batch: some tens of megabytes.
BLOCK_PAIRS = 1 << 17
BATCH_POINTS = 1 << 16


@dataclass(frozen=True, eq=False, slots=True)
class ClosestPoints:
    """The closest point of a scene to each of n points; where there is none: distance inf, indices -1.

    distance : (n,) float64, metres; inf = none
    distance_error : (n,) float64, metres, certified bound on |distance - exact|; 0 where there is none
    location : (n, 3) float64, metres, world, the closest point; 0 where there is none
    instance, primitive : (n,) int32, as in Hits; -1 = none
    barycentric : (n, 2) float64, weights of the triangle's corners 1 and 2; 0 for spheres
    """

    distance: Numbers
    distance_error: Numbers
    location: Vectors
    instance: Integers
    primitive: Integers
    barycentric: Pairs

    def __len__(self) -> int:
        return len(self.distance)

    @property
    def found(self) -> Booleans:
        """(n,) bool, True where there is a closest point."""
        return self.primitive >= 0


class Nodes(NamedTuple):
    """Pairs of point and node, (k,) each: point, owner of the tree, node, the point in the owner's space (k, 3), and a
    lower bound on the distance."""

    point: Indices
    owner: NDArray[np.int64]
    node: NDArray[np.int64]
    local: Floats
    low: Floats

    def select(self, rows: Indices | Booleans | slice) -> Nodes:
        return Nodes(*(take_rows(part, rows) for part in self))


class NearestSearch:
    """The state of n points.

    limit : (n,) what is farther does not count: the least certain distance found so far
    """

    def __init__(self, forest: Forest, primitives: Primitives, points: Floats, limit: Floats) -> None:
        self.forest, self.primitives, self.points, self.limit = forest, primitives, points, limit
        self.geometry = primitives.geometry
        self.size = np.abs(points).max(axis=1) * np.sqrt(3)
        self.measured: list[tuple[Indices, NDArray[np.int64], NDArray[np.int64], Measured]] = []

    def run(self) -> ClosestPoints:
        """Search and choose."""
        top = len(self.forest.root) - 1
        stack = [self._enter(np.arange(len(self.points)), np.full(len(self.points), top))]
        while stack:
            nodes = stack.pop()
            nodes = nodes.select(np.flatnonzero(nodes.low <= self.limit[nodes.point]))
            if len(nodes.point) > BLOCK_PAIRS:
                stack.append(nodes.select(slice(BLOCK_PAIRS, None)))
            opened = self._open(nodes.select(slice(0, BLOCK_PAIRS)))
            if len(opened.point):
                stack.append(opened)
        return self._choose()

    def _enter(self, point: Indices, owner: NDArray[np.int64]) -> Nodes:
        """Return the roots of owners, paired with points."""
        offset = self.points[point] - self.forest.translation[owner]
        local = (self.forest.inverse[owner] * offset[:, np.newaxis]).sum(axis=2)
        return self._bound(point, owner, self.forest.root[owner], local)

    def _bound(self, point: Indices, owner: NDArray[np.int64], node: NDArray[np.int64], local: Floats) -> Nodes:
        box = self.forest.tree.boxes[node]
        below, above = box[:, 0] - local, local - box[:, 1]
        slack = self.forest.slack[owner] * (self.size[point] + self.forest.reach[owner])
        far = length(np.minimum(below, above)) * self.forest.stretch[owner] + slack
        np.minimum.at(self.limit, point, far)  # all of the box's primitives lie that close
        low = length(np.maximum(np.maximum(below, above), 0.0)) * self.forest.shrink[owner] - slack
        return Nodes(point, owner, node, local, low)

    def _open(self, nodes: Nodes) -> Nodes:
        """Return what lies below nodes and may be close enough; measure the primitives of leaves."""
        tree = self.forest.tree
        leaf = tree.leaf[nodes.node]
        inner, leaves = nodes.select(np.flatnonzero(~leaf)), nodes.select(np.flatnonzero(leaf))
        row, child = _spread(tree.first[inner.node], tree.count[inner.node])
        below = self._bound(inner.point[row], inner.owner[row], child, inner.local.take(row, axis=0))
        row, entry = _spread(tree.first[leaves.node], tree.count[leaves.node])
        point, owner, item = leaves.point[row], leaves.owner[row], tree.items[entry]
        is_top = owner == len(self.forest.root) - 1
        self._measure(point[~is_top], owner[~is_top], item[~is_top])
        entered = self._enter(point[is_top], item[is_top])
        joined = Nodes(*(np.concatenate(parts) for parts in zip(below, entered, strict=True)))
        return joined.select(np.flatnonzero(joined.low <= self.limit[joined.point]))

    def _measure(self, point: Indices, owner: NDArray[np.int64], item: NDArray[np.int64]) -> None:
        sphere = owner >= len(self.geometry.instance_mesh)
        for rows in (np.flatnonzero(~sphere), np.flatnonzero(sphere)):
            if not len(rows):
                continue
            places, who, what = point[rows], owner[rows], item[rows]
            if sphere[rows[0]]:
                ball = self.geometry.first_id[who] + what - self.geometry.sphere_id
                found = measure_spheres(self.points[places], self.geometry.centres[ball], self.geometry.radii[ball])
            else:
                ids = self.geometry.first_id[who] + what
                corners = gather_corners(self.primitives, ids).reshape(3, 3, -1)
                found = measure_triangles(self.points[places], corners)
            np.minimum.at(self.limit, places, found.high)
            close = np.flatnonzero(found.low <= self.limit[places])
            kept = Measured(*(part[close] for part in found))
            self.measured.append((places[close], who[close], what[close], kept))

    def _choose(self) -> ClosestPoints:
        """The closest of what was measured, of equals the lowest (instance, primitive)."""
        count = len(self.points)
        result = make_none(count)
        if not self.measured:
            return result
        point, owner, item = (np.concatenate([part[k] for part in self.measured]) for k in range(3))
        found = Measured(*(np.concatenate(parts) for parts in zip(*(part[3] for part in self.measured), strict=True)))
        least = np.full(count, np.inf)
        np.minimum.at(least, point, found.low)
        order = np.lexsort((item, owner, found.distance, point))
        first = order[np.flatnonzero(np.append(True, np.diff(point[order]) != 0))]
        rows, distance = point[first], found.distance[first]
        result.distance[rows] = distance
        result.distance_error[rows] = np.maximum(distance - least[rows], found.high[first] - distance)
        result.location[rows] = self.points[rows] + found.offset[first]
        result.instance[rows], result.primitive[rows] = owner[first], item[first]
        result.barycentric[rows] = found.weights[first]
        return result


def _spread(first: NDArray[np.int64], count: NDArray[np.int64]) -> tuple[Indices, NDArray[np.int64]]:
    """Return (row, number) of first ... first + count - 1 of each row."""
    row = np.repeat(np.arange(len(first)), count)
    return row, np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count) + first[row]


def make_none(count: int) -> ClosestPoints:
    """Return the ClosestPoints of points that have none."""
    nothing = np.full(count, -1, np.int32)
    return ClosestPoints(
        np.full(count, np.inf), np.zeros(count), np.zeros((count, 3)), nothing, nothing.copy(), np.zeros((count, 2))
    )


def find_closest(
    forest: Forest | None, primitives: Primitives, points: ArrayLike, distance: ArrayLike
) -> ClosestPoints:
    """Return the closest point of a scene to each of n points.

    Parameters
    ----------
    forest : of the scene; None where it holds nothing
    points : (n, 3) or (3,) float64, metres, world
    distance : number or (n,), metres; what is farther does not count
    primitives : with corners of float64, or those of float32 are measured

    Returns
    -------
    ClosestPoints of n points; a point that is NaN or infinite has none. Among equal distances, as computed, the lowest
    (instance, primitive) is returned.

    Raises
    ------
    ValueError
        If shapes do not fit.
    """
    places = as_points(points)
    most = as_array(distance, np.float64, ("n",) if np.ndim(distance) else (), "distance")
    if most.shape not in ((), (len(places),)):
        raise ValueError(f"distance: expected a number or an array ({len(places)},), got shape {most.shape}")
    most = np.broadcast_to(most, len(places))
    result = make_none(len(places))
    rows = np.flatnonzero(np.isfinite(places).all(axis=1) & (most >= 0))
    if forest is None:
        return result
    for start in range(0, len(rows), BATCH_POINTS):
        some = rows[start : start + BATCH_POINTS]
        part = NearestSearch(forest, primitives, places[some], most[some].copy()).run()
        far = part.distance > most[some]
        for name in ClosestPoints.__slots__:
            getattr(result, name)[some] = np.where(
                far.reshape(-1, *(1,) * (getattr(part, name).ndim - 1)),
                getattr(result, name)[some],
                getattr(part, name),
            )
    return result
