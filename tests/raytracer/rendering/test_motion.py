"""Pictures of scenes in motion: closed forms, the plain renders of their moments put together, and bits.

What moves shines by itself before black, so a pixel is the share of the time in which it shows it.
"""

from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.casting.dense import tree as dense_tree
from raytracer.film.shutter import sample_times
from raytracer.integrator.media import scene_media
from raytracer.lights import environment
from raytracer.rendering.render import render
from raytracer.scene.moments import find_moment
from raytracer.scene.programs import Program, Register, Step
from tests import meshes
from tests.forbidding import forbid
from tests.raytracer.integrator.media_scenes import DENSITY, RISING, fill, make_box
from tests.raytracer.rendering.rendering_fixtures import make_lit_scene, same

WHITE = raytracer.Material((raytracer.Closure("emission", color=1.0),))
WIDTH, HEIGHT = 48, 8
SAMPLES = 128
# A pixel with s samples of evenly spread times is off by two times of s in each of two replications, at most, where an
# edge crosses it once, and by what a random place in the pixel adds: 5 deviations of that.
MOST = 4 / SAMPLES + 5 * 0.5 / SAMPLES**0.75


def look(distance=5.0, scale=WIDTH):
    """An orthographic camera that shows a metre in a pixel, from above the origin."""
    matrix = np.eye(4)
    matrix[2, 3] = distance
    return raytracer.Camera(matrix, projection="orthographic", ortho_scale=scale)


def move(*places):
    """Return matrices (steps, 4, 4) that only move, to places (x, y, z)."""
    matrices = np.tile(np.eye(4), (len(places), 1, 1))
    matrices[:, :3, 3] = places
    return matrices


def make_quad(x, y):
    return raytracer.Mesh([(x[0], y[0], 0), (x[1], y[0], 0), (x[1], y[1], 0), (x[0], y[1], 0)], [(0, 1, 2), (0, 2, 3)])


def make_scene(mesh, matrices=None, camera=None, **motion):
    """One mesh in motion, as it is in the middle of its steps."""
    middle = np.eye(4) if matrices is None else matrices[len(matrices) // 2]
    if matrices is not None:
        motion["instances"] = raytracer.InstanceMotion([0], matrices[:, np.newaxis])
    return raytracer.Scene(
        [mesh],
        instances=raytracer.Instances([0], middle[np.newaxis]),
        materials=[WHITE],
        camera=camera or look(),
        motion=raytracer.Motion(**motion),
    )


def show(scene, samples=SAMPLES, **settings):
    """Return the brightness (h, w)."""
    settings = {"pixel_filter": "box", **settings}
    return render(scene, WIDTH, HEIGHT, samples, **settings)["Combined"][..., 0].astype(np.float64)


X = np.arange(WIDTH) + 0.5 - WIDTH / 2  # metres, of pixels' centres


def test_a_moving_edge_leaves_a_ramp():
    """Its left edge goes from -10 to 10: a point x is covered from (x + 10) / 20 on, up to the end of the time."""
    scene = make_scene(make_quad((-100, 0), (-99, 99)), move((-10, 0, 0), (0, 0, 0), (10, 0, 0)))
    assert np.abs(show(scene) - np.clip((10 - X) / 20, 0, 1)).max() < MOST


def test_the_error_knows_that_pixels_share_times():
    """Of 30 intervals that hold the truth in 95% of cases, 24 do not with a chance of 1 in 1000; 25% held it when all
    pixels were taken to be wrong on their own."""
    scene = make_scene(make_quad((-100, 0), (-99, 99)), move((-10, 0, 0), (0, 0, 0), (10, 0, 0)))
    fine = (np.arange(WIDTH * 1000) + 0.5) / 1000 - WIDTH / 2
    truth = np.clip((10 - fine) / 20, 0, 1).reshape(WIDTH, 1000).mean(axis=1)
    held = 0
    for seed in range(30):
        film = render(scene, WIDTH, 32, 8, pixel_filter="box", seed=seed)
        seen = film["Combined"][..., 0].astype(np.float64)
        low, high = film.error_interval
        held += low <= np.sqrt(np.mean((seen - truth) ** 2)) / seen.mean() <= high
    assert held > 24


@pytest.mark.parametrize(("first", "middle"), [(-10.0, 6.0), (10.0, -2.0)])
def test_an_edge_that_changes_its_pace_at_a_step_has_a_bend(first, middle):
    scene = make_scene(make_quad((-100, 0), (-99, 99)), move((first, 0, 0), (middle, 0, 0), (10, 0, 0)))
    times = (np.arange(20000) + 0.5) / 20000
    edge = np.interp(times, [0, 0.5, 1], [first, middle, 10])
    expected = (X[:, np.newaxis] < edge).mean(axis=1)
    assert np.abs(show(scene) - expected).max() < 2 * MOST


@pytest.mark.parametrize(
    ("shutter", "covered"),
    [
        ([1.0, 3.0], lambda t: np.where(t < 0.5, 1 - t / 2, 1.5 * (1 - t))),
        ([0.0, 1.0], lambda t: np.clip(2 * (1 - t), 0, 1)),
    ],
)
def test_the_shutter_weighs_times(shutter, covered):
    """A point that the edge reaches at t is covered for the weight of the times after it."""
    scene = make_scene(make_quad((-100, 0), (-99, 99)), move((-10, 0, 0), (10, 0, 0)), shutter=shutter)
    assert np.abs(show(scene) - covered(np.clip((10 + X) / 20, 0, 1))).max() < 2 * MOST


def test_a_spinning_blade_shows_each_point_for_its_angle():
    """A quarter of the plane turns by a quarter about its tip: at an angle a before it, for a / 90 degrees."""
    quarter = raytracer.Mesh([(0, 0, 0), (900, 0, 0), (0, 900, 0)], [(0, 1, 2)])
    turned = np.tile(np.eye(4), (2, 1, 1))
    turned[1, :2, :2] = [[0, -1], [1, 0]]
    found = show(make_scene(quarter, turned))
    y = (np.arange(HEIGHT)[::-1] + 0.5 - HEIGHT / 2)[:, np.newaxis]
    angle = np.degrees(np.arctan2(y, X)) % 360.0
    expected = np.interp(angle, [0, 90, 180, 360], [0, 1, 0, 0])
    far = np.hypot(X, y) > 6  # nearer, an angle is no straight edge across a pixel
    assert np.abs(found - expected)[far].max() < 2 * MOST


def test_a_triangle_that_vanishes_is_seen_for_as_long_as_it_reaches():
    """Its width goes from 20 to nothing and to 20 on the other side: mirrored, through no area at all."""
    matrices = np.tile(np.eye(4), (2, 1, 1))
    matrices[1, 0, 0] = -1.0
    found = show(make_scene(make_quad((0, 20), (-99, 99)), matrices))
    assert np.abs(found - np.clip(0.5 - np.abs(X) / 40, 0, 0.5)).max() < 2 * MOST


def test_a_deforming_mesh_moves_each_corner_on_its_own():
    """The upper corners stay, the lower ones go 20 to the right."""
    mesh = make_quad((-100, 0), (-4, 4))
    steps = np.stack([mesh.positions, mesh.positions])
    steps[1, :2, 0] += 20.0
    found = show(make_scene(mesh, meshes=raytracer.MeshMotion(0, steps)))
    reach = (np.arange(HEIGHT) + 0.5) / HEIGHT * 20  # from the top
    expected = np.clip(1 - X / reach[:, np.newaxis], 0, 1)
    fast = reach > 6  # elsewhere the edge crosses a pixel too slowly for one value
    assert np.abs(found - expected)[fast][:, np.abs(X) > 1].max() < 2 * MOST


def test_a_moving_camera_shows_parallax():
    """Through a pinhole at a height h, a camera that moves by m blurs an edge over m f / h: twice as far, half."""
    width, focal = 8.0, 36.0  # sensor 36 mm: at 1 m the picture is 1 m wide
    for height in (4.0, 8.0):
        camera = raytracer.Camera(move((0, 0, height))[0], focal_length=focal)
        scene = make_scene(make_quad((-1000, 0), (-999, 999)), camera=camera)
        places = move((-width / 8, 0, height), (0, 0, height), (width / 8, 0, height))
        scene = replace(scene, motion=raytracer.Motion(camera=raytracer.CameraMotion(places)))
        ramp = WIDTH / height * (width / 4)  # pixels
        assert np.abs(show(scene) - np.clip(0.5 - X / ramp, 0, 1)).max() < MOST


def test_a_camera_that_zooms_spreads_the_picture():
    """The film doubles: an edge at 1/8 of it goes to 1/16."""
    camera = raytracer.Camera(move((0, 0, 1.0))[0], focal_length=36.0)
    scene = make_scene(make_quad((0.25, 100), (-99, 99)), camera=camera)
    still = np.tile(camera.world_from_camera, (2, 1, 1))
    scene = replace(scene, motion=raytracer.Motion(camera=raytracer.CameraMotion(still, extent=[1.0, 2.0])))
    extent = np.clip(0.25 / np.maximum(X / WIDTH, 1e-9), 1, 2)  # the film's size from which on it is covered
    assert np.abs(show(scene) - (2 - extent)).max() < 2 * MOST


def test_a_sphere_before_a_moving_camera_leaves_a_streak():
    """Along its middle, a point is covered for as long as the sphere is above it."""
    balls = raytracer.Spheres([(0, 0, 0)], [3.0])
    places = move((-10, 0.5, 5), (10, 0.5, 5))
    motion = raytracer.Motion(camera=raytracer.CameraMotion(places))
    scene = raytracer.Scene(spheres=[balls], materials=[WHITE], camera=look(), motion=motion)
    row = show(scene)[HEIGHT // 2]  # half a pixel below the picture's middle: at y = 0
    half = np.sqrt(9 - np.linspace(-0.5, 0.5, 101) ** 2).mean()
    expected = np.clip((10 + half - np.abs(X)) / 20, 0, half / 10)
    assert np.abs(row - expected).max() < MOST


def test_a_camera_that_goes_through_a_wall_sees_both_sides():
    """Half the time before a white wall, half of it behind: there is nothing there."""
    scene = make_scene(make_quad((-999, 999), (-999, 999)))
    camera = raytracer.Camera(move((0, 0, 0.1))[0])
    places = move((0, 0, 1), (0, 0, -1))
    scene = replace(scene, camera=camera, motion=raytracer.Motion(camera=raytracer.CameraMotion(places)))
    assert np.abs(show(scene, 64) - 0.5).max() <= 1 / 32


def test_an_object_that_passes_through_the_camera_is_seen_while_it_is_ahead():
    scene = make_scene(make_quad((-999, 999), (-999, 999)), move((0, 0, -3), (0, 0, 1)), look(0.0))
    assert np.abs(show(scene, 64) - 0.75).max() <= 1 / 32


def make_moving_scene():
    """The lit scene, whose floor tilts before a camera that turns; a triangle deforms above it."""
    still = make_lit_scene()
    triangle = raytracer.Mesh([(-2, -1, 2), (2, -1, 2), (0, -1, 3)], [(0, 1, 2)])
    shapes = triangle.positions + np.array([(0, 0, 0), (0, 0, 0.5), (1, 0, 0.5)])[:, np.newaxis]
    tilted = np.tile(np.eye(4), (3, 1, 1, 1))
    tilted[0, 0, 2, 3], tilted[2, 0, 0, 2] = -0.2, 0.2
    places = np.tile(still.camera.world_from_camera, (2, 1, 1))
    places[1, :3, 3] += (0.3, 0.0, 0.1)
    return replace(
        still,
        meshes=[still.meshes[0], triangle],
        instances=raytracer.Instances([0, 1], np.tile(np.eye(4), (2, 1, 1))),
        motion=raytracer.Motion(
            camera=raytracer.CameraMotion(places),
            instances=raytracer.InstanceMotion([0], tilted),
            meshes=raytracer.MeshMotion(1, shapes),
            shutter=[1.0, 2.0, 1.0],
            rolling_shutter=0.5,
        ),
    )


PASSES = ("Combined", "Normal", "Depth", "Error")


def sum_samples(scene, width, height, samples):
    """Return the sums (n, 4) of the colors and alphas that a render adds up."""
    return render(scene, width, height, samples, seed=3).sums.read_sums("Combined", slice(None))


def test_a_picture_is_made_of_plain_renders_of_its_moments():
    """Each pixel's sample is that of the scene as it is at the pixel's time, rendered like any other."""
    scene, (width, height) = make_moving_scene(), (12, 6)
    row, column = (part.ravel() for part in np.indices((height, width)))
    previous, expected = np.zeros((height * width, 4)), np.zeros((height * width, 4))
    for number in range(4):
        times = sample_times(scene.motion, number, 3, 2, column, row, height)
        for moment in np.unique(times):
            still = find_moment(scene, moment)
            before = sum_samples(still, width, height, number) if number else previous
            after = sum_samples(still, width, height, number + 1)
            seen = times == moment
            expected[seen] += (after - before)[seen]
    found = sum_samples(scene, width, height, 4)
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


def test_bits_depend_on_no_block_tile_worker_or_pause(tmp_path):
    scene, size, settings = make_moving_scene(), (16, 12), {"passes": PASSES}
    whole = render(scene, *size, 4, **settings)
    assert same(whole, render(scene, *size, 4, block_size=50, **settings))
    with raytracer.Workers(2) as workers:
        for block_size in (60, 1000):  # pixels of one sample, and several samples of all
            assert same(whole, render(scene, *size, 4, workers=workers, block_size=block_size, **settings))
    film = render(scene, *size, 4, until=2, **settings)
    raytracer.save_film(film, tmp_path / "film.npz")
    assert same(whole, render(scene, *size, 4, film=raytracer.load_film(tmp_path / "film.npz"), **settings))
    tiles = [render(scene, *size, 4, tile=(number, 3), **settings) for number in (1, 2, 3)]
    merged = raytracer.merge(tiles)
    assert all(np.array_equal(array, merged.arrays[name]) for name, array in whole.arrays.items())
    raytracer.save(scene, tmp_path / "scene.npz")
    assert same(whole, render(raytracer.load(tmp_path / "scene.npz"), *size, 4, **settings))


def test_moments_share_the_blocks_of_their_trees(monkeypatch):
    """They are chosen for the first, and bounded anew for each."""
    made, choose = [], dense_tree.choose_blocks
    monkeypatch.setattr(dense_tree, "choose_blocks", lambda *args: made.append(len(args[1])) or choose(*args))
    mesh = raytracer.Mesh(*meshes.make_torus())
    scene = make_scene(mesh, move((-1, 0, 0), (0, 0, 0), (1, 0, 0)), look(scale=4))
    assert show(scene, 3).max() > 0
    assert made == [len(mesh.triangles)]


def test_depth_is_that_of_the_middle_of_the_time():
    scene = make_scene(make_quad((-99, 99), (-99, 99)), move((0, 0, -4), (0, 0, 0), (0, 0, 2)))
    film = render(scene, 4, 3, 3, passes=("Depth",))
    assert (film["Depth"] == 5.0).all()


def test_a_map_of_the_world_is_made_once_and_of_the_middle(monkeypatch):
    """Workers begin with different moments, and it decides the bits of their samples."""
    made = []
    make = environment.make_direction_map
    monkeypatch.setattr(environment, "make_direction_map", lambda cells: made.append(cells) or make(cells))
    scene = replace(make_moving_scene(), world=make_shaded_world())
    first = render(scene, 12, 6, 2)
    assert len(made) == 1
    assert same(first, render(scene, 12, 6, 2, block_size=5))
    assert np.array_equal(made[0], made[1])


def test_bounds_of_media_are_looked_for_once_and_in_the_middle(monkeypatch):
    """They decide on noise alone, and take longer than a moment's samples do."""
    made = []
    make = scene_media.make_majorants
    monkeypatch.setattr(scene_media, "make_majorants", lambda *given: made.append(make(*given)) or made[-1])
    smoke = fill(raytracer.VolumeClosure("absorption", density=DENSITY), program=RISING)
    moving = make_scene(make_box(1.0), move((-0.5, 0, 0), (0, 0, 0), (0.5, 0, 0)), camera=look(scale=4.0))
    scene = replace(moving, materials=[smoke], world=raytracer.World(1.0))
    first = render(scene, 12, 6, 2)
    assert len(made) == 1
    assert same(first, render(scene, 12, 6, 2, block_size=5))


def make_shaded_world():
    """A world that gets brighter upwards and to the side, as the camera sees it."""
    inputs = (Register(0, "Camera"), np.zeros(3), np.zeros(3), 1.0)
    steps = (Step("TEX_COORD Camera"), Step("VECT_MATH Vector", inputs, {"operation": "ABSOLUTE"}))
    return raytracer.World(Register(1, "Vector"), Program(steps))


def test_adaptive_samples_are_even_where_something_moves():
    film = render(make_moving_scene(), 12, 6, 20, adaptive=True)
    assert film.pilot == 0
    assert (film.sums.counts.read(slice(None)).sum(axis=1) == 20).all()


def test_a_picture_in_which_nothing_moves_pays_nothing(monkeypatch):
    forbid(monkeypatch, "find_moment", "sample_times", "find_middle", "turn_environment", "MovingTracer")
    render(make_lit_scene(), 8, 6, 2, passes=PASSES)


def test_motion_of_what_stands_still_changes_the_picture_by_no_bit():
    """Steps that are all the same: only the pixels are traced in another order."""
    scene = make_moving_scene()
    still = replace(scene, motion=None)
    camera = raytracer.CameraMotion(np.tile(scene.camera.world_from_camera, (3, 1, 1)))
    matrices = np.tile(scene.instances.world_from_object, (3, 1, 1, 1))
    motion = raytracer.Motion(camera, raytracer.InstanceMotion([0, 1], matrices))
    one, other = (render(case, 24, 16, 4, passes=PASSES) for case in (still, replace(still, motion=motion)))
    assert all(np.array_equal(array, other.arrays[name]) for name, array in one.arrays.items())
