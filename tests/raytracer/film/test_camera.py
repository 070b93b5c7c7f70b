"""Primary rays against the lecture's line through two points and hand-computed cameras."""

import numpy as np
import pytest

from raytracer.film.camera import FILM_DEPTH, primary_rays
from raytracer.lecture import line_through, point_on_line
from raytracer.scene.camera import Camera

# cos = 0.6, sin = 0.8: a rotation whose products with small dyadic numbers stay accurate to an ulp.
TURNED = np.array([[0.6, 0.0, 0.8, 10.0], [0.0, 1.0, 0.0, -20.0], [-0.8, 0.0, 0.6, 30.0], [0.0, 0.0, 0.0, 1.0]])
EPSILON = np.finfo(np.float64).eps


def make_camera(**fields) -> Camera:
    return Camera(**{"world_from_camera": np.eye(4), **fields})


def test_perspective_ray_through_the_centre_looks_along_the_axis():
    rays = primary_rays(make_camera(world_from_camera=TURNED), 640, 480, np.array([320.0]), np.array([240.0]))
    assert np.array_equal(rays.origins, [[10.0, -20.0, 30.0]])
    assert np.array_equal(rays.directions, [[-0.8, 0.0, -0.6]])


def test_perspective_ray_through_a_corner_follows_similar_triangles():
    """36 mm of sensor behind 50 mm of lens: the left border lies at 18/50 of the depth, the lower at 3/4 of that."""
    rays = primary_rays(make_camera(), 640, 480, np.array([0.0, 640.0]), np.array([0.0, 480.0]))
    expected = np.array([[-0.36, -0.27, -1.0], [0.36, 0.27, -1.0]])
    assert np.allclose(rays.directions, expected, rtol=4 * EPSILON, atol=0)


def test_orthographic_rays_are_parallel_and_start_in_the_camera_plane():
    camera = make_camera(projection="orthographic", ortho_scale=8.0)
    rays = primary_rays(camera, 640, 480, np.array([0.0, 640.0]), np.array([0.0, 480.0]))
    assert np.array_equal(rays.origins, [[-4.0, -3.0, 0.0], [4.0, 3.0, 0.0]])
    assert np.array_equal(rays.directions, [[0.0, 0.0, -1.0]] * 2)


def test_sensor_fit_chooses_side_and_sensor():
    """The half width of the view at depth 1, wide picture 200x100 and tall picture 100x200, 36 x 24 mm, lens 50 mm."""
    for fit, wide, tall in (("auto", 0.36, 0.18), ("horizontal", 0.36, 0.36), ("vertical", 0.48, 0.12)):
        camera = make_camera(sensor_fit=fit)
        for (width, height), expected in (((200, 100), wide), ((100, 200), tall)):
            rays = primary_rays(camera, width, height, np.array([float(width)]), np.array([height / 2]))
            assert np.allclose(rays.directions, [[expected, 0.0, -1.0]], rtol=4 * EPSILON, atol=0)


def test_shift_counts_in_fitted_sides():
    camera = make_camera(shift_x=0.5, shift_y=-0.25)
    rays = primary_rays(camera, 200, 100, np.array([100.0]), np.array([50.0]))
    assert np.allclose(rays.directions, [[0.36, -0.18, -1.0]], rtol=4 * EPSILON, atol=0)


def test_pixel_aspect_widens_pixels():
    """A 100 x 200 picture of pixels twice as wide as high is square."""
    rays = primary_rays(make_camera(pixel_aspect=2.0), 100, 200, np.array([100.0]), np.array([200.0]))
    assert np.allclose(rays.directions, [[0.36, 0.36, -1.0]], rtol=4 * EPSILON, atol=0)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_clipping_planes_are_t_exactly(projection):
    """The point at t_min lies in the plane at depth clip_start: exact in camera space, where z is -t."""
    camera = make_camera(projection=projection, clip_start=0.1, clip_end=77.7)
    random = np.random.default_rng(3)
    rays = primary_rays(camera, 64, 48, 64 * random.random(100), 48 * random.random(100))
    for t, depth in ((rays.t_min, 0.1), (rays.t_max, 77.7)):
        assert np.array_equal(t, np.full(100, depth))
        assert np.array_equal(point_on_line(rays.origins, rays.directions, t)[:, 2], np.full(100, -depth))


def test_rays_are_the_lectures_line_through_eye_and_film_point():
    camera = make_camera(world_from_camera=TURNED)
    random = np.random.default_rng(4)
    rays = primary_rays(camera, 64, 48, 64 * random.random(100), 48 * random.random(100))
    eye = TURNED[:3, 3]
    film = point_on_line(rays.origins, rays.directions, np.full(100, FILM_DEPTH))
    origin, direction = line_through(eye, film)
    assert np.array_equal(rays.origins, origin)
    # q itself is rounded to an ulp of its size, 30 m.
    assert np.allclose(rays.directions, direction, rtol=0, atol=32 * EPSILON)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_a_batch_equals_its_rays_one_at_a_time(projection):
    camera = make_camera(world_from_camera=TURNED, projection=projection, shift_x=0.1)
    random = np.random.default_rng(5)
    x, y = 64 * random.random(37), 48 * random.random(37)
    batch = primary_rays(camera, 64, 48, x, y)
    for index in range(37):
        ray = primary_rays(camera, 64, 48, x[index : index + 1], y[index : index + 1])
        assert np.array_equal(ray.origins[0], batch.origins[index])
        assert np.array_equal(ray.directions[0], batch.directions[index])


LENS = {"aperture_radius": 0.3, "focus_distance": 4.0}


def cast_lens_rays(count=500, projection="perspective", **fields):
    """Rays of one point of the picture, spread over the lens, in camera space."""
    view = Camera(np.eye(4), projection=projection, **{**LENS, **fields})
    pair = np.random.default_rng(7).random((count, 2))
    return primary_rays(view, 40, 30, np.full(count, 7.3), np.full(count, 21.1), pair)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_lens_rays_of_a_point_meet_in_the_plane_of_focus(projection):
    rays = cast_lens_rays(projection=projection)
    sharp = primary_rays(Camera(np.eye(4), projection=projection), 40, 30, np.array([7.3]), np.array([21.1]))
    met = rays.origins + LENS["focus_distance"] * rays.directions
    expected = sharp.origins + LENS["focus_distance"] * sharp.directions
    np.testing.assert_allclose(met, np.broadcast_to(expected, met.shape), atol=16 * np.finfo(float).eps)
    np.testing.assert_array_equal(rays.directions[:, 2], -1.0)  # t is the depth


def test_lens_is_a_disk_of_the_aperture():
    """Even: of 500 points half lie within 1 / sqrt(2) of the radius, give or take five standard deviations."""
    radii = np.hypot(*cast_lens_rays().origins[:, :2].T)
    assert radii.max() <= LENS["aperture_radius"]
    assert abs((radii < LENS["aperture_radius"] / np.sqrt(2)).sum() - 250) < 5 * np.sqrt(500) / 2


@pytest.mark.parametrize("blades", [3, 5, 8])
def test_blades_make_a_polygon(blades):
    """Of k corners on the border, the first at rotation + pi / k; evenly filled: each of k sectors alike."""
    rotation, count = 0.4, 20_000
    points = cast_lens_rays(count, aperture_blades=blades, aperture_rotation=rotation).origins[:, :2]
    angle = (np.arctan2(points[:, 1], points[:, 0]) - rotation + np.pi / blades) % (2 * np.pi)
    sector, within = np.divmod(angle, 2 * np.pi / blades)
    height = np.hypot(*points.T) * np.cos(within - np.pi / blades)
    inner = LENS["aperture_radius"] * np.cos(np.pi / blades)
    assert (height <= inner * (1 + 8 * np.finfo(float).eps)).all()
    for share, expected in (
        (np.bincount(sector.astype(int)) / count, 1 / blades),
        ((height < inner / 2).mean(), 1 / 4),
    ):
        assert (np.abs(share - expected) < 5 * np.sqrt(expected / count)).all()


def test_ratio_narrows_the_aperture():
    wide, narrow = cast_lens_rays(), cast_lens_rays(aperture_ratio=2.0)
    np.testing.assert_allclose(narrow.origins[:, 0], wide.origins[:, 0] / 2, rtol=4 * np.finfo(float).eps)
    np.testing.assert_array_equal(narrow.origins[:, 1], wide.origins[:, 1])


def test_pinhole_needs_no_lens():
    with_lens, without = cast_lens_rays(aperture_radius=0.0), cast_lens_rays(1)
    assert (with_lens.origins == 0).all()
    assert (without.origins != 0).any()
