"""How what is seen moves over the picture, from the frame before and to the next: Blender's Vector pass.

A point of a surface is found again, by its barycentric weights, where its triangle is at both frames, and is seen
through the cameras of these. With its places x, in pixels, y up, the vector is (x_before - x, x - x_after). A point of
a strand, of which each ray sees another side, moves as the center line's nearest it: by P(u) then less P(u) now.

References
----------
Blender, intern/cycles/kernel/geom/primitive.h: primitive_motion_vector. (Cycles takes the mean over a pixel's samples,
which between two surfaces is the motion of neither; here it is that of the pixel's centre. Its strands' center lines
are straight from key to key, and so is what it takes for P(u) now.)
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
from raytracer.surfaces.curve_points import find_curve_centres


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
    """Return the vectors (n, 4), pixels, of points (n, 3) in the world, on triangles, strands, or spheres, which do not
    move.

    barycentric : (n, 2) weights of the corners 1 and 2; of strands u first
    """
    here = _see(motion, motion.now, position)
    places = []
    for moment in (motion.before, motion.after):
        moved = position.copy()
        for kind, find in FOLLOWED.items():
            rows = np.flatnonzero(moment.geometry.belongs_to_kind(instance, kind))
            if len(rows):
                which = instance[rows], primitive[rows], barycentric[rows]
                moved[rows] += find(moment.geometry, *which) - find(motion.now.geometry, *which)
        places.append(_see(motion, moment, moved))
    return np.concatenate([places[0] - here, here - places[1]], axis=1)


def _interpolate(geometry: Geometry, instance: Integers, primitive: Integers, barycentric: Floats) -> Floats:
    a, b, c = world_corners(geometry, instance, primitive)
    return a + barycentric[:, :1] * (b - a) + barycentric[:, 1:] * (c - a)


def _find_centres(geometry: Geometry, instance: Integers, primitive: Integers, barycentric: Floats) -> Floats:
    return find_curve_centres(geometry, instance, primitive, barycentric[:, 0])


# What finds a point again, of each kind that moves: nothing moves, to the bit, what stands still.
FOLLOWED = {Kind.TRIANGLE: _interpolate, Kind.CURVE: _find_centres}


def _see(motion: ScreenMotion, moment: Moment, points: Floats) -> Floats:
    """Return where points (n, 3) in the world are seen, (n, 2) pixels."""
    seen = transform_points(moment.camera_from_world, points)
    return np.stack(find_on_film(moment.camera, motion.width, motion.height, seen), axis=1)
