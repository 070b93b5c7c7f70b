"""What stays and what moves, cast into apart, against one caster of the whole scene, bit for bit."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

import raytracer
from raytracer.casting.geometry import pack_geometry
from raytracer.casting.moving import MovingCaster, follow_moving
from raytracer.casting.rays import make_rays
from tests import meshes


def make_scene(offsets):
    """Cubes and spheres in turn, at offsets (i, 3)."""
    matrices = np.tile(np.eye(4), (len(offsets), 1, 1))
    matrices[:, :3, 3] = offsets
    records = [raytracer.Mesh(*meshes.make_cube()), raytracer.Mesh(*meshes.make_icosphere(2))]
    mesh = np.arange(len(offsets)) % 2
    return raytracer.Scene(meshes=records, instances=raytracer.Instances(mesh, matrices))


def make_all_rays(rng):
    """Random rays, and rays along a grid that meets faces, edges and corners of cubes at one place."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(-8, 9) / 4, np.arange(-8, 9) / 4))
    grid = np.stack([x, y, np.full(len(x), 9.0)], axis=1)
    origins, directions = meshes.random_rays(rng, 300, 4.0)
    ranges = np.concatenate([np.full(300, np.inf), np.full(len(x), 7.0)])
    directions = np.concatenate([directions, np.tile([(0, 0, -2.0)], (len(x), 1))])
    return make_rays(np.concatenate([origins, grid]), directions, 0.5, ranges)


def assert_same(caster, scene, rays):
    whole = raytracer.build(scene)
    expected = whole.closest_hit(rays.origins, rays.directions, rays.t_min, rays.t_max)
    hits = caster.closest_hit(rays)
    for field in fields(hits):
        np.testing.assert_array_equal(getattr(hits, field.name), getattr(expected, field.name))
    found = whole.any_hit(rays.origins, rays.directions, rays.t_min, rays.t_max)
    np.testing.assert_array_equal(caster.any_hit(rays), found)


@pytest.mark.parametrize("chosen", [(0,), (2,), (0, 3), (1, 2)])
def test_hits_are_those_of_one_caster_where_surfaces_coincide(chosen):
    """Instances 0, 2 and 4 are cubes at one place: the lowest is hit first, whichever moves."""
    offsets = np.zeros((6, 3))
    offsets[1::2] = [(0.5, 0, 0), (0, 0.5, 0), (-2, 0, 0)]
    moving = np.isin(np.arange(6), chosen)
    scene = make_scene(offsets)
    rays = make_all_rays(np.random.default_rng(1))
    assert_same(MovingCaster(scene, pack_geometry(scene), moving), scene, rays)


def test_what_stays_keeps_its_caster_from_frame_to_frame():
    rng = np.random.default_rng(2)
    offsets, rays, last = rng.uniform(-3, 3, (8, 3)), make_all_rays(rng), None
    for frame in range(3):
        offsets[5] += 0.25
        scene, changed = make_scene(offsets), np.arange(8) == 5
        caster = follow_moving(scene, pack_geometry(scene), changed, last)
        assert caster is not None
        assert_same(caster, scene, rays)
        assert frame == 0 or caster._still is last._still
        last = caster
    offsets[1] += 1  # another moves as well: what stays is less
    scene = make_scene(offsets)
    caster = follow_moving(scene, pack_geometry(scene), np.arange(8) == 1, last)
    assert caster is None or caster._still is not last._still


def test_where_much_moves_all_is_packed_anew():
    scene = make_scene(np.zeros((4, 3)))
    assert follow_moving(scene, pack_geometry(scene), np.array([True, True, True, False]), None) is None
