"""Aiming: which point of the picture sees a point of the scene through a point of the lens.

The inverse of `camera.primary_rays`. With l the point of the lens and f the distance of the focus, a camera ray goes
through l + t d, where d = q - l / f for the point q of the film plane. So a point y of camera space at the depth z is
seen where

    q = (y - l (1 - z / f)) / z,        of an orthographic camera        q = y - l (1 - z / f)

for x and y alike. While l stays, an area around y with the unit normal n is as large on the film as |n . d| / z^2 times
itself, with d = (y - l) / z, the ray's direction of depth 1; of an orthographic camera |n . d|.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from raytracer.arrays.rows import join_columns
from raytracer.arrays.types import Floats
from raytracer.film.camera import find_on_film, measure_film_extent, sample_aperture
from raytracer.film.sensor import measure_fitted_side
from raytracer.lecture import dot
from raytracer.scene.camera import Camera

# Metres before the camera; nothing is seen nearer. Its square is no subnormal number.
NEAREST = 2.0**-256


class SeenPoints(NamedTuple):
    """Where n points are seen.

    x, y : (n,) float64, pixels from the lower left corner of the full picture
    scale : (n,) float64, pixels of the film that a square metre of the surface takes; 0 behind the camera
    """

    x: Floats
    y: Floats
    scale: Floats


def find_camera_points(camera: Camera, points: Floats) -> Floats:
    """Return points (n, 3) of the world in camera space, which is turned and moved alone."""
    matrix = camera.world_from_camera
    offset = points - matrix[:3, 3]
    return join_columns(*(dot(offset, axis) for axis in matrix[:3, :3].T))


def find_through_lens(
    camera: Camera, width: int, height: int, points: Floats, normals: Floats, lens: Floats | None
) -> SeenPoints:
    """Return where surfaces at points (n, 3) with unit normals (n, 3), world, are seen; of cameras with a film plane.

    width, height : size of the full picture, pixels
    lens : as of `primary_rays`
    """
    local = find_camera_points(camera, points)
    before = local[:, 2] < -NEAREST
    depth = np.where(before, -local[:, 2], 1.0)
    start = np.zeros((len(points), 2))
    if lens is not None and camera.aperture_radius > 0:
        start = sample_aperture(camera, lens)
    shift = start * (1.0 - depth / camera.focus_distance)[:, np.newaxis]
    on_film = join_columns(local[:, 0] - shift[:, 0], local[:, 1] - shift[:, 1], -depth)
    x, y = find_on_film(camera, width, height, on_film)
    if camera.projection == "orthographic":
        direction = join_columns(*(-start / camera.focus_distance).T, np.full(len(points), -1.0))
        spread = np.ones(len(points))
    else:
        direction = (local - join_columns(*start.T, np.zeros(len(points)))) / depth[:, np.newaxis]
        spread = 1.0 / depth**2
    matrix = camera.world_from_camera[:3, :3]
    turned = join_columns(*(dot(normals, axis) for axis in matrix.T))
    scale = np.abs(dot(direction, turned)) * spread * measure_density(camera, width, height)
    return SeenPoints(x, y, np.where(before, scale, 0.0))


def measure_density(camera: Camera, width: int, height: int) -> float:
    """Return the pixels of a square metre of the film plane."""
    side = measure_fitted_side(camera, width, height) / measure_film_extent(camera)
    return float(side * side * camera.pixel_aspect)


def measure_blur(camera: Camera, width: int, height: int, depth: Floats) -> Floats:
    """Return how far from its middle (n,) the image of a point at depths (n,) reaches at most, pixels."""
    side = measure_fitted_side(camera, width, height) / measure_film_extent(camera) * max(camera.pixel_aspect, 1.0)
    reach = camera.aperture_radius * max(1.0, 1.0 / camera.aperture_ratio)
    blur = side * reach * np.abs(1.0 - depth / camera.focus_distance)
    return blur if camera.projection == "orthographic" else blur / depth
