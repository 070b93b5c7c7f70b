"""The sensor of a camera, as Blender fits it to a picture: by its width or its height, to one side of it."""

from __future__ import annotations

from raytracer.scene.camera import Camera


def measure_fitted_side(camera: Camera, width: float, height: float) -> float:
    """Return the length, in pixel widths, of the side of the picture that the sensor is fitted to."""
    sides = {"horizontal": float(width), "vertical": height / camera.pixel_aspect}
    return max(sides.values()) if camera.sensor_fit == "auto" else sides[camera.sensor_fit]


def choose_sensor_side(camera: Camera) -> float:
    """Return the side of the sensor that is fitted, mm: automatically its width, to whichever side of the picture."""
    return camera.sensor_height if camera.sensor_fit == "vertical" else camera.sensor_width
