"""Where curves are hit: the point, its normals, and where it lies along and across the strand.

With the tangent T = P' / |P'|, the ray's direction D and v across the ribbon, b = T x (-D) / |T x (-D)| points to its
side v = 1, and a ribbon has the normals of a round strand (Cycles' Rounded Ribbons):

    position P + v r b,    shading normal v b + sqrt(1 - v^2) (-D + (T . D) T) / |...|,    geometric normal -D.

On a round strand the point q of the ray gives the shading normal n = (q - P) / |q - P| and the position P + r n. The
geometric normal is that of the surface, n (|P'|^2 - r n . P'') - r' P', where Cycles takes n: rays that leave a tapered
strand to one side of it then stay there.

References
----------
Blender, intern/cycles/kernel/geom/curve_intersect.h: curve_shader_setup.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import any_column, make_zeros, take_rows
from raytracer.arrays.types import Floats, Integers, Numbers, Vectors
from raytracer.arrays.vectors import normalize
from raytracer.casting.curves.ray_space import POSITION_ERROR
from raytracer.casting.curves.strands import Strands, find_bezier
from raytracer.casting.geometry import Geometry, Kind, join_id
from raytracer.casting.rays import Hits, Rays
from raytracer.lecture import cross, dot, length, point_on_line
from raytracer.predicates.rounding import gamma

# A point P + r n: 16 roundings of the spline, 8 of the normal, two more of the sum.
SPLINE_ERROR = gamma(26)


@dataclass(frozen=True, eq=False)
class CurvePoints:
    """The surface at those k of n hits that are curves.

    rows : (k,) which of the hits
    position, geometric_normal, shading_normal : (k, 3) float64, world; error : (k,) metres
    tangent : (k, 3) float64, P', metres per segment
    across : (k,) float64, v, of ribbons; NaN of round strands
    """

    rows: NDArray[np.intp]
    position: Vectors
    error: Numbers
    geometric_normal: Vectors
    shading_normal: Vectors
    tangent: Vectors
    across: Numbers


def find_curve_points(geometry: Geometry, rays: Rays, hits: Hits) -> CurvePoints | None:
    """Return the surface where rays have hit curves; None where they have not, or there are none."""
    if geometry.strands is None:
        return None
    rows = np.flatnonzero(geometry.belongs_to_kind(hits.instance, Kind.CURVE))
    return _make_points(geometry, geometry.strands, rows, rays.select(rows), hits.select(rows)) if len(rows) else None


def find_curve_centres(geometry: Geometry, instance: Integers, primitive: Integers, u: Floats) -> Floats:
    """Return the points P(u) (n, 3) of the center lines of segments, given by group and segment."""
    assert geometry.strands is not None
    strands, segment = geometry.strands, geometry.find_rows(join_id(geometry, instance, primitive), Kind.CURVE)
    return _evaluate(strands.keys.take(strands.rows.take(segment, axis=0), axis=0), u).centre


def describe_strands(points: CurvePoints | None, hits: Hits) -> dict[str, Floats]:
    """Return the fields of a Surface that tell of curves: tangent, along and across, of n hits."""
    count = len(hits)
    tangent, along, across = make_zeros(count), np.zeros(count), np.full(count, np.nan)
    if points is not None:
        rows = points.rows
        tangent[rows], along[rows], across[rows] = points.tangent, hits.barycentric[rows, 0], points.across
    return {"tangent": tangent, "along": along, "across": across}


def _make_points(geometry: Geometry, strands: Strands, where: NDArray[np.intp], rays: Rays, hits: Hits) -> CurvePoints:
    """Return the surface at hits, all of them of curves."""
    segment = geometry.find_rows(join_id(geometry, hits.instance, hits.primitive), Kind.CURVE)
    keys = strands.keys.take(strands.rows.take(segment, axis=0), axis=0)  # (k, 4 keys, 4)
    spline = _evaluate(keys, hits.barycentric[:, 0])
    centre, tangent, radius = spline.centre, spline.tangent, spline.radius
    backward = -normalize(rays.directions)
    thick, across = strands.thick[segment], hits.barycentric[:, 1]
    points = _ribbon_points(centre, tangent, radius, across, backward)
    rows = np.flatnonzero(thick)
    if len(rows):
        at = point_on_line(rays.origins[rows], rays.directions[rows], hits.distance[rows])
        points.put(rows, _round_points(spline.select(rows), at, backward[rows]))
    # What is computed of a ray that starts here depends on the segment's size.
    size = length(np.ptp(keys[:, :, :3], axis=1)) + radius
    error = SPLINE_ERROR * (length(np.abs(keys[:, :, :3]).max(axis=1)) + radius) + 4.0 * POSITION_ERROR * size
    across = np.where(thick, np.nan, across)
    return CurvePoints(where, points.position, error, points.geometric, points.shading, tangent, across)


@dataclass(frozen=True, eq=False)
class _Points:
    """Position and normals, (n, 3) each."""

    position: Vectors
    geometric: Vectors
    shading: Vectors

    def put(self, rows: NDArray[np.intp], other: _Points) -> None:
        for item in fields(self):
            getattr(self, item.name)[rows] = getattr(other, item.name)


class _Spline(NamedTuple):
    """P, P' and P'' (n, 3), r and r' (n,) of segments at u."""

    centre: Floats
    tangent: Floats
    bend: Floats
    radius: Floats
    growth: Floats

    def select(self, rows: NDArray[np.intp]) -> _Spline:
        return _Spline(*(take_rows(part, rows) for part in self))


def _evaluate(keys: Floats, u: Floats) -> _Spline:
    """Return what segments of keys (n, 4 keys, 4) are at u (n,)."""
    bezier = find_bezier(np.ascontiguousarray(keys.transpose(2, 1, 0)))
    b0, b1, b2, b3 = bezier.transpose(1, 0, 2)  # (4, n) each
    s = 1.0 - u
    values = ((b0 * s + 3.0 * u * b1) * s + (3.0 * u * u) * b2) * s + (u * u * u) * b3
    slopes = 3.0 * (((b1 - b0) * s + 2.0 * u * (b2 - b1)) * s + (u * u) * (b3 - b2))
    bends = 6.0 * ((b2 - 2.0 * b1 + b0) * s + (b3 - 2.0 * b2 + b1) * u)
    centre, tangent, bend = (part[:3].T.copy() for part in (values, slopes, bends))
    return _Spline(centre, tangent, bend, np.maximum(values[3], 0.0), slopes[3])


def _ribbon_points(centre: Floats, tangent: Floats, radius: Floats, across: Floats, backward: Floats) -> _Points:
    tangent = normalize(tangent)
    side = normalize(cross(tangent, backward))
    facing = normalize(backward - dot(tangent, backward)[:, np.newaxis] * tangent)
    cosine = np.sqrt(np.maximum(1.0 - across * across, 0.0))
    shading = normalize(across[:, np.newaxis] * side + cosine[:, np.newaxis] * facing)
    shading = np.where(any_column(shading != 0)[:, np.newaxis], shading, backward)
    return _Points(centre + (across * radius)[:, np.newaxis] * side, backward.copy(), shading)


def _round_points(spline: _Spline, at: Floats, backward: Floats) -> _Points:
    normal = normalize(at - spline.centre)
    normal = np.where(any_column(normal != 0)[:, np.newaxis], normal, backward)
    width = dot(spline.tangent, spline.tangent) - spline.radius * dot(normal, spline.bend)
    geometric = normalize(width[:, np.newaxis] * normal - spline.growth[:, np.newaxis] * spline.tangent)
    geometric = np.where(any_column(geometric != 0)[:, np.newaxis], geometric, normal)
    return _Points(spline.centre + spline.radius[:, np.newaxis] * normal, geometric, normal)
