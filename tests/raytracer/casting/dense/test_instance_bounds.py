"""Rays in the frames of instances never contradict exact arithmetic on the world's triangles, rounded as they are.

Tried: the bound on moves a hundredth of what it is, what moves cost edge functions (PLACED_SHARE) and planes (6 w, and
the eighth column) a hundredth, the share of the query's bound (QUERY_SHARE) a hundredth; each turned red. Of the bound
on moves, its parts by the inverse, by corners and by the way cover for each other: a hundredth of one alone is not
noticed. Slack of PLACED_SHARE: 7.
"""

from fractions import Fraction

import numpy as np
import pytest

import raytracer
from raytracer.casting.bvh import hierarchy
from raytracer.casting.bvh.tree import Frame, make_frame
from raytracer.casting.dense.instances import build_instances, place_rays
from raytracer.casting.dense.lines import SMALLEST_MOVED_ROWS, DenseRays, empty_rays, fill_rows
from raytracer.casting.dense.packets import cross_triangles, enter_boxes
from raytracer.casting.dense.tree import pack_edges
from raytracer.casting.framed import frame_rays
from raytracer.casting.geometry import world_corners
from raytracer.casting.planes import make_lines, make_moved_planes, meet_moved_planes
from raytracer.predicates.filtered import intersect_plane_certified

COUNT, MOVED_COUNT = 600, 4000
# Sizes of triangles of a mesh of size one.
SIZES = (1.0, 1e-3, 1e-6)


def make_scene(rng, stretch, away):
    """COUNT instances of a mesh of a few triangles of each size, turned, stretched, and moved away."""
    a = rng.uniform(-1, 1, (9, 1, 3))
    size = np.repeat(SIZES, 3)[:, np.newaxis, np.newaxis]
    corners = np.concatenate([a, a + size * rng.uniform(-1, 1, (9, 2, 3))], axis=1)
    corners = np.concatenate([corners, [[(-2, 0, 0), (2, 0.1, 0), (0, 0, 2)]] * 3])
    mesh = raytracer.Mesh(corners.reshape(-1, 3), np.arange(len(corners) * 3).reshape(-1, 3))
    matrices = np.tile(np.eye(4), (COUNT, 1, 1))
    turns = np.linalg.qr(rng.normal(size=(2, COUNT, 3, 3)))[0]
    matrices[:, :3, :3] = turns[0] @ np.diag([1.0, stretch, -1.0]) @ turns[1]
    matrices[:, :3, 3] = rng.normal(size=(COUNT, 3)) * away
    scene = raytracer.Scene(meshes=[mesh], instances=raytracer.Instances(np.zeros(COUNT, int), matrices))
    return raytracer.build(scene)


def aim(rng, corners, distance):
    """Rays at vertices, at edges, and inside, a third each, shifted by a few roundings."""
    weights = rng.random((COUNT, 3))
    weights[np.arange(COUNT), rng.integers(3, size=COUNT)] *= rng.integers(2, size=COUNT)
    weights[::3] = np.eye(3)[rng.integers(3, size=len(weights[::3]))]
    targets = np.einsum("nc,cnk->nk", weights / weights.sum(axis=1, keepdims=True), corners)
    origins = targets + rng.normal(size=targets.shape) * distance
    targets *= 1 + 2e-16 * rng.integers(-3, 4, targets.shape)
    return origins, targets - origins


def exactly(vectors):
    return [[Fraction(float(x)) for x in vector] for vector in vectors]


def volume(p, q, r):
    """p . (q x r)."""
    return sum(p[i] * (q[i - 2] * r[i - 1] - q[i - 1] * r[i - 2]) for i in range(3))


def bring_exactly(matrix, scale, point):
    """A world point in the unit of an instance's mesh: by Cramer's rule."""
    columns = exactly(matrix[:3, :3].T)
    away = [x - y for x, y in zip(point, exactly([matrix[:3, 3]])[0], strict=True)]
    whole = volume(*columns)
    local = [volume(*(away if k == axis else column for k, column in enumerate(columns))) for axis in range(3)]
    return [x / whole * scale for x in local]


@pytest.mark.parametrize("distance", [0.3, 30.0, 1e5])
@pytest.mark.parametrize(("stretch", "away"), [(1.0, 3.0), (1.0, 1e6), (-0.2, 1e3), (1e-5, 0.0), (3e-3, 1e4)])
@np.errstate(all="ignore")
def test_lines_and_corners_are_moved_by_no_more_than_is_said(rng, monkeypatch, stretch, away, distance):
    monkeypatch.setattr(hierarchy, "FLATTEN_LIMIT", 0)
    caster = make_scene(rng, stretch, away)
    geometry, every = caster.geometry, np.arange(COUNT)
    triangle = every % 9
    corners = np.stack(world_corners(geometry, every, triangle))
    origins, directions = aim(rng, corners, distance)
    frame = make_frame(*caster.primitives.bounds)
    framed = frame_rays(frame, origins, directions)
    built = build_instances(caster.primitives, frame)
    _, lanes = place_rays(built, make_lines(framed.place, framed.direction, 0.0), every, every)
    used = geometry.positions[geometry.triangles.ravel()]
    scale = Fraction(2) ** make_frame(used.min(axis=0), used.max(axis=0)).exponent
    for k in every[::4]:
        if not np.isfinite(lanes.lines[k, 6]):
            continue
        matrix, low = geometry.world_from_object[k], geometry.triangles[triangle[k]]
        shift = Fraction(0)
        for corner, vertex in zip(exactly(corners[:, k]), exactly(geometry.positions[low]), strict=True):
            true = bring_exactly(matrix, scale, corner)
            shift = max([shift, *(abs(x - v * scale) for x, v in zip(true, vertex, strict=True))])
        # About where the triangle is: t = 1.
        o, d = exactly([origins[k], directions[k]])
        true = bring_exactly(matrix, scale, [x + y for x, y in zip(o, d, strict=True)])
        t = Fraction(float(framed.unit[k])) * Fraction(float(lanes.unit[k]))
        o, d = exactly([lanes.lines[k, :3], lanes.lines[k, 3:6]])
        shift += max(abs(x - (y + t * z)) for x, y, z in zip(true, o, d, strict=True))
        assert 6 * shift <= lanes.lines[k, 6]


@pytest.mark.parametrize("moved", [1e-9, 7e-7])
@pytest.mark.parametrize("size", [1.0, 1e-2, 1e-3])
@np.errstate(all="ignore")
def test_moved_corners_stay_within_the_bounds_of_planes_and_edges(rng, size, moved):
    """Corners moved by all that they may be, each to a corner of the cube around it."""
    corners = rng.uniform(-0.9, 0.9, (MOVED_COUNT, 1, 3)) + size * rng.uniform(-0.05, 0.05, (MOVED_COUNT, 3, 3))
    shifted = corners + moved * (1 - 1e-6) * rng.choice([-1, 1], corners.shape)
    weights = rng.dirichlet((0.3, 0.3, 0.3), MOVED_COUNT)
    # Along an edge, to which side of it the corners' moves decide; and where the plane is met far from the triangle.
    weights[::2, 0] = 0
    weights /= weights.sum(axis=1, keepdims=True)
    weights[1::6] = (1 - weights[1::6]) * 10 - [6, 6, 7]
    targets = np.einsum("nc,nck->nk", weights, corners)
    origins = rng.uniform(-1, 1, targets.shape)
    framed = frame_rays(Frame(np.zeros(3), 0), origins, targets - origins)
    placed = corners.transpose(1, 2, 0)
    planes, lines = make_moved_planes(placed, 0), make_lines(framed.place, framed.direction, 0.0, moved)
    t, bound = meet_moved_planes(planes.T, lines.T)
    rays = empty_rays(MOVED_COUNT)
    fill_rows(DenseRays(rays.slabs[:-1], rays.lines[:-1], rays.way), framed, np.full(MOVED_COUNT, moved))
    rows = pack_edges(placed[..., np.newaxis], SMALLEST_MOVED_ROWS)
    products = np.matmul(rows, rays.lines[:-1, np.newaxis, :6].transpose(0, 2, 1))[..., 0]
    for k in range(MOVED_COUNT):
        exact, distance = meet_exactly(framed.origin[:, k], framed.direction[:, k], shifted[k])
        assert not np.isfinite(bound[k]) or abs(distance - Fraction(float(t[k]))) <= Fraction(float(bound[k]))
        for computed, value in zip(products[k], exact, strict=True):
            assert not (computed > 1 and value <= 0)
            assert not (computed < -1 and value >= 0)
    assert np.isfinite(bound).mean() > 0.3 or moved > 1e-3 * size


def meet_exactly(origin, direction, corners):
    """E_a, E_b, E_c of a triangle and t of its plane, None where they are parallel."""
    o, d, *abc = exactly([origin, direction, *corners])
    p, q, r = ([x - y for x, y in zip(corner, o, strict=True)] for corner in abc)
    edges = [volume(d, q, r), volume(d, r, p), volume(d, p, q)]
    return edges, volume(p, q, r) / sum(edges) if sum(edges) else None


@pytest.mark.parametrize("distance", [0.3, 30.0, 1e5])
@pytest.mark.parametrize(("stretch", "away"), [(1.0, 3.0), (1.0, 1e6), (-0.2, 1e3), (1e-7, 0.0), (3e-3, 1e4)])
@pytest.mark.parametrize("which", range(len(SIZES)))
@np.errstate(all="ignore")
def test_signs_and_distances_in_the_frame_of_an_instance_are_right(rng, monkeypatch, which, stretch, away, distance):
    monkeypatch.setattr(hierarchy, "FLATTEN_LIMIT", 0)
    caster = make_scene(rng, stretch, away)
    primitives, every = caster.primitives, np.arange(COUNT)
    assert not primitives.flattened.any()
    triangle = 3 * which + every % 3
    corners = np.stack(world_corners(primitives.geometry, every, triangle))  # (3 corners, n, 3)
    origins, directions = aim(rng, corners, distance)
    frame = make_frame(*primitives.bounds)
    built = build_instances(primitives, frame)
    framed = frame_rays(frame, origins, directions)
    rays, lanes = place_rays(built, make_lines(framed.place, framed.direction, 0.0), every, every)
    (tree,) = built.trees
    # All are in one block.
    rows = tree.edges.reshape(3, -1, 6).transpose(1, 0, 2)[np.argsort(tree.items[0])[triangle]]  # (n, 3, 6)
    lines = rays.lines[:-1, np.newaxis]
    products = np.matmul(rows, lines[:, :, :6].transpose(0, 2, 1))[..., 0].astype(np.float64)
    index, inside = cross_triangles(rows, lines)
    possible, sure = np.zeros(COUNT, bool), np.zeros(COUNT, bool)
    possible[index], sure[index] = True, inside
    t, bound = meet_moved_planes(tree.planes[triangle].T, lanes.lines.T)
    entered = np.zeros(COUNT, bool)
    entered[enter_boxes(np.repeat(tree.levels[0], COUNT, axis=0), rays.slabs[:-1, np.newaxis])[0]] = True
    mirrored = np.sign(np.linalg.det(primitives.geometry.world_from_object[:, :3, :3]))
    known = 0
    for k in every:
        exact, distance_exact = meet_exactly(origins[k], directions[k], corners[:, k])
        hit = sum(exact) != 0 and not min(exact) < 0 < max(exact)
        assert possible[k] or not hit
        assert hit or not sure[k]
        assert entered[k] or not hit or distance_exact < 0
        for computed, value in zip(products[k], exact, strict=True):
            assert not (abs(computed) > 1 and computed * float(np.sign(float(value))) * mirrored[k] <= 0)
        if hit and np.isfinite(bound[k]):
            known += 1
            in_frame = distance_exact * Fraction(float(framed.unit[k])) * Fraction(float(lanes.unit[k]))
            assert abs(in_frame - Fraction(float(t[k]))) <= Fraction(float(bound[k]))
    # Of tiny triangles of a mesh that is pressed flat nothing may be known.
    assert known > 20 or (which > 0 and abs(stretch) < 0.1) or stretch == 1e-7


def make_needles(rng, thin):
    """COUNT instances of a mesh of triangles that are pressed into needles along about the diagonals of space."""
    corners = rng.uniform(-1, 1, (27, 3))
    mesh = raytracer.Mesh(corners, np.arange(27).reshape(-1, 3))
    matrices = np.tile(np.eye(4), (COUNT, 1, 1))
    turns = rng.normal(size=(2, COUNT, 3, 3))
    turns[:, : COUNT // 2, :, 0] = rng.choice([-1, 1], (2, COUNT // 2, 3))
    turns = np.linalg.qr(turns)[0]
    matrices[:, :3, :3] = turns[0] @ np.diag([1.0, thin, thin]) @ turns[1].transpose(0, 2, 1)
    return raytracer.build(
        raytracer.Scene(meshes=[mesh], instances=raytracer.Instances(np.zeros(COUNT, int), matrices))
    )


@np.errstate(all="ignore")
def test_the_share_covers_the_interval_of_the_query(rng, monkeypatch):
    """Of triangles that are needles in the world, with rays along them, to which the query's bound is far wider."""
    monkeypatch.setattr(hierarchy, "FLATTEN_LIMIT", 0)
    shares = []
    for thin in (1.0, 0.1, 1e-3, 1e-4, 1e-5):
        caster, every = make_needles(rng, thin), np.arange(COUNT)
        matrices = caster.geometry.world_from_object[:, :3, :3]
        a, b, c = (corner.T for corner in world_corners(caster.geometry, every, every % 9))
        weights = rng.dirichlet((1, 1, 1), COUNT)
        directions = np.einsum("kij,kj->ki", matrices, rng.normal(size=(COUNT, 3)))
        origins = (weights[:, 0] * a + weights[:, 1] * b + weights[:, 2] * c).T - directions
        frame = make_frame(*caster.primitives.bounds)
        framed, built = frame_rays(frame, origins, directions), build_instances(caster.primitives, frame)
        _, lanes = place_rays(built, make_lines(framed.place, framed.direction, 0.0), every, every)
        t, bound = meet_moved_planes(built.trees[0].planes[every % 9].T, lanes.lines.T)
        query = intersect_plane_certified(directions.T, a - origins.T, b - a, c - a)
        unit = framed.unit * lanes.unit
        reach = np.abs(query.t * unit - t) + query.t_error * unit
        known = t - bound * lanes.share >= 0
        assert known.sum() > COUNT / 4
        assert (reach <= bound * lanes.share)[known].all()
        shares.append(((reach / bound - 1) / (lanes.share - 1))[known].max())
    assert max(shares) > 1 / 100, shares
