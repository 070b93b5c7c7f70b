"""How what is seen moves over the picture, from the frame before and to the next: Blender's Vector pass.

A point of a surface is found again, by its barycentric weights, where its triangle is at both frames, and is seen
through the cameras of these. With its places x, in pixels, y up, the vector is (x_before - x, x - x_after).

References
----------
Blender, intern/cycles/kernel/geom/primitive.h: primitive_motion_vector. (Cycles takes the mean over a pixel's samples,
which between two surfaces is the motion of neither; here it is that of the pixel's centre.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from raytracer.arrays.types import Floats, Integers
from raytracer.casting.geometry import Geometry, Kind, pack_geometry, transform_points, world_corners
from raytracer.film.camera import find_on_film
from raytracer.scene.camera import Camera
from raytracer.scene.moments import find_moment
from raytracer.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Moment:
    """Where things are at a frame, and what is seen of them."""

    geometry: Geometry
    camera: Camera
    camera_from_world: Floats


@dataclass(frozen=True, eq=False)
class ScreenMotion:
    """A scene at the frame before, now, and at the next; width and height of the picture, pixels."""

    before: Moment
    now: Moment
    after: Moment
    width: int
    height: int


def make_screen_motion(scene: Scene, geometry: Geometry, resolution: tuple[int, int]) -> ScreenMotion | None:
    """Return what tells how a scene moves over the picture; None where nothing is known of other frames.

    geometry : the scene's; resolution : of the full picture, pixels
    """
    if scene.neighbors is None or scene.camera is None:
        return None
    moving = replace(scene, motion=scene.neighbors)
    before, after = (_make_moment(find_moment(moving, time)) for time in (0.0, 1.0))
    return ScreenMotion(before, _look(scene.camera, geometry), after, *resolution)


def _make_moment(scene: Scene) -> Moment:
    assert scene.camera is not None
    return _look(scene.camera, pack_geometry(scene))


def _look(camera: Camera, geometry: Geometry) -> Moment:
    return Moment(geometry, camera, np.linalg.inv(camera.world_from_camera))


def find_vectors(
    motion: ScreenMotion, position: Floats, instance: Integers, primitive: Integers, barycentric: Floats
) -> Floats:
    """Return the vectors (n, 4), pixels, of points (n, 3) in the world, on triangles or on spheres, which do not move.

    barycentric : (n, 2) weights of the corners 1 and 2
    """
    here = _see(motion, motion.now, position)
    places = []
    for moment in (motion.before, motion.after):
        moved = position.copy()
        rows = np.flatnonzero(moment.geometry.belongs_to_kind(instance, Kind.TRIANGLE))
        which = instance[rows], primitive[rows]
        then, now = (_interpolate(other.geometry, *which, barycentric[rows]) for other in (moment, motion.now))
        moved[rows] += then - now  # nothing, to the bit, where it stands still
        places.append(_see(motion, moment, moved))
    return np.concatenate([places[0] - here, here - places[1]], axis=1)


def _interpolate(geometry: Geometry, instance: Integers, primitive: Integers, barycentric: Floats) -> Floats:
    a, b, c = world_corners(geometry, instance, primitive)
    return a + barycentric[:, :1] * (b - a) + barycentric[:, 1:] * (c - a)


def _see(motion: ScreenMotion, moment: Moment, points: Floats) -> Floats:
    """Return where points (n, 3) in the world are seen, (n, 2) pixels."""
    seen = transform_points(moment.camera_from_world, points)
    return np.stack(find_on_film(moment.camera, motion.width, motion.height, seen), axis=1)
