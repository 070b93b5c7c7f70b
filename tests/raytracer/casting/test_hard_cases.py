"""The hard cases every certified caster must pass, by number: meshes, edges, vertices, degenerate triangles (1 to 23).

Each runs with every accelerator and is judged by exact arithmetic. The others are in `test_hard_cases_of_range.py`.
"""

from functools import partial

import numpy as np
import pytest

import raytracer
from tests import meshes
from tests.oracle.exact_oracle import pack_scene
from tests.oracle.judging import ACCELERATORS, assert_same_hits, build_with, judge, mesh_scene

ULP = np.finfo(np.float64).eps
OFFSETS = [(0, 0, 0), (148376, 1234, -223423), (1e6, 1e6, 1e6)]
DOWN = (0.0, 0.0, -1.0)
TRIANGLE = np.array([(0, 0, 1), (4, 0, 1), (0, 4, 1)], dtype=np.float64)
ONE = np.array([(0, 1, 2)], dtype=np.int32)


@pytest.fixture(params=ACCELERATORS)
def build(request):
    return partial(build_with, request.param)


def all_vertices_vertically(mesh, height=10.0):
    """Vertical rays down through each vertex."""
    return mesh[0] * (1, 1, 0) + (0, 0, height), np.broadcast_to(DOWN, mesh[0].shape)


@pytest.mark.parametrize("offset", OFFSETS, ids=str)
def test_hard_case_01_closed_mesh_has_no_leak_at_its_vertices(build, offset):
    mesh = meshes.make_icosphere(3, centre=offset)
    hits = judge(build(mesh_scene(mesh)), *meshes.rays_at_vertices(mesh, np.add(offset, (0.1, 0.2, 0.3))))
    assert hits.hit.all()


@pytest.mark.parametrize("offset", OFFSETS, ids=str)
def test_hard_case_02_closed_mesh_has_no_leak_at_its_edges(build, offset):
    mesh = meshes.make_icosphere(3, centre=offset)
    generator = np.random.default_rng(2)
    rays = meshes.rays_at_edges(mesh, np.add(offset, (0.1, 0.2, 0.3)), generator, 1000)
    assert judge(build(mesh_scene(mesh)), *rays).hit.all()


def test_hard_case_03_ray_through_the_diagonal_of_a_quad_hits(build):
    along = np.linspace(-0.5, 0.5, 101)
    origins = np.stack([along, along, np.full(101, 3.0)], axis=1)
    hits = judge(build(mesh_scene(meshes.make_quad())), origins, DOWN * np.ones((101, 1)))
    np.testing.assert_array_equal(hits.primitive, 0)
    np.testing.assert_array_equal(hits.distance, 3)


@pytest.mark.parametrize("up", [False, True], ids=["from above", "from below"])
def test_hard_case_04_heightfield_is_hit_at_all_961_interior_vertices(build, up):
    mesh = meshes.make_heightfield()
    interior = (np.abs(mesh[0][:, :2]) < 1).all(axis=1)
    origins, directions = all_vertices_vertically(mesh, -10.0 if up else 10.0)
    hits = judge(build(mesh_scene(mesh)), origins[interior], directions[interior] * (-1 if up else 1))
    assert hits.hit.sum() == 961


def test_hard_case_05_heightfield_is_hit_at_all_boundary_vertices(build):
    mesh = meshes.make_heightfield()
    boundary = (np.abs(mesh[0][:, :2]) == 1).any(axis=1)
    origins, directions = all_vertices_vertically(mesh)
    hits = judge(build(mesh_scene(mesh)), origins[boundary], directions[boundary])
    assert hits.hit.sum() == 128


@pytest.mark.parametrize("half_size", [0.5, 1.0, 2.0, 10.0, 1e3, 1e6])
def test_hard_case_06_ray_in_the_plane_of_a_face_hits_the_cube(build, half_size):
    origins = np.array([(1, 0.25, 3), (-1, 0.25, 3), (0.25, 1, 3), (0.25, -1, 3)]) * half_size
    hits = judge(build(mesh_scene(meshes.make_cube(half_size))), origins, np.broadcast_to(DOWN, (4, 3)))
    np.testing.assert_array_equal(hits.distance, 2 * half_size)


def test_hard_case_07_grid_is_hit_by_289_vertical_rays_through_its_vertices(build):
    mesh = meshes.make_grid()
    assert judge(build(mesh_scene(mesh)), *all_vertices_vertically(mesh)).hit.sum() == 289


@pytest.mark.parametrize("zeros", [(-0.0, -0.0), (0.0, -0.0), (-0.0, 0.0)], ids=str)
def test_hard_case_08_negative_zeros_in_the_direction_change_nothing(build, zeros):
    mesh = meshes.make_grid()
    caster = build(mesh_scene(mesh))
    origins, directions = all_vertices_vertically(mesh)
    hits = caster.closest_hit(origins, np.full_like(directions, -1.0) * (0, 0, 1) + (*zeros, 0.0))
    assert_same_hits(hits, caster.closest_hit(origins, directions))
    assert hits.hit.sum() == 289


def test_hard_case_09_origin_on_a_box_plane_with_a_parallel_direction_hits(build):
    # 0 * inf in the slab test: on one box plane, on two, on three (a corner of the box).
    origins = [(1, 0.25, 0.5), (1, -0.75, 1), (1, -1, 1), (-1, -1, -1), (0.25, 1, -3)]
    directions = [(0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 0, 1), (0, 0, 1)]
    caster = build(mesh_scene(meshes.make_cube()))
    assert judge(caster, origins, directions).hit.all()
    # The same among many boxes that share planes.
    cubes = [meshes.make_cube(1.0, (2 * i, 2 * j, 0)) for i in range(5) for j in range(5)]
    assert judge(build(mesh_scene(meshes.join_meshes(cubes))), origins, directions).hit.all()


@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_hard_case_10_zero_direction_components_of_either_sign_hit(build, zero):
    mesh = meshes.make_icosphere(3)
    signs = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if 0 in (x, y, z)])
    directions = signs[(signs != 0).any(axis=1)].astype(np.float64)
    directions[directions == 0] = zero
    assert judge(build(mesh_scene(mesh)), -3 * directions, directions).hit.all()


def test_hard_case_11_ray_in_a_face_of_the_bounding_box_hits(build):
    origins = [(-3, 0.25, 1), (-3, 1, 0.25), (0.25, -3, -1), (-3, 1, 1), (1, 3, -1)]
    directions = [(1, 0, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0), (0, -1, 0)]
    hits = judge(build(mesh_scene(meshes.make_cube())), origins, directions)
    np.testing.assert_array_equal(hits.distance, 2)


@pytest.mark.parametrize("excess", [2.0**-22, ULP])
def test_hard_case_12_ray_barely_beside_a_cube_misses(build, excess):
    origins = [(1 + excess, 0.25, 3), (0.25, -1 - excess, 3), (1, 0.25, 3)]
    hits = judge(build(mesh_scene(meshes.make_cube())), origins, np.broadcast_to(DOWN, (3, 3)))
    np.testing.assert_array_equal(hits.hit, [False, False, True])


def test_hard_case_13_ray_past_a_skinny_triangle_at_half_a_degree_misses(build):
    # Side lengths 11.2, 9.9 and 1.4; the rays meet its plane outside, at up to 500 away, rising by 0.52 degrees.
    corners = np.array([(0, 0, 0), (11.2, 0, 0), (9.85, 0.4, 0)])
    generator = np.random.default_rng(13)
    rise = np.tan(np.radians(0.52))
    angle = generator.uniform(0, 2 * np.pi, 2000)
    heading = np.stack([np.cos(angle), np.sin(angle), np.full(2000, -rise)], axis=1)
    beside = generator.choice([-1, 1], 2000)[:, np.newaxis] * (0, 1, 0) * generator.uniform(0.41, 3, (2000, 1))
    through = corners.mean(axis=0) + beside
    turn = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    origins = (through - generator.uniform(20, 500, (2000, 1)) * heading) @ turn.T
    hits = judge(build(mesh_scene((corners @ turn.T, ONE))), origins, heading @ turn.T)
    assert not hits.hit.any()


def test_hard_case_14_skinny_triangle_at_a_grazing_angle_is_decided_exactly(build):
    # Aspect 1e5, 0.57 degrees, 4000 rays at points within a few widths of it, turned at random.
    generator = np.random.default_rng(14)
    width, rise = 1e-5, np.tan(np.radians(0.57))
    corners = np.array([(0, 0, 0), (1, 0, 0), (0.5, width, 0)])
    through = generator.uniform((-0.1, -0.2 * width, 0), (1.1, 1.2 * width, 0), (4000, 3))
    angle = generator.uniform(0, 2 * np.pi, 4000)
    heading = np.stack([np.cos(angle), np.sin(angle), np.full(4000, -rise)], axis=1)
    turn = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    hits = judge(build(mesh_scene((corners @ turn.T, ONE))), (through - 10 * heading) @ turn.T, heading @ turn.T)
    assert 0 < hits.hit.sum() < 4000


def test_hard_case_15_lens_of_needles_has_no_leak(build):
    mesh = meshes.make_needle_lens(aspect=1e7)
    caster, generator = build(mesh_scene(mesh)), np.random.default_rng(15)
    inside = (0.05, 0.02, 0.01)
    assert judge(caster, *meshes.rays_at_vertices(mesh, inside)).hit.all()
    assert judge(caster, *meshes.rays_at_edges(mesh, inside, generator, 1000)).hit.all()


def test_hard_case_16_collinear_triangle_is_never_hit(build):
    # Policy: without area no ray hits it, not even along or through it; the triangle behind it is found.
    collinear = np.array([(0, 0, 2), (1, 1, 2), (3, 3, 2)])
    origins = [(0, 0, 3), (1, 1, 3), (0.5, 0.5, 3), (-1, -1, 2)]
    directions = [DOWN, DOWN, DOWN, (1, 1, 0)]
    assert not judge(build(mesh_scene((collinear, ONE))), origins, directions).hit.any()
    hits = judge(build(mesh_scene((collinear, ONE), (TRIANGLE, ONE))), origins, directions)
    np.testing.assert_array_equal(hits.instance, [1, 1, 1, -1])
    assert np.isfinite(hits.barycentric).all()


def test_hard_case_17_triangle_of_identical_vertices_is_never_hit(build):
    point = np.full((3, 3), 0.5)
    origins, directions = [(0.5, 0.5, 3), (0, 0, 0), (0.5, 0.5, 0.5)], [DOWN, (1, 1, 1), DOWN]
    assert not judge(build(mesh_scene((point, ONE))), origins, directions).hit.any()
    assert not judge(build(mesh_scene((point, ONE), (point, np.zeros((1, 3), int)))), origins, directions).hit.any()


def test_hard_case_18_ray_in_the_plane_of_a_triangle_misses_it(build):
    origins = [(-1, 1, 1), (-1, 0, 1), (-1, -1, 1), (1, 1, 1)]
    directions = [(1, 0, 0), (1, 0, 0), (1, 1, 0), (1, 0, 0)]
    assert not judge(build(mesh_scene((TRIANGLE, ONE))), origins, directions).hit.any()
    # A closed mesh is hit through the faces beside: at the edge that the ray's face shares with the side it comes to.
    hits = judge(build(mesh_scene(meshes.make_cube())), [(-2, 0.25, 1)], [(1, 0, 0)])
    np.testing.assert_array_equal(hits.distance, 1)
    assert hits.primitive[0] in (8, 9)


def test_hard_case_19_ray_along_an_edge_misses_both_its_triangles(build):
    quad = meshes.make_quad()
    origins = [(-2, -2, 0), (-2, -0.5, 0), (0, 0, 0)]
    directions = [(1, 1, 0), (1, 0, 0), (1, 1, 0)]
    assert not judge(build(mesh_scene(quad)), origins, directions).hit.any()
    # Along an edge of a cube, and along a diagonal: the faces that the ray meets at their corner are hit.
    hits = judge(build(mesh_scene(meshes.make_cube())), [(1, 1, 3), (3, 3, 1)], [DOWN, (-1, -1, 0)])
    np.testing.assert_array_equal(hits.distance, 2)


def test_hard_case_20_of_identical_triangles_the_lowest_index_is_hit(build):
    twice = (TRIANGLE, np.array([(0, 1, 2), (0, 1, 2), (2, 1, 0)]))
    origins = np.array([(1, 1, 5), (0, 0, 5), (2, 2, 5), (1, 1, -5)], dtype=np.float64)
    directions = np.array([DOWN, DOWN, DOWN, (0, 0, 1)])
    np.testing.assert_array_equal(judge(build(mesh_scene(twice)), origins, directions).primitive, 0)
    apart = judge(build(mesh_scene((TRIANGLE, ONE), (TRIANGLE, ONE))), origins, directions)
    np.testing.assert_array_equal(apart.instance, 0)
    placed = raytracer.Instances([0] * 20, np.tile(np.eye(4), (20, 1, 1)))
    scene = raytracer.Scene(meshes=[raytracer.Mesh(*twice)], instances=placed)
    hits = judge(build(scene), origins, directions)
    np.testing.assert_array_equal((hits.instance, hits.primitive), np.zeros((2, 4)))


def test_hard_case_21_shells_one_ulp_apart_are_found_in_their_exact_order(build):
    shells = meshes.make_nested_shells(8)
    caster, generator = build(mesh_scene(shells)), np.random.default_rng(21)
    origins, directions = meshes.random_rays(generator, 300, size=0.9)
    inner = judge(caster, origins, directions)
    np.testing.assert_array_equal(inner.primitive // 12, 7)
    outer = judge(caster, origins + 5 * directions / np.abs(directions).max(axis=1, keepdims=True), -directions)
    np.testing.assert_array_equal(outer.primitive // 12, 0)


def test_hard_case_22_crossings_count_an_edge_or_a_vertex_once(build):
    caster = build(mesh_scene(meshes.make_quad()))
    origins = [(0, 0, 1), (0.25, 0.25, 1), (0.25, 0.1, 1), (2, 2, 1), (0, 0, -1), (0, 0, np.nan)]
    np.testing.assert_array_equal(caster.crossings(origins, [DOWN] * 6), [1, 1, 1, 0, 0, 0])
    mesh = meshes.make_icosphere(3)
    caster, generator = build(mesh_scene(mesh)), np.random.default_rng(22)
    inside = (0.1, 0.2, 0.3)
    for rays in (meshes.rays_at_vertices(mesh, inside), meshes.rays_at_edges(mesh, inside, generator, 1000)):
        np.testing.assert_array_equal(caster.crossings(*rays), 1)


@pytest.mark.parametrize("shape", ["cube", "torus", "needle_lens", "nested_shells"])
def test_hard_case_22_crossings_from_vertices_and_along_edges_are_exact(build, shape):
    positions, triangles = mesh = getattr(meshes, f"make_{shape}")()
    caster, generator = build(mesh_scene(mesh)), np.random.default_rng(22)
    a, b, _ = np.moveaxis(positions[triangles[generator.integers(len(triangles), size=100)]], 1, 0)
    lattice = generator.integers(-1, 2, size=(100, 3)).astype(np.float64)
    for origins, directions in ((a, b - a), (2 * a - b, b - a), (a, lattice), meshes.random_rays(generator, 100)):
        exact = pack_scene(caster.scene).crossings(origins, directions)
        np.testing.assert_array_equal(caster.crossings(origins, directions), exact)


def test_hard_case_23_origin_on_a_face_hits_it_at_zero_unless_it_runs_in_the_plane(build):
    # Policy: the range is closed, so the face is hit at t = 0 going in and going out; in its plane it is not.
    caster = build(mesh_scene(meshes.make_cube()))
    origin, directions = (0.25, 0.5, 1), [DOWN, (0, 0, 1), (0.3, 0.1, -2), (1, 0, 0)]
    hits = judge(caster, np.tile(origin, (4, 1)), directions)
    np.testing.assert_array_equal(hits.distance, [0, 0, 0, 0.75])
    # t_min above 0 leaves the face behind.
    hits = judge(caster, np.tile(origin, (4, 1)), directions, t_min=5e-324)
    np.testing.assert_array_equal(hits.distance[[0, 1, 3]], [2, np.inf, 0.75])
