"""How large a pixel is where rays hit: the step of finite differences."""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import transform
from raytracer.shading.light_path import LightPath
from raytracer.shading.site_tables import SiteTables
from raytracer.surfaces.surface import Surface


def measure_footprint(tables: SiteTables, surface: Surface, path: LightPath | None) -> Floats:
    """Return about the size (n,) of a pixel, metres, where rays hit, at the end of the way that they travelled.

    A camera's rays stand closer away from the picture's centre: to a pixel's width w at 1 m belong the angles
    w |d_z| sqrt(1 - d_x^2) and w |d_z| sqrt(1 - d_y^2) around a direction d in its space, of which the mean is taken.
    What has been reflected is taken for a ray of the centre.
    """
    travelled = np.zeros(len(surface)) if path is None else path.values["travelled"]
    if tables.view is None:
        return 1e-3 * travelled
    if tables.view.camera.projection == "orthographic":
        return np.full(len(travelled), tables.view.pixel)
    if path is None or "camera" not in path.values or tables.view.camera.panorama is not None:
        return tables.view.pixel * travelled
    x, y, z = np.moveaxis(transform(tables.view.camera_from_world[:3, :3], surface.outgoing), -1, 0)
    angle = np.abs(z) * (np.sqrt(np.maximum(1.0 - x * x, 0.0)) + np.sqrt(np.maximum(1.0 - y * y, 0.0))) / 2.0
    return tables.view.pixel * travelled * np.where(path.values["camera"] > 0, angle, 1.0)
