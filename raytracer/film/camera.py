"""Primary rays: from the eye through sample points on the film plane ("Ray Tracing Fundamentals" of the lecture).

A camera ray is the lecture's line through two points, p + t (q - p): p is the eye and q the sample's point on the film
plane, which stands one metre in front of the eye. So t is the depth along the viewing axis, in metres, for perspective
and orthographic cameras alike: Blender's clipping planes are exactly t_min and t_max, and the Depth pass is t.

A panorama has no film plane: a point of its picture is a direction (`panorama`), of length 1, and t the distance.

A lens has extent: rays start all over it, and those of one point of the picture meet in the plane of focus. With the
start l on the lens, and the focus at the distance f, p becomes p + l and the direction d becomes d - l / f.

Camera space is Blender's: x right, y up, looking along -z.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from raytracer.arrays.rows import join_columns, lay_columns
from raytracer.arrays.types import Floats
from raytracer.casting.rays import Rays
from raytracer.film.panorama import (
    find_directions,
    find_on_panorama,
    normalize_exactly,
    place_eye,
    require_panorama,
)
from raytracer.film.sensor import choose_sensor_side, measure_fitted_side
from raytracer.lecture import dot, line_through
from raytracer.sampling.warps import sample_disk
from raytracer.scene.camera import Camera

FILM_DEPTH = 1.0  # metres from the eye to the film plane: makes t the depth


def primary_rays(camera: Camera, width: int, height: int, x: Floats, y: Floats, lens: Floats | None = None) -> Rays:
    """Return the rays through points of the picture.

    Parameters
    ----------
    camera : Camera
    width, height : size of the full picture, pixels
    x, y : (n,) float64, pixels from the lower left corner, y up; the centre of pixel (i, j) is (i + 0.5, j + 0.5)
    lens : (n, 2) uniform numbers, for the point of the lens; None starts all rays from its centre

    Returns
    -------
    Rays of n, world space; t is the depth along the viewing axis, from clip_start to clip_end; of a panorama, the
    distance, and the direction is 0 where its lens shows nothing
    """
    if camera.projection == "panorama":
        return panoramic_rays(camera, find_directions(camera, width, height, x, y), lens)
    film = locate_on_film(camera, width, height, x, y)  # (n, 3)
    eye = np.zeros((1, 3)) if camera.projection == "perspective" else film + np.array([0.0, 0.0, FILM_DEPTH])
    _, directions = line_through(eye, film)
    if lens is not None and camera.aperture_radius > 0:
        start = join_columns(*sample_aperture(camera, lens).T, np.zeros(len(lens)))
        eye, directions = eye + start, directions - start / camera.focus_distance
    return place_rays(camera, eye, directions)


def place_rays(camera: Camera, origins: Floats, directions: Floats) -> Rays:
    """Return rays of camera space in world space, within the camera's clipping planes.

    origins : (n, 3), or (1, 3) where all start at one point; directions : (n, 3)
    """
    matrix = camera.world_from_camera
    return Rays(
        origins=lay_columns(np.broadcast_to(_rotate(matrix, origins) + matrix[:3, 3], directions.shape)),
        directions=_rotate(matrix, directions),
        t_min=np.full(len(directions), camera.clip_start),
        t_max=np.full(len(directions), camera.clip_end),
    )


def panoramic_rays(camera: Camera, directions: Floats, lens: Floats | None) -> Rays:
    """Return the rays of a panorama in directions (n, 3) of camera space, unit or 0.

    A ray starts on a lens that faces its own direction d, with a polygon's corners turned like Cycles': the lens' first
    axis is the viewing axis (of a mirror ball, x) without its part along d.
    """
    origins = np.zeros_like(directions)
    if lens is not None and camera.aperture_radius > 0:
        is_ball = require_panorama(camera).kind == "mirror_ball"
        axis = np.array([1.0, 0.0, 0.0] if is_ball else [0.0, 0.0, -1.0])
        seen = directions.any(axis=1)
        first = axis - dot(directions, axis)[:, np.newaxis] * directions
        first = np.where(first.any(axis=1)[:, np.newaxis], first, np.array([0.0, 1.0, 0.0]))
        first = normalize_exactly(first)
        second = np.cross(directions, first) * (-1.0 if is_ball else 1.0)
        place = sample_aperture(camera, lens)
        origins = (place[:, :1] * first + place[:, 1:] * second) * seen[:, np.newaxis]
        directions = normalize_exactly(directions * camera.focus_distance - origins)
    if require_panorama(camera).eye_offset:
        eye, directions = place_eye(require_panorama(camera), directions)
        origins = origins + eye
    rays = place_rays(camera, origins, directions)
    return replace(rays, directions=normalize_exactly(rays.directions))


def sample_aperture(camera: Camera, pair: Floats) -> Floats:
    """Return points (n, 2) of the lens, metres, even over its aperture, for uniform numbers (n, 2).

    A polygon of k corners, on the lens' border at the angles rotation + (2 j + 1) pi / k, is k triangles around its
    centre; what is left of the first number within one spreads points in it. The ratio narrows the whole.
    """
    if camera.aperture_blades < 3:
        points = sample_disk(pair)
    else:
        half = np.pi / camera.aperture_blades
        side, rest = np.divmod(pair[:, 0] * camera.aperture_blades, 1.0)
        outwards = np.sqrt(rest)
        along = outwards * np.cos(half)
        across = outwards * (2.0 * pair[:, 1] - 1.0) * np.sin(half)
        turn = camera.aperture_rotation + side * 2.0 * half
        cosine, sine = np.cos(turn), np.sin(turn)
        points = np.stack([cosine * along - sine * across, sine * along + cosine * across], axis=1)
    return points * (camera.aperture_radius / camera.aperture_ratio, camera.aperture_radius)


def locate_on_film(camera: Camera, width: int, height: int, x: Floats, y: Floats) -> Floats:
    """Return the points of the film plane, z = -FILM_DEPTH in camera space, that the picture's points (x, y) show.

    With the fitted side of the picture as unit of length, measured in pixel widths:
    (X, Y) = extent * ((x - width / 2) / fitted + shift_x, (y - height / 2) / (aspect fitted) + shift_y).

    Returns
    -------
    (n, 3) float64, metres
    """
    fitted = measure_fitted_side(camera, width, height)
    extent = measure_film_extent(camera)
    return join_columns(
        extent * ((x - width / 2) / fitted + camera.shift_x),
        extent * ((y - height / 2) / (camera.pixel_aspect * fitted) + camera.shift_y),
        np.full(len(x), -FILM_DEPTH),
    )


def find_on_film(camera: Camera, width: int, height: int, points: Floats) -> tuple[Floats, Floats]:
    """Return where points (n, 3) of camera space are seen, x and y (n,) in pixels: the inverse of `locate_on_film`."""
    if camera.projection == "panorama":
        return find_on_panorama(camera, width, height, points)
    fitted = measure_fitted_side(camera, width, height)
    extent = measure_film_extent(camera)
    depth = -points[:, 2] / FILM_DEPTH if camera.projection == "perspective" else np.ones(len(points))
    depth = np.where(depth == 0, np.nextafter(0.0, 1.0), depth)
    x = (points[:, 0] / depth / extent - camera.shift_x) * fitted + width / 2
    y = (points[:, 1] / depth / extent - camera.shift_y) * camera.pixel_aspect * fitted + height / 2
    return x, y


def measure_film_extent(camera: Camera) -> float:
    """Return the length of the fitted side on the film plane, metres.

    By similar triangles, sensor / focal length at a distance of 1; an orthographic camera states the extent itself.
    """
    if camera.projection == "orthographic":
        return camera.ortho_scale
    return FILM_DEPTH * choose_sensor_side(camera) / camera.focal_length


def _rotate(matrix: Floats, vectors: Floats) -> Floats:
    """Apply the linear part of a 4x4 matrix to (n, 3) vectors.

    One ufunc per product, not a matrix product: BLAS may round a row differently in a batch of another size.
    """
    x, y, z = vectors.T
    return join_columns(*(row[0] * x + row[1] * y + row[2] * z for row in matrix[:3]))
