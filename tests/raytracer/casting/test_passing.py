"""Rays that pass the scene's box: none that meets it in exact arithmetic is left out, and hits stay as they were."""

from fractions import Fraction

import numpy as np
import pytest

import raytracer
from raytracer.casting import caster as caster_module
from raytracer.casting.passing import find_meeting, may_meet
from tests import meshes
from tests.oracle.judging import assert_same_hits

# Powers of two of the box and of directions.
SCALES = [(0, 0), (300, -300), (-300, -510), (510, 300), (900, 900), (-1000, -1000), (-1000, 26), (900, -1000)]


def meets_exactly(box, origin, direction):
    """True where the ray o + t d, t >= 0, meets a box, in fractions."""
    first, last = Fraction(0), None
    for low, high, o, d in zip(*(map(Fraction, row.tolist()) for row in (*box, origin, direction)), strict=True):
        if d == 0:
            if not low <= o <= high:
                return False
            continue
        ends = sorted([(low - o) / d, (high - o) / d])
        first, last = max(first, ends[0]), ends[1] if last is None else min(last, ends[1])
    return last is None or first <= last


def aim_at_edges(rng, box, count):
    """Rays exactly through points of the box's edges, corners and sides, in numbers of few bits."""
    points = box[0] + (box[1] - box[0]) * rng.integers(0, 17, (count, 3)) / 16
    fixed = rng.random((count, 3)) < 0.7
    points = np.where(fixed, np.where(rng.random((count, 3)) < 0.5, box[0], box[1]), points)
    origins = rng.integers(-(2**20), 2**20, (count, 3)) / 2.0**18
    origins = np.where(rng.random((count, 3)) < 0.1, points, origins)
    directions = (points - origins) * rng.integers(2**28, 2**29, (count, 1)) / 2.0**28
    directions *= rng.choice([1, 1, -1], (count, 1))
    usable = (directions != 0).any(axis=1)
    return origins[usable], directions[usable]


@pytest.mark.parametrize(("scale", "length"), SCALES)
def test_no_ray_that_meets_the_box_is_left_out(rng, scale, length):
    box = np.array([(-1.0, -0.75, -1.25), (1.5, 1.0, 0.5)])
    origins, directions = aim_at_edges(rng, box, 2000)
    with np.errstate(under="ignore", over="ignore"):
        box, origins, directions = np.ldexp(box, scale), np.ldexp(origins, scale), np.ldexp(directions, length)
    expected = np.array([meets_exactly(box, *ray) for ray in zip(origins, directions, strict=True)])
    found = may_meet(box, origins, directions)
    assert expected.any()
    assert (found | ~expected).all()


def test_rays_at_random_are_told_apart(rng):
    box = np.array([(-1.0, -0.75, -1.25), (1.5, 1.0, 0.5)])
    origins, directions = rng.uniform(-2, 2, (1000, 3)), rng.normal(size=(1000, 3))
    directions[:200, 0] = directions[100:300, 1] = 0
    expected = [meets_exactly(box, *ray) for ray in zip(origins, directions, strict=True)]
    assert 200 < np.count_nonzero(expected) < 800
    np.testing.assert_array_equal(may_meet(box, origins, directions), expected)


def test_extreme_directions_and_origins_are_not_left_out(rng):
    sizes = np.array([0.0, 5e-324, 1e-310, 1e-160, 1.0, 1e160, 1e308])
    box = np.array([(-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)])
    for extent in (1.0, 1e-300, 1e300):
        origins = rng.choice(sizes, (800, 3)) * rng.choice([-1.0, 1.0], (800, 3))
        directions = rng.choice(sizes, (800, 3)) * rng.choice([-1.0, 1.0], (800, 3))
        directions[~directions.any(axis=1)] = 1.0
        # Next to the box and towards it, in steps that are no normal numbers where it is small.
        origins[:400] = rng.uniform(-3, 3, (400, 3)) * extent
        directions[:400] = (rng.uniform(-1, 1, (400, 3)) * extent - origins[:400]) * 1e-11
        # Before a side, to which they come slowly.
        origins[400:600] = rng.uniform(-0.9, 0.9, (200, 3)) * extent
        origins[400:600, 0] = -extent - 1e-11 * extent * rng.random(200)
        directions[400:600] = rng.uniform(0.1, 1, (200, 3)) * (1e-11, 0.1, 0.1) * extent
        found = may_meet(box * extent, origins, directions)
        expected = np.array([meets_exactly(box * extent, *ray) for ray in zip(origins, directions, strict=True)])
        assert (found | ~expected).all()


def test_rays_are_looked_at_only_where_many_pass(rng):
    box = np.array([(-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)])
    origins = rng.uniform(-1, 1, (9000, 3))
    directions = rng.normal(size=origins.shape)
    assert find_meeting(box, origins, directions) is None
    origins[::2] += 10
    rows = find_meeting(box, origins, directions)
    assert set(range(1, 9000, 2)) < set(rows.tolist())
    assert len(rows) < 5000


@pytest.mark.parametrize("spheres", [False, True])
def test_hits_are_the_same_whether_rays_are_left_out_or_not(rng, monkeypatch, spheres):
    scene = raytracer.Scene(
        meshes=[raytracer.Mesh(*meshes.make_icosphere(3))],
        spheres=[raytracer.Spheres(centres=[(0, 0, 3)], radii=[0.25])] if spheres else [],
    )
    origins = rng.uniform(-4, 4, (6000, 3))
    directions = rng.normal(size=origins.shape)
    directions[:3000] = rng.uniform((-1, -1, 3 * spheres - 1), (1, 1, 3 * spheres + 1), (3000, 3)) - origins[:3000]
    caster = raytracer.build(scene)
    looked = []
    monkeypatch.setattr(caster_module, "find_meeting", lambda *ray: (looked.append(find_meeting(*ray)), looked[-1])[1])
    hits, found = caster.closest_hit(origins, directions), caster.any_hit(origins, directions)
    assert len(looked) == 2
    assert all(len(rows) < 5000 for rows in looked)
    monkeypatch.setattr(caster_module, "SMALLEST_BATCH", 1 << 30)
    assert_same_hits(hits, caster.closest_hit(origins, directions))
    np.testing.assert_array_equal(found, caster.any_hit(origins, directions))
    assert hits.hit.sum() > 300
