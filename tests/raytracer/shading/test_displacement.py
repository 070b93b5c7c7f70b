"""Meshes that programs move: ways in closed form, once for each vertex, and the normals that follow."""

import numpy as np
import pytest

from raytracer import Instances, Material, Mesh, Scene
from raytracer.scene.programs import Program, Register, Step
from raytracer.shading.displacement import Displacement, displace

# A roof: two faces that share the edge from (0, 0, 1) to (0, 1, 1), and one far away.
POSITIONS = np.array(
    [(-1, 0, 0), (0, 0, 1), (1, 0, 0), (-1, 1, 0), (0, 1, 1), (1, 1, 0), (9, 0, 0), (9, 1, 0), (8, 0, 0)]
)
TRIANGLES = np.array([(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4), (6, 7, 8)])
TURN = np.array([(0.0, -2.0, 0.0, 3.0), (2.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.5, 1.0), (0.0, 0.0, 0.0, 1.0)])
UP = np.array((0.0, 0.0, 1.0))


def along_normal(scale):
    """scale N, in world space."""
    steps = [
        Step("NEW_GEOMETRY Normal"),
        Step("VECT_MATH Vector", (Register(0, "Normal"), np.zeros(3), np.zeros(3), scale), {"operation": "SCALE"}),
    ]
    return Program(steps), Register(1, "Vector")


def move(value, bends=True, normals=None, smooth=True, material=0, matrix=TURN):
    program, value = value if isinstance(value, tuple) else (Program(()), value)
    mesh = Mesh(POSITIONS, TRIANGLES, normals=normals, material=material)
    scene = Scene(
        meshes=[mesh], instances=Instances([0], [matrix]), materials=[Material(()) for _ in range(np.max(material) + 1)]
    )
    seen = np.broadcast_to(UP, POSITIONS.shape)
    return displace(scene, {0: Displacement(program, value, bends)}, seen, np.full(len(TRIANGLES), smooth))


def flat_normals(positions):
    a, b, c = positions[TRIANGLES].transpose(1, 0, 2)
    found = np.cross(b - a, c - a)
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def test_a_way_in_the_world_is_one_in_the_object():
    moved = move(np.array((0.0, 4.0, 1.0)))
    np.testing.assert_allclose(
        moved.positions - POSITIONS, np.broadcast_to((2.0, 0.0, 2.0), POSITIONS.shape), atol=1e-15
    )


def test_programs_see_the_normals_of_vertices_even_of_flat_meshes():
    moved = move(along_normal(0.25))
    np.testing.assert_allclose(moved.positions, POSITIONS + 0.5 * UP, atol=1e-15)
    assert moved.normals is None


def test_what_has_another_material_stays():
    moved = move(np.array((0.0, 4.0, 1.0)), material=np.array([1, 1, 0, 0, 1]))
    still = [0, 3, 6, 7, 8]
    np.testing.assert_array_equal(moved.positions[still], POSITIONS[still])
    assert (np.delete(moved.positions, still, axis=0)[:, 0] != np.delete(POSITIONS, still, axis=0)[:, 0]).all()


@pytest.mark.parametrize("smooth", [True, False])
def test_smooth_normals_are_made_anew_where_geometry_bends_them(smooth):
    """At the ridge the mean of both sides, straight up; elsewhere the side's own."""
    moved = move(np.zeros(3), normals=np.broadcast_to((1.0, 0.0, 0.0), POSITIONS.shape), smooth=smooth)
    flat = flat_normals(moved.positions)
    if not smooth:
        np.testing.assert_allclose(moved.normals, np.repeat(flat[:, None], 3, axis=1), atol=1e-15)
        return
    # Two triangles of one side and one of the other meet at each end of the ridge.
    ends = {1: flat[0] + flat[2] + flat[3], 4: flat[0] + flat[1] + flat[3]}
    for triangle, corners in enumerate(TRIANGLES):
        for corner, vertex in enumerate(corners):
            expected = ends.get(vertex, flat[triangle])
            np.testing.assert_allclose(moved.normals[triangle, corner], expected / np.linalg.norm(expected), atol=1e-15)


def test_normals_stay_where_the_material_bends_them():
    before = flat_normals(POSITIONS)
    np.testing.assert_allclose(move(along_normal(1.0), bends=False).normals, np.repeat(before[:, None], 3, axis=1))
    given = np.broadcast_to((0.0, 1.0, 0.0), POSITIONS.shape)
    assert (move(along_normal(1.0), bends=False, normals=given).normals == (0.0, 1.0, 0.0)).all()


def test_what_is_not_finite_and_what_has_no_inverse_moves_nothing():
    np.testing.assert_array_equal(move(np.array((np.nan, np.inf, -np.inf))).positions, POSITIONS)
    flat = TURN.copy()
    flat[0] = 0.0
    np.testing.assert_array_equal(move(UP, matrix=flat).positions, POSITIONS)
