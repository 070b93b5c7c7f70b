"""From a hit to the surface there: position with an error bound, normals, side, material, uv.

The position is taken on the primitive itself, from barycentric weights (lecture, "Barycentric Coordinates") or from the
sphere's centre and radius, not as o + t d: its error then depends on the primitive and not on how far the ray came.

References
----------
M. Pharr, W. Jakob, G. Humphreys, "Physically Based Rendering", 4th edition, section 6.8, "Managing Rounding Error".
N. J. Higham, "Accuracy and Stability of Numerical Algorithms", 2nd edition, 2002, section 3.1: gamma(n).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import (
    any_column,
    lay_columns,
    make_zeros,
    put_rows,
    shorten_rows,
    take_rows,
)
from raytracer.arrays.types import Booleans, Floats, Integers, Numbers, Pairs, Vectors
from raytracer.arrays.vectors import normalize
from raytracer.casting.geometry import Kind, join_id
from raytracer.casting.rays import Hits, Rays, select_rows
from raytracer.lecture import dot, length, point_on_line
from raytracer.surfaces.curve_points import CurvePoints, describe_strands, find_curve_points
from raytracer.surfaces.places import find_layers
from raytracer.surfaces.surface_tables import (
    CASTER_ERROR,
    INTERPOLATION_ERROR,
    SurfaceTables,
    gather_corners,
    interpolate,
    measure_triangles,
    turn_normals,
)

# Times the bound on a point's error within which it may lie where its path was just before: the surface that that has
# left may be larger, and so may be the bound there.
SURROUNDINGS = 64.0


def make_surface(tables: SurfaceTables, rays: Rays, hits: Hits) -> Surface:
    """Return the surface where rays hit; every ray must have hit.

    Parameters
    ----------
    tables : SurfaceTables of the scene that was hit
    rays, hits : n rays and their hits, without misses

    Returns
    -------
    Surface of n points. Its geometric normal is the object's normal, turned by the inverse transpose of the instance's
    matrix as in Blender, so that mirroring an instance does not turn its front to its back.
    """
    is_triangle = tables.geometry.belongs_to_kind(hits.instance, Kind.TRIANGLE)
    strands = None
    if is_triangle.all():
        position, error, normal, shading = describe_triangles(tables, hits)
    else:
        strands = find_curve_points(tables.geometry, rays, hits)
        position, error, normal, shading = _mixed_surface(tables, rays, hits, is_triangle, strands)
    outgoing = -normalize(lay_columns(rays.directions))
    layer = _find_tied_layers(tables, rays, hits, error * tables.roundoff)
    return Surface(
        position=position,
        position_error=error * tables.roundoff,
        geometric_normal=normal,
        shading_normal=normal if tables.normals is None and strands is None else shading,
        outgoing=outgoing,
        front=dot(normal, outgoing) >= 0,
        material=find_material(tables, hits),
        instance=hits.instance,
        primitive=hits.primitive,
        uv=None if tables.uvs is None else _interpolate_uvs(tables, hits, is_triangle),
        barycentric=hits.barycentric if tables.with_barycentric else None,
        layer=layer,
        approach=None if layer is None else _find_approach(rays, hits, outgoing),
        **({} if tables.geometry.strands is None else describe_strands(strands, hits)),
    )


def find_material(tables: SurfaceTables, hits: Hits) -> Integers:
    """Return the indices (n,) of the materials that rays hit."""
    first, step = tables.material_first[hits.instance], tables.material_step[hits.instance]
    return tables.material[first + step * hits.primitive]


def _find_tied_layers(tables: SurfaceTables, rays: Rays, hits: Hits, error: Numbers) -> NDArray[np.int64] | None:
    """Return the layers (n,) of surfaces that may not lie alone, 0 of others; None where all are alone.

    error : (n,) metres, bound on that of the point

    A ray that starts from a lone surface, and has not left its surroundings, says nothing of the side that its path
    came from: where it starts tells that, outside the bound, and what it has met counts as alone, too.
    """
    if hits.tied is None or tables.layers is None or not hits.tied.any():
        return None
    rows = np.flatnonzero(hits.tied)
    away = hits.distance[rows] * length(rays.directions[rows]) > SURROUNDINGS * error[rows]
    if rays.departure is not None:
        away |= rays.departure.reach[rows] >= 0
    layer, rows = np.zeros(len(hits), np.int64), rows[away]
    layer[rows] = find_layers(tables, hits.instance[rows], hits.primitive[rows])
    return layer


def _find_approach(rays: Rays, hits: Hits, outgoing: Floats) -> Floats:
    """Return the directions (n, 3) towards where paths came from to the places that they are at: of a ray that has not
    left the place where it started, the one that led there."""
    if rays.departure is None:
        return outgoing
    here = hits.distance <= rays.departure.reach
    return np.where(here[:, np.newaxis], rays.departure.approach, outgoing)


# Position (n, 3), its error (n,), geometric and shading normal (n, 3).
_PointParts = tuple[Floats, Floats, Floats, Floats]


def describe_triangles(tables: SurfaceTables, hits: Hits) -> _PointParts:
    """Return position (n, 3), its error (n,) in float64's arithmetic, geometric and shading normal (n, 3) where
    triangles are hit."""
    position, error, normal = _triangle_points(tables, hits.instance, hits.primitive, hits.barycentric)
    shading = _interpolate_normals(tables, hits.instance, hits.primitive, hits.barycentric, normal)
    return position, error, normal, shading


def _mixed_surface(
    tables: SurfaceTables, rays: Rays, hits: Hits, is_triangle: NDArray[np.bool_], strands: CurvePoints | None
) -> _PointParts:
    """Return what `describe_triangles` does where some of the hits, or all, are spheres or curves."""
    position, normal, shading = (make_zeros(len(hits)) for _ in range(3))
    error = np.empty(len(hits))
    flat, round_ = np.flatnonzero(is_triangle), np.flatnonzero(~is_triangle)
    if len(flat):
        found = describe_triangles(tables, hits.select(flat))
        _put_points((position, error, normal, shading), flat, found)
    if strands is not None:
        found = (strands.position, strands.error, strands.geometric_normal, strands.shading_normal)
        _put_points((position, error, normal, shading), strands.rows, found)
        round_ = np.flatnonzero(tables.geometry.belongs_to_kind(hits.instance, Kind.SPHERE))
    at = point_on_line(take_rows(rays.origins, round_), take_rows(rays.directions, round_), hits.distance[round_])
    on_spheres = _sphere_points(tables, hits, round_, at)
    _put_points((position, error, normal, shading), round_, (*on_spheres, on_spheres[-1]))
    return position, error, normal, shading


def _put_points(targets: _PointParts, rows: NDArray[np.intp], parts: _PointParts) -> None:
    """Put what is known of some of the points where all have their place."""
    for target, part in zip(targets, parts, strict=True):
        if target.ndim == 1:
            target[rows] = part
        else:
            put_rows(target, rows, part)


def _triangle_points(
    tables: SurfaceTables, instance: Integers, primitive: Integers, weights: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return position alpha a + beta b + gamma c (n, 3), its error bound (n,) and the geometric normal (n, 3)."""
    if tables.triangles is None:
        triangles = measure_triangles(tables.geometry, tables.mirrored, instance, primitive)
    else:
        triangles = tables.triangles.select(join_id(tables.geometry, instance, primitive))
    return interpolate(weights, triangles.a, triangles.b, triangles.c), triangles.error, triangles.normal


def _sphere_points(
    tables: SurfaceTables, hits: Hits, rows: NDArray[np.intp], at: Floats
) -> tuple[Floats, Floats, Floats]:
    """Move points `at` (n, 3) radially onto their spheres: c + r n with n the direction from the centre.

    n is a unit vector to within gamma(5), the product and the sum round once each: gamma(7) of r, and of |c| as well.
    """
    geometry = tables.geometry
    sphere = geometry.find_rows(join_id(geometry, hits.instance[rows], hits.primitive[rows]), Kind.SPHERE)
    centre, radius = lay_columns(geometry.centres[sphere]), geometry.radii[sphere]
    normal = normalize(at - centre)
    position = centre + radius[:, np.newaxis] * normal
    error = INTERPOLATION_ERROR * (length(centre) + radius) + CASTER_ERROR * radius
    return position, error, normal


def _interpolate_normals(
    tables: SurfaceTables, instance: Integers, primitive: Integers, weights: Floats, geometric: Floats
) -> Floats:
    """Return the interpolated corner normals in world space, unit (n, 3); geometric normals where there are none.

    The cofactor matrix is det(M) M^-T: its sign is taken back for mirrored instances.
    """
    if tables.normals is None:
        return geometric
    mesh = tables.geometry.instance_mesh[instance]
    smooth = np.flatnonzero(tables.normals.first[mesh] >= 0)
    rows = shorten_rows(smooth, len(mesh))
    local = gather_corners(tables.normals, mesh[rows], primitive[rows], take_rows(weights, rows))
    world = normalize(turn_normals(tables, instance[rows], normalize(local)))
    turned = tables.mirrored[instance[rows]]
    if turned.any():
        world = np.where(turned[:, np.newaxis], -world, world)
    usable = any_column(world != 0)
    if len(smooth) == len(mesh) and usable.all():
        return world
    shading = geometric.copy("K")
    put_rows(shading, smooth[usable], take_rows(world, usable))
    return shading


def _interpolate_uvs(tables: SurfaceTables, hits: Hits, is_triangle: NDArray[np.bool_]) -> Floats:
    """Return (n, 2) uvs, NaN on spheres and on meshes that have none."""
    assert tables.uvs is not None
    uv = np.full((len(hits), 2), np.nan)
    rows = np.flatnonzero(is_triangle)
    mesh = tables.geometry.instance_mesh[hits.instance[rows]]
    has_uv = tables.uvs.first[mesh] >= 0
    rows, mesh = rows[has_uv], mesh[has_uv]
    uv[rows] = gather_corners(tables.uvs, mesh, hits.primitive[rows], hits.barycentric[rows])
    return uv


def imagine_surface(position: Vectors, normal: Vectors, outgoing: Vectors, is_front: bool, weights: Pairs) -> Surface:
    """Return surface points that no ray has hit: where programs of worlds and lights are evaluated.

    position, normal, outgoing : (n, 3); is_front : side that is seen; weights : (n, 2), in place of barycentric ones
    """
    count = len(position)
    zeros = np.zeros(count, dtype=np.int32)
    return Surface(
        position=position,
        position_error=np.zeros(count),
        geometric_normal=normal,
        shading_normal=normal,
        outgoing=outgoing,
        front=np.full(count, is_front),
        material=zeros,
        instance=zeros,
        primitive=zeros,
        barycentric=weights,
    )


@dataclass(frozen=True, eq=False, slots=True)
class Surface:
    """The surface at n hits (misses are left out beforehand); what a scene does not need is None.

    position : (n, 3) float64, metres, world, on the surface to within `position_error`
    position_error : (n,) float64, metres, bound on the distance of `position` from the exact surface point
    geometric_normal : (n, 3) float64, unit, of the flat triangle or the sphere, as wound (not flipped to the ray)
    shading_normal : (n, 3) float64, unit, interpolated; the same array as geometric_normal without smooth normals
    outgoing : (n, 3) float64, unit, from the surface towards where the ray came from
    front : (n,) bool, True where the ray arrived at the side that geometric_normal points to
    material : (n,) int32, index into the scene's materials
    instance, primitive : (n,) int32, as in Hits
    uv : (n, 2) float64, NaN where there are none; None where the scene has no uvs or nothing reads them
    barycentric : (n, 2) float64, as in Hits, or None where nothing reads it
    layer : (n,) int64, of surfaces that may not lie alone, as rays come to their front (`places`); 0 of others; None
        where all lie alone
    approach : (n, 3) float64, unit, towards where the path came from to the place of the surface, which may have met
        others there; None where `layer` is
    tangent : (n, 3) float64, metres, along the strand where a curve is hit, the derivative by `along`; 0 elsewhere;
        None in scenes without curves, as the following ones
    along : (n,) float64, where along its segment a curve is hit, 0 to 1; 0 elsewhere
    across : (n,) float64, where across a ribbon, -1 to 1, positive on the side of tangent x outgoing; NaN elsewhere
    """

    position: Vectors
    position_error: Numbers
    geometric_normal: Vectors
    shading_normal: Vectors
    outgoing: Vectors
    front: Booleans
    material: Integers
    instance: Integers
    primitive: Integers
    uv: Pairs | None = None
    barycentric: Pairs | None = None
    layer: NDArray[np.int64] | None = None
    approach: Vectors | None = None
    tangent: Vectors | None = None
    along: Numbers | None = None
    across: Numbers | None = None

    def __len__(self) -> int:
        return len(self.position)

    def select(self, rows: Any) -> Surface:
        """Return some of the points: index or boolean array."""
        return select_rows(self, rows)
