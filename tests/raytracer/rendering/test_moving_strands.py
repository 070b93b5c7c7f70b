"""Strands that change their shape while the shutter is open: closed forms, exact hits at a time, and bits."""

from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.film.shutter import sample_times
from raytracer.rendering.render import render
from raytracer.scene.moments import find_moment
from tests.forbidding import forbid
from tests.raytracer.casting.curves.strands_fixtures import SHAPES, aim_at, judge, make_wild_strand
from tests.raytracer.rendering.test_motion import HEIGHT, MOST, WHITE, X, look, make_moving_scene, move, show

STILL = move((0, 0, 0), (0, 0, 0))
# Of places of a few metres, in few operations.
ROUNDING = 2.0**-48


def make_scene(points, radii, shape="ribbon", matrices=STILL, strands=None):
    """Strands as they are in the middle of steps of points (steps, p, 3) and radii (steps, p), or of matrices, from so
    far away that ribbons are met."""
    points, radii = np.asarray(points, float), np.asarray(radii, float)
    strands = [0, points.shape[1]] if strands is None else strands
    curves = raytracer.Curves(points[len(points) // 2], radii[len(radii) // 2], strands, shape=shape)
    motion = raytracer.Motion(curves=raytracer.CurvesMotion(0, points, radii, matrices))
    return raytracer.Scene(curves=curves, materials=[WHITE], camera=look(100.0), motion=motion)


def make_upright(width, reach=20.0, count=4):
    """A straight strand along y, from below the picture to above it."""
    points = np.zeros((count, 3))
    points[:, 1] = np.linspace(-reach, reach, count)
    return points, np.full(count, width)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_strand_whose_points_move_leaves_the_streak_of_one_that_is_moved(shape):
    """From -10 to 10 a point is covered for 6 / 20 of the time; bit for bit the picture of a moving object."""
    points, radii = make_upright(3.0)
    shift = np.array([(-10.0, 0, 0), (10.0, 0, 0)])
    shaped = make_scene(points + shift[:, np.newaxis], [radii] * 2, shape)
    moved = make_scene(points[np.newaxis], radii[np.newaxis], shape, move(*shift))
    expected = (np.minimum(X + 3, 10) - np.maximum(X - 3, -10)).clip(0) / 20
    assert np.abs(show(shaped) - expected).max() < 2 * MOST
    assert np.array_equal(show(shaped, 4), show(moved, 4))


@pytest.mark.parametrize("shape", SHAPES)
def test_points_go_straight_on_between_steps(shape):
    """A strand that turns about its root by 90 degrees, in two steps: halfway its tip is on the chord, at cos(45) of
    its length, where a ray meets it and one beyond does not. An object that turns by 90 degrees keeps its length."""
    points = np.array([(0, 0, 0), (1, 0, 0), (2, 0, 0), (4, 0, 0)], float)
    turned = points[:, [1, 0, 2]]
    radii = np.full(4, 0.1)
    shaped = make_scene([points, turned], [radii] * 2, shape)
    quarter = np.stack([np.eye(4), np.eye(4)])
    quarter[1, :2, :2] = [[0, -1], [1, 0]]
    rigid = make_scene(points[np.newaxis], radii[np.newaxis], shape, quarter)
    along = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    chord = 4.0 * np.cos(np.pi / 4)
    places = np.array([chord - 0.01, chord + 0.2, 3.99, 4.2])[:, np.newaxis] * along + (0, 0, 5)
    for scene, length, hit in ((shaped, chord, [True, False, False, False]), (rigid, 4.0, [True, True, True, False])):
        moment = find_moment(scene, 0.5)
        assert np.abs(moment.curves[0].points[-1] - length * along).max() < ROUNDING
        assert raytracer.build(moment).any_hit(places, (0, 0, -1)).tolist() == hit


def test_a_strand_that_thins_to_nothing_is_seen_for_as_long_as_it_is_wide():
    """Its half width goes from 20 to 0."""
    points, radii = make_upright(20.0)
    found = show(make_scene([points] * 2, [radii, 0 * radii]))
    assert np.abs(found - np.clip(1 - np.abs(X) / 20, 0, 1)).max() < 2 * MOST


@pytest.mark.parametrize("shape", SHAPES)
def test_a_strand_that_shrinks_to_a_point_is_seen_for_as_long_as_it_reaches(shape):
    """From its root at the lower edge, 8 high, until all its points are one: a height h is covered till 1 - h / 8."""
    points, radii = np.zeros((3, 3)), np.full(3, 10.0)
    points[:, 1] = np.linspace(0, HEIGHT, 3) - HEIGHT / 2
    ended = np.broadcast_to(points[0], points.shape)
    scene = make_scene([points, ended], [radii] * 2, shape)
    height = (np.arange(HEIGHT)[::-1] + 0.5)[:, np.newaxis]
    found, inside = show(scene), np.abs(X) < 9
    assert np.abs(found - (1 - height / HEIGHT))[:, inside].max() < 2 * MOST
    # At the end itself, and a rounding before it.
    for time in (1.0, np.nextafter(1.0, 0.0)):
        hits = raytracer.build(find_moment(scene, time)).any_hit([(0.0, 0.0, 100.0)], [(0.0, 0.0, -1.0)])
        assert not hits.any()


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("time", [0.0, 0.3, 0.5, float(np.nextafter(0.5, 0.0)), 1.0])
def test_hits_at_a_time_are_the_exact_ones_of_the_points_then(shape, time):
    """Between steps and at them: points and radii are a + share (b - a), each operation rounded, and those of a step
    themselves."""
    rng = np.random.default_rng(7)
    steps = [make_wild_strand(rng) for _ in range(3)]
    steps = [(points, radii + 0.2) for points, radii in steps]
    scene = make_scene([points for points, _ in steps], [radii for _, radii in steps], shape)
    moment = find_moment(scene, time)
    first = min(int(2 * time), 1)
    share = 2 * time - first
    expected = [
        a if share == 0 else b if share == 1 else a + share * (b - a) for a, b in zip(*steps[first:][:2], strict=True)
    ]
    (curves,) = moment.curves
    assert np.array_equal(curves.points, expected[0])
    assert np.abs(curves.radii - expected[1]).max() < ROUNDING
    assert judge(raytracer.build(moment), *aim_at(rng, expected[0], 12)) > 1


def add_fur(scene):
    """Wild strands of three steps, ribbons and round ones, above a scene in motion."""
    rng, groups, motions = np.random.default_rng(3), [], []
    for number, shape in enumerate(SHAPES):
        steps = [make_wild_strand(rng, 8) for _ in range(3)]
        points, radii = (np.stack(part) for part in zip(*steps, strict=True))
        points = 0.4 * points + (0, -1, 1)
        groups.append(raytracer.Curves(points[1], radii[1], [0, 3, 8], shape=shape))
        motions.append(raytracer.CurvesMotion(number, points, radii, STILL))
    return replace(scene, curves=groups, motion=replace(scene.motion, curves=motions))


def sum_samples(scene, width, height, samples, **settings):
    """Return the sums (n, 4) of the colors and alphas that a render adds up."""
    return render(scene, width, height, samples, seed=3, **settings).sums.read_sums("Combined", slice(None))


def test_a_picture_of_fur_is_made_of_plain_renders_of_its_moments():
    """Each pixel's sample is that of the strands as they are at the pixel's time, rendered like any other."""
    plain, (width, height) = make_moving_scene(), (12, 6)
    scene = add_fur(plain)
    row, column = (part.ravel() for part in np.indices((height, width)))
    times = sample_times(scene.motion, 0, 3, 2, column, row, height)
    expected = np.zeros((height * width, 4))
    for moment in np.unique(times):
        still, seen = find_moment(scene, moment), times == moment
        expected[seen] = sum_samples(still, width, height, 1)[seen]
    found = sum_samples(scene, width, height, 1)
    assert np.array_equal(found, expected)
    assert not np.array_equal(found, sum_samples(plain, width, height, 1))


def test_bits_of_fur_depend_on_no_block_or_file(tmp_path):
    scene = add_fur(make_moving_scene())
    whole = sum_samples(scene, 12, 6, 2)
    assert np.array_equal(whole, sum_samples(scene, 12, 6, 2, block_size=13))
    raytracer.save(scene, tmp_path / "fur.npz")
    assert np.array_equal(whole, sum_samples(raytracer.load(tmp_path / "fur.npz"), 12, 6, 2))


def test_a_scene_without_strands_in_motion_pays_nothing(monkeypatch):
    forbid(monkeypatch, "move_curves", "find_curve_centres")
    render(make_moving_scene(), 6, 4, 2)
