"""Closest points, insides and visibility, against Blender's own, closed forms and brute force."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from addon import closest_point, inside, ray_cast, visible
from tests.addon.scripting.ray_cast_fixtures import (
    DOWN,
    TOLERANCE,
    find_depsgraph,
    forget_casters,  # noqa: F401  (a fixture, found by its name)
    link,
    make_collection_instance,
    make_quad,
)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("forget_casters")]


def test_closest_points_are_those_of_blenders_tree(empty_scene: Any) -> None:
    bpy.ops.mesh.primitive_monkey_add()
    monkey = bpy.context.object
    monkey.modifiers.new("Triangles", "TRIANGULATE")  # Blender's normals are those of polygons
    depsgraph = find_depsgraph()
    points = np.random.default_rng(1).uniform(-2, 2, (300, 3))
    closest = closest_point(depsgraph, points)
    tree = BVHTree.FromObject(monkey, depsgraph)
    result, location, normal, index = closest
    assert result.all()
    for row, point in enumerate(points):
        expected = tree.find_nearest(Vector(point))
        assert abs(expected[3] - closest.distance[row]) < TOLERANCE
        if index[row] == expected[2]:  # at edges and vertices several are equally close
            np.testing.assert_allclose(location[row], expected[0], atol=1e-3)
            np.testing.assert_allclose(normal[row], expected[1], atol=1e-3)
    same = [tree.find_nearest(Vector(point))[2] for point in points] == index
    assert same.mean() > 0.4
    assert 0 < closest.distance_error.max() < 1e-12
    assert (closest.objects[0], closest.object.max()) == (monkey, 0)


def test_closest_points_are_in_the_world_however_objects_are_scaled(empty_scene: Any) -> None:
    """A square stretched to 8 x 1 and lifted; and instances, by the distance of a box in closed form."""
    stretched = link("Stretched", make_quad(), (0, 0, 2))
    stretched.scale = (4, 0.5, 1)
    points = np.random.default_rng(2).uniform(-6, 6, (100, 3))
    away = np.maximum(np.abs(points - (0, 0, 2)) - (4, 0.5, 0), 0)
    closest = closest_point(find_depsgraph(), points)
    np.testing.assert_allclose(closest.distance, np.linalg.norm(away, axis=1), atol=1e-6)
    make_collection_instance()
    closest = closest_point(find_depsgraph(), [(2.25, 0.5, 0.5), (-2, 1, 0)], 0.75)
    assert [closest.objects[number].name for number in closest.object] == ["Source", "Source"]
    np.testing.assert_allclose(closest.distance, [0.5, 0.5], atol=1e-6)
    assert closest.placement[0] != closest.placement[1]


def test_closest_points_of_a_selection_within_a_range(empty_scene: Any) -> None:
    low, _ = link("Low", make_quad()), link("High", make_quad(), (0, 0, 1))
    point = (0.25, 0.5, 1.5)
    assert closest_point(find_depsgraph(), point).distance.tolist() == [0.5]
    assert closest_point(find_depsgraph(), point, objects=[low]).distance.tolist() == [1.5]
    nothing = closest_point(find_depsgraph(), point, 1.0, objects=[low])
    assert not nothing.result[0]
    assert (nothing.index[0], nothing.object[0], nothing.distance[0]) == (-1, -1, np.inf)
    assert nothing.location[0].tolist() == [0, 0, 0]


def test_inside_of_closed_meshes_and_of_none_else(empty_scene: Any) -> None:
    bpy.ops.mesh.primitive_uv_sphere_add(radius=1)
    bpy.ops.mesh.primitive_cube_add(size=2, location=(1, 0, 0))
    link("Floor", make_quad(10), (0, 0, -2))
    points = np.random.default_rng(3).uniform(-2, 2.5, (2000, 3))
    in_cube = (np.abs(points - (1, 0, 0)) < 1).all(axis=1)
    radius = np.linalg.norm(points, axis=1)
    clear = (radius > 1) | (radius < 0.97)  # the faces of the sphere are between
    found = inside(find_depsgraph(), points)
    np.testing.assert_array_equal(found[clear], (in_cube | (radius < 1))[clear])
    cube = bpy.data.objects["Cube"]
    np.testing.assert_array_equal(inside(find_depsgraph(), points, objects=[cube]), in_cube)


def test_vertices_seen_from_a_place_are_those_of_a_convex_body_in_closed_form(empty_scene: Any) -> None:
    """A vertex of a sphere is seen where one of its faces is seen from the front; no tolerance is needed for it."""
    bpy.ops.mesh.primitive_uv_sphere_add(radius=1)
    mesh, eye = bpy.context.object.data, np.array((3.0, 2.0, 1.0))
    front = {vertex for polygon in mesh.polygons if polygon.normal.dot(Vector(eye) - polygon.center) > 0
             for vertex in polygon.vertices}  # fmt: skip
    points = np.array([vertex.co for vertex in mesh.vertices], dtype=float)
    for tolerance in (None, 0.0):
        seen = visible(find_depsgraph(), points, eye, tolerance=tolerance)
        np.testing.assert_array_equal(np.flatnonzero(seen), sorted(front))


def test_visibility_goes_both_ways_and_ends_at_the_points(empty_scene: Any) -> None:
    wall = link("Wall", make_quad(), (0, 0, 1))
    depsgraph = find_depsgraph()
    points, eyes = [(0.1, 0.2, 0), (0.1, 0.2, 1), (3, 0, 0)], (0.1, 0.2, 3)
    assert visible(depsgraph, points, eyes).tolist() == [False, True, True]
    assert visible(depsgraph, eyes, points).tolist() == [False, True, True]
    assert visible(depsgraph, (0.1, 0.2, 0), [(0.1, 0.2, z) for z in (0.5, 1.0, 1.5)]).tolist() == [True, True, False]
    assert visible(depsgraph, points, eyes, objects=[]).all()
    assert visible(depsgraph, [(np.nan, 0, 0), (0, 0, 5)], (0, 0, 5)).tolist() == [False, True]
    cast = ray_cast(depsgraph, np.random.default_rng(1).uniform((-0.9, -0.9, 6), (0.9, 0.9, 8), (500, 3)), DOWN)
    assert visible(depsgraph, cast.location, (0.3, 0.2, 7)).all()
    assert wall.name == "Wall"


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda depsgraph: closest_point(depsgraph, [(0, 0)]), r"points: expected shape \(n, 3\)"),
        (lambda depsgraph: closest_point(depsgraph, (0, 0, 0), [1, 2]), r"distance: expected .* \(1,\)"),
        (lambda depsgraph: closest_point(None, (0, 0, 0)), "depsgraph: expected a bpy.types.Depsgraph, got NoneType"),
        (lambda depsgraph: inside(depsgraph, "here"), "points: expected an array"),
        (lambda depsgraph: visible(depsgraph, (0, 0, 0), (0, 0)), r"from_: expected shape \(n, 3\)"),
        (
            lambda depsgraph: visible(depsgraph, np.zeros((3, 3)), np.zeros((2, 3))),
            "from_: expected one place or as many",
        ),
        (lambda depsgraph: visible(depsgraph, (0, 0, 0), (0, 0, 1), tolerance="x"), "tolerance: expected an array"),
    ],
)
def test_arguments_that_do_not_fit_are_named(empty_scene: Any, call: Any, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        call(find_depsgraph())
