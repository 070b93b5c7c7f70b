"""Lights of all kinds that have a place, and points that they may light."""

from dataclasses import replace

import numpy as np

import raytracer
from raytracer.arrays.vectors import normalize
from raytracer.lights.light_bounds import bound_lights
from raytracer.lights.light_importance import Receivers
from raytracer.lights.light_tree import make_light_tree
from raytracer.scene.fields import ALL_SETS

COUNT = 41  # no power of 2: leaves at different depths


def make_tree(lights):
    """Return the tree of lights that have a place."""
    return make_light_tree(bound_lights(tuple(lights)))


def turn_round(rng):
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
        make_light(number % 10, rng.uniform(-5, 5, 3), rng.uniform(1, 20, 3), turn_round(rng))
        for number in range(COUNT)
    ]
    return tuple(replace(light, receivers=receivers[k % len(receivers)]) for k, light in enumerate(lights))


def make_points(rng, count, sets=None):
    """Return points with normals, some of them very near to lights."""
    position = rng.uniform(-6, 6, (count, 3))
    return Receivers(position.T, normalize(rng.normal(size=(count, 3))).T, sets)


def list_lights(tree, node):
    """Return the lights below a node."""
    if tree.second[node] < 0:
        return [int(tree.light[node])]
    return list_lights(tree, node + 1) + list_lights(tree, tree.second[node])
