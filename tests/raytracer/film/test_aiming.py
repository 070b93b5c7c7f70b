"""Points seen through a lens: the ray through what is found meets them; sizes on the film against differences."""

import numpy as np
import pytest

from raytracer.film.aiming import find_through_lens, measure_blur
from raytracer.film.camera import primary_rays
from raytracer.lecture import distance_point_line
from raytracer.scene.camera import Camera

# cos = 0.6, sin = 0.8.
TURNED = np.array([[0.6, 0.0, 0.8, 1.0], [0.0, 1.0, 0.0, -2.0], [-0.8, 0.0, 0.6, 3.0], [0.0, 0.0, 0.0, 1.0]])
CAMERAS = [
    Camera(TURNED),
    Camera(TURNED, aperture_radius=0.5, focus_distance=3.0),
    Camera(TURNED, aperture_radius=0.5, focus_distance=3.0, aperture_blades=5, aperture_ratio=1.7, shift_x=0.2),
    Camera(TURNED, aperture_radius=0.5, focus_distance=3.0, pixel_aspect=1.5, sensor_fit="vertical"),
    Camera(TURNED, projection="orthographic", aperture_radius=0.5, focus_distance=3.0, shift_y=-0.1),
]
WIDTH, HEIGHT, COUNT = 48, 32, 50
STEP = 2.0**-16


def scatter(rng):
    """Return points from 2 to 10 metres before the camera, unit normals and points of the lens."""
    local = rng.uniform((-2, -2, -10), (2, 2, -2), (COUNT, 3))
    normals = rng.normal(size=(COUNT, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, np.newaxis]
    return local @ TURNED[:3, :3].T + TURNED[:3, 3], normals, rng.random((COUNT, 2))


@pytest.mark.parametrize("camera", CAMERAS)
def test_the_ray_through_what_is_found_meets_the_point(rng, camera):
    points, normals, lens = scatter(rng)
    seen = find_through_lens(camera, WIDTH, HEIGHT, points, normals, lens)
    rays = primary_rays(camera, WIDTH, HEIGHT, seen.x, seen.y, lens)
    directions = rays.directions / np.linalg.norm(rays.directions, axis=1)[:, np.newaxis]
    assert distance_point_line(points, rays.origins, directions).max() < 1e3 * np.finfo(np.float64).eps


@pytest.mark.parametrize("camera", CAMERAS)
def test_sizes_are_those_of_small_parallelograms(rng, camera):
    points, normals, lens = scatter(rng)
    u = np.cross(normals, rng.normal(size=(COUNT, 3)))
    u /= np.linalg.norm(u, axis=1)[:, np.newaxis]
    sides = [
        [
            (high - low) / (2.0 * STEP)
            for low, high in zip(
                find_through_lens(camera, WIDTH, HEIGHT, points - STEP * side, normals, lens)[:2],
                find_through_lens(camera, WIDTH, HEIGHT, points + STEP * side, normals, lens)[:2],
                strict=True,
            )
        ]
        for side in (u, np.cross(normals, u))
    ]
    expected = np.abs(sides[0][0] * sides[1][1] - sides[0][1] * sides[1][0])
    seen = find_through_lens(camera, WIDTH, HEIGHT, points, normals, lens)
    np.testing.assert_allclose(seen.scale, expected, rtol=1e-6, atol=1e-6 * expected.max())  # differences of 2^-16


@pytest.mark.parametrize("camera", CAMERAS)
def test_no_point_of_the_lens_sees_farther_than_the_blur_reaches(rng, camera):
    depth = np.array([2.0, 5.0])
    points = np.outer(-depth, TURNED[:3, 2]) + TURNED[:3, 3]
    numbers = rng.random((4000, 2))
    for point, reach in zip(points, measure_blur(camera, WIDTH, HEIGHT, depth), strict=True):
        rows = np.tile(point, (len(numbers), 1))
        middle = find_through_lens(camera, WIDTH, HEIGHT, rows[:1], rows[:1], None)
        seen = find_through_lens(camera, WIDTH, HEIGHT, rows, rows, numbers)
        farthest = np.hypot(seen.x - middle.x, seen.y - middle.y).max()
        assert farthest <= reach * (1 + 1e-12)
        assert farthest >= 0.5 * reach


def test_nothing_behind_the_camera_is_seen():
    points = TURNED[:3, 3] + np.array([[0.0], [1.0]]) * TURNED[:3, 2]
    seen = find_through_lens(CAMERAS[1], WIDTH, HEIGHT, points, points, np.full((2, 2), 0.5))
    assert seen.scale.tolist() == [0.0, 0.0]
