"""Strands and rays for tests, and the judge that compares what was cast with exact arithmetic."""

from __future__ import annotations

from typing import Any

import numpy as np

import raytracer
from tests.oracle.curve_oracle import Meeting, find_meetings

SHAPES = ("ribbon", "thick")
# How far from the points of a strand rays are aimed at, metres.
AROUND = 0.1
# Rays that pass a ribbon's edge, or the side of a round strand, by less than this share of the distance may be told
# either way: the bound of `ray_space`, doubled.
EDGE = 64 * 2.0**-53


def build_strand(points: Any, radii: Any, shape: str) -> raytracer.Caster:
    """Return the caster of one strand alone."""
    curves = raytracer.Curves(points, np.broadcast_to(radii, (len(points),)), [0, len(points)], shape=shape)
    return raytracer.build(raytracer.Scene(curves=curves))


def make_wild_strand(rng: np.random.Generator, count: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Return points and radii of a strand that turns at each point."""
    points = np.cumsum(rng.normal(size=(count, 3)) * rng.choice([1.0, 0.3]), axis=0)
    return points, rng.uniform(0.02, 0.5, count) * rng.choice([1.0, 0.1])


def aim_at(rng: np.random.Generator, points: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return rays from around a strand to places near it, with directions of any length."""
    targets = points[rng.integers(len(points), size=count)] + rng.normal(size=(count, 3)) * AROUND
    origins = points.mean(axis=0) + rng.normal(size=(count, 3)) * 4.0
    return origins, (targets - origins) * rng.uniform(0.2, 3.0, (count, 1))


def find_exact(
    caster: raytracer.Caster, origin: Any, direction: Any, edge: float = 0.0
) -> list[tuple[float, int, Meeting]]:
    """Return (t, segment, meeting) of all that a ray meets from t = 0 on, in order.

    edge : of radii that are larger by this share of the distance
    """
    strands = caster.geometry.strands
    assert strands is not None
    found = []
    for segment in range(len(strands)):
        keys = strands.keys[strands.rows[segment]]
        keys[:, 3] += edge * np.linalg.norm(keys[:, :3] - np.asarray(origin), axis=1).max()
        if is_far_away(np.asarray(origin), np.asarray(direction), keys):
            continue
        meetings = find_meetings(
            list(map(float, origin)), list(map(float, direction)), keys.tolist(), bool(strands.thick[segment])
        )
        found += [(meeting.t, segment, meeting) for meeting in meetings if meeting.t >= 0]
    return sorted(found, key=lambda one: one[:2])


def is_far_away(origin: np.ndarray, direction: np.ndarray, keys: np.ndarray) -> bool:
    """Return whether a ray passes a ball around a segment: exact arithmetic is slow."""
    centre = keys[1:3, :3].mean(axis=0)
    size = 2.0 * np.linalg.norm(keys[:, :3] - centre, axis=1).max() + 2.0 * keys[:, 3].max()
    way = centre - origin
    gap = np.linalg.norm(np.cross(way, direction)) / np.linalg.norm(direction)
    return bool(gap > size * 1.001 + 1e-9 * np.linalg.norm(way))


def judge(caster: raytracer.Caster, origins: np.ndarray, directions: np.ndarray) -> int:
    """Assert that each ray's first hit is the exact one, to its bound; return how many hit."""
    hits = caster.closest_hit(origins, directions)
    assert np.array_equal(caster.any_hit(origins, directions), hits.hit)
    for ray, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
        # Where a strand's first points coincide, its derivative is 0, and a root at u = 0 may be told either way.
        exact = [one for one in find_exact(caster, origin, direction) if one[2].u != 0]
        if hits.hit[ray] and hits.barycentric[ray, 0] == 0.0:
            continue
        if hits.hit[ray] != bool(exact):
            if hits.hit[ray]:
                assert find_exact(caster, origin, direction, EDGE), (ray, "hit what is not there", hits.distance[ray])
                continue
            assert is_at_edge(caster, exact[0], origin), (ray, "missed", exact[0])
            continue
        if exact:
            error = abs(exact[0][0] - hits.distance[ray])
            assert error <= hits.distance_error[ray], (ray, exact, hits.distance[ray], hits.distance_error[ray])
    return int(hits.hit.sum())


def is_at_edge(caster: raytracer.Caster, found: tuple[float, int, Meeting], origin: Any) -> bool:
    """Return whether a meeting is so close to the edge that rounding may lose it."""
    strands = caster.geometry.strands
    assert strands is not None
    keys = strands.keys[strands.rows[found[1]]]
    reach = np.linalg.norm(keys[:, :3] - np.asarray(origin), axis=1).max()
    return found[2].margin * np.abs(keys[:, 3]).max() <= 2 * EDGE * reach
