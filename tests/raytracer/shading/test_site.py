"""The size of a pixel on a surface, by which bumps are measured: against the camera's own neighbouring rays."""

from types import SimpleNamespace

import numpy as np
import pytest

from raytracer.film.camera import primary_rays
from raytracer.scene.camera import Camera
from raytracer.shading.footprint import measure_footprint
from raytracer.shading.light_path import LightPath
from raytracer.shading.site_tables import CameraView

WIDTH, HEIGHT = 320, 200
TURNED = np.array([[0.36, 0.48, -0.8, 1.0], [-0.8, 0.6, 0.0, 2.0], [0.48, 0.64, 0.6, 3.0], [0, 0, 0, 1.0]])


def look(camera, column, row):
    directions = primary_rays(camera, WIDTH, HEIGHT, column, row).directions
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.mark.parametrize("focal_length", [18.0, 50.0])
def test_a_pixel_is_as_large_as_the_step_between_neighbouring_rays(focal_length):
    camera = Camera(TURNED, focal_length=focal_length)
    view = CameraView(camera, WIDTH, HEIGHT, np.linalg.inv(TURNED))
    rng = np.random.default_rng(1)
    column, row = rng.uniform(0, WIDTH, 50), rng.uniform(0, HEIGHT, 50)
    middle = look(camera, column, row)
    steps = [look(camera, column + 1, row) - middle, look(camera, column, row + 1) - middle]
    distance = rng.uniform(1, 9, 50)
    expected = distance * np.mean([np.linalg.norm(step, axis=1) for step in steps], axis=0)
    tables, surface = SimpleNamespace(view=view), SimpleNamespace(outgoing=-middle)
    path = LightPath({"travelled": distance, "camera": np.ones(50)})
    # A step of a pixel is no differential: it is off by a pixel's angle at most.
    np.testing.assert_allclose(measure_footprint(tables, surface, path), expected, rtol=view.pixel)
    reflected = LightPath({"travelled": distance, "camera": np.zeros(50)})
    np.testing.assert_allclose(measure_footprint(tables, surface, reflected), distance * view.pixel)
