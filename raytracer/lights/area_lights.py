"""Area lights: rectangles and ellipses that shine to one side, with Blender's spread.

Rectangles are sampled evenly over the solid angle of the part that can light the point, full ellipses over their area.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from raytracer.arrays.rows import all_columns, join_columns, keep_rows, scale_vectors, take_rows
from raytracer.arrays.types import Booleans, Floats
from raytracer.arrays.vectors import normalize
from raytracer.lecture import dot, intersect_plane, length, point_on_line
from raytracer.lights.light_shapes import (
    SMALL_SOLID_ANGLE,
    LightHits,
    LightSamples,
    divide_rows,
    place_hits,
    rectangle_solid_angle,
    sample_rectangle,
    without_extent,
)
from raytracer.sampling.warps import sample_disk
from raytracer.scene.lights import AreaLight


def area_of(light: AreaLight) -> Floats:
    area = length(light.axis_u) * length(light.axis_v)
    return area * np.pi / 4.0 if light.shape == "ellipse" else area


# Weak: a cache that holds lamps would hold the memory that all arrays of their scenes lie in.
_AXES: WeakKeyDictionary[AreaLight, tuple[Floats, Floats, Floats]] = WeakKeyDictionary()


def unit_axes(light: AreaLight) -> tuple[Floats, Floats, Floats]:
    """Return unit axes u, v and the side that shines, -(u x v)."""
    axes = _AXES.get(light)
    if axes is None:
        u, v = normalize(light.axis_u), normalize(light.axis_v)
        axes = _AXES[light] = (u, v, -normalize(np.cross(u, v)))
    return axes


def area_spread_factor(light: AreaLight, cosine: Floats) -> Floats:
    """Return (tan h - tan x) / (tan h - h) for the angle x off the light's axis and half the spread h, 0 beyond it.

    The share of light that the slats of a soft box let through at x, normalized to keep the light's power:
    2 integral_0^h (tan h - tan x) cos x sin x dx = tan h - h.

    cosine : (n,) float64, cos x
    """
    if light.spread >= np.pi:
        return np.ones_like(cosine)
    half = light.spread / 2.0
    tangent = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0)) / np.maximum(cosine, np.finfo(np.float64).tiny)
    return np.maximum(np.tan(half) - tangent, 0.0) / _tangent_excess(half)


def _tangent_excess(angle: float) -> float:
    """tan h - h; by its series h^3/3 + 2 h^5/15 + 17 h^7/315 + 62 h^9/2835 below 2^-6, where the difference cancels
    and the next term is below 2^-57 of the sum."""
    if angle > 2.0**-6:
        return float(np.tan(angle) - angle)
    square = angle * angle
    return angle * square * (1 / 3 + square * (2 / 15 + square * (17 / 315 + square * 62 / 2835)))


def area_radiance(light: AreaLight, cosine: Floats) -> Floats:
    """P / (pi A), dimmed by the spread: (n, 3)."""
    return scale_vectors(light.power / (np.pi * area_of(light))[..., np.newaxis], area_spread_factor(light, cosine))


def _visible_part(light: AreaLight, positions: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the part of the rectangle that can light each point: low, high along u and v from the centre, (n, 2) or
    (1, 2) where that is all of it, and the height (n,) of the point over the light's plane, on the side that shines."""
    u, v, axis = unit_axes(light)
    offset = positions - light.position
    height = dot(offset, axis)
    high = np.atleast_2d(np.stack([length(light.axis_u), length(light.axis_v)], axis=-1) / 2.0)
    if light.spread >= np.pi:
        return -high, high, height
    foot = join_columns(dot(offset, u), dot(offset, v))
    reach = (np.maximum(height, 0.0) * np.tan(light.spread / 2.0))[:, np.newaxis]
    return np.maximum(-high, foot - reach), np.minimum(high, foot + reach), height


def _is_sampled_by_area(light: AreaLight) -> bool:
    """A full ellipse is sampled evenly on its area; every other light by the solid angle of a rectangle around it."""
    return light.shape == "ellipse" and light.spread >= np.pi


def sample_area(light: AreaLight, positions: Floats, pair: Floats) -> LightSamples:
    if light.spread == 0:
        return _sample_parallel_area(light, positions)
    u, v, axis = unit_axes(light)
    low, high, height = _visible_part(light, positions)
    lit, solid_angle = (height > 0) & all_columns(high > low), None
    if _is_sampled_by_area(light):
        local = sample_disk(pair) * high
    else:
        local, solid_angle = sample_rectangle(_relative(light, positions), low, high, pair)
        lit &= _is_inside(light, local)
    way = light.position + scale_vectors(u, local[:, 0]) + scale_vectors(v, local[:, 1]) - positions
    direction, distance = normalize(way), length(way)
    cosine = -dot(direction, axis)
    density = keep_rows(_area_density(light, low, high, distance, cosine, solid_angle), lit)
    return LightSamples(direction, distance, divide_rows(area_radiance(light, cosine), density), density)


def _relative(light: AreaLight, positions: Floats) -> Floats:
    """Return positions in the light's frame (u, v, shining axis), from its centre."""
    offset = positions - light.position
    return join_columns(*(dot(offset, axis) for axis in unit_axes(light)))


def _is_inside(light: AreaLight, local: Floats) -> Booleans:
    """True where points (n, 2) of the light's plane lie on its ellipse; rectangles are sampled within their border."""
    if light.shape == "rectangle":
        return np.ones(len(local), dtype=np.bool_)
    half_u, half_v = length(light.axis_u) / 2.0, length(light.axis_v) / 2.0
    return (local[:, 0] / half_u) ** 2 + (local[:, 1] / half_v) ** 2 <= 1.0


def _area_density(
    light: AreaLight, low: Floats, high: Floats, distance: Floats, cosine: Floats, solid_angle: Floats | None
) -> Floats:
    """Return the density (n,) per solid angle with which `sample_area` takes directions at `cosine` off the axis.

    solid_angle : (n,) of the rectangle low..high; None where the light is sampled by area
    """
    if solid_angle is None:
        return divide_rows(distance * distance, area_of(light) * np.maximum(cosine, 0.0))
    width, height = np.maximum(high - low, 0.0).T
    by_angle, small = divide_rows(np.ones_like(solid_angle), solid_angle), solid_angle < SMALL_SOLID_ANGLE
    if not small.any():
        return by_angle
    by_distance = divide_rows(distance * distance, width * height * np.maximum(cosine, 0.0))
    return np.where(small, by_distance, by_angle)


def _sample_parallel_area(light: AreaLight, positions: Floats) -> LightSamples:
    """A spread of 0: parallel light along the axis, irradiance P / A where the point lies below the light."""
    u, v, axis = unit_axes(light)
    offset = positions - light.position
    local = join_columns(dot(offset, u) / length(light.axis_u), dot(offset, v) / length(light.axis_v))
    inside = (np.abs(local) <= 0.5).all(axis=1) if light.shape == "rectangle" else (local**2).sum(axis=1) <= 0.25
    height = dot(offset, axis)
    irradiance = np.where((inside & (height > 0))[:, np.newaxis], light.power / area_of(light)[..., np.newaxis], 0.0)
    return without_extent(np.broadcast_to(-axis, positions.shape), height, irradiance)


def evaluate_area(light: AreaLight, origins: Floats, directions: Floats) -> LightHits:
    """Few rays meet a light: what they see of it is computed for those alone that head for the side that shines."""
    u, v, axis = unit_axes(light)
    facing = np.flatnonzero((dot(origins - light.position, axis) > 0) & (dot(directions, axis) < 0))
    count, origins, directions = len(origins), take_rows(origins, facing), take_rows(directions, facing)
    low, high, _ = _visible_part(light, origins)
    distance = intersect_plane(origins, directions, axis, dot(axis, light.position))
    offset = point_on_line(origins, directions, distance) - light.position
    local = join_columns(dot(offset, u), dot(offset, v))
    rows = np.flatnonzero((distance > 0) & all_columns(local >= low) & all_columns(local <= high))
    rows = rows[_is_inside(light, take_rows(local, rows))]
    low, high = (side if len(side) == 1 else take_rows(side, rows) for side in (low, high))
    distance, solid_angle = distance[rows], None
    if not _is_sampled_by_area(light):
        solid_angle = rectangle_solid_angle(_relative(light, take_rows(origins, rows)), low, high)
    cosine = -dot(take_rows(directions, rows), axis)
    density = _area_density(light, low, high, distance, cosine, solid_angle)
    return place_hits(facing[rows], count, distance, area_radiance(light, cosine), density)
