"""How wide pixels are: as cameras say themselves, and what lies outside of pictures."""

from __future__ import annotations

import numpy as np
import pytest

from raytracer import Camera, Panorama
from raytracer.film.camera import find_on_film
from raytracer.subdivision.pixel_size import MOST_INSTANCES, View, choose_instances, is_wider, measure_pixels

WIDTH, HEIGHT = 360, 240
PLACE = np.array([(0.0, -1, 0, 3), (1, 0, 0, 2), (0, 0, 1, 1), (0, 0, 0, 1)])


def in_world(points):
    return np.asarray(points, float) @ PLACE[:3, :3].T + PLACE[:3, 3]


@pytest.mark.parametrize("depth", [0.5, 2.0, 40.0])
@pytest.mark.parametrize(
    "fields", [{}, {"projection": "orthographic"}, {"sensor_fit": "vertical"}, {"pixel_aspect": 2.0}]
)
def test_pixels_in_the_middle_are_those_of_the_camera(fields, depth):
    camera = Camera(PLACE, **fields)
    right, up = np.array([(0.0, 0, -depth), (1e-3, 0, -depth)]), np.array([(0.0, 0, -depth), (0, 1e-3, -depth)])
    seen = [np.hypot(*np.diff(find_on_film(camera, WIDTH, HEIGHT, points), axis=1)[:, 0]) for points in (right, up)]
    found = measure_pixels(View(camera, WIDTH, HEIGHT, 4.0), in_world(right[:1]))
    # The chord of an angle, not its tangent: 1 - 1/2 of 1/500 squared.
    np.testing.assert_allclose(found, 1e-3 / max(seen), rtol=1e-5)


def test_a_panorama_has_pixels_of_one_angle():
    camera = Camera(PLACE, projection="panorama", panorama=Panorama("equirectangular"))
    points = in_world([(0, 0, -2), (0, 0, 2), (3, 0, 0), (0.1, 0.2, 0.3)])
    found = measure_pixels(View(camera, WIDTH, 180, 4.0), points)
    np.testing.assert_allclose(found, np.linalg.norm(points - PLACE[:3, 3], axis=1) * np.deg2rad(1.0), rtol=1e-4)


def test_pixels_grow_outside_of_the_picture():
    """By what the distance to it says: of a point beside, of one behind, and of one above an orthographic picture."""
    view = View(Camera(PLACE), WIDTH, HEIGHT, 5.0)
    pixel = 1 / 500 / np.hypot(1, 1 / 500)
    side = np.array([1.0, 0, 0.36])
    side /= np.linalg.norm(side)
    inside = np.array([0.36, 0, -1])
    points = in_world([inside, inside + 0.5 * side, (0, 0, 3.0), (0, 0, -3.0)])
    at = np.linalg.norm(inside + 0.5 * side)
    expected = pixel * np.array([np.linalg.norm(inside), at + 4 * 0.5, 3 + 4 * 3, 3])
    np.testing.assert_allclose(measure_pixels(view, points), expected, rtol=1e-12)
    flat = View(Camera(PLACE, projection="orthographic", ortho_scale=3.6), WIDTH, HEIGHT, 5.0)
    half = np.hypot(1.8, 1.2) / np.sqrt(2)
    np.testing.assert_allclose(
        measure_pixels(flat, in_world([(0, 1.2 + half, -1), (1.8, 1.2, -9), (0, 0, half)])), (0.05, 0.01, 0.05)
    )


def test_nothing_at_the_camera_is_without_size():
    view = View(Camera(PLACE, clip_start=0.1), WIDTH, HEIGHT)
    np.testing.assert_allclose(measure_pixels(view, in_world([(0, 0, 0)])), 0.1 / 500, rtol=1e-5)


def test_the_instance_that_is_seen_largest_decides():
    view = View(Camera(PLACE), WIDTH, HEIGHT)
    near, far = np.eye(4), np.eye(4)
    near[:3, 3], far[:3, 3] = in_world([(0, 0, -1)])[0], in_world([(0, 0, -10)])[0]
    one, other = np.zeros((1, 3)), np.array([(0.01, 0.0, 0.0)])
    assert not is_wider(view, far[np.newaxis], 2.0, one, other).any()
    assert is_wider(view, np.stack([far, near]), 2.0, one, other).all()
    doubled = far * (10, 10, 10, 1)
    assert is_wider(view, doubled[np.newaxis], 2.0, one, other).all()


def test_of_many_instances_the_nearest_are_asked():
    view = View(Camera(PLACE), WIDTH, HEIGHT)
    places = np.tile(np.eye(4), (10 * MOST_INSTANCES, 1, 1))
    depth = 1.0 + np.random.default_rng(0).permutation(len(places))
    places[:, :3, 3] = in_world(depth[:, np.newaxis] * (0, 0, -1.0))
    found = choose_instances(view, places, np.zeros((1, 3)))
    np.testing.assert_array_equal(found, places[depth <= MOST_INSTANCES])


def test_an_edge_that_passes_the_camera_is_measured_in_its_middle():
    """10 m long, 1 m before the camera: 5000 pixels of its middle, but 980 of its ends."""
    view = View(Camera(np.eye(4)), WIDTH, HEIGHT)
    ends = np.array([(-5.0, 0, -1)]), np.array([(5.0, 0, -1)])
    assert is_wider(view, np.eye(4)[np.newaxis], 4990.0, *ends).all()
    assert not is_wider(view, np.eye(4)[np.newaxis], 5010.0, *ends).any()
