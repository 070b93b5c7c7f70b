"""Panoramic cameras: each point of the picture is a direction, whatever lies straight ahead.

A point's place in the picture, 0 to 1 from the lower left corner, is (u, v). Lenses measure it in millimetres on a
sensor; r is its distance from the middle there, theta the angle between its direction and the viewing axis, and a lens
is a relation of the two. Camera space is Blender's: x right, y up, looking along -z.

References
----------
Blender, intern/cycles/kernel/camera/projection.h and blender/camera.cpp (the mappings, their axes and sensors).
Schneider, Schwalbe, Maas, "Validation of geometric models for fisheye lenses", ISPRS Journal 64, 2009.
Brown, "Bringing pixels front and center in VR video", 2017 (equiangular cube maps).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from raytracer.arrays.rows import split_columns
from raytracer.arrays.types import Booleans, Floats
from raytracer.film.sensor import choose_sensor_side, measure_fitted_side
from raytracer.predicates.double_double import two_product, two_sum
from raytracer.scene.camera import Camera, Panorama

# Newton's steps for the radius that belongs to an angle of a polynomial lens, and where they are close enough.
MOST_STEPS, SMALLEST_STEP = 20, 1e-12


class Plane(NamedTuple):
    """Points of a picture in the unit of a projection, (n,) each, seen from the picture's middle."""

    x: Floats
    y: Floats


def find_directions(camera: Camera, width: int, height: int, x: Floats, y: Floats) -> Floats:
    """Return the unit directions (n, 3) that points of the picture show, camera space; 0 where the lens shows nothing.

    x, y : (n,) pixels from the lower left corner; width, height : of the full picture
    """
    panorama = require_panorama(camera)
    u, v = x / width * panorama.span[0] + camera.shift_x, y / height * panorama.span[1] + camera.shift_y
    project, _ = PROJECTIONS[panorama.kind]
    return project(panorama, measure_sensor(camera, width, height), u - 0.5, v - 0.5)


def find_on_panorama(camera: Camera, width: int, height: int, points: Floats) -> tuple[Floats, Floats]:
    """Return where points (n, 3) of camera space are seen, x and y (n,) in pixels: the inverse of `find_directions`."""
    panorama = require_panorama(camera)
    _, locate = PROJECTIONS[panorama.kind]
    place = locate(panorama, measure_sensor(camera, width, height), points)
    u, v = place.x + 0.5, place.y + 0.5
    return (u - camera.shift_x) / panorama.span[0] * width, (v - camera.shift_y) / panorama.span[1] * height


def place_eye(panorama: Panorama, directions: Floats) -> tuple[Floats, Floats]:
    """Return where an eye stands, (n, 3) of camera space, for unit directions (n, 3) that a camera shows, and the
    directions (n, 3), unit, in which it looks: to the right of each direction, at the camera's height.

    With the direction d and the eye's place e the eye looks along f d - e, at a distance f of convergence. From the
    first altitude of `pole_merge` on, the offset falls with a cosine to 0 at the second, as in Cycles.
    """
    side = np.stack([-directions[:, 2], np.zeros(len(directions)), directions[:, 0]], axis=1)
    first, last = panorama.pole_merge
    altitude = np.abs(np.arcsin(np.clip(directions[:, 1], -1.0, 1.0)))
    share = np.clip((altitude - first) / (last - first), 0.0, 1.0) if last > first else (altitude > last) * 1.0
    eye = panorama.eye_offset * np.cos(share * np.pi / 2)[:, np.newaxis] * normalize_exactly(side)
    if np.isinf(panorama.convergence):
        return eye, directions
    return eye, normalize_exactly(panorama.convergence * directions - eye)


def require_panorama(camera: Camera) -> Panorama:
    """Return the panorama of a camera that is known to have one."""
    assert camera.panorama is not None
    return camera.panorama


def measure_sensor(camera: Camera, width: int, height: int) -> tuple[float, float]:
    """Return width and height, mm, of the part of the sensor that a picture shows: the fitted side is the sensor's."""
    span = require_panorama(camera).span
    across, up = width / span[0], height / span[1]
    side = choose_sensor_side(camera) / measure_fitted_side(camera, across, up)
    return side * across, side * up / camera.pixel_aspect


def normalize_exactly(vectors: Floats) -> Floats:
    """Return (n, 3) vectors at a length of 1 to within an ulp; those of no length stay as they are.

    What rounding leaves of 1 - |v|^2 after a division by |v| is found in pairs of floats; half of it is added along v.
    """
    length = np.sqrt((vectors[:, 0] ** 2 + vectors[:, 1] ** 2) + vectors[:, 2] ** 2)
    unit = vectors / np.where(length > 0, length, 1.0)[:, np.newaxis]
    high, low = np.ones(len(unit)), np.zeros(len(unit))
    for axis in range(3):
        square, rest = two_product(unit[:, axis], unit[:, axis])
        high, carry = two_sum(high, -square)
        low += carry - rest
    return unit + unit * (np.where(length > 0, high + low, 0.0) / 2.0)[:, np.newaxis]


# Projections: from the picture's points, measured from its middle, to directions, and back.


def project_equirectangular(panorama: Panorama, sensor: tuple[float, float], x: Floats, y: Floats) -> Floats:
    """Longitude and latitude grow evenly along the picture's sides."""
    longitude, latitude = interpolate(panorama.longitude, x), interpolate(panorama.latitude, y)
    level = np.cos(latitude)
    return normalize_exactly(
        np.stack([level * np.sin(longitude), np.sin(latitude), -level * np.cos(longitude)], axis=1)
    )


def locate_equirectangular(panorama: Panorama, sensor: tuple[float, float], points: Floats) -> Plane:
    """The inverse of `project_equirectangular`."""
    x, y, z = split_columns(points)
    longitude, latitude = np.arctan2(x, -z), np.arctan2(y, np.hypot(x, z))
    return Plane(find_share(panorama.longitude, longitude), find_share(panorama.latitude, latitude))


def project_cylinder(panorama: Panorama, sensor: tuple[float, float], x: Floats, y: Floats) -> Floats:
    """Longitude grows evenly across, and the height on a cylinder of radius 1 upwards."""
    longitude, height = interpolate(panorama.cylinder[:2], x), interpolate(panorama.cylinder[2:], y)
    return normalize_exactly(np.stack([np.sin(longitude), height, -np.cos(longitude)], axis=1))


def locate_cylinder(panorama: Panorama, sensor: tuple[float, float], points: Floats) -> Plane:
    """The inverse of `project_cylinder`."""
    x, y, z = split_columns(points)
    longitude, radius = np.arctan2(x, -z), np.hypot(x, z)
    height = np.divide(y, radius, out=np.zeros_like(radius), where=radius > 0)
    return Plane(find_share(panorama.cylinder[:2], longitude), find_share(panorama.cylinder[2:], height))


def project_cube_face(panorama: Panorama, sensor: tuple[float, float], x: Floats, y: Floats) -> Floats:
    """A face of a cube whose pixels cover equal angles along its middle lines."""
    across, up = np.tan(x * (np.pi / 2)), np.tan(y * (np.pi / 2))
    return normalize_exactly(np.stack([across, up, np.full_like(x, -1.0)], axis=1))


def locate_cube_face(panorama: Panorama, sensor: tuple[float, float], points: Floats) -> Plane:
    """The inverse of `project_cube_face`."""
    x, y, z = split_columns(points)
    return Plane(np.arctan2(x, -z) / (np.pi / 2), np.arctan2(y, -z) / (np.pi / 2))


def project_mirror_ball(panorama: Panorama, sensor: tuple[float, float], x: Floats, y: Floats) -> Floats:
    """What a ball of polished steel shows from far away, turned round so that its middle looks ahead.

    At the point (X, Y) of the disk the ball's normal is n = (X, Y, s), X^2 + Y^2 + s^2 = 1; the direction is the axis
    reflected there, (2 s X, 2 s Y, 1 - 2 s^2).
    """
    across, up = 2.0 * x, 2.0 * y
    square = 1.0 - (across**2 + up**2)
    facing = np.sqrt(np.maximum(square, 0.0))
    directions = np.stack([2.0 * facing * across, 2.0 * facing * up, 1.0 - 2.0 * facing**2], axis=1)
    return leave_out(normalize_exactly(directions), square < 0)


def locate_mirror_ball(panorama: Panorama, sensor: tuple[float, float], points: Floats) -> Plane:
    """The inverse of `project_mirror_ball`: the normal halves the angle between axis and direction."""
    unit = normalize_exactly(points)
    facing = np.sqrt(np.maximum((1.0 - unit[:, 2]) / 2.0, 0.0))
    scale = np.divide(0.25, facing, out=np.zeros_like(facing), where=facing > 0)
    return Plane(unit[:, 0] * scale, unit[:, 1] * scale)


def project_equidistant(panorama: Panorama, sensor: tuple[float, float], x: Floats, y: Floats) -> Floats:
    """theta = r, in such a unit that the circle within the picture is the field of view."""
    radius = 2.0 * np.hypot(x, y)
    return leave_out(point_from_axis(radius * panorama.field_of_view / 2.0, x, y), radius > 1.0)


def locate_equidistant(panorama: Panorama, sensor: tuple[float, float], points: Floats) -> Plane:
    """The inverse of `project_equidistant`."""
    return place_around_middle(points, measure_angle(points) / panorama.field_of_view)


def project_equisolid(panorama: Panorama, sensor: tuple[float, float], x: Floats, y: Floats) -> Floats:
    """r = 2 f sin(theta / 2): equal areas of the sensor are equal solid angles."""
    across, up = x * sensor[0], y * sensor[1]
    radius = np.hypot(across, up)
    largest = 2.0 * panorama.lens * np.sin(panorama.field_of_view / 4.0)
    angle = 2.0 * np.arcsin(np.minimum(radius / (2.0 * panorama.lens), 1.0))
    return leave_out(point_from_axis(angle, across, up), radius > largest)


def locate_equisolid(panorama: Panorama, sensor: tuple[float, float], points: Floats) -> Plane:
    """The inverse of `project_equisolid`."""
    place = place_around_middle(points, 2.0 * panorama.lens * np.sin(measure_angle(points) / 2.0))
    return Plane(place.x / sensor[0], place.y / sensor[1])


def project_polynomial(panorama: Panorama, sensor: tuple[float, float], x: Floats, y: Floats) -> Floats:
    """theta = -(k_0 + k_1 r + k_2 r^2 + k_3 r^3 + k_4 r^4), as lenses are calibrated."""
    across, up = x * sensor[0], y * sensor[1]
    angle = -evaluate_polynomial(panorama.polynomial, np.hypot(across, up))
    return leave_out(point_from_axis(angle, across, up), np.abs(angle) > panorama.field_of_view / 2.0)


def locate_polynomial(panorama: Panorama, sensor: tuple[float, float], points: Floats) -> Plane:
    """The inverse of `project_polynomial`, by Newton's steps from the root of its linear part, of each point as many as
    it needs: what others need decides about no bit."""
    aim, slopes = -measure_angle(points), np.arange(1, 5) * np.array(panorama.polynomial[1:])
    radius = (aim - panorama.polynomial[0]) / panorama.polynomial[1] if panorama.polynomial[1] else np.ones_like(aim)
    goes_on = np.ones(len(radius), dtype=np.bool_)
    for _ in range(MOST_STEPS):
        slope = evaluate_polynomial(slopes, radius)
        step = (aim - evaluate_polynomial(panorama.polynomial, radius)) / np.where(slope != 0, slope, 1.0)
        radius = radius + np.where(goes_on, step, 0.0)
        goes_on &= ~(np.abs(step) < SMALLEST_STEP)
        if not goes_on.any():
            break
    place = place_around_middle(points, radius)
    return Plane(place.x / sensor[0], place.y / sensor[1])


def interpolate(ends: tuple[float, ...], place: Floats) -> Floats:
    """Return what lies between two ends at a place, -0.5 to 0.5."""
    return (ends[0] + ends[1]) / 2.0 + (ends[1] - ends[0]) * place


def find_share(ends: tuple[float, ...], value: Floats) -> Floats:
    """The inverse of `interpolate`."""
    return (value - (ends[0] + ends[1]) / 2.0) / (ends[1] - ends[0])


def evaluate_polynomial(coefficients: Iterable[float], radius: Floats) -> Floats:
    """Return k_0 + k_1 r + k_2 r^2 + ... by Horner's rule."""
    value = np.zeros_like(radius)
    for coefficient in reversed(tuple(coefficients)):
        value = value * radius + coefficient
    return value


def point_from_axis(angle: Floats, x: Floats, y: Floats) -> Floats:
    """Return unit vectors (n, 3) at an angle from the axis -z, towards (x, y); the axis itself where that is 0."""
    radius = np.hypot(x, y)
    share = np.divide(np.sin(angle), radius, out=np.zeros_like(radius), where=radius > 0)
    return normalize_exactly(np.stack([share * x, share * y, -np.cos(angle)], axis=1))


def measure_angle(points: Floats) -> Floats:
    """Return the angles (n,) between the axis -z and points."""
    return np.arctan2(np.hypot(points[:, 0], points[:, 1]), -points[:, 2])


def place_around_middle(points: Floats, radius: Floats) -> Plane:
    """Return places at a distance from the middle, in the direction in which points lie from the axis."""
    distance = np.hypot(points[:, 0], points[:, 1])
    scale = np.divide(radius, distance, out=np.zeros_like(distance), where=distance > 0)
    return Plane(points[:, 0] * scale, points[:, 1] * scale)


def leave_out(directions: Floats, outside: Booleans) -> Floats:
    """Return directions with 0 where the lens shows nothing."""
    return np.where(outside[:, np.newaxis], 0.0, directions)


Project = Callable[[Panorama, tuple[float, float], Floats, Floats], Floats]
Locate = Callable[[Panorama, tuple[float, float], Floats], Plane]

PROJECTIONS: dict[str, tuple[Project, Locate]] = {
    "equirectangular": (project_equirectangular, locate_equirectangular),
    "cube_face": (project_cube_face, locate_cube_face),
    "mirror_ball": (project_mirror_ball, locate_mirror_ball),
    "fisheye_equidistant": (project_equidistant, locate_equidistant),
    "fisheye_equisolid": (project_equisolid, locate_equisolid),
    "fisheye_polynomial": (project_polynomial, locate_polynomial),
    "cylinder": (project_cylinder, locate_cylinder),
}
