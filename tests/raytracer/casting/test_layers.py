"""All surfaces that rays meet, against exact arithmetic: each surface at one t once."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

import raytracer
from raytracer.casting.layers import iterate_layers
from tests import meshes
from tests.oracle.exact_oracle import all_hits
from tests.oracle.judging import mesh_scene, sphere_scene


def list_surfaces(scene_meshes, origin, direction):
    """Return the sorted distinct (t, instance) of one ray, t a Fraction."""
    found = set()
    for instance, (positions, triangles) in enumerate(scene_meshes):
        hits = all_hits([origin], [direction], positions[triangles], None, None, 0.0, np.inf)
        found |= {(t, instance) for _, _, t in hits}
    return sorted(found)


def assert_layers_are_exact(scene_meshes, origins, directions):
    layers = list(iterate_layers(raytracer.build(mesh_scene(*scene_meshes)), origins, directions))
    for ray, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
        expected = list_surfaces(scene_meshes, origin, direction)
        met = [layer for layer in layers if layer.hit[ray]]
        assert [layer.instance[ray] for layer in met] == [instance for _, instance in expected]
        for layer, (t, _) in zip(met, expected, strict=True):
            assert abs(Fraction(layer.distance[ray]) - t) <= Fraction(layer.distance_error[ray])
        assert layers[: len(met)] == met  # a ray that has met its last surface meets no more


def test_layers_through_edges_and_vertices_meet_each_surface_once():
    rng = np.random.default_rng(4)
    sphere = meshes.make_icosphere(1)
    for make in (meshes.rays_at_vertices, lambda *arguments: meshes.rays_at_edges(*arguments, rng, 30)):
        assert_layers_are_exact([sphere], *make(sphere, (2.0, 1.5, 1.0)))


def test_layers_of_coinciding_objects_meet_each_of_them_once():
    cube = meshes.make_cube()
    turned = cube[0], cube[1][:, [1, 2, 0]]
    x, y = (
        axis.ravel() for axis in np.meshgrid(np.arange(-4, 5) / 4, np.arange(-4, 5) / 4)
    )  # diagonals, edges, corners
    origins = np.stack([x, y, np.full(81, 3.0)], axis=1)
    assert_layers_are_exact([cube, turned, meshes.make_quad()], origins, np.tile([(0.0, 0.0, -0.3)], (81, 1)))


def test_layers_of_crossing_triangles_are_told_apart_in_integers():
    """Two planes of one mesh cross in a line that is no edge of either: only integers know that both are met there."""
    positions = np.array([(-3, -3, -3), (3, -3, -3), (0, 4, 4), (-3, -3, 3), (3, -3, 3), (0, 4, -4)], dtype=float)
    mesh = positions, np.array([(0, 1, 2), (3, 4, 5)], dtype=np.int32)
    targets = np.array([(k / 7, 0.0, 0.0) for k in range(-5, 6)])
    targets[:, 1] = targets[:, 2] = 0.0
    origins = targets + np.array([(0.25 * k, 5.0, 1 + k) for k in range(11)])
    assert_layers_are_exact([mesh], origins, targets - origins)


def test_a_closed_sphere_has_two_layers_for_rays_that_cross_it():
    """A client that starts again where it has hit meets the same surface again and again."""
    rng = np.random.default_rng(3)
    origins = rng.normal(size=(20000, 3))
    origins *= 4 / np.linalg.norm(origins, axis=1)[:, np.newaxis]
    directions = rng.uniform(-0.5, 0.5, (20000, 3)) - origins
    caster = raytracer.build(mesh_scene(meshes.make_icosphere(3)))
    assert [int(hits.hit.sum()) for hits in iterate_layers(caster, origins, directions)] == [20000, 20000]


def test_all_hits_are_the_layers_ray_by_ray():
    caster = raytracer.build(mesh_scene(meshes.make_nested_shells(4)))
    origins, directions = meshes.random_rays(np.random.default_rng(1), 200)
    layers = list(caster.layers(origins, directions))
    found = caster.all_hits(origins, directions)
    assert found.count.tolist() == np.sum([layer.hit for layer in layers], axis=0).tolist()
    assert found.count.max() == len(layers) >= 8
    for ray, layer, distance, primitive in zip(
        found.ray, found.layer, found.hits.distance, found.hits.primitive, strict=True
    ):
        assert (distance, primitive) == (layers[layer].distance[ray], layers[layer].primitive[ray])
    assert (np.diff(found.ray) >= 0).all()
    few = caster.all_hits(origins, directions, most=2)
    assert few.count.tolist() == np.minimum(found.count, 2).tolist()


def test_spheres_are_met_twice_and_the_range_is_kept():
    caster = raytracer.build(sphere_scene([(0, 0, 0), 1.0], [(0, 0, 5), 1.0]))
    distances = [hits.distance[0] for hits in caster.layers([(0, 0, -3)], [(0, 0, 1)])]
    assert distances == [2, 4, 7, 9]
    distances = [hits.distance[0] for hits in caster.layers([(0, 0, -3)], [(0, 0, 1)], 3.0, 7.0)]
    assert distances == [4, 7]


def test_invalid_rays_and_bad_limits():
    caster = raytracer.build(mesh_scene(meshes.make_quad()))
    found = caster.all_hits([(0, 0, 1), (np.nan, 0, 1)], (0, 0, -1))
    assert found.count.tolist() == [1, 0]
    for most in (0, 1.5, 2.0, np.inf, np.nan, True, [1]):
        with pytest.raises(ValueError, match="most: expected a whole number"):
            caster.all_hits((0, 0, 1), (0, 0, -1), most=most)
