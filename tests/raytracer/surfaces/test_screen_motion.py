"""The Vector pass: closed forms of motion over the picture, and none of what stands still."""

from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.rendering.render import render
from tests.forbidding import forbid
from tests.raytracer.rendering.rendering_fixtures import make_lit_scene

SIZE = WIDTH, HEIGHT = 16, 12
PASSES = ("Vector",)
# Of places in a picture of 16 pixels, and of corners 99 metres away: units of roundoff of these.
ROUNDING = 2.0**-40


def move(*places):
    matrices = np.tile(np.eye(4), (len(places), 1, 1))
    matrices[:, :3, 3] = places
    return matrices


def make_plane(camera=None):
    """A plane of two triangles that fills the picture, which shows a metre in a pixel."""
    corners = [(-99, -99, 0), (99, -99, 0), (99, 99, 0), (-99, 99, 0)]
    camera = camera or raytracer.Camera(move((0, 0, 5))[0], projection="orthographic", ortho_scale=WIDTH)
    return raytracer.Scene(
        [raytracer.Mesh(corners, [(0, 1, 2), (0, 2, 3)])],
        instances=raytracer.Instances([0], np.eye(4)[np.newaxis]),
        camera=camera,
    )


def show(scene, **neighbors):
    scene = replace(scene, neighbors=raytracer.Motion(**neighbors))
    return render(scene, *SIZE, 1, passes=PASSES)["Vector"].astype(np.float64)


def test_an_object_that_moves_was_behind_and_will_be_ahead():
    places = move((-1, 2, 0), (0, 0, 0), (3, 0.5, 0))
    found = show(make_plane(), instances=raytracer.InstanceMotion([0], places[:, np.newaxis]))
    assert np.abs(found - (-1, 2, -3, -0.5)).max() < ROUNDING


def test_a_camera_that_moves_drives_the_picture_the_other_way():
    places = move((-1, 0, 5), (0, 0, 5), (0, 2, 5))
    found = show(make_plane(), camera=raytracer.CameraMotion(places))
    assert np.abs(found - (1, 0, 0, 2)).max() < ROUNDING


def test_a_camera_that_nears_spreads_the_picture():
    """From a height h, a point is seen at x / h: at 2/3 and at 2 times where it is, from 3, 2 and 1."""
    camera = raytracer.Camera(move((0, 0, 2))[0], focal_length=36.0)
    found = show(make_plane(camera), camera=raytracer.CameraMotion(move((0, 0, 3), (0, 0, 2), (0, 0, 1))))
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5 - WIDTH / 2, (np.arange(HEIGHT) + 0.5 - HEIGHT / 2)[::-1])
    expected = np.stack([-x / 3, -y / 3, -x, -y], axis=-1)
    assert np.abs(found - expected).max() < 1e-6 * WIDTH  # float32 of the film


def test_a_zoom_spreads_the_picture():
    camera = raytracer.Camera(move((0, 0, 2))[0], focal_length=36.0)
    still = np.tile(camera.world_from_camera, (3, 1, 1))
    found = show(make_plane(camera), camera=raytracer.CameraMotion(still, extent=[2.0, 1.0, 0.5]))
    x = np.arange(WIDTH) + 0.5 - WIDTH / 2
    assert np.abs(found[0, :, 0] + x / 2).max() < 1e-6 * WIDTH
    assert np.abs(found[0, :, 2] + x).max() < 1e-6 * WIDTH


def test_a_mesh_that_deforms_moves_each_point_by_its_corners():
    """Corners on the right move by 99, those on the left by -99: a point at x by x."""
    scene = make_plane()
    shapes = np.stack([scene.meshes[0].positions] * 3)
    shapes[0, :, 0] *= 2.0
    found = show(scene, meshes=raytracer.MeshMotion(0, shapes))
    x = np.arange(WIDTH) + 0.5 - WIDTH / 2
    assert np.abs(found[..., 0] - x).max() < 1e-6 * WIDTH
    assert not found[..., 1:].any()


def test_what_stands_still_or_is_missed_has_no_vector():
    scene = make_plane()
    matrices = np.tile(np.eye(4), (3, 1, 1, 1))
    assert not show(scene, instances=raytracer.InstanceMotion([0], matrices)).any()
    assert not show(raytracer.Scene(camera=scene.camera)).any()
    assert not show(raytracer.Scene(spheres=[raytracer.Spheres([(0, 0, 0)], [3.0])], camera=scene.camera)).any()
    assert not render(scene, *SIZE, 1, passes=PASSES)["Vector"].any()


def test_a_panorama_tells_of_turning():
    """An equirectangular picture of 16 pixels shows 22.5 degrees in one: a turn by 9 moves it by 0.4."""
    panorama = raytracer.Panorama("equirectangular")
    upright = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], float)
    camera = raytracer.Camera(upright, projection="panorama", panorama=panorama)
    turned = []
    for degrees in (-9.0, 0.0, 9.0):
        angle = np.radians(degrees)
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        turned.append(turn @ upright)
    scene = replace(make_plane(camera), instances=raytracer.Instances([0], move((0, 0, -1))))
    found = show(scene, camera=raytracer.CameraMotion(turned))[-1]  # the lowest row
    inner = slice(1, -1)  # at the seam a point leaves on one side and comes back on the other
    assert np.abs(np.abs(found[inner, 0]) - 0.4).max() < 1e-6
    assert np.abs(found[inner, 0] - found[inner, 2]).max() < 1e-6
    assert np.abs(found[inner, 1::2]).max() < 1e-6


def test_a_picture_without_the_pass_pays_nothing(monkeypatch):
    forbid(monkeypatch, "make_screen_motion", "find_vectors")
    render(make_lit_scene(), 4, 3, 1, passes=("Combined", "Depth"))


def make_strand(shape="ribbon"):
    """A strand along y that is wider than the picture, far below it, and bends where it is out of sight."""
    points = np.zeros((7, 3))
    points[:, 1], points[:, 2] = np.arange(-99, 100, 33), -99
    points[[0, -1], 0] = 3, -5
    curves = raytracer.Curves(points, [20.0] * 7, [0, 7], shape=shape)
    return raytracer.Scene(curves=curves, camera=make_plane().camera)


def follow(scene, points, matrices=None):
    radii = np.tile(scene.curves[0].radii, (len(points), 1))
    return raytracer.CurvesMotion(0, points, radii, move((0, 0, 0), (0, 0, 0)) if matrices is None else matrices)


@pytest.mark.parametrize("shape", ["ribbon", "thick"])
def test_a_strand_that_moves_was_behind_and_will_be_ahead(shape):
    """As a whole, and point by point."""
    scene, places = make_strand(shape), move((-1, 2, 0), (0, 0, 0), (3, 0.5, 0))
    still = scene.curves[0].points
    for motion in (follow(scene, still[np.newaxis], places), follow(scene, still + places[:, np.newaxis, :3, 3])):
        assert np.abs(show(scene, curves=motion) - (-1, 2, -3, -0.5)).max() < ROUNDING


def test_a_strand_that_changes_its_shape_moves_each_point_by_those_around_it():
    """All points of a strand go along x by their height over 33: so does each place between them, of the spline."""
    scene = make_strand()
    still = scene.curves[0].points
    steps = np.stack([still] * 3)
    steps[0, :, 0] += still[:, 1] / 33
    found = show(scene, curves=follow(scene, steps))
    y = (np.arange(HEIGHT) + 0.5 - HEIGHT / 2)[::-1]
    # The curve's place along y is that of u, on these even points, and the ray's.
    assert np.abs(found[..., 0] - y[:, np.newaxis] / 33).max() < 1e-6 * WIDTH
    assert not found[..., 1:].any()


def test_strands_that_stand_still_have_no_vector():
    scene = make_strand()
    assert not show(scene).any()
    assert not show(scene, curves=follow(scene, scene.curves[0].points[np.newaxis])).any()
