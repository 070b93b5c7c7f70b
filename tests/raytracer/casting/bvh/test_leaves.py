"""The float32 test of leaves never contradicts exact arithmetic: what it rules out is missed, what is sure is hit."""

from fractions import Fraction

import numpy as np
import pytest

from raytracer.casting.bvh import culling, leaves, traverse
from raytracer.casting.bvh.tree import NO_ITEM, Tree, make_frame

PAIRS = 1500


def make_triangles(rng, size):
    """(n, 3, 3) corners in [-1, 1]^3: edges of a given size, one in three a sliver, one in seven flat in an axis."""
    a = rng.uniform(-1, 1, (PAIRS, 3))
    e, f = size * rng.uniform(-1, 1, (2, PAIRS, 3))
    f[::3] = 0.7 * e[::3] + 1e-4 * size * rng.uniform(-1, 1, f[::3].shape)
    e[::7, 2] = f[::7, 2] = 0
    return np.clip(np.stack([a, a + e, a + f], axis=1), -1, 1)


def aim_at(rng, triangles, distance, size):
    """Rays from about `distance` at points on edges, at vertices and inside, most of them shifted a little."""
    weights = rng.dirichlet((0.7, 0.7, 0.7), PAIRS)
    weights[::2, 0] = 0
    weights[::6, 1] = 0
    targets = np.einsum("nc,nck->nk", weights / weights.sum(axis=1, keepdims=True), triangles)
    targets += (
        rng.normal(size=(PAIRS, 3)) * size * 10.0 ** rng.uniform(-9, -2, (PAIRS, 1)) * (rng.random((PAIRS, 1)) < 0.8)
    )
    origins = targets + rng.normal(size=(PAIRS, 3)) * distance
    directions = targets - origins
    directions[::5] *= 10.0 ** rng.integers(-20, 20, (len(directions[::5]), 1))
    return origins, directions


def hit_exactly(origin, direction, corners):
    """The exact distance at which the closed triangle meets the ray's line, or None."""
    o, d = ([Fraction(x) for x in vector] for vector in (origin, direction))
    p, q, r = ([Fraction(x) - y for x, y in zip(corner, o, strict=True)] for corner in corners)
    edges = [volume(d, *pair) for pair in ((q, r), (r, p), (p, q))]
    if sum(edges) == 0 or (min(edges) < 0 < max(edges)):
        return None
    return volume(p, q, r) / sum(edges)


def volume(p, q, r):
    """p . (q x r)."""
    return sum(p[i] * (q[i - 2] * r[i - 1] - q[i - 1] * r[i - 2]) for i in range(3))


def run_test(triangles, rays, frame):
    """Return `leaves.test_leaves` of pairs, the triangle in one slot, (n,) each."""
    slots = np.full((PAIRS, 4), NO_ITEM, np.int32)
    slots[np.arange(PAIRS), np.arange(PAIRS) % 4] = np.arange(PAIRS)
    tree = Tree(frame, np.zeros((0, 8, 4), np.float32), slots)
    table = leaves.pack_leaves(tree, triangles.reshape(-1, 9)).reshape(-1, 4)
    lines = np.repeat(rays.rows[list(traverse.LINE_COLUMNS), :, None], 4, axis=2)
    with np.errstate(all="ignore"):
        hits = leaves.test_leaves(table, np.arange(PAIRS), lines)
    assert not hits.possible[slots == NO_ITEM].any()
    assert not hits.sure[slots == NO_ITEM].any()
    return (column[slots != NO_ITEM] for column in hits)


@pytest.mark.parametrize("distance", [0.3, 4.0, 1e5])
@pytest.mark.parametrize("size", [1.0, 1e-2, 1e-4, 1e-9])
@pytest.mark.parametrize(("centre", "scale"), [((0.0, 0.0, 0.0), 1.0), ((4e3, -1.0, 7.0), 0.3)])
def test_leaves_never_contradict_exact_arithmetic(rng, distance, size, centre, scale):
    triangles = make_triangles(rng, size)
    origins, directions = aim_at(rng, triangles, distance, size)
    triangles, origins, directions = triangles * scale + centre, origins * scale + centre, directions * scale
    frame = make_frame(np.subtract(centre, scale), np.add(centre, scale))
    rays = culling.prepare_rays(frame, origins, directions)
    possible, sure, low, high = run_test(triangles, rays, frame)
    exact = [hit_exactly(*pair) for pair in zip(origins.tolist(), directions.tolist(), triangles.tolist(), strict=True)]
    hit = np.array([t is not None for t in exact])
    assert possible[hit].all()
    assert hit[sure].all()
    for k in np.flatnonzero(hit & np.isfinite(low) & np.isfinite(high)):
        t_row = (exact[k] - Fraction(rays.start[k])) * Fraction(2) ** int(rays.exponent[k])
        assert Fraction(float(low[k])) <= t_row
        assert Fraction(float(high[k])) >= t_row


def test_leaves_decide_all_but_rays_next_to_edges(rng):
    """Triangles of a thousandth of the scene, as a mesh of a million has, and rays at points around them."""
    triangles = make_triangles(rng, 1e-3)[np.arange(PAIRS) % 3 > 0]
    triangles = np.repeat(triangles, 2, axis=0)[:PAIRS]
    origins = rng.normal(size=(PAIRS, 3))
    directions = triangles.mean(axis=1) + 3e-4 * rng.normal(size=(PAIRS, 3)) - origins
    frame = make_frame(-np.ones(3), np.ones(3))
    possible, sure, *_ = run_test(triangles, culling.prepare_rays(frame, origins, directions), frame)
    assert sure.sum() > 50
    assert (sure | ~possible).mean() > 0.8


def test_leaves_leave_what_is_no_triangle_alone():
    slots = np.array([[0, 1, NO_ITEM, NO_ITEM]], np.int32)
    frame = make_frame(-np.ones(3), np.ones(3))
    corners = np.array([[0.1, 0.1, 0.5, 0.2, 0.1, 0.5, 0.1, 0.2, 0.5]])
    tree = Tree(frame, np.zeros((0, 8, 4), np.float32), slots)
    table = leaves.pack_leaves(tree, corners).reshape(-1, 4)
    rows = culling.prepare_rays(frame, np.array([[-0.5, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]])).rows
    lines = np.repeat(rows[list(traverse.LINE_COLUMNS), :, None], 4, axis=2)
    with np.errstate(all="ignore"):
        hits = leaves.test_leaves(table, np.zeros(1, np.intp), lines)
    assert hits.possible.tolist() == [[False, True, False, False]]
    assert not hits.sure.any()
    assert not hits.low[0, 1] > -np.inf
