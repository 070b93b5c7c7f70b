"""How long an edge may be: so many pixels of a camera, or metres of the object.

A pixel at a distance r from a perspective camera is r w / sqrt(1 + w^2) wide, where w is the width of one in the middle
of the picture at a distance of 1; of an orthographic one it is what it is everywhere; a panorama has pixels as large as
the one in the middle of its picture, at any distance. Beside and behind the picture pixels grow: by `offscreen` - 1
times what one would be as far off as the point is from all that is seen.

References
----------
Blender, intern/cycles/scene/camera.cpp, Camera::world_to_raster_size, and subd/split.cpp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from raytracer.arrays.types import Booleans, Floats
from raytracer.arrays.vectors import transform
from raytracer.film.camera import locate_on_film, measure_film_extent
from raytracer.film.panorama import find_directions
from raytracer.film.sensor import measure_fitted_side
from raytracer.lecture import dot, length
from raytracer.scene.camera import Camera

# Of the instances of a mesh that may be the finest, so many are asked: those that are nearest.
MOST_INSTANCES = 64


@dataclass(frozen=True)
class View:
    """A camera that meshes are diced for.

    width, height : of its picture, pixels
    offscreen : how much larger edges may be outside the picture, 1 or more
    """

    camera: Camera
    width: int
    height: int
    offscreen: float = 1.0


def measure_pixels(view: View, points: Floats) -> Floats:
    """Return how wide pixels are at points (n, 3) in the world, (n,) metres."""
    seen = transform(np.linalg.inv(view.camera.world_from_camera), np.pad(points, ((0, 0), (0, 1)), constant_values=1))
    seen = seen[:, :3]
    if view.camera.projection == "panorama":
        return measure_angle(view) * np.maximum(length(seen), view.camera.clip_start)
    fitted = measure_fitted_side(view.camera, view.width, view.height)
    width = measure_film_extent(view.camera) / fitted * min(1.0, 1.0 / view.camera.pixel_aspect)
    if view.camera.projection == "orthographic":
        return width * (1.0 + (view.offscreen - 1.0) * measure_beside(view, seen))
    width /= np.hypot(1.0, width)
    distance = np.maximum(length(seen), view.camera.clip_start)
    return width * (distance + (view.offscreen - 1.0) * measure_outside(view, seen))


def measure_angle(view: View) -> float:
    """Return the angle of the pixel in the middle of a panorama."""
    x, y = 0.5 * view.width + np.array([0.0, 1.0, 0.0]), 0.5 * view.height + np.array([0.0, 0.0, 1.0])
    middle, right, above = find_directions(view.camera, view.width, view.height, x, y)
    return float(min(length(right - middle), length(above - middle)))


def find_frame(view: View) -> tuple[Floats, Floats]:
    """Return the lower left and the upper right corner of the picture, (3,) each, on the film plane."""
    sides = np.array([0.0, view.width]), np.array([0.0, view.height])
    low, high = locate_on_film(view.camera, view.width, view.height, *sides)
    return low, high


def measure_beside(view: View, seen: Floats) -> Floats:
    """Return how far points (n, 3) of camera space are from what an orthographic camera sees, (n,), in half diagonals
    of the picture over sqrt(2)."""
    low, high = find_frame(view)
    nearest = np.clip(seen, [low[0], low[1], -np.inf], [high[0], high[1], 0.0])
    return length(seen - nearest) / (np.hypot(*(high - low)[:2]) / np.sqrt(8.0))


def measure_outside(view: View, seen: Floats) -> Floats:
    """Return how far points (n, 3) of camera space are from the pyramid that a perspective camera sees, (n,) metres:
    the distance to the farthest of its four sides, and to its tip for those behind."""
    low, high = find_frame(view)
    depth = -low[2]
    sides = np.array([(-depth, 0, -low[0]), (depth, 0, high[0]), (0, -depth, -low[1]), (0, depth, high[1])])
    distances = [dot(seen, side / length(side)) for side in sides]
    outside = np.maximum(np.max(distances, axis=0), 0.0)
    return np.where((seen[:, 2] > 0) & (outside > 0), length(seen), outside)


def is_longer(size: float, one: Floats, other: Floats) -> Booleans:
    """Return (n,) True for edges between points (n, 3) that are longer than a size."""
    return length(one - other) > size


def is_wider(view: View, world_from_object: Floats, pixels: float, one: Floats, other: Floats) -> Booleans:
    """Return (n,) True for edges between points (n, 3) of an object that are longer than so many pixels.

    world_from_object : (i, 4, 4) where it stands; an edge is too long if it is so for one of these

    The smallest of the pixels at both ends and in the middle counts.
    """
    found = np.zeros(len(one), np.bool_)
    for matrix in world_from_object:
        first, last = (transform(matrix[:3, :3], points) + matrix[:3, 3] for points in (one, other))
        pixel = np.minimum(measure_pixels(view, first), measure_pixels(view, last))
        pixel = np.minimum(pixel, measure_pixels(view, 0.5 * (first + last)))
        found |= length(last - first) > pixels * pixel
    return found


def choose_instances(view: View, world_from_object: Floats, positions: Floats) -> Floats:
    """Return those of the places (i, 4, 4) of an object where it may be seen largest, `MOST_INSTANCES` at most.

    positions : (v, 3) of its vertices
    """
    if len(world_from_object) <= MOST_INSTANCES:
        return world_from_object
    middle = 0.5 * (positions.min(axis=0) + positions.max(axis=0))
    centres = (world_from_object[:, :3, :3] * middle).sum(axis=2) + world_from_object[:, :3, 3]
    scale = np.linalg.norm(world_from_object[:, :3, :3], axis=(1, 2))
    nearest = np.argsort(measure_pixels(view, centres) / np.maximum(scale, np.finfo(float).tiny), kind="stable")
    return world_from_object[np.sort(nearest[:MOST_INSTANCES])]
