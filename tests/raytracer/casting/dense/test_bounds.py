"""The float32 tables never contradict exact arithmetic: what they rule out is missed, what they are sure of is hit.

Tried: each bound a hundredth of what it is, and origins believed with a hundred times the error (PAD, MOVED,
EDGE_ROUNDING, ORIGIN_SHARE, SMALLEST_ROWS, the step upwards of `to_bounds`); each turned red. Slack, measured the same
way: an eighth of PAD and of the step upwards is too little, a quarter is not; of the others an eighth is not.
"""

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from raytracer.casting.bvh.tree import make_frame
from raytracer.casting.dense.lines import prepare_rays, to_bounds
from raytracer.casting.dense.packets import cross_triangles, enter_boxes
from raytracer.casting.dense.tree import pack_boxes, pack_edges
from raytracer.casting.rays import make_rays

PAIRS = 1500
# Coordinates that are multiples of 1 / GRID stay exact for all distances here.
GRID = 2.0**12
# Frames are a little smaller than a power of two, so that coordinates in them come near one.
FRAME, INSIDE = 0.9999, 0.999


def prepare(frame, origins, directions):
    """`prepare_rays` without a query; also what it tells the decisions: the unit of t."""
    unit = np.empty(len(origins))
    decisions = SimpleNamespace(
        query=SimpleNamespace(rays=make_rays(origins, directions)),
        set_rays=lambda rows, framed: unit.__setitem__(rows, framed.unit),
    )
    with np.errstate(all="ignore"):
        return prepare_rays(frame, decisions), unit


def aim_at(rng, targets, distance, spread):
    """Rays from about `distance` to points, half of them shifted by up to `spread`."""
    targets = targets + rng.uniform(-spread, spread, targets.shape) * (rng.random((len(targets), 1)) < 0.5)
    origins = targets + rng.normal(size=targets.shape) * distance
    directions = targets - origins
    directions[::5] *= 10.0 ** rng.integers(-20, 20, (len(directions[::5]), 1))
    return origins, directions


def aim_exactly(rng, targets, distance):
    """Rays exactly through points of a grid, from about `distance`: few digits in all."""
    directions = rng.integers(-GRID / 4, GRID / 4, targets.shape) * 4.0 / GRID + 2.0 / GRID
    return targets - directions * np.exp2(np.round(np.log2(distance))), directions


def to_exact(*vectors):
    return [[Fraction(float(x)) for x in vector] for vector in vectors]


def cross_box_exactly(origin, direction, low, high):
    """The first t >= 0 at which a ray is in a closed box, or None."""
    o, d, low, high = to_exact(origin, direction, low, high)
    begin, end = Fraction(0), None
    for axis in range(3):
        if d[axis] == 0:
            if not low[axis] <= o[axis] <= high[axis]:
                return None
            continue
        near, far = sorted([(low[axis] - o[axis]) / d[axis], (high[axis] - o[axis]) / d[axis]])
        begin, end = max(begin, near), far if end is None else min(end, far)
    return begin if begin <= end else None


@pytest.mark.parametrize("distance", [0.5, 3.0, 1e3, 3e8, 3e10])
@pytest.mark.parametrize("size", [1.0, 1e-2, 1e-6, 0.0])
@pytest.mark.parametrize(("centre", "scale"), [((0.0, 0.0, 0.0), 1.0), ((4e3, -1.0, 7.0), 0.3)])
def test_no_box_is_missed(rng, distance, size, centre, scale):
    """Rays at corners, edges and faces of boxes, one in three along an axis or nearly so."""
    low = rng.uniform(-INSIDE, INSIDE, (PAIRS, 3))
    low[::4] = np.round(low[::4] * GRID) / GRID
    high = np.minimum(low + size * rng.random((PAIRS, 3)), INSIDE)
    high = np.maximum(low, high)
    share = rng.choice([0.0, 0.0, 1.0, 1.0, 0.3], (PAIRS, 3))
    origins, directions = aim_at(rng, low + share * (high - low), distance, 1e-7)
    directions[::3, 0] = rng.choice([0.0, -0.0, 1e-30, 1e-9], len(directions[::3])) * np.abs(directions[::3, 1])
    origins[::4], directions[::4] = aim_exactly(rng, low[::4], distance)
    low, high = low * scale + centre, high * scale + centre
    origins, directions = origins * scale + centre, directions * scale
    frame = make_frame(np.subtract(centre, scale * FRAME), np.add(centre, scale * FRAME))
    table = pack_boxes(frame.place(low), frame.place(high), 1)
    rays, unit = prepare(frame, origins, directions)
    with np.errstate(all="ignore"):
        index, entry = enter_boxes(table, rays.slabs[:-1, np.newaxis])
    entered = np.full(PAIRS, np.nan)
    entered[index] = entry
    met = 0
    for k in range(PAIRS):
        t = cross_box_exactly(origins[k], directions[k], low[k], high[k])
        if t is None:
            continue
        met += 1
        assert not np.isnan(entered[k]), f"ray {k} enters the box at {float(t)}"
        if np.isfinite(rays.way[k]):
            assert Fraction(float(entered[k])) <= t * Fraction(float(unit[k])) - Fraction(float(rays.way[k]))
    # What is rounded seldom meets a tiny box exactly.
    assert met > PAIRS / 20 or size < 1e-2


def edge_functions_exactly(origin, direction, corners):
    """E_a, E_b, E_c of the world's triangle and ray."""
    o, d, a, b, c = to_exact(origin, direction, *corners)
    p, q, r = ([x - y for x, y in zip(corner, o, strict=True)] for corner in (a, b, c))
    return [volume(d, *pair) for pair in ((q, r), (r, p), (p, q))]


def volume(p, q, r):
    """p . (q x r)."""
    return sum(p[i] * (q[i - 2] * r[i - 1] - q[i - 1] * r[i - 2]) for i in range(3))


def make_triangles(rng, size):
    """(n, 3 corners, 3) in the frame: one in three a sliver, one in seven flat in an axis, a few without area."""
    a = rng.uniform(-INSIDE, INSIDE, (PAIRS, 3))
    e, f = size * rng.uniform(-1, 1, (2, PAIRS, 3))
    f[::3] = 0.7 * e[::3] + 1e-4 * size * rng.uniform(-1, 1, f[::3].shape)
    e[::7, 2] = f[::7, 2] = 0
    f[::50] = e[::50]
    return np.clip(np.stack([a, a + e, a + f], axis=1), -INSIDE, INSIDE)


@pytest.mark.parametrize("distance", [0.3, 3.0, 1e3, 1e8, 2.0**40])
@pytest.mark.parametrize("size", [1.0, 1e-2, 1e-4, 1e-13])
@pytest.mark.parametrize(("centre", "scale"), [((0.0, 0.0, 0.0), 1.0), ((4e3, -1.0, 7.0), 0.3)])
def test_edge_functions_are_off_by_one_at_most(rng, distance, size, centre, scale):
    """Rays at points of edges, at vertices and inside: no sign that is taken for certain is wrong."""
    triangles = make_triangles(rng, size)
    weights = rng.dirichlet((0.7, 0.7, 0.7), PAIRS)
    weights[::2, 0] = 0
    weights[::6, 1] = 0
    targets = np.einsum("nc,nck->nk", weights / weights.sum(axis=1, keepdims=True), triangles)
    origins, directions = aim_at(rng, targets, distance, size * 1e-6)
    triangles[::4] = np.round(triangles[::4] * GRID) / GRID
    origins[::4], directions[::4] = aim_exactly(rng, triangles[::4, 1], distance)
    triangles, origins, directions = triangles * scale + centre, origins * scale + centre, directions * scale
    frame = make_frame(np.subtract(centre, scale * FRAME), np.add(centre, scale * FRAME))
    rays, _ = prepare(frame, origins, directions)
    placed = frame.place(triangles).transpose(1, 2, 0)[..., np.newaxis]  # (3 corners, 3, n, 1)
    rows, lines = pack_edges(placed), rays.lines[:-1, np.newaxis]
    products = np.matmul(rows, lines[:, :, :6].transpose(0, 2, 1))[..., 0].astype(np.float64)
    index, inside = cross_triangles(rows, lines)
    possible, sure = np.zeros(PAIRS, bool), np.zeros(PAIRS, bool)
    possible[index], sure[index] = True, inside
    passes = np.isnan(lines[:, 0, 0])
    for k in range(PAIRS):
        exact = edge_functions_exactly(origins[k], directions[k], triangles[k])
        hit = sum(exact) != 0 and not min(exact) < 0 < max(exact)
        assert possible[k] or not hit
        assert hit or not sure[k]
        for computed, value in zip(products[k], exact, strict=True):
            assert passes[k] or (not (computed > 1 and value <= 0) and not (computed < -1 and value >= 0))


def test_edge_functions_decide_all_but_rays_next_to_edges(rng):
    """Triangles of a thousandth of the scene, as a mesh of a million has."""
    triangles = make_triangles(rng, 1e-3)[np.arange(PAIRS) % 3 > 0]
    origins = rng.normal(size=(len(triangles), 3))
    targets = triangles.mean(axis=1) + 3e-4 * rng.normal(size=origins.shape)
    frame = make_frame(-FRAME * np.ones(3), FRAME * np.ones(3))
    rays, _ = prepare(frame, origins, targets - origins)
    rows = pack_edges(frame.place(triangles).transpose(1, 2, 0)[..., np.newaxis])
    _, inside = cross_triangles(rows, rays.lines[:-1, np.newaxis])
    assert inside.sum() > 50
    assert (~inside).sum() < 0.05 * len(triangles)


def test_distances_as_float32_are_upper_bounds(rng):
    t = rng.normal(size=4000) * 10.0 ** rng.integers(-40, 40, 4000)
    way = np.where(rng.random(4000) < 0.5, 0.0, np.abs(t) * rng.uniform(0, 2, 4000))
    with np.errstate(all="ignore"):
        bounds = to_bounds(t, way)
    for k in range(len(t)):
        assert not np.isfinite(bounds[k]) or Fraction(float(bounds[k])) >= Fraction(t[k]) - Fraction(way[k])
    np.testing.assert_array_equal(to_bounds(np.array([np.inf, 1.0]), np.array([1.0, -np.inf])), np.inf)
