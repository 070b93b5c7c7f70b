"""The camera, as Blender sets it up: perspective, orthographic or panoramic, with a lens."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from raytracer.arrays.checks import as_array, require_choice, require_range
from raytracer.scene.fields import set_array, set_count, set_field, set_number

PROJECTIONS = ("perspective", "orthographic", "panorama")
PANORAMAS = (
    *("equirectangular", "cube_face", "mirror_ball", "cylinder"),
    *("fisheye_equidistant", "fisheye_equisolid", "fisheye_polynomial"),
)


# Angles, heights and coefficients beyond it mean nothing, and would overflow.
LARGEST = 1e30


@dataclass(frozen=True, eq=False)
class Panorama:
    """How a panoramic camera maps directions to its picture; see `film.panorama`.

    kind : one of PANORAMAS
    longitude, latitude : radians at the left and right, and the lower and upper edge, of an equirectangular picture
    field_of_view : radians, of fisheyes; lens : mm, focal length of an equisolid one
    polynomial : the five coefficients of a polynomial lens, radians per mm^k
    cylinder : longitudes at left and right, heights at the lower and upper edge of a cylinder of radius 1
    span : width and height of the picture in those of the whole panorama: a viewport shows more or less than that
    eye_offset : metres from the camera to the right, where an eye that turns with its direction stands; 0 for none
    convergence : metres at which eyes look at the same point as the camera; inf for eyes that look in parallel
    pole_merge : radians, altitudes between which the eye comes to the camera's place
    """

    kind: str = "equirectangular"
    longitude: tuple[float, float] = (-np.pi, np.pi)
    latitude: tuple[float, float] = (-np.pi / 2, np.pi / 2)
    field_of_view: float = np.pi
    lens: float = 10.5
    polynomial: tuple[float, ...] = (0.0, -0.02, 0.0, 0.0, 0.0)
    cylinder: tuple[float, ...] = (-np.pi, np.pi, -1.0, 1.0)
    span: tuple[float, float] = (1.0, 1.0)
    eye_offset: float = 0.0
    convergence: float = np.inf
    pole_merge: tuple[float, float] = (np.pi / 2, np.pi / 2)

    def __post_init__(self) -> None:
        tiny = np.nextafter(0.0, 1.0)
        require_choice(self.kind, PANORAMAS, "Panorama: kind")
        for name in ("field_of_view", "lens"):
            set_number(self, name, tiny, np.inf, "Panorama")
        for name, count in (
            ("longitude", 2),
            ("latitude", 2),
            ("polynomial", 5),
            ("cylinder", 4),
            ("span", 2),
            ("pole_merge", 2),
        ):
            values = as_array(getattr(self, name), np.float64, (count,), f"Panorama: {name}")
            require_range(values, -LARGEST, LARGEST, f"Panorama: {name}")
            set_field(self, name, tuple(values.tolist()))
        require_range(np.array(self.span), tiny, np.inf, "Panorama: span")
        set_number(self, "eye_offset", -LARGEST, LARGEST, "Panorama")
        convergence = as_array(self.convergence, np.float64, (), "Panorama: convergence")
        require_range(convergence, tiny, np.inf, "Panorama: convergence")
        set_field(self, "convergence", float(convergence))


@dataclass(frozen=True, eq=False)
class Camera:
    """Blender's camera: looks along its -z axis, y up.

    world_from_camera : (4, 4) float64, rigid (scale is removed where the camera is extracted)
    projection : 'perspective', 'orthographic' or 'panorama'; panorama : how the last maps directions to the picture
    focal_length, sensor_width, sensor_height : millimetres; sensor_fit : 'auto', 'horizontal' or 'vertical'
    ortho_scale : metres, the larger (or fitted) side of an orthographic view
    shift_x, shift_y : Blender's lens shift, in units of the fitted side
    clip_start, clip_end : metres along the view axis; along the ray of a panorama
    pixel_aspect : width over height of a pixel (Blender's pixel_aspect_x / pixel_aspect_y)
    aperture_radius : metres, of the lens that rays start from; 0 is a pinhole, all in focus
    focus_distance : metres along the view axis, where all rays of a point of the picture meet
    aperture_blades : corners of the aperture's polygon; fewer than 3 make a disk
    aperture_rotation : radians, counter-clockwise as the camera sees; aperture_ratio : height over width
    """

    world_from_camera: Any
    projection: str = "perspective"
    focal_length: float = 50.0
    sensor_width: float = 36.0
    sensor_height: float = 24.0
    sensor_fit: str = "auto"
    ortho_scale: float = 6.0
    shift_x: float = 0.0
    shift_y: float = 0.0
    clip_start: float = 0.0
    clip_end: float = np.inf
    pixel_aspect: float = 1.0
    aperture_radius: float = 0.0
    focus_distance: float = 10.0
    aperture_blades: int = 0
    aperture_rotation: float = 0.0
    aperture_ratio: float = 1.0
    panorama: Panorama | None = None

    def __post_init__(self) -> None:
        tiny = np.nextafter(0.0, 1.0)
        matrix = set_array(self, "world_from_camera", np.float64, (4, 4), "Camera")
        if (matrix[3] != (0.0, 0.0, 0.0, 1.0)).any():
            raise ValueError(
                f"Camera: world_from_camera: expected (0, 0, 0, 1) as the last row, got {matrix[3].tolist()}"
            )
        require_choice(self.projection, PROJECTIONS, "Camera: projection")
        if (self.projection == "panorama") != isinstance(self.panorama, Panorama):
            raise ValueError(
                "Camera: panorama: expected a Panorama where the projection is 'panorama', and None elsewhere, "
                f"got {type(self.panorama).__name__} with '{self.projection}'"
            )
        require_choice(self.sensor_fit, ("auto", "horizontal", "vertical"), "Camera: sensor_fit")
        lens = ("focal_length", "sensor_width", "sensor_height", "ortho_scale", "pixel_aspect")
        for name in (*lens, "focus_distance", "aperture_ratio"):
            set_number(self, name, tiny, np.inf, "Camera")
        for name in ("shift_x", "shift_y", "aperture_rotation"):
            set_number(self, name, -np.inf, np.inf, "Camera")
        for name in ("clip_start", "aperture_radius"):
            set_number(self, name, 0.0, np.inf, "Camera")
        set_count(self, "aperture_blades", "Camera")
        clip_end = as_array(self.clip_end, np.float64, (), "Camera: clip_end")
        require_range(clip_end, self.clip_start, np.inf, "Camera: clip_end")
        set_field(self, "clip_end", float(clip_end))
