"""Matrices and shapes between steps of time: closed forms, and bits that must not change."""

import numpy as np
import pytest

import raytracer
from raytracer.scene.moments import find_moment, moves_geometry
from raytracer.scene.rigid_motion import find_step, interpolate, interpolate_matrices

# Of a product of two rotations whose entries are off by a few units of roundoff.
ROUNDING = 2.0**-48


def rotate(angle, axis=(0.0, 0.0, 1.0)):
    """The rotation by an angle, radians, about a unit axis: Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.cos(angle) * np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * np.outer(axis, axis)


def place(linear, origin=(0.0, 0.0, 0.0)):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, origin
    return matrix


def between(first, second, time):
    return interpolate_matrices(np.stack([first, second])[:, np.newaxis], time)[0]


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 0.6, 0.8), (2 / 7, 3 / 7, 6 / 7)])
@pytest.mark.parametrize("angle", [1e-9, 0.01, 1.0, np.pi / 2, 3.0])
@pytest.mark.parametrize("time", [0.25, 0.5, 0.9])
def test_a_rotation_turns_evenly_about_its_axis(axis, angle, time):
    tilt = rotate(0.7, (0.0, 1.0, 0.0))
    found = between(place(tilt, (1, 2, 3)), place(rotate(angle, axis) @ tilt, (3, 2, 1)), time)
    assert np.abs(found[:3, :3] - rotate(time * angle, axis) @ tilt).max() < ROUNDING
    assert np.allclose(found[:3, 3], (1 + 2 * time, 2, 3 - 2 * time), rtol=0, atol=ROUNDING)


def test_a_rotation_takes_the_shorter_way():
    found = between(place(np.eye(3)), place(rotate(1.5 * np.pi)), 0.5)
    assert np.abs(found[:3, :3] - rotate(-np.pi / 4)).max() < ROUNDING


def test_half_a_turn_stays_a_rotation():
    """The shorter way is either, and matrices in between must not collapse as linear ones do."""
    found = between(place(np.eye(3)), place(np.diag([-1.0, -1.0, 1.0])), 0.5)
    assert np.abs(found[:3, :3] @ found[:3, :3].T - np.eye(3)).max() < ROUNDING
    assert abs(abs(found[0, 1]) - 1.0) < ROUNDING


@pytest.mark.parametrize("stretch", [np.diag([2.0, 1.0, 0.5]), np.diag([-1.0, 1.0, 1.0]), np.diag([1e-6, 1.0, 1e6])])
def test_a_stretched_or_mirrored_object_turns_likewise(stretch):
    found = between(place(stretch), place(rotate(1.0) @ stretch), 0.5)
    scale = np.abs(stretch).sum(axis=0)
    assert (np.abs(found[:3, :3] - rotate(0.5) @ stretch) <= ROUNDING * scale.max()).all()


def test_a_changing_scale_is_linear():
    found = between(place(np.diag([1.0, 2.0, 3.0])), place(np.diag([3.0, 2.0, 1.0])), 0.25)
    assert np.abs(found[:3, :3] - np.diag([1.5, 2.0, 2.5])).max() < ROUNDING


def test_what_is_squeezed_flat_changes_linearly():
    first, second = place(np.diag([1.0, 1.0, 0.0])), place(rotate(1.0))
    found = between(first, second, 0.5)
    assert np.array_equal(found, interpolate(first, second, 0.5))


def test_bits_stay_at_steps_and_of_what_stands_still():
    rng = np.random.default_rng(0)
    steps = np.tile(np.eye(4), (5, 3, 1, 1))
    steps[:, :2, :3] = rng.normal(size=(5, 2, 3, 4))
    steps[:, 2, :3] = rng.normal(size=(3, 4))
    for number in range(5):
        assert np.array_equal(interpolate_matrices(steps, number / 4), steps[number])
    for time in rng.random(20):
        assert np.array_equal(interpolate_matrices(steps, time)[2], steps[0, 2])
    values = rng.normal(size=(2, 1000))
    assert np.array_equal(interpolate(values[0], values[0], 0.3), values[0])
    assert np.array_equal(interpolate(values[0], values[1], 1.0), values[1])


def test_steps_are_even_and_the_last_time_is_the_last_step():
    assert find_step(0.0, 3) == (0, 0.0)
    assert find_step(0.5, 3) == (1, 0.0)
    assert find_step(0.75, 3) == (1, 0.5)
    assert find_step(1.0, 3) == (1, 1.0)
    assert find_step(np.nextafter(0.5, 0.0), 3)[0] == 0


def make_scene(**motion):
    triangle = raytracer.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], normals=[[0, 0, 1]] * 3)
    return raytracer.Scene(
        [triangle, triangle],
        instances=raytracer.Instances([0, 1], np.tile(np.eye(4), (2, 1, 1))),
        camera=raytracer.Camera(np.eye(4)),
        motion=raytracer.Motion(**motion),
    )


def test_a_moment_holds_what_has_moved_and_the_same_records_of_the_rest():
    shapes = np.zeros((2, 3, 3))
    shapes[1, :, 2] = 1.0
    scene = make_scene(meshes=raytracer.MeshMotion(1, shapes, np.tile([0.0, 0.0, 1.0], (2, 3, 1))))
    moment = find_moment(scene, 0.25)
    assert moment.motion is None
    assert moment.meshes[0] is scene.meshes[0]
    assert moment.instances is scene.instances
    assert moment.camera is scene.camera
    assert np.array_equal(moment.meshes[1].positions, shapes[1] * 0.25)


def test_spheres_go_with_their_object():
    """Half of a quarter turn about a point beside them, while their object grows to twice its size."""
    centres, radii = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 2.0]]), np.array([0.1, 0.2])
    steps = np.array([place(np.eye(3), (5, 0, 0)), place(2.0 * rotate(np.pi / 2), (7, 0, 0))])
    spheres = raytracer.Spheres(centres + np.array([5.0, 0.0, 0.0]), radii, name="Cloud")
    motion = raytracer.Motion(spheres=raytracer.SpheresMotion(0, centres, radii, steps))
    scene = raytracer.Scene(spheres=spheres, motion=motion)
    assert moves_geometry(motion)
    moment = find_moment(scene, 0.5).spheres[0]
    root = 1.5 * np.sqrt(0.5)
    np.testing.assert_allclose(moment.centres, [[6 + root, root, 0], [6, 0, 3]], rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(moment.radii, 1.5 * radii, rtol=1e-14)
    assert moment.name == "Cloud"
    np.testing.assert_array_equal(find_moment(scene, 0.0).spheres[0].centres, spheres.centres)


def test_spheres_whose_object_grows_from_nothing_are_points_before():
    steps = np.array([place(np.zeros((3, 3))), place(np.zeros((3, 3))), place(np.eye(3))])
    motion = raytracer.Motion(spheres=raytracer.SpheresMotion(0, [[0.0, 0.0, 2.0]], [0.5], steps))
    scene = raytracer.Scene(spheres=raytracer.Spheres([[0.0, 0.0, 2.0]], [0.5]), motion=motion)
    assert find_moment(scene, 0.25).spheres[0].radii < 1e-300
    assert find_moment(scene, 0.75).spheres[0].radii == pytest.approx(0.25)
    hits = raytracer.build(find_moment(scene, 0.25)).closest_hit([(0.0, 0.0, -1.0)], [(0.0, 0.1, 1.0)])
    assert hits.instance == -1


def test_curves_go_with_their_object_and_change_their_shape():
    """Half of a quarter turn, of an object that grows to twice its size, while a tip rises by 1 and gets thinner."""
    points = np.array([[[1.0, 0.0, 0.0], [1.0, 0.0, 1.0]], [[1.0, 0.0, 0.0], [1.0, 0.0, 2.0]]])
    radii = np.array([[0.2, 0.1], [0.2, 0.0]])
    steps = np.array([place(np.eye(3), (5, 0, 0)), place(2.0 * rotate(np.pi / 2), (7, 0, 0))])
    curves = raytracer.Curves(points[0] + np.array([5.0, 0.0, 0.0]), radii[0], [0, 2], name="Hair")
    motion = raytracer.Motion(curves=raytracer.CurvesMotion(0, points, radii, steps))
    scene = raytracer.Scene(curves=curves, motion=motion)
    assert moves_geometry(motion)
    moment = find_moment(scene, 0.5).curves[0]
    root = 1.5 * np.sqrt(0.5)
    np.testing.assert_allclose(moment.points, [[6 + root, root, 0], [6 + root, root, 1.5 * 1.5]], atol=1e-14)
    np.testing.assert_allclose(moment.radii, [0.3, 0.075], rtol=1e-14)
    assert (moment.name, moment.world_from_object[0, 3]) == ("Hair", 6.0)
    still = raytracer.Motion(curves=raytracer.CurvesMotion(0, points[:1], radii[:1], steps))
    rigid = find_moment(raytracer.Scene(curves=curves, motion=still), 0.5).curves[0]
    np.testing.assert_allclose(rigid.points[1], [6 + root, root, 1.5], atol=1e-14)


def test_the_film_of_a_zooming_camera_grows_linearly():
    """As in Cycles, which interpolates the film's points, of three steps."""
    still = np.tile(np.eye(4), (3, 1, 1))
    scene = make_scene(camera=raytracer.CameraMotion(still, extent=[1.0, 2.0, 4.0]))
    lengths = [find_moment(scene, time).camera.focal_length for time in (0.0, 0.25, 0.5, 0.75, 1.0)]
    assert np.allclose(50.0 / np.array(lengths), [1.0, 1.5, 2.0, 3.0, 4.0], rtol=ROUNDING, atol=0)


MATRICES = np.tile(np.eye(4), (3, 1, 1, 1))
SHAPES = np.zeros((3, 3, 3))


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        ({"instances": raytracer.InstanceMotion([2], MATRICES)}, "expected numbers from 0 to 1"),
        ({"meshes": raytracer.MeshMotion(2, SHAPES, SHAPES)}, "expected numbers below 2"),
        ({"meshes": raytracer.MeshMotion(0, SHAPES)}, "normals: expected"),
        ({"meshes": raytracer.MeshMotion(0, SHAPES[:, :2], SHAPES)}, "positions: expected"),
        ({"spheres": raytracer.SpheresMotion(0, [(0, 0, 0)], [1.0], MATRICES[:, 0])}, "expected groups below 0"),
        (
            {"curves": raytracer.CurvesMotion(0, [[(0, 0, 0)]], [[1.0]], MATRICES[:, 0])},
            "curves: expected groups below 0",
        ),
        ({"shutter": [0.0, 0.0]}, "above 0"),
        ({"shutter": [-1.0, 1.0]}, "shutter"),
        ({"rolling_shutter": 2.0}, "rolling_shutter"),
        ({"camera": 1}, "CameraMotion"),
    ],
)
def test_motion_that_does_not_fit_is_refused(motion, message):
    with pytest.raises(ValueError, match=message):
        make_scene(**motion)


@pytest.mark.parametrize(
    "make",
    [
        lambda: raytracer.InstanceMotion([0], MATRICES[:1]),
        lambda: raytracer.InstanceMotion([1, 0], np.tile(np.eye(4), (2, 2, 1, 1))),
        lambda: raytracer.InstanceMotion([0], np.zeros((2, 1, 4, 4))),
        lambda: raytracer.CameraMotion(MATRICES[:1, 0]),
        lambda: raytracer.CameraMotion(MATRICES[:, 0], extent=[1.0, 0.0]),
        lambda: raytracer.MeshMotion(0, SHAPES[:1]),
    ],
)
def test_steps_that_are_none_are_refused(make):
    with pytest.raises(ValueError, match="Motion"):
        make()
