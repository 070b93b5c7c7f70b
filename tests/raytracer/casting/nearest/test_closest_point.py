"""Closest points against fractions, closed forms and brute force."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

import raytracer
from raytracer.casting.geometry import world_corners
from raytracer.casting.nearest import search
from raytracer.casting.nearest.distances import measure_triangles
from tests import meshes
from tests.oracle.judging import mesh_scene, sphere_scene


def subtract(p, q):
    return [x - y for x, y in zip(p, q, strict=True)]


def dot(p, q):
    return sum(x * y for x, y in zip(p, q, strict=True))


def squared_distance(point, triangle):
    """The exact squared distance of a point from a triangle: the least over its inside and its edges, in fractions."""
    p, *corners = ([Fraction(float(x)) for x in vector] for vector in (point, *triangle))
    found = []
    for a, b in pairwise([*corners, corners[0]]):
        edge, offset = subtract(b, a), subtract(p, a)
        length = dot(edge, edge)
        step = min(max(dot(offset, edge) / length, Fraction(0)), Fraction(1)) if length else Fraction(0)
        rest = [x - step * y for x, y in zip(offset, edge, strict=True)]
        found.append(dot(rest, rest))
    a, u, v = corners[0], subtract(corners[1], corners[0]), subtract(corners[2], corners[0])
    w, uu, uv, vv = subtract(p, a), dot(u, u), dot(u, v), dot(v, v)
    whole = uu * vv - uv * uv
    if whole:
        beta, gamma = (dot(w, u) * vv - dot(w, v) * uv) / whole, (dot(w, v) * uu - dot(w, u) * uv) / whole
        if beta >= 0 and gamma >= 0 and beta + gamma <= 1:
            rest = [x - beta * y - gamma * z for x, y, z in zip(w, u, v, strict=True)]
            found.append(dot(rest, rest))
    return min(found)


def assert_holds(low, high, squared):
    assert low <= high
    assert Fraction(float(low)) ** 2 <= squared <= Fraction(float(high)) ** 2


def make_hard_triangles(rng):
    """Needles, caps, triangles without area, far away, tiny, and ordinary ones."""
    count = 40
    ordinary = rng.normal(size=(count, 3, 3))
    needles, caps, far, tiny = (ordinary.copy() for _ in range(4))
    needles[:, 2] = needles[:, 1] + 1e-9 * rng.normal(size=(count, 3))
    caps[:, 2] = (caps[:, 0] + caps[:, 1]) / 2 + 1e-12 * rng.normal(size=(count, 3))
    flat = ordinary.copy()
    flat[:, 2] = 2 * flat[:, 1] - flat[:, 0]
    points = ordinary[:, [0, 0, 0]]
    far += 1e6
    tiny *= 1e-12
    return np.concatenate([ordinary, needles, caps, flat, points, far, tiny])


@pytest.mark.parametrize("away", [1.0, 1e-6, 1e-12, 0.0])
def test_bounds_hold_the_exact_distance_of_hard_triangles(away):
    rng = np.random.default_rng(7)
    triangles = make_hard_triangles(rng)
    weights = rng.dirichlet((0.5, 0.5, 0.5), len(triangles))
    weights[::5] = np.eye(3)[rng.integers(3, size=len(weights[::5]))]
    points = (weights[:, :, np.newaxis] * triangles).sum(axis=1) + away * rng.normal(size=(len(triangles), 3))
    found = measure_triangles(points, triangles.transpose(1, 2, 0))
    for point, triangle, low, high in zip(points, triangles, found.low, found.high, strict=True):
        assert_holds(low, high, squared_distance(point, triangle))
    if away == 1.0:  # of well-shaped triangles the bound is that of a few roundings
        assert (found.high - found.low)[:40].max() < 1e-13


def find_brute(caster, points):
    """Return the least distance of each point over all triangles, and the (instance, primitive) that has it first."""
    geometry, best = caster.geometry, []
    for point in points:
        rows = [(i, p) for i, mesh in enumerate(geometry.instance_mesh) for p in range(geometry.mesh_count[mesh])]
        instance, primitive = np.array(rows).T
        corners = np.stack(world_corners(geometry, instance, primitive)).transpose(0, 2, 1)
        found = measure_triangles(np.tile(point, (len(rows), 1)), corners)
        first = int(found.distance.argmin())
        best.append((found.distance[first], *rows[first]))
    return best


def make_instances(rng):
    """Five instances of two meshes: turned, mirrored, flattened to nothing, stretched."""
    matrices = np.tile(np.eye(4), (6, 1, 1))
    matrices[:, :3, 3] = rng.uniform(-3, 3, (6, 3))
    matrices[1:, :3, :3] = rng.normal(size=(5, 3, 3))
    matrices[3, :3, 2] = 0
    matrices[4, :3, :3] = np.diag([3, -0.01, 1])
    records = [raytracer.Mesh(*meshes.make_icosphere(2)), raytracer.Mesh(*meshes.make_torus(12, 8))]
    return raytracer.Scene(meshes=records, instances=raytracer.Instances([0, 1, 0, 1, 0, 1], matrices))


@pytest.mark.parametrize("kind", ["soup", "cubes", "instances"])
def test_closest_points_are_those_of_brute_force(kind, monkeypatch):
    monkeypatch.setattr(search, "BLOCK_PAIRS", 500)
    rng = np.random.default_rng(3)
    scene = {
        "soup": lambda: mesh_scene(meshes.make_soup(rng, 300)),
        "cubes": lambda: mesh_scene(*(meshes.make_cube(0.5, centre) for centre in ((0, 0, 0), (1, 0, 0), (0, 3, 0)))),
        "instances": lambda: make_instances(rng),
    }[kind]()
    caster = raytracer.build(scene)
    points = np.concatenate([rng.uniform(-4, 4, (60, 3)), np.round(rng.uniform(-2, 2, (40, 3)) * 2) / 2])
    closest = caster.closest_point(points)
    assert list(zip(closest.distance, closest.instance, closest.primitive, strict=True)) == find_brute(caster, points)


def test_the_error_of_closest_points_bounds_the_exact_distance():
    rng = np.random.default_rng(5)
    mesh = meshes.make_soup(rng, 60)
    caster = raytracer.build(mesh_scene(mesh))
    points = np.concatenate([rng.normal(size=(30, 3)), mesh[0][:20], mesh[0][mesh[1][:20]].mean(axis=1)])
    closest = caster.closest_point(points)
    assert closest.distance_error.max() < 1e-7
    assert np.median(closest.distance_error) < 1e-14
    for point, distance, error in zip(points, closest.distance, closest.distance_error, strict=True):
        exact = min(squared_distance(point, triangle) for triangle in mesh[0][mesh[1]])
        low, high = max(Fraction(distance) - Fraction(error), 0), Fraction(distance) + Fraction(error)
        assert low**2 <= exact <= high**2


def test_closest_points_of_spheres_and_of_a_box_have_closed_forms():
    rng = np.random.default_rng(1)
    points = rng.normal(size=(200, 3)) * 2
    centres = np.array([(0.5, 0, 0), (-2, 1, 0), (0, 0, 3)])
    closest = raytracer.build(sphere_scene(*((centre, 0.75) for centre in centres))).closest_point(points)
    each = np.abs(np.linalg.norm(points[:, np.newaxis] - centres, axis=2) - 0.75)
    np.testing.assert_allclose(closest.distance, each.min(axis=1), rtol=1e-14, atol=1e-15)
    np.testing.assert_array_equal(closest.instance, 0)
    np.testing.assert_array_equal(closest.primitive, each.argmin(axis=1))
    on_it = np.linalg.norm(closest.location - centres[closest.primitive], axis=1)
    np.testing.assert_allclose(on_it, 0.75, rtol=1e-14)
    closest = raytracer.build(mesh_scene(meshes.make_cube())).closest_point(points)
    outside = np.linalg.norm(np.maximum(np.abs(points) - 1, 0), axis=1)
    expected = np.where(outside > 0, outside, (1 - np.abs(points)).min(axis=1))
    np.testing.assert_allclose(closest.distance, expected, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(points - closest.location, axis=1), expected, rtol=1e-13, atol=1e-15)


def test_the_center_of_a_sphere_of_many_triangles_needs_no_more_memory():
    caster = raytracer.build(mesh_scene(meshes.make_icosphere(4)))
    closest = caster.closest_point(np.zeros((50, 3)))
    assert len(set(closest.primitive.tolist())) == 1
    positions, triangles = meshes.make_icosphere(4)
    inner = min(squared_distance((0, 0, 0), triangle) for triangle in positions[triangles[:400]])
    assert closest.distance[0] ** 2 <= float(inner) * (1 + 1e-14)


def test_the_range_and_points_that_are_no_points():
    caster = raytracer.build(mesh_scene(meshes.make_quad()))
    closest = caster.closest_point([(0, 0, 2), (0, 0, 0.5), (np.nan, 0, 0), (0.1, 0, 0)], 1.0)
    assert closest.found.tolist() == [False, True, False, True]
    assert closest.distance.tolist() == [np.inf, 0.5, np.inf, 0]
    assert closest.location[0].tolist() == [0, 0, 0]
    assert closest.instance.tolist() == [-1, 0, -1, 0]
    assert not raytracer.build(raytracer.Scene()).closest_point([(0, 0, 0)]).found.any()
    for arguments, sentence in (
        (([(0, 0)],), r"points: expected shape \(n, 3\)"),
        (([(0, 0, 0)], [1, 2]), "distance: expected a number"),
    ):
        with pytest.raises(ValueError, match=sentence):
            caster.closest_point(*arguments)
