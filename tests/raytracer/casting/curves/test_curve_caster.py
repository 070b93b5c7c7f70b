"""Curves beside triangles and spheres: order, ranges, layers, parts of a scene, independence of how rays are cast."""

from __future__ import annotations

import numpy as np
import pytest

import raytracer
from raytracer.casting.curves.query import CurveQuery
from raytracer.casting.subset_caster import SubsetCaster
from tests.raytracer.casting.curves.strands_fixtures import SHAPES, build_strand

WALL = raytracer.Mesh([(-9, -9, 0), (9, -9, 0), (0, 9, 0)], [(0, 1, 2)])


def make_fur(shape: str, count: int = 60, seed: int = 1) -> raytracer.Curves:
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(count, 5, 3)) * 0.2
    steps[:, 0] *= 5.0
    return raytracer.Curves(
        np.cumsum(steps, axis=1).reshape(-1, 3), rng.uniform(0, 0.05, 5 * count), np.arange(count + 1) * 5, shape=shape
    )


def make_rays(count: int, seed: int = 2) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    origins = rng.normal(size=(count, 3)) * 3.0
    return origins, rng.normal(size=(count, 3)) - origins


@pytest.mark.parametrize("shape", SHAPES)
def test_the_tree_of_segments_loses_no_hit(shape: str) -> None:
    caster = raytracer.build(raytracer.Scene(curves=make_fur(shape)))
    origins, directions = make_rays(400)
    hits, strands = caster.closest_hit(origins, directions), caster.geometry.strands
    assert strands is not None
    rays = raytracer.Rays(origins, directions, np.zeros(400), np.full(400, np.inf))
    query = CurveQuery(caster.primitives, strands, rays, False, np.full(400, -np.inf), np.full(400, -1))
    ids = np.arange(len(strands))
    for ray in range(400):
        query.offer(np.full(len(ids), ray), ids)
    assert np.array_equal(np.where(hits.hit, hits.primitive, query.best_id.max()), query.best_id)
    assert np.array_equal(hits.distance, query.best)
    assert 20 < hits.hit.sum() < 400


@pytest.mark.parametrize("shape", SHAPES)
def test_a_ray_meets_the_same_alone_and_among_others(shape: str) -> None:
    caster = raytracer.build(raytracer.Scene(curves=make_fur(shape)))
    origins, directions = make_rays(200)
    hits = caster.closest_hit(origins, directions)
    for ray in np.flatnonzero(hits.hit)[:20]:
        alone = caster.closest_hit(origins[ray], directions[ray])
        for name in ("distance", "distance_error", "instance", "primitive", "barycentric"):
            assert np.array_equal(getattr(alone, name)[0], getattr(hits, name)[ray]), name


@pytest.mark.parametrize("shape", SHAPES)
def test_the_closer_of_curves_and_others_is_hit(shape: str) -> None:
    strand = raytracer.Curves([(-1, 0, 1), (1, 0, 1)], [0.1, 0.1], [0, 2], shape=shape)
    ball = raytracer.Spheres([(5.0, 0, 0)], [1.0])
    scene = raytracer.Scene(meshes=[WALL], spheres=[ball], curves=[strand])
    caster = raytracer.build(scene)
    down, up = (
        caster.closest_hit([(0, 0, 3), (5, 0, 3), (0.5, 3, 3)], (0, 0, -1)),
        caster.closest_hit((0, 0, -3), (0, 0, 1)),
    )
    assert down.instance.tolist() == [2, 1, 0]
    assert down.primitive.tolist() == [0, 0, 0]
    assert up.instance.tolist() == [0]
    assert down.distance[0] == (2.0 if shape == "ribbon" else 1.9)
    layers = list(caster.layers((0, 0, 3), (0, 0, -1)))
    assert [int(hits.instance[0]) for hits in layers] == [2, 0]
    layers = list(caster.layers((0, 0, -3), (0, 0, 1)))
    assert [int(hits.instance[0]) for hits in layers] == [0, 2]


def test_a_triangle_wins_where_a_ribbon_lies_in_it() -> None:
    strand = raytracer.Curves([(-1, 0, 0), (1, 0, 0)], [0.1, 0.1], [0, 2])
    caster = raytracer.build(raytracer.Scene(meshes=[WALL], curves=[strand]))
    first, second = list(caster.layers((0, 0, 2), (0, 0, -1)))
    assert (first.instance[0], second.instance[0]) == (0, 1)
    assert first.distance[0] == second.distance[0] == 2.0


@pytest.mark.parametrize("shape", SHAPES)
def test_ranges_include_their_ends(shape: str) -> None:
    caster = build_strand([(-1, 0, 0), (1, 0, 0)], 0.25, shape)
    distance = caster.closest_hit((0, 0, 2), (0, 0, -1)).distance[0]
    below, above = np.nextafter(distance, 0), np.nextafter(distance, 9)
    for t_min, t_max, hit in ((0, distance, True), (0, below, False), (distance, 9, True), (above, 9, False)):
        assert caster.any_hit((0, 0, 2), (0, 0, -1), t_min, t_max)[0] == hit, (t_min, t_max)
        assert caster.closest_hit((0, 0, 2), (0, 0, -1), t_min, t_max).hit[0] == hit
    twice = caster.closest_hit((0, 0, 2), (0, 0, -4))
    assert np.isclose(twice.distance[0], distance / 4, rtol=1e-15)


def test_a_ribbon_is_not_met_within_its_width_of_the_origin() -> None:
    caster = build_strand([(-1, 0, 0), (1, 0, 0)], 0.25, "ribbon")
    assert caster.any_hit([(0, 0, 0.51), (0, 0, 0.49)], (0, 0, -1)).tolist() == [True, False]


def test_only_the_outside_of_a_round_strand_is_met() -> None:
    caster = build_strand([(0, 0, 0), (0, 0, 1)], 0.25, "thick")
    assert not caster.any_hit((0.1, 0, 0.5), (1, 0.3, 0.1))[0]
    assert len(list(caster.layers((-3, 0.1, 0.5), (1, 0, 0)))) == 1


def test_a_round_straight_strand_is_a_cylinder() -> None:
    """|(o + t d) - axis|^2 = r^2 between the ends, which are open."""
    caster = build_strand([(0, 0, 0), (0, 0, 0.5), (0, 0, 1), (0, 0, 1.5)], 0.25, "thick")
    rng = np.random.default_rng(3)
    targets = np.stack([*rng.uniform(-0.3, 0.3, (2, 3000)), rng.uniform(-0.2, 1.7, 3000)], axis=1)
    origins = targets + 3.0 * rng.normal(size=(3000, 3))
    origins = origins[np.hypot(*origins.T[:2]) > 0.26]
    directions = targets[: len(origins)] - origins
    (ox, oy, oz), (dx, dy, dz) = origins.T, directions.T
    a, b, c = dx**2 + dy**2, ox * dx + oy * dy, ox**2 + oy**2 - 0.25**2
    with np.errstate(invalid="ignore"):
        t = (-b - np.sqrt(b * b - a * c)) / a
    z = oz + t * dz
    expected = (t > 0) & (z >= 0) & (z <= 1.5)
    hits = caster.closest_hit(origins, directions)
    assert np.array_equal(hits.hit, expected)
    assert 500 < expected.sum() < len(origins)
    assert np.abs(hits.distance - t)[expected].max() < 1e-10


def test_a_part_of_a_scene_knows_its_curves() -> None:
    groups = [make_fur("ribbon", seed=1), make_fur("thick", seed=2)]
    whole = raytracer.build(raytracer.Scene(meshes=[WALL], curves=groups))
    part = SubsetCaster(whole, np.array([False, False, True]))
    origins, directions = make_rays(300)
    alone = raytracer.build(raytracer.Scene(curves=groups[1])).closest_hit(origins, directions)
    hits = part.closest_hit(origins, directions)
    assert np.array_equal(hits.distance, alone.distance)
    assert set(hits.instance[hits.hit].tolist()) == {2}


def test_invalid_rays_miss_curves() -> None:
    caster = build_strand([(-1, 0, 0), (1, 0, 0)], 0.25, "ribbon")
    origins = [(0, 0, np.nan), (0, 0, 2), (0, 0, 2), (0, 0, 1e300), (0, 0, 2)]
    directions = [(0, 0, -1), (0, 0, 0), (np.inf, 0, 0), (0, 0, -1), (0, 0, -1e-200)]
    hits = caster.closest_hit(origins, directions)
    assert hits.valid.tolist() == [False, False, False, True, True]
    assert hits.hit.tolist() == [False, False, False, True, True]
    assert np.isclose(hits.distance[4], 2e200, rtol=1e-14)


def test_no_curves_at_all_are_no_curves() -> None:
    empty = raytracer.Curves(np.zeros((0, 3)), [], [0])
    points = raytracer.Curves([(0, 0, 0), (1, 0, 0)], [1.0, 1.0], [0, 1, 2])
    caster = raytracer.build(raytracer.Scene(meshes=[WALL], curves=[empty, points]))
    assert caster.closest_hit((0, 0, 2), (0, 0, -1)).instance.tolist() == [0]
