"""Many lights: what the tree holds, against every light one by one."""

import itertools

import numpy as np
import pytest

import raytracer
from raytracer.arrays.vectors import normalize
from raytracer.lights.light_tree import LARGEST_CUT, OPENNESS, cut_nodes, find_near_lights
from raytracer.lights.lights import evaluate_light, has_extent, sample_light
from raytracer.lights.stacked_lights import stack_lights
from tests.raytracer.lights.light_kinds import COUNT, list_lights, make_lights, make_tree


def cut(tree, position):
    return cut_nodes(tree.clusters, tree.within, tree.second, position)


def test_a_cut_holds_every_light_once_and_no_group_that_looks_large():
    rng = np.random.default_rng(5)
    places = np.concatenate([rng.uniform(-50, 50, (300, 3)), rng.normal(scale=0.2, size=(50, 3))])
    tree = make_tree(tuple(raytracer.PointLight(place, 1.0, radius=0.01) for place in places))
    points = rng.uniform(-60, 60, (3, 40))
    row, node = cut(tree, points)
    for number in range(40):
        nodes = node[row == number]
        held = [list_lights(tree, one) for one in nodes]
        assert sorted(itertools.chain(*held)) == list(range(350))
        for lights in held:
            box = places[lights] - 0.01, places[lights] + 0.01
            low, high = box[0].min(axis=0), box[1].max(axis=0)
            distance = np.linalg.norm((low + high) / 2 - points[:, number])
            assert len(lights) == 1 or np.linalg.norm(high - low) / 2 <= np.sqrt(OPENNESS) * distance * (1 + 1e-9)


@pytest.mark.parametrize("size", [0.01, 5.0])
def test_cuts_stay_small_however_many_lights_are_near(size):
    """A thousand lights in a room of 10 m: small ones, and such as all reach into each other."""
    rng = np.random.default_rng(6)
    places = rng.uniform(-5, 5, (1000, 3))
    tree = make_tree(tuple(raytracer.PointLight(place, 1.0, radius=size) for place in places))
    row, _ = cut(tree, rng.uniform(-5, 5, (3, 500)))
    assert len(row) / 500 < 1.25 * LARGEST_CUT


def test_a_thousand_lights_at_one_place_make_a_tree():
    tree = make_tree((raytracer.PointLight((1, 2, 3), 1.0),) * 1000)
    row, _ = cut(tree, np.array([[1.0, 1.1], [2, 2], [3, 3]]))
    assert np.bincount(row)[1] < LARGEST_CUT


def test_rays_come_near_all_the_lights_that_they_meet():
    rng = np.random.default_rng(3)
    lights, count = make_lights(rng), 3000
    origins, target = rng.uniform(-9, 9, (count, 3)), rng.integers(0, COUNT, count)
    places = np.array([light.position for light in lights])
    directions = normalize(places[target] + rng.normal(scale=0.3, size=(count, 3)) - origins)
    ray, light = find_near_lights(make_tree(lights), origins, 7.0 * directions)
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
