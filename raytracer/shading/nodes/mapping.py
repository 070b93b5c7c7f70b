"""Vectors turned and moved: Mapping, Vector Rotate, Vector Transform, Normal, Radial Tiling.

References
----------
Blender, intern/cycles/kernel/svm/mapping_util.h, vector_rotate.h, vector_transform.h.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from raytracer.arrays.vectors import normalize
from raytracer.lecture import cross, dot
from raytracer.shading.nodes.operation import Array, Operation, divide, spread, stack
from raytracer.shading.site import Site
from raytracer.textures.radial_tiling import tile_radially


def make_rotation(angles: Any) -> Array:
    """Return matrices (..., 3, 3) that turn about x, then y, then z by angles (..., 3), radians."""
    angles = np.asarray(angles, dtype=np.float64)
    (sx, sy, sz), (cx, cy, cz) = np.moveaxis(np.sin(angles), -1, 0), np.moveaxis(np.cos(angles), -1, 0)
    rows = (
        (cy * cz, sx * sy * cz - cx * sz, cx * sy * cz + sx * sz),
        (cy * sz, sx * sy * sz + cx * cz, cx * sy * sz - sx * cz),
        (-sy, sx * cy, cx * cy),
    )
    return np.stack([stack(*row) for row in rows], axis=-2)


def turn(vector: Any, angles: Any, back: bool = False) -> Array:
    """Apply the rotation by Euler angles, or its inverse."""
    matrix = make_rotation(angles)
    return dot(np.swapaxes(matrix, -1, -2) if back else matrix, np.asarray(vector, float)[..., np.newaxis, :])


def map_vector(vector: Any, location: Any, rotation: Any, scale: Any, *, vector_type: str) -> Array:
    """Scale, rotate, move; the inverse for TEXTURE; without location for VECTOR and NORMAL."""
    if vector_type == "TEXTURE":
        return divide(turn(np.asarray(vector) - location, rotation, back=True), scale)
    if vector_type == "NORMAL":
        return normalize(turn(divide(vector, scale), rotation))
    turned = turn(np.asarray(vector) * scale, rotation)
    return turned + location if vector_type == "POINT" else turned


AXES = {"X_AXIS": (1.0, 0.0, 0.0), "Y_AXIS": (0.0, 1.0, 0.0), "Z_AXIS": (0.0, 0.0, 1.0)}


def rotate_vector(
    vector: Any, centre: Any, axis: Any, angle: Any, rotation: Any, *, rotation_type: str, invert: bool
) -> Array:
    """Rodrigues' formula about an axis, or Euler angles; an axis without length turns nothing."""
    arm = np.asarray(vector, float) - centre
    if rotation_type == "EULER_XYZ":
        return turn(arm, rotation, back=invert) + centre
    unit = normalize(np.asarray(AXES.get(rotation_type, axis), float))
    angle = spread(-np.asarray(angle) if invert else angle)
    unit, arm = np.broadcast_arrays(unit, arm)
    along = unit * spread(dot(unit, arm)) * (1.0 - np.cos(angle))
    turned = arm * np.cos(angle) + cross(unit, arm) * np.sin(angle) + along
    return np.where(spread(np.abs(unit).max(axis=-1)) > 0, turned, arm) + centre


def transform_vector(site: Site, vector: Any, *, vector_type: str, convert_from: str, convert_to: str) -> Array:
    """From one of world, object and camera space to another, as a point, a vector or a normal."""
    if convert_from == convert_to:
        return np.asarray(vector)
    world = site.to_world(vector, convert_from, vector_type)
    result = site.from_world(world, convert_to, vector_type)
    return normalize(result) if vector_type == "NORMAL" else result


OPERATIONS = {
    "MAPPING": Operation(map_vector, ("Vector", "Location", "Rotation", "Scale"), ("Vector",), ("vector_type",)),
    "VECTOR_ROTATE": Operation(
        rotate_vector,
        ("Vector", "Center", "Axis", "Angle", "Rotation"),
        ("Vector",),
        ("rotation_type", "invert"),
    ),
    "VECT_TRANSFORM": Operation(
        transform_vector,
        ("Vector",),
        ("Vector",),
        ("vector_type", "convert_from", "convert_to"),
        reads_site=True,
    ),
    "ShaderNodeRadialTiling": Operation(  # the type that Blender gives it
        tile_radially,
        ("Vector", "Sides", "Roundness"),
        ("Segment Coordinates", "Segment ID", "Segment Width", "Segment Rotation"),
        ("normalize",),
    ),
    "NORMAL Dot": Operation(
        lambda normal, *, direction: dot(normalize(np.asarray(normal)), direction),
        ("Normal",),
        ("Dot",),
        ("direction",),
    ),
    "NORMAL Normal": Operation(lambda *, direction: np.asarray(direction), (), ("Normal",), ("direction",)),
}
