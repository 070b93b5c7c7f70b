"""Lights picked by cuts of a tree: against every light one by one, and against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.arrays.vectors import normalize
from raytracer.lights.light_importance import Receivers, average_above, find_importance
from raytracer.lights.light_picks import POINTS_AT_ONCE, find_chances, pick_lights
from raytracer.lights.light_tree import cut_nodes
from raytracer.lights.lights import sample_light
from raytracer.scene.fields import ALL_SETS
from tests.raytracer.lights.light_kinds import COUNT, list_lights, make_lights, make_points, make_tree, turn_round

PICKS = 5
STEPS = 4096
GROUND = np.array([[0.0], [0], [1]])  # the normal of one point


def pick_evenly(tree, points, count=PICKS, steps=STEPS):
    """Return the picks (count, steps) of one point for numbers even over the unit interval."""
    return pick_lights(tree, points.select(np.zeros(steps, np.intp)), (np.arange(steps) + 0.5) / steps, count)


def find_all_chances(tree, points, count=PICKS):
    """Return the chances (n, lights) of all lights at n points."""
    total = len(tree.leaf)
    row = np.repeat(np.arange(len(points)), total)
    return find_chances(tree, np.tile(np.arange(total), len(points)), row, points, count).reshape(-1, total)


@pytest.mark.parametrize("count", [PICKS, 16])
def test_lights_are_aimed_at_as_often_as_their_chances_say(count):
    """Each light is met for one stretch of numbers, as long as its chance, or for two, at the ends; never twice."""
    rng = np.random.default_rng(1)
    tree, points = make_tree(make_lights(rng)), make_points(rng, 20)
    expected = find_all_chances(tree, points, count)
    for row in range(len(points)):
        light, chance = pick_evenly(tree, points.select([row]), count)
        rows, columns = np.nonzero(light >= 0)
        often = np.bincount(light[rows, columns], minlength=COUNT) / STEPS
        np.testing.assert_allclose(often, expected[row], rtol=0, atol=2.0 / STEPS, err_msg=str(row))
        np.testing.assert_allclose(chance[rows, columns], expected[row][light[rows, columns]], rtol=1e-12)
        ordered = np.sort(np.where(light >= 0, light, -1 - np.arange(count)[:, np.newaxis]), axis=0)
        assert (ordered[1:] != ordered[:-1]).all()


def test_every_light_that_reaches_a_point_can_be_aimed_at():
    rng = np.random.default_rng(2)
    sets = rng.integers(0, 3, 4000)
    lights = make_lights(rng, receivers=(1, 2, 3, 4, 7))
    tree, points = make_tree(lights), make_points(rng, 4000, sets)
    chances, shining = find_all_chances(tree, points), 0
    for number, light in enumerate(lights):
        samples = sample_light(light, points.position.T, rng.random((4000, 2)))
        lit = (samples.weight != 0).any(axis=1) & (samples.density > 0) & (light.receivers >> sets & 1 != 0)
        assert (chances[lit, number] > 0).all(), light
        assert not chances[light.receivers >> sets & 1 == 0, number].any()
        shining += lit.sum()
    assert shining > 10_000


def make_hall(side, area=False):
    """Return the lights of a hall, one every 4 m, 2 m above its floor, and their positions and mean intensities."""
    rng = np.random.default_rng(4)
    x, y = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    places = np.stack([4.0 * x.ravel(), 4.0 * y.ravel(), np.full(side * side, 1.8)], axis=1)
    places += rng.random(places.shape)
    powers = 30.0 * (0.5 + rng.random((side * side, 3)))
    if area:
        return (
            tuple(
                raytracer.AreaLight(*of_light, power)
                for *of_light, power in zip(
                    places,
                    np.tile((0.1, 0, 0), (len(places), 1)),
                    np.tile((0, 0.1, 0), (len(places), 1)),
                    powers,
                    strict=True,
                )
            ),
            places,
            powers.mean(axis=1) / np.pi,
        )
    lights = tuple(map(raytracer.PointLight, places, powers))
    return lights, places, powers.mean(axis=1) / (4.0 * np.pi)


@pytest.mark.parametrize("area", [False, True])
def test_a_few_of_a_thousand_lights_tell_what_all_of_them_send(area):
    """The irradiance I cos b / d^2, of small areas I cos a cos b / d^2: over all numbers the mean is the sum, within
    the error of the grid, and 16 lights tell it to 2% (measured 1.3 and 1.1; picked from the root, one by one, 17)."""
    lights, places, intensity = make_hall(32, area)
    tree, rng = make_tree(lights), np.random.default_rng(6)
    ground = np.concatenate([rng.uniform(50, 76, (15, 2)), np.zeros((15, 1))], axis=1)
    errors = []
    for place in ground:
        sent = find_sent(place, places, intensity, area)
        light, chance = pick_evenly(tree, Receivers(place[:, np.newaxis], GROUND, None), 16, 512)
        told = np.where(light >= 0, sent[light] / np.where(light >= 0, chance, 1.0), 0.0).sum(axis=0)
        errors.append(np.std(told) / sent.sum())
        np.testing.assert_allclose(told.mean(), sent.sum(), rtol=4.0 * errors[-1] / np.sqrt(512) + 0.002)
    assert np.sqrt(np.mean(np.square(errors))) < 0.02


def find_sent(place, places, intensity, area):
    """Return the irradiance (lights,) of the ground by lights above it."""
    offset = places - place
    square = (offset**2).sum(axis=1)
    sent = intensity * offset[:, 2] / square**1.5
    return sent * offset[:, 2] / np.sqrt(square) if area else sent


@pytest.mark.parametrize("area", [False, True])
def test_groups_promise_about_what_their_lights_send(area):
    """Shares of the cut measured 0.18 and 0.23 off; with spheres for boxes 0.32 and 0.29."""
    lights, places, intensity = make_hall(32, area)
    tree, place = make_tree(lights), np.array([60.0, 63.0, 0.0])
    points = Receivers(place[:, np.newaxis], GROUND, None)
    row, node = cut_nodes(tree.clusters, tree.within, tree.second, points.position)
    of_light = find_sent(place, places, intensity, area)
    groups = tree.second[node] >= 0
    sent = np.array([of_light[list_lights(tree, one)].sum() for one in node[groups]])
    promised = find_importance(tree.clusters, node, points, row)[groups]
    ratio = promised / promised.sum() / (sent / sent.sum())
    assert np.sqrt(np.average((ratio - 1.0) ** 2, weights=sent)) < 0.25


def test_lights_that_promise_most_are_always_aimed_at_and_by_one_source_each():
    """So each source's samples of its light are as even as those of a light that is always aimed at; measured of 141
    certain lights 124, the others lie in groups. Without their places at the front it were 69."""
    lights, places, _ = make_hall(12)
    tree, sources = make_tree(lights), []
    for number in range(60, 80):
        place = places[number] - (1.5, 1.2, 1.5)
        light, chance = pick_evenly(tree, Receivers(place[:, np.newaxis], GROUND, None), 16, 256)
        for one in np.unique(light[chance == 1.0]):
            assert (light == one).any(axis=0).all()
            sources.append((light == one).any(axis=1).sum())
    assert len(sources) > 100
    assert (np.array(sources) == 1).mean() > 0.8


def test_picks_are_the_same_whatever_points_come_along():
    """Bit for bit: in blocks, in another order and alone."""
    rng = np.random.default_rng(7)
    tree, count = make_tree(make_lights(rng)), POINTS_AT_ONCE + 900
    points, choice = make_points(rng, count), rng.random(count)
    light, chance = pick_lights(tree, points, choice, PICKS)
    order = rng.permutation(count)
    again = pick_lights(tree, points.select(order), choice[order], PICKS)
    np.testing.assert_array_equal(again.light, light[:, order])
    np.testing.assert_array_equal(again.chance, chance[:, order])
    for row in order[:50]:
        alone = pick_lights(tree, points.select([row]), choice[[row]], PICKS)
        np.testing.assert_array_equal(alone.light[:, 0], light[:, row])
        np.testing.assert_array_equal(alone.chance[:, 0], chance[:, row])


def test_where_no_light_shines_none_is_aimed_at():
    lights = [raytracer.SpotLight((x, 0, 5), 10.0, spot_size=1.0) for x in range(40)]
    above = Receivers(np.array([[20.0], [0], [9]]), np.array([[0.0], [0], [-1]]), None)
    light, chance = pick_evenly(make_tree(tuple(lights)), above)
    assert (light == -1).all()
    assert not chance.any()


def test_lights_that_shine_away_are_not_aimed_at():
    """A wall of lights, half of them turned round."""
    turned = np.diag([1.0, -1.0, -1.0])
    lights = [
        raytracer.SpotLight((x, 0, 5), 10.0, spot_size=1.0, world_from_light=turned if x % 2 else np.eye(3))
        for x in range(40)
    ]
    tree = make_tree(tuple(lights))
    points = Receivers(np.array([[20.0], [0], [0]]), GROUND, None)
    chances = find_all_chances(tree, points)[0]
    assert not chances[1::2].any()
    assert abs(chances.argmax() - 20) <= 2


def test_few_picks_are_left_without_a_light():
    """Each light is aimed at once at most: what near ones do not need goes to the others."""
    lights, places, _ = make_hall(12)
    points = Receivers(places.T - 0.5, np.repeat([[0.0], [0], [1]], len(places), axis=1), None)
    chances = find_all_chances(make_tree(lights), points, 16)
    assert chances.max() == 1.0
    assert 15.8 < chances.sum(axis=1).mean() < 16.0


def test_importance_of_a_light_is_what_it_sends():
    """A point's: I cos b / d^2. A small area's: I cos a cos b / d^2, within its size over the distance."""
    rng = np.random.default_rng(8)
    matrix = turn_round(rng)
    point, area = (
        raytracer.PointLight((0, 0, 0), 40.0),
        raytracer.AreaLight((0, 0, 0), matrix[0] * 0.01, matrix[1] * 0.01, 9.0),
    )
    position = rng.normal(size=(500, 3)) * 3.0
    direction = -normalize(position)
    normal = normalize(direction + 0.8 * normalize(rng.normal(size=(500, 3))))
    square, cosine = (position**2).sum(axis=1), (normal * direction).sum(axis=1)
    shining = (np.cross(matrix[0], matrix[1]) * direction).sum(axis=1)
    points = Receivers(position.T, normal.T, None)
    for light, sent, rows in (
        (point, 10.0 / np.pi * cosine / square, cosine > 0.05),
        (area, 9.0 / np.pi * cosine * shining / square, (cosine > 0.1) & (shining > 0.1)),
    ):
        clusters = make_tree((light,)).clusters
        importance = find_importance(clusters, np.zeros(500, np.intp), points, np.arange(500))
        rows = np.flatnonzero(rows & (importance > 0))
        assert len(rows) > 100
        np.testing.assert_allclose(importance[rows], sent[rows], rtol=0.05)


@pytest.mark.parametrize(
    ("height", "extent"), [(2.0, 1.0), (0.5, 1.0), (-0.5, 1.0), (-2.0, 1.0), (0.3, 0.0), (-0.3, 0.0)]
)
def test_heights_above_the_horizon_have_their_mean(height, extent):
    steps = (np.arange(10_000) + 0.5) / 5000 - 1.0
    expected = np.maximum(height + extent * steps, 0.0).mean()
    np.testing.assert_allclose(average_above(np.array([height]), np.array([extent])), expected, atol=1e-7)


def test_lights_of_no_power_are_not_aimed_at():
    lights = list(make_lights(np.random.default_rng(9), receivers=(ALL_SETS,)))
    lights[3:30] = [replace(light, power=0.0 * np.asarray(light.power)) for light in lights[3:30]]
    chances = find_all_chances(make_tree(tuple(lights)), make_points(np.random.default_rng(10), 200))
    assert not chances[:, 3:30].any()
    assert np.isfinite(chances).all()
