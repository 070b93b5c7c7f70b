"""Points where light passes a surface, and how the surface's normal turns around them.

Within a triangle the point moves in a plane while the interpolated normal turns: with corner normals m_0, m_1, m_2 in
object space, weights b, c of the last two and C the cofactors of the instance's matrix,

    n = N / |N|,   N = C ((1 - b - c) m_0 + b m_1 + c m_2),   dn/db = (I - n n^T) C (m_1 - m_0) / |N|

These are the surfaces that rays are bent by, so what follows is exact for them, and not for the smooth shape that an
artist had in mind.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from raytracer.arrays.types import Numbers, Pairs, Vectors
from raytracer.arrays.vectors import make_frame
from raytracer.casting.geometry import world_corners
from raytracer.casting.rays import Hits, select_rows
from raytracer.lecture import cross, dot, length
from raytracer.surfaces.departing import LeavingPoints, spawn_origin
from raytracer.surfaces.surface import describe_triangles
from raytracer.surfaces.surface_tables import SurfaceTables, interpolate


@dataclass(frozen=True, eq=False, slots=True)
class Vertex:
    """A point on triangles for each of n chains.

    position : (n, 3) float64, metres, and its error (n,)
    geometric_normal, normal : (n, 3) float64, unit, of the flat triangle, and interpolated
    along, across : (n, 3) float64, unit, in the triangle's plane, at right angles to each other
    turn_along, turn_across : (n, 3) float64, per metre, how the interpolated normal turns that way
    eta : (n,) float64, index of refraction behind the surface over that before its front
    """

    position: Vectors
    error: Numbers
    geometric_normal: Vectors
    normal: Vectors
    along: Vectors
    across: Vectors
    turn_along: Vectors
    turn_across: Vectors
    eta: Numbers

    def __len__(self) -> int:
        return len(self.position)

    def select(self, rows: Any) -> Vertex:
        """Return the points of some of the chains: index or boolean array."""
        return select_rows(self, rows)

    def move(self, step: Pairs) -> Vectors:
        """Return the points (n, 3) that steps (n, 2) in the triangle's plane lead to."""
        return self.position + step[:, 0:1] * self.along + step[:, 1:2] * self.across

    def leave(self, direction: Vectors) -> Vectors:
        """Return where rays (n, 3) that leave the point start."""
        return spawn_origin(LeavingPoints(self.position, self.error, self.geometric_normal), direction)


def make_vertex(tables: SurfaceTables, hits: Hits, eta: Numbers) -> Vertex:
    """Return the points where rays have hit smooth meshes."""
    position, error, geometric_normal, normal = describe_triangles(tables, hits)
    along, across = make_frame(geometric_normal)
    turns = _find_turns(tables, hits, normal, (along, across))
    return Vertex(position, error * tables.roundoff, geometric_normal, normal, along, across, *turns, eta)


def _find_turns(
    tables: SurfaceTables, hits: Hits, normal: Vectors, directions: tuple[Vectors, Vectors]
) -> tuple[Vectors, Vectors]:
    """Return how the interpolated normal turns (n, 3), per metre, along two directions in the triangle's plane."""
    assert tables.normals is not None
    first = tables.normals.first[tables.geometry.instance_mesh[hits.instance]]
    rows = tables.normals.rows.take(first + hits.primitive, axis=0)  # (n, 3 corners)
    matrices = tables.normal_from_object[hits.instance]  # (n, 3, 3)
    world = [dot(matrices, tables.normals.values.take(corner, axis=0)[:, np.newaxis, :]) for corner in rows.T]
    total = interpolate(hits.barycentric, *world)
    size = length(total)
    sign = np.where(tables.mirrored[hits.instance], -1.0, 1.0)
    share = np.divide(sign, size, out=np.zeros_like(size), where=size > 0)[:, np.newaxis]
    by_weight = [share * (corner - world[0]) for corner in world[1:]]
    by_weight = [turn - dot(turn, normal)[:, np.newaxis] * normal for turn in by_weight]
    first_turn, second_turn = (
        b[:, np.newaxis] * by_weight[0] + c[:, np.newaxis] * by_weight[1]
        for b, c in _find_weights(tables, hits, directions)
    )
    return first_turn, second_turn


def _find_weights(
    tables: SurfaceTables, hits: Hits, directions: tuple[Vectors, Vectors]
) -> list[tuple[Numbers, Numbers]]:
    """Return how fast the weights b and c (n,) of the last two corners grow along directions d (n, 3) in the plane.

    Cramer's rule for d = b e + c f with the edges e and f and A = e x f: b = (d x f) . A / A^2, c = (e x d) . A / A^2.
    """
    corner, second, third = world_corners(tables.geometry, hits.instance, hits.primitive)
    e, f = second - corner, third - corner
    area = cross(e, f)
    square = dot(area, area)
    area = area * np.divide(1.0, square, out=np.zeros_like(square), where=square > 0)[:, np.newaxis]
    return [(dot(cross(d, f), area), dot(cross(e, d), area)) for d in directions]
