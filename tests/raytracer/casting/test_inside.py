"""Which points lie inside, against closed forms and exact arithmetic."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import raytracer
from raytracer.casting.inside import is_closed
from tests import meshes
from tests.oracle.judging import build_with, mesh_scene, sphere_scene


def lie_in_cube(points, centre, half_size=1.0):
    """Closed form of the half-open cube that holds what a moved point lies in: low <= p < high."""
    offset = points - np.asarray(centre)
    return ((offset >= -half_size) & (offset < half_size)).all(axis=1)


@pytest.mark.parametrize("accelerator", ["brute_force", "bvh", "dense"])
def test_inside_of_cubes_is_exact_on_faces_edges_and_corners(accelerator):
    """All points of a grid that has the faces on it: the symbolic perturbation makes each cube half open."""
    line = np.arange(-12, 13) / 4.0
    points = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3)
    caster = build_with(accelerator, mesh_scene(meshes.make_cube(), meshes.make_cube(1.0, (1.0, 0.5, 0.0))))
    expected = lie_in_cube(points, (0, 0, 0)) | lie_in_cube(points, (1, 0.5, 0))
    np.testing.assert_array_equal(caster.inside(points), expected)


def test_inside_counts_each_object_for_itself():
    """Where two spheres overlap, a ray crosses two surfaces: the parity of all together would say outside."""
    spheres = meshes.make_icosphere(2), meshes.make_icosphere(2, centre=(0.5, 0, 0))
    caster = raytracer.build(mesh_scene(*spheres))
    points = np.array([(0.25, 0, 0), (-0.8, 0, 0), (1.4, 0, 0), (1.6, 0, 0)])
    assert caster.inside(points).tolist() == [True, True, True, False]
    assert (caster.crossings(points[:1], (0, 0, 1)) % 2).tolist() == [0]


def test_inside_of_nested_shells_alternates():
    """One mesh of four cubes in each other: by the even-odd rule what lies between is in and out by turns."""
    shells = meshes.join_meshes([meshes.make_cube(size) for size in (1, 2, 3, 4)])
    points = [(x, 0.25, 0) for x in (0, 1, 1.5, 2.5, 3, 3.5, 4, 5)]
    expected = [False, True, True, False, True, True, False, False]
    assert raytracer.build(mesh_scene(shells)).inside(points).tolist() == expected


def test_a_mesh_with_a_border_has_no_inside():
    floor = meshes.make_quad(10)
    positions, triangles = meshes.make_cube()
    lid = np.array([(0, 0, -5), (0, 0, 5), (0, 0, 0)], dtype=float)
    assert not raytracer.build(mesh_scene(floor)).inside(lid).any()
    assert not raytracer.build(mesh_scene((positions, triangles[1:]))).inside(lid).any()
    assert raytracer.build(mesh_scene(floor, (positions, triangles))).inside(lid).tolist() == [False, False, True]


def test_vertices_at_one_place_close_a_mesh():
    positions, triangles = meshes.make_cube()
    split = raytracer.Mesh(positions[triangles].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    zeros = raytracer.Mesh(np.where(positions == -1, -0.0, positions + 0.0), triangles)
    assert is_closed(split)
    assert is_closed(zeros)
    assert not is_closed(raytracer.Mesh(positions, triangles[:-1]))
    assert not is_closed(raytracer.Mesh(positions, np.zeros((0, 3), np.int32)))


def test_inside_of_spheres_is_exact_within_a_rounding():
    centre, radius = (0.1, 0.2, 0.3), 0.7
    caster = raytracer.build(sphere_scene([centre, radius], [(0.15, 0.2, 0.3), 0.7], [(30, 0, 0), 1.0]))
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(400, 3))
    directions[:, 0] = -np.abs(directions[:, 0])  # the side that the second sphere does not reach
    points = np.array(centre) + radius * directions / np.linalg.norm(directions, axis=1)[:, np.newaxis]
    exact = [sum((Fraction(p) - Fraction(c)) ** 2 for p, c in zip(point, centre, strict=True)) for point in points]
    expected = [squared < Fraction(radius) ** 2 for squared in exact]
    assert 0 < sum(expected) < 400
    inside = caster.inside(points)
    near_other = [sum((Fraction(p) - Fraction(c)) ** 2 for p, c in zip(point, (0.15, 0.2, 0.3), strict=True))
                  < Fraction(radius) ** 2 for point in points]  # fmt: skip
    assert inside.tolist() == [one or other for one, other in zip(expected, near_other, strict=True)]
    assert caster.inside([(0.12, 0.2, 0.3)]).tolist() == [True]  # in both


def test_inside_of_instances_follows_their_matrices():
    mesh, matrix = raytracer.Mesh(*meshes.make_cube()), np.eye(4)
    matrix[:3] = [(2, 0, 0, 10), (0, -0.5, 0, 0), (0, 0, 1, 0)]
    scene = raytracer.Scene(meshes=[mesh], instances=raytracer.Instances([0, 0], [np.eye(4), matrix]))
    points = [(0.9, 0.9, 0), (11.9, 0.4, 0.9), (11.9, 0.6, 0.9), (8.1, -0.4, -0.9)]
    assert raytracer.build(scene).inside(points).tolist() == [True, True, False, True]


def test_points_that_are_no_points():
    caster = raytracer.build(mesh_scene(meshes.make_cube()))
    assert caster.inside([(np.nan, 0, 0), (np.inf, 0, 0), (0, 0, 0)]).tolist() == [False, False, True]
    with pytest.raises(ValueError, match=r"points: expected shape \(n, 3\)"):
        caster.inside([(0, 0)])
    with pytest.raises(ValueError, match="inside: precision: expected 'certified'"):
        raytracer.build(replace(caster.scene), "float64").inside([(0, 0, 0)])
