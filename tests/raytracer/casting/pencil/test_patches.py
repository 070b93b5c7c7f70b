"""Edge functions and nearness in float32 are within their bounds, and the bounds are not idle.

Each test also asks how near errors come to their bound: a hundredth of the bound would fail it.
"""

import numpy as np
import pytest

from raytracer.casting.pencil import patches
from raytracer.casting.pencil.cluster_culling import project_vertices
from raytracer.casting.pencil.grids import PixelGrid
from raytracer.casting.pencil.patches import CONSTANT, EDGES, LEAST, MOST, NEAR_ERROR, SLOPE_X, SLOPE_Y, TOLERANCE
from raytracer.casting.pencil.strip_grid import STRIP, find_least

COUNT, SCREEN = 20000, 200.0
# Errors that come nearer than this to their bound show that it is not a hundred times too wide.
NOT_IDLE = 0.01


def evaluate_edges(corners, x, y):
    """E of image points (2, 3, n) at points (n,), float64, counterclockwise positive; (3, n)."""
    right, up = corners[0] - x, corners[1] - y
    return np.stack([right[p] * up[q] - up[p] * right[q] for p, q in ((1, 2), (2, 0), (0, 1))])


def make_small(rng, size, flatness, ray_error):
    """Triangles near integer bases, as float64 and as rows, and places of rays with their true points."""
    base = rng.integers(-SCREEN, SCREEN, (2, COUNT)).astype(np.float64)
    local = rng.uniform(0, size, (2, 3, COUNT))
    local[:, 2] = local[:, 0] + (local[:, 1] - local[:, 0]) * rng.random(COUNT) + rng.normal(size=(2, COUNT)) * flatness
    corners = base[:, np.newaxis] + local
    nearness = rng.uniform(0.5, 2.0, (3, COUNT))
    image = patches.Image(ray_error, patches.FLOAT32_ROUNDOFF, 0.0)
    rows = np.empty((patches.ROWS, COUNT), np.float32)
    reach = np.full(COUNT, np.float32(np.ceil(size)))
    points = np.concatenate([corners, nearness[np.newaxis]]).astype(np.float32)
    with np.errstate(all="ignore"):
        patches.set_up_small(points, base.astype(np.float32), reach, image, rows)
    place = rng.integers(0, int(np.ceil(size)) + 1, (2, COUNT)).astype(np.float32)
    true = base + place + rng.choice([-1, 1], (2, COUNT)) * ray_error
    return corners, nearness, rows, place, true


def evaluate_rows(rows, function, place):
    return rows[CONSTANT + function] + place[0] * rows[SLOPE_X + function] + place[1] * rows[SLOPE_Y + function]


@pytest.mark.parametrize("ray_error", [0.0, 1e-4])
@pytest.mark.parametrize("flatness", [1.0, 1e-3, 1e-7])
@pytest.mark.parametrize("size", [0.3, 2.0, 8.0])
def test_small_triangles_are_within_their_bounds(rng, size, flatness, ray_error):
    corners, nearness, rows, place, true = make_small(rng, size, flatness, ray_error)
    edges = evaluate_edges(corners, *true)
    area = edges.sum(axis=0)
    computed = np.stack([evaluate_rows(rows, edge, place) for edge in range(EDGES)]).astype(np.float64)
    sign = np.sign(area)
    known = np.abs(area) > 2 * rows[TOLERANCE]
    share = (np.abs(computed - edges * sign) / rows[TOLERANCE])[:, known]
    assert share.max(initial=0.0) <= 1
    assert share.max(initial=1.0) > NOT_IDLE
    # Whatever the sign: who is inside beyond doubt of the true triangle is kept.
    inside = (edges * sign).min(axis=0) >= 0
    assert (computed.min(axis=0) >= -rows[TOLERANCE])[inside].all()
    near = (edges * nearness).sum(axis=0) / area
    error = np.abs(evaluate_rows(rows, EDGES, place) - near)
    checked = inside & known
    assert (error <= rows[NEAR_ERROR])[checked].all()
    assert ((rows[LEAST] <= near) & (near <= rows[MOST]))[inside & (area != 0)].all()
    if checked.sum() > 1000:
        assert (error / rows[NEAR_ERROR])[checked].max() > NOT_IDLE


def test_triangles_of_unknown_orientation_are_kept_where_they_are_hit(rng):
    """Slivers so thin that float32 turns some around: rays at points of theirs."""
    turned = 0
    for flatness in (1e-6, 1e-5, 1e-4):
        corners, _, rows, place, true = make_small(rng, 2.0, flatness, 0.0)
        shift = true - (corners * rng.dirichlet(np.ones(3), COUNT).T).sum(axis=1)
        moved = corners + shift[:, np.newaxis]
        base = (true - place).astype(np.float32)
        points = np.concatenate([moved, np.ones((1, 3, COUNT))]).astype(np.float32)
        image = patches.Image(1e-14, patches.FLOAT32_ROUNDOFF, 0.0)
        with np.errstate(all="ignore"):
            patches.set_up_small(points, base, np.full(COUNT, np.float32(2)), image, rows)
        computed = np.stack([evaluate_rows(rows, edge, place) for edge in range(EDGES)])
        assert (computed.min(axis=0) >= -rows[TOLERANCE]).all()
        exact = evaluate_edges(moved, *true)
        turned += (np.sign(computed.sum(axis=0)) != np.sign(exact.sum(axis=0))).sum()
        turned += ((computed * np.sign(exact.sum(axis=0))).max(axis=0) < 0).sum()
    assert turned > 0


def make_large(rng):
    """Triangles of all sizes around a point, relative to it, and a camera's matrix, in cells."""
    relative = rng.normal(size=(3, 3, 2000)) * rng.uniform(0.05, 3.0, 2000)
    relative[2] += rng.choice([0.0, 1.0, 4.0], 2000)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    matrix = np.diag([150.0, 150.0, 1.0]) @ turn
    return matrix, np.einsum("ji,jck->ick", turn, relative)


@pytest.mark.parametrize("ray_error", [0.0, 1e-4])
def test_large_triangles_are_within_their_bounds_in_every_tile(rng, ray_error):
    matrix, relative = make_large(rng)
    large = patches.span_large(matrix, relative, SCREEN)
    item = np.repeat(np.arange(2000), 20)
    base = rng.integers(-25, 24, (2, len(item))) * 8.0
    rows = patches.set_up_tiles(large, item, base, 8.0, ray_error)
    place = rng.uniform(0, 8, (2, len(item))).astype(np.float32)
    point = base + place + rng.choice([-1, 1], (2, len(item))) * ray_error
    mapped = np.einsum("ij,jck->ick", matrix.astype(np.longdouble), relative.astype(np.longdouble))
    a, b, c = (mapped[:, corner] for corner in range(3))
    normals = np.stack([np.cross(p, q, axis=0) for p, q in ((b, c), (c, a), (a, b))])
    determinant = (a * normals[0]).sum(axis=0)
    extent = np.abs(normals[:, :2]).sum(axis=1) + np.abs(normals[:, 2]) / SCREEN
    edges = normals * (np.sign(determinant) / extent)[:, np.newaxis]
    functions = np.concatenate([edges, (normals.sum(axis=0) / determinant)[np.newaxis]])
    true = functions[:, 0, item] * point[0] + functions[:, 1, item] * point[1] + functions[:, 2, item]
    computed = np.stack([evaluate_rows(rows, function, place) for function in range(4)])
    share = np.abs(computed[:EDGES] - true[:EDGES]) / rows[TOLERANCE]
    assert NOT_IDLE < share.max() <= 1
    share = np.abs(computed[EDGES] - true[EDGES]) / rows[NEAR_ERROR]
    assert NOT_IDLE < share.max() <= 1
    inside = true[:EDGES].min(axis=0) >= 0
    assert inside.sum() > 1000
    slack = rows[NEAR_ERROR][inside]
    assert (rows[LEAST][inside] <= true[EDGES][inside] + slack).all()
    assert (rows[MOST][inside] >= true[EDGES][inside] - slack).all()
    reaches, most = patches.may_reach(rows, 0.0, 8.0)
    assert reaches[inside].all()
    assert (most[inside] >= true[EDGES][inside]).all()
    assert 0.1 < reaches.mean() < 0.9


def test_functions_with_tolerance_are_within_their_bounds_on_runs(rng):
    """What strips are tested with: (c + tolerance) + x c_x + y c_y, at rays anywhere in their reach."""
    corner = rng.integers(-200, 190, (2, COUNT)).astype(np.float32)
    corners = corner[:, np.newaxis] + rng.uniform(0, 3, (2, 3, COUNT))
    base = corner + np.float32(1.5)
    reach = np.full(COUNT, np.float32(1.5 + STRIP))
    image = patches.Image(0.0, patches.FLOAT32_ROUNDOFF, 0.0)
    rows = np.empty((patches.ROWS, COUNT), np.float32)
    points = np.concatenate([corners, np.ones((1, 3, COUNT))]).astype(np.float32)
    patches.set_up_small(points, base, reach, image, rows)
    place = (rng.uniform(-1, 1, (2, COUNT)) * reach).astype(np.float32)
    true = evaluate_edges(corners, *(base.astype(float) + place))
    true *= np.sign(true.sum(axis=0))
    tolerance = rows[TOLERANCE]
    known = np.flatnonzero(np.abs(true.sum(axis=0)) > 2 * tolerance)
    computed = find_least(rows, np.arange(COUNT), *place[:, np.newaxis])[0]
    share = (np.abs(computed - tolerance - true.min(axis=0)) / tolerance)[known]
    assert NOT_IDLE < share.max() <= 1


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_image_points_of_vertices_are_within_their_bound(rng, scale):
    """Float32 image points of vertices before the plane of the point, against long double."""
    matrix = np.diag([300.0, 300.0, 1.0]) @ np.linalg.qr(rng.normal(size=(3, 3)))[0] / scale
    vertices = rng.normal(size=(3, 20000)) * scale + 5 * scale
    centre = rng.normal(size=3) * scale
    grid = PixelGrid(centre, matrix, np.ones(100), 10, 0, 0.0)
    with np.errstate(all="ignore"):
        points = project_vertices(grid, vertices)
    mapped = matrix.astype(np.longdouble) @ (vertices.astype(np.longdouble) - centre[:, np.newaxis])
    seen = np.flatnonzero(~np.isnan(points[0]))
    assert len(seen) > 1000
    assert (mapped[2, seen] > 0).all()
    true = mapped[:2, seen] / mapped[2, seen]
    image = patches.judge_image(matrix, 0.0)
    share = np.abs(points[:2, seen] - true) / (image.corner_share * np.abs(true) + image.corner_error)
    assert NOT_IDLE < share.max() <= 1


def test_rounding_alone_is_within_its_share_and_so_is_level_nearness(rng):
    """Corners that are float32 numbers near the base, and triangles all of whose corners are equally near."""
    corners = rng.uniform(-8, 8, (2, 3, COUNT)).astype(np.float32)
    nearness = rng.uniform(0.5, 2.0, COUNT)
    points = np.concatenate([corners, np.tile(nearness, (1, 3, 1))]).astype(np.float32)
    rows = np.empty((patches.ROWS, COUNT), np.float32)
    image = patches.Image(0.0, 0.0, 0.0)
    patches.set_up_small(points, np.zeros((2, COUNT), np.float32), np.full(COUNT, np.float32(8)), image, rows)
    place = rng.uniform(-8, 8, (2, COUNT)).astype(np.float32)
    edges = evaluate_edges(corners.astype(np.float64), *place.astype(np.float64))
    edges *= np.sign(edges.sum(axis=0))
    share = np.abs([evaluate_rows(rows, edge, place) for edge in range(EDGES)] - edges) / rows[TOLERANCE]
    assert NOT_IDLE < share.max() <= 1
    share = np.abs(evaluate_rows(rows, EDGES, place) - nearness) / rows[NEAR_ERROR]
    assert NOT_IDLE < share.max() <= 1
