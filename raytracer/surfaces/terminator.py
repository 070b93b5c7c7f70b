"""The shadow terminator of smooth meshes: Blender's two per-object offsets that hide how coarse they are.

Near the terminator the flat triangles of a smooth mesh shade themselves although their interpolated normals still see
the light. The *geometry offset* starts grazing shadow rays on a curved surface over the triangle instead, whose height
h over it is

    h = a u (u - 1) + (a + b + c) u v + b v (v - 1),   a = (N3 - N1) . (V1 - V3),  b = (N3 - N2) . (V2 - V3),
                                                       c = (N2 - N1) . (V2 - V1),

with weights u, v of corners V1, V2 and unit normals Ni there, kept between half of that and the planes through the
corners across their normals. The *shading offset* makes the cosine of diffuse reflection fall faster, to 0 before the
right angle.

References
----------
Blender, intern/cycles/kernel/light/sample.h: shadow_ray_offset, which rays are lifted and how far; closure/bsdf.h:
shift_cos_in; scene/object.cpp: the factor that the shading offset stands for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import find_sign, take_rows
from raytracer.arrays.types import Floats, Indices
from raytracer.arrays.vectors import normalize
from raytracer.casting.geometry import world_corners
from raytracer.lecture import dot
from raytracer.scene.scene import Scene
from raytracer.surfaces.surface import Surface
from raytracer.surfaces.surface_tables import SurfaceTables, turn_normals


@dataclass(frozen=True, eq=False)
class Terminator:
    """Offsets of a scene's objects.

    cutoff : (instances + groups,) float64, cosine below which shadow rays are lifted; 0 never
    frequency : (instances + groups,) float64, factor of the angle between normal and light; None where it is 1
    """

    cutoff: Floats
    frequency: Floats | None


class Lifted(NamedTuple):
    """Points that shadow rays start higher from: their rows (k,), and how far their origins move (k, 3)."""

    rows: Indices
    offset: Floats


# What lifts points (n): arguments as of `lift_points`.
Lift = Callable[[Surface, Indices | slice, Floats, Floats, Floats], Lifted]


def make_terminator(scene: Scene) -> Terminator | None:
    """Return the offsets of a scene; None where no object has any."""
    instances = scene.instances
    if instances is None or (instances.terminator_geometry is None and instances.terminator_shading is None):
        return None
    groups = np.zeros(len(scene.groups))
    zeros = np.zeros(len(instances))
    geometry, shading = (
        zeros if values is None else values for values in (instances.terminator_geometry, instances.terminator_shading)
    )
    frequency = 1.0 / (1.0 - 0.5 * np.concatenate([shading, groups])) if shading.any() else None
    return Terminator(np.concatenate([geometry, groups]), frequency)


def lift_points(
    tables: SurfaceTables,
    terminator: Terminator,
    surface: Surface,
    places: Indices | slice,
    normal: Floats,
    geometric: Floats,
    light: Floats,
) -> Lifted:
    """Return which of n points grazing shadow rays start higher from, and how far.

    With n . l and g . l the light's cosines with the two normals, on its side, and the cutoff c, the height counts in
    full below n . l + g . l = c, and fades out towards 2 c; where n . l > c, from g . l = 0 to c. What may not lie
    alone stays where it is, for it must not pass what lies upon it.

    places : (n,) where the points are on the surface; a slice where they are all
    normal, geometric : (n, 3) unit, shading and geometric normal towards the viewer
    light : (n, 3) unit, towards the light
    """
    assert tables.normals is not None
    cutoff = find_cutoffs(tables, terminator).take(surface.instance[places])
    if surface.layer is not None:
        cutoff[surface.layer[places] != 0] = 0.0
    along, over = dot(normal, light), dot(geometric, light)
    side = find_sign(along >= 0)
    over *= side
    near = np.flatnonzero((cutoff > 0) & (over < 2.0 * cutoff))  # few graze: all others stay
    along, over, cutoff = np.abs(along[near]), over[near], cutoff[near]
    amount = np.where(along < cutoff, 2.0 - (over + along) / cutoff, 1.0 - over / cutoff)
    lifted = np.flatnonzero(amount > 0)
    rows, amount = near[lifted], np.minimum(amount[lifted], 1.0)
    points = surface.select(rows if isinstance(places, slice) else places[rows])
    smooth = find_smooth_offset(tables, points, side[rows, np.newaxis] * take_rows(geometric, rows))
    return Lifted(rows, amount[:, np.newaxis] * smooth)


def find_cutoffs(tables: SurfaceTables, terminator: Terminator) -> Floats:
    """Return the cutoffs (instances + groups,) of objects that are smooth; 0 of all others."""
    assert tables.normals is not None
    cutoff = np.zeros(len(terminator.cutoff))
    smooth = np.flatnonzero(tables.normals.first[tables.geometry.instance_mesh] >= 0)
    cutoff[smooth] = terminator.cutoff[smooth]
    return cutoff


def find_smooth_offset(tables: SurfaceTables, surface: Surface, geometric: Floats) -> Floats:
    """Return the way (k, 3) from points of smooth triangles to the curved surface over them, on the side of the normal
    `geometric` (k, 3)."""
    assert tables.normals is not None
    assert surface.barycentric is not None
    instance, primitive = surface.instance, surface.primitive
    corners = world_corners(tables.geometry, instance, primitive)
    table, mesh = tables.normals, tables.geometry.instance_mesh[instance]
    local = table.values[table.rows[table.first[mesh] + primitive]]  # (k, 3 corners, 3)
    turn = np.where(tables.mirrored[instance], -1.0, 1.0)[:, np.newaxis]
    normals = [turn * normalize(turn_normals(tables, instance, local[:, corner])) for corner in range(3)]
    second, third = surface.barycentric.T
    weights = (1.0 - second - third, second, third)
    point = sum(weight[:, np.newaxis] * corner for weight, corner in zip(weights, corners, strict=True))
    normal = sum(weight[:, np.newaxis] * across for weight, across in zip(weights, normals, strict=True))
    sign = np.where(dot(normal, geometric) > 0, 1.0, -1.0)
    height = sign * _bend(corners, normals, weights)
    limit = np.minimum.reduce([_stay_below(corners, normals, corner, point, sign) for corner in range(3)])
    return (sign * np.maximum(limit, 0.5 * height))[:, np.newaxis] * normal


def _bend(corners: tuple[Floats, ...], normals: list[Floats], weights: tuple[Floats, ...]) -> Floats:
    """Return the height (k,) of the parabolic surface that has the normals at the corners."""
    u, v, _ = weights
    a, b, c = (
        dot(normals[j] - normals[i], corners[k] - corners[m])
        for i, j, k, m in ((0, 2, 0, 2), (1, 2, 1, 2), (0, 1, 1, 0))
    )
    height: Floats = a * u * (u - 1.0) + (a + b + c) * u * v + b * v * (v - 1.0)
    return height


def _stay_below(corners: tuple[Floats, ...], normals: list[Floats], corner: int, point: Floats, sign: Floats) -> Floats:
    """Return the height (k,) at a point of the plane across a corner's normal that is no lower than the other corners,
    on the side of `sign` (k,)."""
    others = [corners[other] - corners[corner] for other in range(3) if other != corner]
    highest = np.maximum(np.maximum(*(sign * dot(way, normals[corner]) for way in others)), 0.0)
    height: NDArray[np.float64] = np.maximum(sign * dot(corners[corner] - point, normals[corner]) + highest, 0.0)
    return height
