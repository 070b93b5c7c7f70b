"""Emissive objects as groups of a tree: against all their primitives."""

import numpy as np
import pytest

from raytracer.casting.geometry import Kind, world_corners
from raytracer.lights.emitter_groups import group_emitters
from raytracer.lights.emitter_table import locate_emitters, make_emitters
from raytracer.lights.emitters import pick_emitters
from raytracer.lights.light_linking import LightLinks
from raytracer.lights.light_picks import find_chances
from raytracer.surfaces.surface_tables import LARGEST_TABLE
from tests.raytracer.lights.light_kinds import make_points
from tests.raytracer.lights.test_instanced_emitters import RADIANCE, make_scene, make_tables


@pytest.fixture(params=[0, LARGEST_TABLE], ids=["instanced", "listed"])
def emitters(request):
    return make_emitters(make_tables(make_scene(1.0)), RADIANCE, largest=request.param)


def test_boxes_of_objects_hold_all_that_shines(emitters):
    group, geometry = group_emitters(emitters, None, 0), emitters.tables.geometry
    listed = make_emitters(emitters.tables, RADIANCE)
    np.testing.assert_array_equal(group.record, np.unique(listed.instance))
    row, clusters = group.number[listed.instance], group.tree.clusters
    low, high = (clusters.middle + sign * clusters.half for sign in (-1, 1))
    low, high = (values.T[group.tree.leaf[row]] for values in (low, high))
    flat = geometry.belongs_to_kind(listed.instance, Kind.TRIANGLE)
    margin = 1e-12
    for corners in world_corners(geometry, listed.instance[flat], listed.primitive[flat]):
        assert (corners >= low[flat] - margin).all()
        assert (corners <= high[flat] + margin).all()
    centre, radius = geometry.centres[listed.primitive[~flat]], geometry.radii[listed.primitive[~flat], np.newaxis]
    assert (centre - radius >= low[~flat] - margin).all()
    assert (centre + radius <= high[~flat] + margin).all()


def test_primitives_of_an_object_are_picked_in_their_share_of_it(emitters):
    """Even steps through each object: as many fall on a primitive as on it among all, over the object's share."""
    group, steps = group_emitters(emitters, None, 0), 4096
    np.testing.assert_allclose(group.share.sum(), 1.0, rtol=1e-12)
    overall = locate_emitters(emitters, pick_emitters(emitters, (np.arange(64 * steps) + 0.5) / (64 * steps)))
    for row, record in enumerate(group.record):
        picked = group.pick_primitives(emitters, np.full(steps, row), (np.arange(steps) + 0.5) / steps)
        instance, primitive = locate_emitters(emitters, picked)
        assert (instance == record).all()
        among = overall[1][overall[0] == record]
        assert abs(len(among) / (64 * steps) - group.share[row]) < 2e-5
        size = max(primitive.max(), among.max()) + 1
        expected = np.bincount(among, minlength=size) / len(among)
        np.testing.assert_allclose(np.bincount(primitive, minlength=size) / steps, expected, atol=2e-3)


def test_factors_make_chances_of_shares_and_leave_what_is_dark(emitters):
    group, rng = group_emitters(emitters, None, 0), np.random.default_rng(3)
    points, instance = make_points(rng, 300), rng.integers(0, len(group.number), 300)
    factor = group.find_factors(instance, points, 4)
    row = group.number[instance]
    assert (factor[row < 0] == 1.0).all()
    shining = np.flatnonzero(row >= 0)
    chance = find_chances(group.tree, row[shining], shining, points, 4)
    assert len(shining) > 100
    np.testing.assert_allclose(factor[shining] * group.share[row[shining]], chance, rtol=1e-12)


def test_objects_are_not_aimed_at_from_what_they_do_not_light(emitters):
    rng, count = np.random.default_rng(4), len(emitters.tables.material_first)
    links = LightLinks(np.zeros(count, np.int64), np.where(np.arange(count) % 2, 1, 2))
    group = group_emitters(emitters, links, 0)
    points = make_points(rng, len(group.record), np.zeros(len(group.record), np.int64))
    factor = group.find_factors(group.record, points, 3)
    np.testing.assert_array_equal(factor > 0, group.record % 2 == 1)


def test_few_objects_make_no_group(emitters):
    group = group_emitters(emitters, None, 0)
    assert group_emitters(emitters, None, len(group.record)) is None
    assert group_emitters(emitters, None, len(group.record) - 1) is not None
