"""Hits of curves against exact rational arithmetic: at random, and where it is hard."""

from __future__ import annotations

import numpy as np
import pytest

from tests.raytracer.casting.curves.strands_fixtures import SHAPES, aim_at, build_strand, judge, make_wild_strand


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow), pytest.param(3, marks=pytest.mark.slow)])
def test_hits_of_wild_strands_are_the_exact_ones(shape: str, seed: int) -> None:
    rng, count = np.random.default_rng(seed), 0
    for _ in range(6):
        points, radii = make_wild_strand(rng)
        count += judge(build_strand(points, radii, shape), *aim_at(rng, points, 8))
    assert count > 8


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("size", [1e-9, 1e9])
def test_hits_of_tiny_and_huge_strands_are_the_exact_ones(shape: str, size: float) -> None:
    rng = np.random.default_rng(5)
    points, radii = make_wild_strand(rng)
    origins, directions = aim_at(rng, points, 8)
    assert judge(build_strand(size * points, size * radii, shape), size * origins, directions) > 1


@pytest.mark.parametrize("shape", SHAPES)
def test_hits_far_from_the_origin_are_the_exact_ones(shape: str) -> None:
    rng, far = np.random.default_rng(16), np.array([1e6, -2e6, 3e5])
    points, radii = make_wild_strand(rng)
    origins, directions = aim_at(rng, points, 8)
    assert judge(build_strand(points + far, radii, shape), origins + far, directions) > 1


HARD = {
    "loop": ([(0, 0, 0), (1, 0, 0), (0.5, 1, 0), (0.2, -0.5, 0.3), (1, 0.4, 0)], 0.1),
    "cusp": ([(0, 0, 0), (1, 1, 0), (0, 1e-3, 0), (1, 0, 0)], 0.05),
    "coincident": ([(0, 0, 0), (0, 0, 0), (0, 0, 1), (0, 0, 1), (0, 0.5, 1)], 0.1),
    "point": ([(0, 0, 0), (0, 0, 0), (0, 0, 0)], 0.5),
    "tip": ([(0, 0, 0), (0, 0.1, 1), (0, 0.3, 2)], (0.2, 0.1, 0.0)),
    "fold": ([(0, 0, 0), (0, 0, 1), (0, 1e-9, 0), (0, 0, 1)], 0.05),
    "thick bend": ([(-1, 0, 0), (0, 0, 0.2), (0, 0, -0.2), (1, 0, 0)], 0.6),
    "flare": ([(0, 0, 0), (0, 0, 1), (0, 0, 2)], (0.0, 0.8, 0.1)),
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", HARD)
def test_hits_of_hard_strands_are_the_exact_ones(shape: str, name: str) -> None:
    points, radii = HARD[name]
    rng, places = np.random.default_rng(7), np.array(points, dtype=np.float64)
    targets = (places[1:] + places[:-1]) / 2 + 0.03 * rng.normal(size=(len(places) - 1, 3))
    origins = targets + rng.normal(size=targets.shape)
    judge(build_strand(places, radii, shape), origins, targets - origins)


@pytest.mark.parametrize("shape", SHAPES)
def test_rays_along_and_next_to_a_straight_strand_are_decided(shape: str) -> None:
    """Along the axis a ribbon is seen edge-on, and a round strand from inside: neither is there."""
    caster = build_strand([(0, 0, 0), (0, 0, 1)], 0.25, shape)
    assert not caster.any_hit((0, 0, -3), (0, 0, 1))[0]
    offsets = np.array([(0.25, 0), (0.1, 0), (0.3, 0), (0.2, 0.1)])
    directions = np.array([(1e-3, 2e-3, 1.0), (-1e-2, 0.0, 1.0), (-0.05, 1e-9, 1.0), (1e-7, 0.0, 1.0)])
    for x, y in offsets:
        judge(caster, np.tile((x, y, -0.3), (4, 1)), directions)


@pytest.mark.parametrize("shape", SHAPES)
def test_rays_that_touch_are_lost_or_met_at_the_edge_only(shape: str) -> None:
    caster = build_strand([(0, 0, 0), (0, 0, 2)], 0.25, shape)
    edge = 0.25 * (1 + np.array([-1e-3, -1e-9, -1e-14, -1e-16, 0.0, 1e-15, 1e-9]))
    origins = np.stack([edge, np.full(7, -2.0), np.full(7, 1.2)], axis=1)
    for direction in ((0, 1, 0), (0, 1, 0.3)):
        judge(caster, origins, np.tile(np.array(direction, dtype=np.float64), (7, 1)))


@pytest.mark.parametrize("shape", SHAPES)
def test_no_ray_slips_through_the_joint_of_two_segments(shape: str) -> None:
    """Where the foot of the ray is the joint, it belongs to one segment or the other, and to none twice."""
    rng = np.random.default_rng(8)
    points = np.cumsum(np.abs(rng.normal(size=(6, 3))) + 0.2, axis=0)
    caster = build_strand(points, 0.05, shape)
    joint = rng.integers(1, 5, 2000)
    tangent = points[joint + 1] - points[joint - 1]
    across = np.cross(tangent, rng.normal(size=(2000, 3)))
    across /= np.linalg.norm(across, axis=1)[:, np.newaxis]
    origins = points[joint] + 3.0 * across
    hits = caster.closest_hit(origins, -across)
    assert hits.hit.all()
    radius = 0.0 if shape == "ribbon" else 0.05
    assert np.abs(hits.distance - (3.0 - radius)).max() < 1e-4
    if shape == "ribbon":
        assert not caster.closest_hit(origins, -across, after=hits).hit.any()


def test_a_ray_far_away_meets_what_a_near_one_does() -> None:
    rng = np.random.default_rng(9)
    points, radii = make_wild_strand(rng)
    caster = build_strand(points, radii, "thick")
    origins, directions = aim_at(rng, points, 6)
    back = directions / np.linalg.norm(directions, axis=1)[:, np.newaxis]
    assert judge(caster, origins - 2.0**20 * back, directions) > 0
