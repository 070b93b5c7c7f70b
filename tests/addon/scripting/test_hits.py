"""All hits, ranges and distances of ray_cast, against closed forms, exact layers and Scene.ray_cast."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import bpy
import numpy as np
import pytest

from addon import ray_cast, ray_cast_layers
from addon.scripting.held import find_held
from raytracer.casting.geometry import world_corners
from tests.addon.scripting.ray_cast_fixtures import (
    DOWN,
    aim_down,
    find_depsgraph,
    forget_casters,  # noqa: F401  (a fixture, found by its name)
    link,
    make_quad,
)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("forget_casters")]


@pytest.fixture
def sphere(empty_scene: Any) -> Any:
    bpy.ops.mesh.primitive_ico_sphere_add(radius=1, subdivisions=3)
    return bpy.context.object


def aim_at_center(count: int, seed: int = 3) -> tuple[Any, Any]:
    """Return rays from a sphere of radius 4, of lengths of their own, that cross one of radius 1."""
    rng = np.random.default_rng(seed)
    origins = rng.normal(size=(count, 3))
    origins *= 4 / np.linalg.norm(origins, axis=1)[:, np.newaxis]
    return origins, (rng.uniform(-0.5, 0.5, (count, 3)) - origins) * rng.uniform(0.1, 10, (count, 1))


def test_results_unpack_as_those_of_blender_do(sphere: Any) -> None:
    cast = ray_cast(find_depsgraph(), [(0, 0, 5), (9, 9, 9)], DOWN)
    result, location, normal, index, number, matrix = cast
    assert result is cast.result
    assert location is cast.location
    assert normal is cast.normal
    assert index is cast.index
    assert number is cast.object
    assert matrix.shape == (2, 4, 4)
    assert len(cast) == 2


def test_a_sphere_has_two_surfaces_on_each_ray_that_crosses_it(sphere: Any) -> None:
    rays = aim_at_center(3000)
    cast = ray_cast(find_depsgraph(), *rays, hits=np.inf)
    assert cast.result.shape == (3000, 2)
    assert cast.result.all()
    assert (cast.distance[:, 0] < cast.distance[:, 1]).all()
    for hits in (1, 3):
        some = ray_cast(find_depsgraph(), *rays, hits=hits)
        assert some.location.shape == (3000, hits, 3)
        assert some.result.sum(axis=1).tolist() == [min(hits, 2)] * 3000
        np.testing.assert_array_equal(some.distance[:, :1], cast.distance[:, :1])
    first = ray_cast(find_depsgraph(), *rays)
    for name in ("location", "normal", "index", "object", "distance", "distance_error", "barycentric", "matrix"):
        np.testing.assert_array_equal(getattr(first, name), getattr(cast, name)[:, 0])


def test_layers_are_the_columns_of_all_hits(sphere: Any) -> None:
    bpy.ops.mesh.primitive_torus_add(major_radius=1.5)
    rays = aim_at_center(500)
    cast = ray_cast(find_depsgraph(), *rays, hits=np.inf)
    layers = list(ray_cast_layers(find_depsgraph(), *rays))
    assert len(layers) == cast.result.shape[1] > 2
    for column, layer in enumerate(layers):
        np.testing.assert_array_equal(layer.distance, cast.distance[:, column])
        np.testing.assert_array_equal(layer.normal, cast.normal[:, column])


def test_a_polygon_is_met_once_through_its_diagonal_and_its_corners(empty_scene: Any) -> None:
    link("Quads", make_quad(copies=3))
    line = np.arange(-4, 5) / 4.0
    origins = np.array([(x, y, 5.0) for x in line for y in line])
    cast = ray_cast(find_depsgraph(), origins, DOWN, hits=np.inf)
    assert cast.result.shape == (81, 3)
    assert cast.result.all()
    np.testing.assert_array_equal(cast.index, np.tile([0, 1, 2], (81, 1)))


def test_coinciding_objects_are_each_met(empty_scene: Any) -> None:
    for name in ("One", "Two"):
        link(name, make_quad())
    cast = ray_cast(find_depsgraph(), (0.25, 0.5, 3), DOWN, hits=np.inf)
    assert cast.distance.tolist() == [[3, 3]]
    assert [cast.objects[number].name for number in cast.object[0]] == ["One", "Two"]


def test_the_range_is_from_near_to_distance(empty_scene: Any) -> None:
    link("Quads", make_quad(copies=3), (0, 0, 1))  # at 1, 0.9 and 0.8
    depsgraph, origin = find_depsgraph(), (0.25, 0.5, 2.0)
    for near, expected in ((0.0, 0), (1.0, 0), (1.05, 1), (1.15, 2), (1.5, -1)):
        assert ray_cast(depsgraph, origin, (0, 0, -7), near=near).index.tolist() == [expected]
    cast = ray_cast(depsgraph, origin, (0, 0, -0.1), 1.15, near=1.05, hits=2)
    assert cast.index.tolist() == [[1, -1]]
    cast = ray_cast(depsgraph, np.tile(origin, (3, 1)), DOWN, near=[1.05, np.nan, -3.0])
    assert cast.index.tolist() == [1, -1, 0]


def test_distances_are_metres_within_their_error(empty_scene: Any) -> None:
    """Against the exact crossing of the plane, in fractions, whose square times |d|^2 is the square of the distance."""
    bpy.ops.mesh.primitive_monkey_add()
    origins, directions = aim_at_center(200)
    depsgraph = find_depsgraph()
    cast = ray_cast(depsgraph, origins, directions)
    geometry = find_held(depsgraph)[0].caster.geometry
    for ray in np.flatnonzero(cast.result):
        corners = [[Fraction(float(x)) for x in corner[0]] for corner in world_corners(
            geometry, cast.placement[ray : ray + 1], cast.places.primitive[ray : ray + 1])]  # fmt: skip
        o, d = ([Fraction(float(x)) for x in row[ray]] for row in (origins, directions))
        a, b, c = corners
        u, v, w = ([x - y for x, y in zip(p, q, strict=True)] for p, q in ((b, a), (c, a), (a, o)))
        n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
        t = sum(x * y for x, y in zip(n, w, strict=True)) / sum(x * y for x, y in zip(n, d, strict=True))
        squared = t * t * sum(x * x for x in d)
        low = Fraction(cast.distance[ray]) - Fraction(cast.distance_error[ray])
        high = Fraction(cast.distance[ray]) + Fraction(cast.distance_error[ray])
        assert low**2 <= squared <= high**2
    assert 0 < cast.distance_error[cast.result].max() < 1e-13
    missed = ~cast.result
    assert (cast.distance[missed] == np.inf).all()
    assert (cast.distance_error[missed] == 0).all()


def test_vertices_and_weights_give_the_location(empty_scene: Any) -> None:
    bpy.ops.mesh.primitive_monkey_add(location=(0.3, 0.2, 0), scale=(1, -1, 0.5))
    monkey = bpy.context.object
    link("Other", make_quad(5), (0, 0, -2))
    cast = ray_cast(find_depsgraph(), *aim_down(2.0))
    assert (cast.object == cast.objects.index(monkey)).any()
    for ray in np.flatnonzero(cast.result):
        shown = cast.objects[cast.object[ray]]
        a, b, c = (np.array(shown.matrix_world @ shown.data.vertices[vertex].co) for vertex in cast.vertices[ray])
        second, third = cast.barycentric[ray]
        mean = (1 - second - third) * a + second * b + third * c
        np.testing.assert_allclose(mean, cast.location[ray], atol=1e-5)
        polygon = shown.data.polygons[cast.index[ray]]
        assert set(cast.vertices[ray]) <= set(polygon.vertices)
    assert (cast.vertices[~cast.result] == -1).all()


def test_no_rays_and_no_hits_keep_their_shapes(empty_scene: Any) -> None:
    assert ray_cast(find_depsgraph(), np.zeros((0, 3)), DOWN, hits=2).result.shape == (0, 2)
    assert ray_cast(find_depsgraph(), np.zeros((3, 3)), DOWN, hits=np.inf).result.shape == (3, 0)
    assert ray_cast(find_depsgraph(), np.zeros((3, 3)), DOWN, hits=2).matrix.shape == (3, 2, 4, 4)
    assert list(ray_cast_layers(find_depsgraph(), np.zeros((3, 3)), DOWN)) == []


@pytest.mark.parametrize("hits", [0, -1, 1.5, "2", True, [1], np.nan])
def test_hits_that_are_no_number_are_refused(empty_scene: Any, hits: Any) -> None:
    with pytest.raises(ValueError, match="hits: expected a whole number of at least 1, inf or None"):
        ray_cast(find_depsgraph(), (0, 0, 0), DOWN, hits=hits)


def test_near_of_another_length_is_refused(empty_scene: Any) -> None:
    with pytest.raises(ValueError, match=r"near: expected a number or an array \(1,\)"):
        ray_cast(find_depsgraph(), (0, 0, 0), DOWN, near=[1, 2])
