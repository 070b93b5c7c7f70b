"""Certified hits where bounds meet their limits: near zeros, underflow and overflow, tangents, far origins, ties.

Each test is what one margin, constant or comparison of the ray tracer is there for, as the mutations in
`test_certified_scenes.py` show.
"""

from fractions import Fraction

import numpy as np
import pytest

import raytracer
from raytracer.casting.bvh import hierarchy, tree
from raytracer.casting.geometry import pack_geometry
from raytracer.casting.measure import TURNS, gather_lines, lie_out_of_range
from raytracer.casting.primitives import instance_bounds
from raytracer.casting.query import Query
from raytracer.casting.rays import make_rays
from raytracer.predicates import filtered, refine
from tests import meshes
from tests.oracle import exact_oracle
from tests.oracle.judging import ACCELERATORS, build_with, judge, mesh_scene, sphere_scene


def exact_cross(p, q):
    return [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]


def as_fractions(vector):
    return [Fraction(float(x)) for x in vector]


def unimodular_matrix(generator, steps):
    """Integer rows (3, 3) of determinant 1 with entries that grow with the number of shears."""
    matrix = np.eye(3, dtype=object)
    for _ in range(steps):
        one, other = generator.permutation(3)[:2]
        matrix[one] += matrix[other] * int(generator.integers(1, 8))
    return matrix


@pytest.mark.parametrize("determinant", [1, 0])
def test_zero_is_told_from_the_smallest_edge_function_there_can_be(rng, determinant):
    """d . (P x Q) of integers is 0 or at least 1: rows of large numbers with either determinant."""
    certain_zeros = doubts = 0
    for steps in range(1, 60):
        rows = unimodular_matrix(rng, steps)
        if not determinant:
            rows[0] = rows[1] + rows[2]
        if max(abs(rows).ravel()) >= 1 << 52:
            continue
        direction, p, q = rows.astype(np.float64)[:, :, np.newaxis]
        sign, certain = refine.edge_sign(np.zeros((3, 1)), direction, p, q)
        assert sign[0] == determinant * certain[0]
        certain_zeros += certain[0] and not determinant
        doubts += not certain[0]
    assert certain_zeros or determinant
    assert doubts  # numbers grow until pairs of floats do not suffice


@pytest.mark.parametrize("accelerator", ACCELERATORS)
@pytest.mark.parametrize("determinant", [-1, 0, 1])
def test_edges_that_pairs_of_floats_leave_in_doubt_are_decided_in_integers(accelerator, determinant):
    """Rays that pass an edge p q with d . (P x Q) = -1, 0 or 1 in integers of up to 50 bits."""
    generator, hit = np.random.default_rng(11), 0
    for steps in range(20, 70):
        near, p, q = unimodular_matrix(generator, steps)
        direction = (p + q + determinant * near).astype(np.float64)
        if np.abs(direction).max() > 2.0**50:
            continue
        p, q = p.astype(np.float64), q.astype(np.float64)
        across = np.cross(p, q)
        third = (p + q) / 2 + across / np.linalg.norm(across) * np.linalg.norm(p)
        caster = build_with(accelerator, mesh_scene((np.stack([p, q, third]), [(0, 1, 2)])))
        hit += judge(caster, np.zeros(3), direction).hit[0]
    assert (hit > 0) == (determinant >= 0)


@pytest.mark.parametrize("accelerator", ACCELERATORS)
@pytest.mark.parametrize(
    ("scale", "length"),
    [(1e-300, 1e20), (1e-200, 1e120), (1e-20, 1e300), (1e-310, 1.0), (1e200, 1e-200), (1e150, 1e150), (1e300, 1.0)],
)
def test_distances_that_underflow_or_overflow_keep_their_bounds(accelerator, scale, length):
    generator = np.random.default_rng(12)
    positions, triangles = meshes.make_icosphere(1)
    spheres = raytracer.Spheres(np.array([(3.0, 0.0, 0.0)]) * scale, [0.5 * scale])
    caster = build_with(accelerator, mesh_scene((positions * scale, triangles), spheres=[spheres]))
    origins, directions = meshes.random_rays(generator, 60, size=0.5)
    directions[::3] = positions[:20] - origins[::3]
    directions[1::6] = (3.0, 0.0, 0.1) - origins[1::6]
    judge(caster, origins * scale, directions * length)
    judge(caster, origins * scale, directions * length, t_max=-np.inf)


@pytest.mark.parametrize("accelerator", ACCELERATORS)
def test_distance_below_the_least_float_has_a_bound(accelerator):
    """t = 2^-1000 / 2^199 is 0 as a float64, and no bound of 0 is right."""
    positions, triangles = meshes.make_quad(2.0**199)
    caster = build_with(accelerator, mesh_scene((np.add(positions, (0.0, 0.0, 2.0**-1000)), triangles)))
    hits = judge(caster, (2.0**190, 2.0**180, 0.0), (0.0, 0.0, 2.0**199))
    assert hits.hit.all()
    assert hits.distance[0] == 0


@pytest.mark.parametrize("accelerator", ACCELERATORS)
@pytest.mark.parametrize("distance", [2.0, 1e4, 1e8])
def test_spheres_are_hit_up_to_their_tangents(accelerator, distance):
    """Rays that pass nine spheres by 10^-k of the radius inside or outside, along axes and not."""
    generator = np.random.default_rng(13)
    centres = np.stack(np.meshgrid([-2.5, 0.0, 2.5], [-2.5, 0.0, 2.5], [0.0]), axis=-1).reshape(-1, 3)
    caster = build_with(accelerator, sphere_scene(*((centre, 1.0) for centre in centres)))
    count = 120
    away = generator.normal(size=(count, 3))
    away[::2] = np.eye(3)[generator.integers(3, size=count // 2)] * generator.choice([-1.0, 1.0], (count // 2, 1))
    beside = np.roll(away, 1, axis=1)
    beside -= (beside * away).sum(axis=1, keepdims=True) / (away * away).sum(axis=1, keepdims=True) * away
    beside /= np.linalg.norm(beside, axis=1, keepdims=True)
    miss = 1 + generator.choice([-1.0, 1.0], (count, 1)) * 10.0 ** -generator.integers(1, 16, (count, 1))
    targets = centres[generator.integers(9, size=count)] + beside * miss
    judge(caster, targets - away * distance, away)


def test_rays_through_a_point_are_told_from_those_that_pass_it_by_rounding(rng):
    relative = rng.normal(size=(3, 400))
    direction = relative * rng.choice([0.5, -2.0, 1 / 3, 0.7, 1e-20], 400)
    origin = np.round(rng.normal(size=(3, 400)) * 8) / 8 * rng.integers(0, 2, 400)
    tiny = np.array([(1e-170, 2e-170, 0.0), (3e-170, 1e-170, 0.0)]).T  # products underflow
    origin, relative = np.column_stack([origin, np.zeros(3)]), np.column_stack([relative, tiny[:, 0]])
    direction = np.column_stack([direction, tiny[:, 1]])
    point = origin + relative
    passing = refine.passes_through(origin, direction, point)
    for ray in range(401):
        away = [x - y for x, y in zip(as_fractions(point[:, ray]), as_fractions(origin[:, ray]), strict=True)]
        if passing[ray]:
            assert exact_cross(away, as_fractions(direction[:, ray])) == [0, 0, 0]
    assert passing[(direction[:, :400] == relative[:, :400] * 0.5).all(axis=0).nonzero()[0]].sum() > 20
    assert not passing[400]


def test_boxes_of_cubes_hold_their_rounded_corners(rng):
    """The corners of a placed cube reach its box: only the margin for rounding is left."""
    count = 200
    mesh = raytracer.Mesh(*meshes.make_cube(1.0, (0.3, 0.2, 0.1)))
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = rng.normal(size=(count, 3, 3)), rng.normal(size=(count, 3)) * 1e6
    instances = raytracer.Instances(np.zeros(count, np.int32), matrices)
    scene = raytracer.Scene(meshes=[mesh], instances=instances)
    boxes = instance_bounds(pack_geometry(scene), np.arange(count))
    corners = exact_oracle.pack_scene(scene).corners.reshape(count, -1, 3)
    assert (corners.min(axis=1) >= boxes[:, 0]).all()
    assert (corners.max(axis=1) <= boxes[:, 1]).all()


@pytest.mark.parametrize("distance", [1e6, 1e9, 1e12, 1e15])
def test_scenes_are_hit_from_far_away(rng, distance):
    mesh = meshes.make_icosphere(2)
    tree = build_with("bvh", mesh_scene(mesh, spheres=[raytracer.Spheres([(3.0, 0.0, 0.0)], [1.0])]))
    away = rng.normal(size=(len(mesh[0]), 3))
    away[::3] = np.eye(3)[rng.integers(3, size=len(away[::3]))]
    origins = mesh[0] + away * distance
    judge(tree, origins, mesh[0] - origins)
    judge(tree, origins, -away)
    t = tree.closest_hit(origins, -away).distance
    judge(tree, origins, -away, t_max=t)
    judge(tree, origins, -away, t_min=np.where(np.isfinite(t), t, 0.0))


@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 2, 0), (2, 0, 1)])
@pytest.mark.parametrize("flatten_limit", [0, hierarchy.FLATTEN_LIMIT])
def test_one_edge_bound_per_ray_holds_for_every_triangle(rng, monkeypatch, axes, flatten_limit):
    """Scenes that are flat, long, and larger by their shared instances."""
    monkeypatch.setattr(hierarchy, "FLATTEN_LIMIT", flatten_limit)
    positions, triangles = meshes.make_heightfield(6)
    mesh = raytracer.Mesh((positions * (100.0, 1.0, 1e-3))[:, axes], triangles)
    matrices = [np.eye(4), np.diag([5.0, 5.0, 5.0, 1.0])]
    matrices[1][:3, 3] = 0.0, 300.0, 0.0
    scene = raytracer.Scene(meshes=[mesh], instances=raytracer.Instances([0, 0], matrices))
    caster = build_with("bvh", scene)
    assert caster.primitives.flattened.all() == (flatten_limit > 0)
    corners = exact_oracle.pack_scene(scene).corners
    query = Query(caster.primitives, make_rays(rng.normal(size=(30, 3)) * 1e-3, rng.normal(size=(30, 3))), False)
    for ray, axis in enumerate(query.axis):
        line = gather_lines(query.primitives, query.rays, np.array([ray]), axis)
        relative = corners[:, :, TURNS[axis]] - line[:3, 0]
        a, b = relative[:, 0].T, relative[:, 1].T
        bound = filtered.edge_error(a, b, line[6:])
        assert (bound <= query._bound_edges(line, axis)).all()


def test_candidates_at_one_distance_stay_until_the_lowest_index_is_chosen():
    """Bounds of zero, as they could only be: two candidates that touch each other's bounds are both kept."""
    caster = build_with("bvh", mesh_scene(*[meshes.make_quad()] * 2))
    query = Query(caster.primitives, make_rays((0.25, 0.125, 1.0), (0.0, 0.0, -1.0), t_max=1.0), any_hit=False)
    one, yes = np.ones(2), np.ones(2, dtype=bool)
    query._weigh(np.zeros(2, np.intp), np.array([2, 0]), one, one * 0, yes, yes.copy())
    assert sorted(query._remaining().primitive_id.tolist()) == [0, 2]
    assert query.closest().instance.tolist() == [0]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_faces_in_one_axis_plane_tie_without_integers(rng, axis):
    """A box on a floor, their faces in one plane; from above, a third face an ulp higher comes first."""
    turn = np.roll([0, 1, 2], axis)
    floor, triangles = meshes.make_quad()
    layers = [(3.0, 0.1), (1.5, 0.1), (1.5, np.nextafter(0.1, 1.0))]
    faces = [(floor * size + (0.3, -0.2, height))[:, turn] for size, height in layers]
    faces = [(positions, triangles) for positions in faces]
    jitter = rng.normal(size=(200, 2, 3)) * (0.1, 0.1, 0.0)
    below = (jitter[:, 0] + (0.3, -0.2, -3.0))[:, turn]
    up = (jitter[:, 1] + (0.0, 0.0, 1.0))[:, turn]
    caster = build_with("bvh", mesh_scene(*faces[:2]))
    query = Query(caster.primitives, make_rays(below, up), any_hit=False)
    caster.offer(query)
    assert query.closest().instance.tolist() == [0] * 200
    assert query.exact_count == 0
    caster = build_with("bvh", mesh_scene(*faces))
    judge(caster, below, up)
    judge(caster, below + 6.0 * up, -up)


def test_boxes_of_the_tree_are_rounded_outward(rng):
    """The boxes hold the items' boxes themselves, moved to the frame in exact arithmetic."""
    low = rng.normal(size=(300, 3)) + 1e3
    boxes = np.stack([low, low + rng.random((300, 3))], axis=1)
    frame = tree.make_frame(boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0))
    low, minus_high = tree.to_bounds(frame, boxes).astype(np.float64).reshape(2, 3, -1)
    rounded = np.stack([low.T, -minus_high.T], axis=1)
    unit = Fraction(2) ** -frame.exponent
    for side, outward in ((0, -1), (1, 1)):
        for row, box in zip(rounded[:, side], boxes[:, side], strict=True):
            for axis in range(3):
                exact = (Fraction(box[axis]) - Fraction(frame.centre[axis])) / unit
                # One rounding of the difference, to float64, is left to the rays' pad.
                assert outward * (Fraction(row[axis]) - exact) >= -abs(exact) / 2**53


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_rays_that_start_in_an_axis_plane_need_no_integers(rng, axis):
    """Rays from points of a floor: they hit it at t = 0, from either side, unless the range begins later."""
    turn = np.roll([0, 1, 2], axis)
    floor, triangles = meshes.make_quad(3.0)
    floor[:, 2] = 0.1
    caster = build_with("bvh", mesh_scene((floor[:, turn], triangles)))
    origins = np.column_stack([rng.uniform(-2, 2, (200, 2)), np.full(200, 0.1)])[:, turn]
    directions = rng.normal(size=(200, 3))
    query = Query(caster.primitives, make_rays(origins, directions), any_hit=False)
    caster.offer(query)
    assert query.closest().hit.any()
    assert query.exact_count == 0
    judge(caster, origins, directions)
    judge(caster, origins, directions, t_min=1e-300)
    # A plane that is off by the least there is: t = 0 is not certain, and not the answer.
    judge(caster, np.nextafter(origins, np.inf), directions)


def test_rays_that_end_just_before_a_triangle_need_no_integers(rng):
    """Shadow rays to emissive geometry: their range ends within a few last places of it, on either side."""
    corners, triangle = rng.normal((7.0, -3.0, 5.0), 1.0, size=(20, 3, 3)), np.repeat(np.arange(20), 40)
    targets = np.einsum("nk,nki->ni", rng.dirichlet(np.ones(3), size=len(triangle)), corners[triangle])
    origins = rng.normal(size=(len(triangle), 3))
    query, beyond, off = end_around(rng, corners, triangle, origins, targets - origins, 6)
    query.offer(np.arange(len(triangle)), triangle)
    left = query._remaining().ray
    assert len(left) > 100
    out = lie_out_of_range(query.primitives, query.rays, query.t_min, np.arange(len(triangle)), triangle)
    assert not (out & ~beyond).any()
    assert out[beyond & (off > 1)].all()
    query.found_any()
    assert query.exact_count <= len(left) - out[left].sum()


def test_what_pairs_cannot_tell_from_the_range_is_not_left_out(rng):
    """Rays in a triangle's plane but for the rounding of their directions: t is off by several last places."""
    corners, triangle = rng.normal((7.0, -3.0, 5.0), 1.0, size=(50, 3, 3)), np.repeat(np.arange(50), 40)
    sides = corners[:, 1:] - corners[:, :1]
    directions = np.einsum("nk,nki->ni", rng.normal(size=(len(triangle), 2)), sides[triangle])
    origins = rng.normal(size=(len(triangle), 3))
    query, beyond, _ = end_around(rng, corners, triangle, origins, directions, 16)
    out = lie_out_of_range(query.primitives, query.rays, query.t_min, np.arange(len(triangle)), triangle)
    assert out.any()
    assert not (out & ~beyond).any()


def end_around(rng, corners, triangle, origins, directions, widest):
    """A query whose rays end within 2^widest last places of t of a triangle's plane, whether t is beyond, and by how
    many."""
    exact = [exact_distance(*ray, corners[t]) for *ray, t in zip(origins, directions, triangle, strict=True)]
    rounded = np.abs(np.array([float(t) for t in exact]))
    directions = np.where(np.array([t < 0 for t in exact])[:, np.newaxis], -directions, directions)
    places = rng.choice([-1, 1], len(exact)) * np.floor(2.0 ** rng.uniform(-1, widest, len(exact)))
    t_max = rounded + places * np.spacing(rounded)
    caster = build_with("bvh", mesh_scene((corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3))))
    query = Query(caster.primitives, make_rays(origins, directions, t_max=t_max), any_hit=True)
    beyond = np.array([abs(t) > Fraction(end) for t, end in zip(exact, t_max, strict=True)])
    return query, beyond, np.abs(rounded - t_max) / np.spacing(rounded)


def exact_distance(origin, direction, corners):
    """t of a triangle's plane, as a fraction."""
    origin, direction, a, b, c = map(as_fractions, (origin, direction, *corners))
    sides = [[x - y for x, y in zip(corner, a, strict=True)] for corner in (b, c)]
    normal = exact_cross(*sides)
    above = sum(n * (x - y) for n, x, y in zip(normal, a, origin, strict=True))
    return above / sum(n * x for n, x in zip(normal, direction, strict=True))
