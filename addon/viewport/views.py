"""What a region of a 3D viewport shows, as camera, frame and border.

The rectangle that is seen comes from Blender's own window matrix, so that picture and overlays lie over each other in
any view: free, orthographic, or through a camera with its shift, zoom and offset. Where a camera stands comes from its
object, which has more digits than the view matrix.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import raytracer
from raytracer.film.camera import measure_film_extent
from raytracer.film.sensor import measure_fitted_side

from ..extract.camera import read_camera
from ..extract.warnings import WarningList

Matrix = NDArray[np.float64]
Border = tuple[int, int, int, int]

# Of cameras that show a given rectangle; only its ratio to the focal length matters.
SENSOR_WIDTH = 36.0


@dataclass(frozen=True)
class Window:
    """The rectangle that a region shows: of the plane at a distance of 1 (perspective) or of any (orthographic), metres
    from the view axis."""

    left: float
    bottom: float
    right: float
    top: float
    is_perspective: bool

    @property
    def width(self) -> float:
        return self.right - self.left

    @property
    def height(self) -> float:
        return self.top - self.bottom


@dataclass(frozen=True)
class RegionView:
    """What a region shows: the camera of its frame, width x height pixels, and the part that is drawn; None = all."""

    camera: raytracer.Camera
    width: int
    height: int
    border: Border | None


class EmptyBorderError(Exception):
    """A border that holds no pixel of the region."""


def read_view(region: Any, region_data: Any, space: Any, scene: Any) -> RegionView:
    """Return what a region shows of an evaluated scene.

    Raises
    ------
    ValueError
        If the camera's matrix has no inverse.
    EmptyBorderError
        If nothing is to be drawn.
    """
    window = read_window(np.array(region_data.window_matrix, dtype=np.float64))
    size = region.width, region.height
    seen_from = find_camera(region_data, space, scene)
    if seen_from is None:
        matrix = np.linalg.inv(np.array(region_data.view_matrix, dtype=np.float64))
        matrix[3] = (0.0, 0.0, 0.0, 1.0)
        camera = show_window(pinhole(matrix, find_clip(space, window)), window)
        return RegionView(camera, *size, find_border(space.use_render_border, read_borders(space, "render_"), size))
    lens = read_camera(seen_from, scene.render, WarningList())
    frame = find_frame(lens, scene.render)
    fractions = place_in_window(read_borders(scene.render, ""), frame, window)
    shown = show_window(lens, window) if lens.panorama is None else show_panorama(lens, frame, window)
    return RegionView(shown, *size, find_border(scene.render.use_border, fractions, size))


def find_camera(region_data: Any, space: Any, scene: Any) -> Any:
    """Return the object that a region looks through, or None for a free view."""
    if region_data.view_perspective != "CAMERA":
        return None
    return space.camera if space.use_local_camera else scene.camera


def read_window(matrix: Matrix) -> Window:
    """Return what a projection matrix (4, 4) shows.

    Perspective: (P00 x + P02 z) / -z is -1 and 1 at z = -1 where x = (P02 -+ 1) / P00. Orthographic: P00 x + P03 is
    where x = (-P03 -+ 1) / P00.
    """
    is_perspective = bool(matrix[3, 3] == 0)
    offset = matrix[:2, 2] if is_perspective else -matrix[:2, 3]
    scale = matrix.diagonal()[:2]
    low, high = (offset - 1.0) / scale, (offset + 1.0) / scale
    return Window(float(low[0]), float(low[1]), float(high[0]), float(high[1]), is_perspective)


def find_clip(space: Any, window: Window) -> tuple[float, float]:
    """Return the clipping distances of a free view: an orthographic one shows what is behind the eye as well."""
    if window.is_perspective:
        return space.clip_start, space.clip_end
    return -space.clip_end / 2, space.clip_end / 2


def pinhole(world_from_camera: Matrix, clip: tuple[float, float]) -> raytracer.Camera:
    """Return a camera that clips there; distances below 0 move it back along its axis."""
    start, end = clip
    matrix = world_from_camera.copy()
    if start < 0:
        matrix[:3, 3] -= start * matrix[:3, 2]
        start, end = 0.0, end - start
    return raytracer.Camera(matrix, clip_start=start, clip_end=end)


def show_window(camera: raytracer.Camera, window: Window) -> raytracer.Camera:
    """Return the camera with the window as its frame; a viewport's pixels are square."""
    return replace(
        camera,
        projection="perspective" if window.is_perspective else "orthographic",
        sensor_fit="horizontal",
        sensor_width=SENSOR_WIDTH,
        focal_length=SENSOR_WIDTH / window.width,
        ortho_scale=window.width,
        shift_x=(window.left + window.right) / (2 * window.width),
        shift_y=(window.bottom + window.top) / (2 * window.width),
        pixel_aspect=1.0,
    )


def show_panorama(camera: raytracer.Camera, frame: Window, window: Window) -> raytracer.Camera:
    """Return the panoramic camera with its picture in a frame, such as a perspective camera's, of the window."""
    assert camera.panorama is not None
    span = window.width / frame.width, window.height / frame.height
    return replace(
        camera,
        panorama=replace(camera.panorama, span=span),
        shift_x=camera.shift_x + (window.left - frame.left) / frame.width,
        shift_y=camera.shift_y + (window.bottom - frame.bottom) / frame.height,
        pixel_aspect=1.0,
    )


def find_frame(camera: raytracer.Camera, render: Any) -> Window:
    """Return the rectangle that a render of the camera shows, as a viewport's window."""
    width, height = render.resolution_x, render.resolution_y
    fitted, extent = measure_fitted_side(camera, width, height), measure_film_extent(camera)
    half_x, half_y = extent * width / fitted / 2, extent * height / (camera.pixel_aspect * fitted) / 2
    x, y = extent * camera.shift_x, extent * camera.shift_y
    return Window(x - half_x, y - half_y, x + half_x, y + half_y, camera.projection != "orthographic")


def read_borders(owner: Any, prefix: str) -> tuple[float, float, float, float]:
    """Return a border's left, bottom, right and top as fractions."""
    left, bottom, right, top = (getattr(owner, f"{prefix}border_{end}") for end in ("min_x", "min_y", "max_x", "max_y"))
    return left, bottom, right, top


def place_in_window(
    fractions: tuple[float, float, float, float], frame: Window, window: Window
) -> tuple[float, float, float, float]:
    """Return fractions of a frame as fractions of the window that it is seen in."""
    left, bottom, right, top = fractions
    x = [(frame.left + part * frame.width - window.left) / window.width for part in (left, right)]
    y = [(frame.bottom + part * frame.height - window.bottom) / window.height for part in (bottom, top)]
    return x[0], y[0], x[1], y[1]


def find_border(is_used: bool, fractions: tuple[float, float, float, float], size: tuple[int, int]) -> Border | None:
    """Return a border of fractions of a region in its pixels, or None where none is used."""
    if not is_used:
        return None
    limits = (*size, *size)
    x_min, y_min, x_max, y_max = (
        min(max(round(part * limit), 0), limit) for part, limit in zip(fractions, limits, strict=True)
    )
    if x_min >= x_max or y_min >= y_max:
        raise EmptyBorderError
    return x_min, y_min, x_max, y_max
