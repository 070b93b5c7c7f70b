"""Many lights: what the tree promises, against every light one by one."""

from dataclasses import replace

import numpy as np

import raytracer
from raytracer.arrays.vectors import normalize
from raytracer.lights.light_tree import Receivers, find_near_lights, find_probability, make_light_tree, pick_lights
from raytracer.lights.lights import evaluate_light, has_extent, sample_light
from raytracer.lights.stacked_lights import stack_lights
from raytracer.scene.fields import ALL_SETS

COUNT = 41  # no power of 2: leaves at different depths


def turn(rng):
    """Return a random rotation (3, 3)."""
    matrix = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return matrix * np.sign(np.linalg.det(matrix))


def make_light(kind, place, power, matrix):
    """Return one of ten kinds of lights that have a place."""
    point, spot, area = raytracer.PointLight, raytracer.SpotLight, raytracer.AreaLight
    u, v = matrix[:2]
    return (
        lambda: point(place, power),
        lambda: point(place, power, radius=0.4),
        lambda: point(place, -power, radius=0.3, soft_falloff=False),
        lambda: spot(place, power, spot_size=0.9, world_from_light=3.0 * matrix),
        lambda: spot(place, power, radius=0.5, spot_size=1.1, world_from_light=matrix * (1.0, 3.0, 0.5)),
        lambda: spot(place, power, radius=0.5, soft_falloff=False, spot_blend=0.0, world_from_light=matrix),
        lambda: area(place, u, 0.4 * v, power),
        lambda: area(place, u, v, power, shape="ellipse"),
        lambda: area(place, u, v, power, spread=0.8),
        lambda: area(place, u, v, power, spread=0.0),
    )[kind]()


def make_lights(rng, receivers=(ALL_SETS,)):
    """Return lights of all kinds from all over a room of 10 m."""
    lights = [
        make_light(number % 10, rng.uniform(-5, 5, 3), rng.uniform(1, 20, 3), turn(rng)) for number in range(COUNT)
    ]
    return tuple(replace(light, receivers=receivers[k % len(receivers)]) for k, light in enumerate(lights))


def make_points(rng, count, sets=None):
    """Return points with normals, some of them very near to lights."""
    position = rng.uniform(-6, 6, (count, 3))
    return Receivers(position, normalize(rng.normal(size=(count, 3))), sets)


def test_picked_lights_split_the_unit_interval_in_proportion_to_their_probability():
    """An even grid of numbers hits a part of length p within one step. Parts are connected: each light is found once,
    and where it begins the depth is within a step of 0. What is left leads to halves of which no light shines there."""
    rng, steps = np.random.default_rng(1), 4096
    tree = make_light_tree(make_lights(rng))
    for row in range(20):
        points = make_points(rng, 1).select(np.zeros(steps, np.intp))
        light, probability, depth = pick_lights(tree, points, (np.arange(steps) + 0.5) / steps)
        shines = probability > 0
        expected = find_probability(tree, np.arange(COUNT), points.select(np.zeros(COUNT, np.intp)))
        share = np.bincount(light[shines], minlength=COUNT) / steps
        np.testing.assert_allclose(share, expected, rtol=0, atol=1.0 / steps, err_msg=str(row))
        np.testing.assert_allclose(probability[shines], expected[light[shines]], rtol=1e-12)  # the same shares' product
        begins = np.append(True, light[1:] != light[:-1])
        assert (depth[begins & shines] < 1.0 / steps).all()
        assert len(np.unique(light)) == begins.sum()


def test_every_light_that_reaches_a_point_can_be_picked_there():
    rng = np.random.default_rng(2)
    sets = rng.integers(0, 3, 4000)
    lights = make_lights(rng, receivers=(1, 2, 3, 4, 7))
    tree, points = make_light_tree(lights), make_points(rng, 4000, sets)
    shining = 0
    for number, light in enumerate(lights):
        samples = sample_light(light, points.position, rng.random((4000, 2)))
        lit = (samples.weight != 0).any(axis=1) & (samples.density > 0) & (light.receivers >> sets & 1 != 0)
        probability = find_probability(tree, np.full(4000, number), points)
        assert (probability[lit] > 0).all(), light
        assert not probability[light.receivers >> sets & 1 == 0].any()
        shining += lit.sum()
    assert shining > 10_000


def test_lights_that_shine_away_are_not_picked():
    """All else being equal, cones halve what is picked from: a wall of lights, half of them turned round."""
    turned = np.diag([1.0, -1.0, -1.0])
    lights = [
        raytracer.SpotLight((x, 0, 5), 10.0, spot_size=1.0, world_from_light=turned if x % 2 else np.eye(3))
        for x in range(40)
    ]
    tree = make_light_tree(tuple(lights))
    points = Receivers(np.array([(20.0, 0, 0)]), np.array([(0.0, 0, 1)]), None).select(np.zeros(40, np.intp))
    probability = find_probability(tree, np.arange(40), points)
    assert not probability[1::2].any()
    assert abs(probability.argmax() - 20) <= 2


def test_rays_come_near_all_the_lights_that_they_meet():
    rng = np.random.default_rng(3)
    lights, count = make_lights(rng), 3000
    origins, target = rng.uniform(-9, 9, (count, 3)), rng.integers(0, COUNT, count)
    places = np.array([light.position for light in lights])
    directions = normalize(places[target] + rng.normal(scale=0.3, size=(count, 3)) - origins)
    ray, light = find_near_lights(make_light_tree(lights), origins, 7.0 * directions)
    near = set(zip(ray.tolist(), light.tolist(), strict=True))
    met = 0
    for number, one in enumerate(lights):
        if has_extent(one):
            rows = np.flatnonzero(evaluate_light(one, origins, directions).density > 0)
            assert near >= {(row, number) for row in rows.tolist()}
            met += len(rows)
    assert met > 500
    assert len(near) < 0.2 * count * COUNT
    assert np.array_equal(np.lexsort((ray, light)), np.arange(len(ray)))


def test_a_record_of_lights_is_sampled_as_each_of_them_bit_for_bit():
    rng = np.random.default_rng(4)
    lights = make_lights(rng)
    stacks, stack, row = stack_lights(lights)
    assert len(stacks) < len(lights) / 2
    light, position, pair = rng.integers(0, COUNT, 900), rng.uniform(-5, 5, (900, 3)), rng.random((900, 2))
    for number, of_stack in enumerate(stacks):
        rows = np.flatnonzero(stack[light] == number)
        together = sample_light(of_stack.take(row[light[rows]]), position[rows], pair[rows])
        for place, k in enumerate(rows):
            alone = sample_light(lights[light[k]], position[k : k + 1], pair[k : k + 1])
            for name in ("direction", "distance", "weight", "density"):
                np.testing.assert_array_equal(getattr(together, name)[place], getattr(alone, name)[0], err_msg=name)
