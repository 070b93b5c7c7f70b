"""The test meshes are what the other tests take them for."""

import numpy as np
import pytest

from tests import meshes

CLOSED = {
    "cube": meshes.make_cube(),
    "icosphere": meshes.make_icosphere(2),
    "torus": meshes.make_torus(),
    "needle lens": meshes.make_needle_lens(),
    "shells": meshes.make_nested_shells(),
}


def signed_volume(mesh):
    a, b, c = np.moveaxis(mesh[0][mesh[1]], 1, 0)
    return (np.cross(a, b) * c).sum() / 6


@pytest.mark.parametrize("name", CLOSED)
def test_closed_mesh_has_each_edge_once_in_each_direction(name):
    triangles = CLOSED[name][1]
    directed = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    assert len(np.unique(directed, axis=0)) == len(directed)
    np.testing.assert_array_equal(np.unique(directed, axis=0), np.unique(directed[:, ::-1], axis=0))


@pytest.mark.parametrize("name", CLOSED)
def test_closed_mesh_faces_outwards(name):
    assert signed_volume(CLOSED[name]) > 0


def test_icosphere_has_1280_triangles_at_level_3_on_the_unit_sphere():
    positions, triangles = meshes.make_icosphere(3)
    assert len(triangles) == 1280
    np.testing.assert_allclose(np.linalg.norm(positions, axis=1), 1, rtol=1e-15)


def test_needle_lens_has_slivers_of_the_given_aspect():
    positions, triangles = meshes.make_needle_lens(aspect=1e7)
    corners = positions[triangles]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1)
    assert (sides.max(axis=1) / sides.min(axis=1) > 1e7).sum() == 2 * 32


def test_nested_shells_lie_one_ulp_apart():
    positions, _ = meshes.make_nested_shells(count=3)
    np.testing.assert_array_equal(np.unique(np.abs(positions)), 1 + np.finfo(float).eps * np.arange(3))


def test_heightfield_has_961_interior_vertices():
    positions, _ = meshes.make_heightfield()
    assert (np.abs(positions[:, :2]) < 1).all(axis=1).sum() == 961
