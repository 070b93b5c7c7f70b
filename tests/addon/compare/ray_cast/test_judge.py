"""The judge of hits against an independent exact solution of every triangle, and on rays whose answer is plain."""

from fractions import Fraction

import numpy as np
import pytest

import raytracer
from addon.compare.ray_cast.judge import BLOCK, Judge
from raytracer.casting.geometry import pack_geometry, world_corners

QUAD = raytracer.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])


def make_judge(*meshes, instances=None):
    return Judge(pack_geometry(raytracer.Scene(meshes=meshes, instances=instances)))


def find_first(judge, origin, direction):
    return set(judge.find_first(np.array(origin, dtype=float), np.array(direction, dtype=float)))


def determinant(a, b, c):
    return a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0])


def solve_exactly(corners, origin, direction):
    """Cramer's rule in fractions: o + t d = a + beta (b - a) + gamma (c - a); t of a hit with t >= 0, or None."""
    origin, direction = [Fraction(value) for value in origin], [Fraction(value) for value in direction]
    a, b, c = ([Fraction(value) for value in corner] for corner in corners)
    side_b, side_c, right = ([y - x for x, y in zip(a, other, strict=True)] for other in (b, c, origin))
    back = [-value for value in direction]
    total = determinant(side_b, side_c, back)
    if total == 0:
        return None
    beta = determinant(right, side_c, back) / total
    gamma = determinant(side_b, right, back) / total
    t = determinant(side_b, side_c, right) / total
    return t if t >= 0 and beta >= 0 and gamma >= 0 and beta + gamma <= 1 else None


def find_first_slowly(geometry, counts, origin, direction):
    found = {}
    for instance, count in enumerate(counts):
        for triangle in range(count):
            corners = [corner[0].tolist() for corner in world_corners(geometry, [instance], [triangle])]
            t = solve_exactly(corners, origin.tolist(), direction.tolist())
            if t is not None:
                found[instance, triangle] = t
    return {primitive for primitive, t in found.items() if t == min(found.values())}


def test_a_ray_through_the_diagonal_hits_both_triangles():
    assert find_first(make_judge(QUAD), (0.25, 0.25, 1), (0, 0, -1)) == {(0, 0), (0, 1)}


def test_a_ray_through_a_face_hits_one_triangle():
    assert find_first(make_judge(QUAD), (0.75, 0.25, 1), (0, 0, -1)) == {(0, 0)}


@pytest.mark.parametrize(("x", "expected"), [(1.0, {(0, 0)}), (np.nextafter(1.0, 2.0), set())])
def test_the_border_belongs_to_the_triangle(x, expected):
    assert find_first(make_judge(QUAD), (x, 0.5, 1), (0, 0, -1)) == expected


def test_what_lies_behind_is_not_hit():
    assert find_first(make_judge(QUAD), (0.75, 0.25, 1), (0, 0, 1)) == set()


def test_between_two_surfaces_only_the_one_in_front_is_hit():
    both = raytracer.Mesh(
        np.concatenate([QUAD.positions, QUAD.positions + np.array([0, 0, 2])]),
        np.concatenate([QUAD.triangles, QUAD.triangles + 4]),
    )
    assert find_first(make_judge(both), (0.75, 0.25, 0.5), (0, 0, 1)) == {(0, 2)}
    assert find_first(make_judge(both), (0.75, 0.25, 0.5), (0, 0, -1)) == {(0, 0)}


def test_a_ray_that_starts_on_a_triangle_hits_it():
    assert find_first(make_judge(QUAD), (0.75, 0.25, 0), (0, 0, 1)) == {(0, 0)}


def test_the_nearer_of_two_surfaces_one_ulp_apart_is_hit():
    lifted = raytracer.Mesh(QUAD.positions + np.array([0, 0, 2.0**-40]), QUAD.triangles)
    assert find_first(make_judge(QUAD, lifted), (0.75, 0.25, 1), (0, 0, -1)) == {(1, 0)}
    assert find_first(make_judge(QUAD, lifted), (0.75, 0.25, -1), (0, 0, 1)) == {(0, 0)}


def test_a_scene_without_triangles_is_missed():
    assert find_first(make_judge(), (0, 0, 1), (0, 0, -1)) == set()


def test_an_empty_mesh_between_others_shifts_no_index():
    empty = raytracer.Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
    assert find_first(make_judge(empty, QUAD, empty), (0.75, 0.25, 1), (0, 0, -1)) == {(1, 0)}


@pytest.mark.parametrize("aim", ["anywhere", "vertex", "edge"])
def test_the_judge_agrees_with_solving_every_triangle(aim):
    rng = np.random.default_rng(11)
    count = BLOCK + 40  # more than one block
    meshes = [raytracer.Mesh(rng.random((60, 3)), rng.integers(60, size=(size, 3))) for size in (count, 25)]
    matrices = np.tile(np.eye(4), (3, 1, 1))
    matrices[1, :3] = rng.normal(size=(3, 4))
    matrices[2, 0, 0] = -1
    instances = raytracer.Instances([0, 1, 1], matrices)
    geometry = pack_geometry(raytracer.Scene(meshes=meshes, instances=instances))
    judge, counts = Judge(geometry), (count, 25, 25)
    for _ in range(12):
        instance = int(rng.integers(3))
        a, b, _ = world_corners(geometry, [instance], [int(rng.integers(counts[instance]))])
        target = {"anywhere": rng.random(3), "vertex": a[0], "edge": a[0] + 0.375 * (b[0] - a[0])}[aim]
        origin = rng.normal(size=3).astype(np.float32).astype(float)
        direction = target - origin
        assert set(judge.find_first(origin, direction)) == find_first_slowly(geometry, counts, origin, direction)
