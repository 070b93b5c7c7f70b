"""The hard cases every certified caster must pass, by number: ranges, scales, instances, spheres, batches (24 to 43).

Each runs with every accelerator and is judged by exact arithmetic. The first ones are in `test_hard_cases.py`.
"""

from fractions import Fraction
from functools import partial

import numpy as np
import pytest

import raytracer
from raytracer import lecture
from raytracer.casting.rays import Rays
from raytracer.integrator.features import derive_features
from raytracer.surfaces.departing import spawn_origin
from raytracer.surfaces.surface import make_surface
from raytracer.surfaces.surface_tables import make_surface_tables
from tests import meshes
from tests.oracle.exact_oracle import pack_scene
from tests.oracle.judging import (
    ACCELERATORS,
    assert_miss_is_data,
    assert_same_hits,
    build_with,
    judge,
    judge_hits,
    mesh_scene,
    sphere_scene,
)

UNIT = ((0, 0, 0), 1.0)
ALONG_X = (1.0, 0.0, 0.0)


@pytest.fixture(params=ACCELERATORS)
def build(request):
    return partial(build_with, request.param)


def select_hits(hits, index):
    found = (getattr(hits, name) for name in raytracer.Hits.__slots__)
    return raytracer.Hits(*(None if values is None else values[index] for values in found))


def surfaces_of(caster, origins, directions, hits):
    """The raytracer.Surface of hits, without misses."""
    features = derive_features(caster.scene)
    tables = make_surface_tables(caster.scene, caster.geometry, features.smooth_normals, features.uvs)
    zeros = np.zeros(len(origins))
    return make_surface(tables, Rays(origins, directions, zeros, zeros + np.inf), hits)


def test_hard_case_24_t_max_is_inclusive(build):
    quad = build(mesh_scene(meshes.make_quad()))
    origins, directions = np.tile((0.25, 0.125, 3.0), (2, 1)), np.tile((0.0, 0.0, -2.0), (2, 1))
    hits = judge(quad, origins, directions, t_max=np.array([1.5, np.nextafter(1.5, 0)]))
    np.testing.assert_array_equal(hits.hit, [True, False])
    # And where the exact distance is no float64: on either side of it.
    mesh, generator = meshes.make_icosphere(2), np.random.default_rng(24)
    caster, rays = build(mesh_scene(mesh)), meshes.random_rays(generator, 200, size=0.5)
    t = caster.closest_hit(*rays).distance
    for t_max in (np.nextafter(t, 0), t, np.nextafter(t, np.inf)):
        judge(caster, *rays, t_max=t_max)


def test_hard_case_25_t_min_is_inclusive(build):
    quad = build(mesh_scene(meshes.make_quad()))
    origins, directions = np.tile((0.25, 0.125, 3.0), (3, 1)), np.tile((0.0, 0.0, -2.0), (3, 1))
    hits = judge(quad, origins, directions, t_min=np.array([1.5, np.nextafter(1.5, 2), -1]))
    np.testing.assert_array_equal(hits.hit, [True, False, True])
    mesh, generator = meshes.make_icosphere(2), np.random.default_rng(25)
    caster, rays = build(mesh_scene(mesh)), meshes.random_rays(generator, 200, size=1.0)
    t = np.where(np.isfinite(caster.closest_hit(*rays).distance), caster.closest_hit(*rays).distance, 0)
    for t_min in (np.nextafter(t, 0), t, np.nextafter(t, np.inf)):
        judge(caster, *rays, t_min=t_min)
    ball = build(sphere_scene(UNIT))
    roots = lecture.intersect_sphere(*rays, *UNIT)
    for t_min in (np.nextafter(roots, 0), roots, np.nextafter(roots, np.inf)):
        for root in np.moveaxis(np.nan_to_num(t_min), -1, 0):
            judge(ball, *rays, t_min=root)
    # A negative t_min counts as 0: nothing behind the origin is found.
    for caster in (quad, ball):
        assert not judge(caster, [(0.25, 0.125, -3)], [(0, 0, -2)], t_min=-5).hit.any()


@pytest.mark.parametrize("shape", ["cubes", "spheres"])
def test_hard_case_26_both_surfaces_of_a_thin_shell_are_found(build, shape):
    gap, generator = 4e-5, np.random.default_rng(26)
    if shape == "cubes":
        scene = mesh_scene(meshes.make_cube(1.0), meshes.make_cube(1.0 + gap))
    else:
        scene = sphere_scene(UNIT, ((0, 0, 0), 1.0 + gap))
    caster = build(scene)
    directions = generator.normal(size=(500, 3))
    origins = generator.uniform(-0.5, 0.5, (500, 3))
    inner = judge(caster, origins, directions)
    outer = judge(caster, origins, directions, t_min=np.nextafter(inner.distance + inner.distance_error, np.inf))
    first, second = (inner.instance, outer.instance) if shape == "cubes" else (inner.primitive, outer.primitive)
    np.testing.assert_array_equal(first, 0)
    np.testing.assert_array_equal(second, 1)


@pytest.mark.parametrize("distance", [1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9])
def test_hard_case_27_small_triangle_is_hit_from_afar(build, distance):
    corners = np.array([(0, -1, -1), (0, 1, -1), (0, 0, 1)], dtype=np.float64)
    generator = np.random.default_rng(27)
    targets = np.array([(0, -1, -1), (0, 1, -1), (0, 0, 1), (0, 0, 0), (0, 0.3, -0.7)], dtype=np.float64)
    away = generator.normal(size=(5, 3)) * 0.3 + ALONG_X
    origins = targets + distance * away / np.linalg.norm(away, axis=1, keepdims=True)
    caster = build(mesh_scene((corners, [(0, 1, 2)])))
    assert judge(caster, origins, targets - origins).hit[3:].all()
    straight = judge(caster, targets + np.array((distance, 0, 0)), np.tile((-1.0, 0.0, 0.0), (5, 1)))
    np.testing.assert_array_equal(straight.distance, distance)


def assert_scaled_cube_is_hit(build, scale):
    cube = meshes.make_cube(scale)
    generator = np.random.default_rng(28)
    origins, directions = meshes.random_rays(generator, 50, size=0.9)
    assert judge(build(mesh_scene(cube)), origins * scale, directions).hit.all()
    targets = meshes.make_cube(scale / 3)[0]
    rays = meshes.aim(np.array((3.0, 2.0, 1.5)) * scale, targets)
    assert judge(build(mesh_scene(cube)), *rays).hit.all()


@pytest.mark.parametrize("scale", [1e-6, 1e-10, 1e-15, 1e-20, 1e-30, 1e-40])
def test_hard_case_28_tiny_cube_is_hit(build, scale):
    assert_scaled_cube_is_hit(build, scale)


@pytest.mark.parametrize("scale", [1e12, 1e15, 1e20, 1e25])
def test_hard_case_29_huge_cube_is_hit(build, scale):
    assert_scaled_cube_is_hit(build, scale)


@pytest.mark.parametrize("scale", [1e-30, 2.0**-100, 2.0**100, 1e30])
def test_hard_case_30_distance_scales_with_the_direction(build, scale):
    mesh, generator = meshes.make_icosphere(2), np.random.default_rng(30)
    caster, (origins, directions) = build(mesh_scene(mesh)), meshes.random_rays(generator, 200, size=0.5)
    hits, base = judge(caster, origins, directions * scale), caster.closest_hit(origins, directions)
    np.testing.assert_array_equal(hits.primitive, base.primitive)
    # One rounding in each component of the scaled direction turns it a little: the distance follows to first order.
    np.testing.assert_allclose(hits.distance * scale, base.distance, rtol=1e-12)
    judge(build(sphere_scene(UNIT)), origins, directions * scale)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_hard_case_31_invalid_rays_miss_are_flagged_and_harm_no_others(build, bad):
    for scene in (mesh_scene(meshes.make_icosphere(2)), sphere_scene(UNIT)):
        caster, generator = build(scene), np.random.default_rng(31)
        origins, directions = meshes.random_rays(generator, 40, size=0.5)
        good = caster.closest_hit(origins, directions)
        invalid = np.arange(40) % 4 == 1
        origins[1::12, 2], directions[5::12, 0], directions[9::12] = bad, bad, 0
        hits = judge(caster, origins, directions)
        np.testing.assert_array_equal(hits.valid, ~invalid)
        assert_miss_is_data(hits, invalid)
        assert_same_hits(select_hits(hits, ~invalid), select_hits(good, ~invalid))
    ranged = caster.closest_hit(origins[:3], directions[:3] * 0 + 1, t_min=[0, np.nan, 0], t_max=[np.nan, 1, 9])
    np.testing.assert_array_equal(ranged.valid, [False, False, True])


def test_hard_case_32_a_miss_is_a_miss_whatever_was_cast_before(build):
    for scene in (mesh_scene(meshes.make_icosphere(2)), sphere_scene(UNIT), raytracer.Scene()):
        caster, generator = build(scene), np.random.default_rng(32)
        caster.closest_hit(*meshes.random_rays(generator, 300, size=0.1))
        origins = generator.normal(size=(300, 3))
        hits = judge(caster, np.abs(origins) + 6, np.abs(generator.normal(size=(300, 3))))
        assert hits.valid.all()
        assert_miss_is_data(hits, np.ones(300, dtype=bool))
        assert len(caster.closest_hit(np.zeros((0, 3)), np.zeros((0, 3)))) == 0


@pytest.mark.parametrize("offset", [1e6, 2.0**24, 1e8])
def test_hard_case_33_geometry_far_from_the_origin_stays_exact(build, offset):
    centre = np.array((offset, -offset, offset))
    mesh, generator = meshes.make_icosphere(2, centre=centre), np.random.default_rng(33)
    origins, directions = meshes.random_rays(generator, 300)
    judge(build(mesh_scene(mesh)), origins + centre, directions)
    assert judge(build(mesh_scene(mesh)), *meshes.rays_at_vertices(mesh, centre + 0.125)).hit.all()


def placed(mesh, matrices):
    matrices = np.asarray(matrices, dtype=np.float64)
    return raytracer.Scene(
        meshes=[raytracer.Mesh(*mesh)], instances=raytracer.Instances(np.zeros(len(matrices), int), matrices)
    )


def affine(linear, translation=(0, 0, 0)):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, translation
    return matrix


@pytest.mark.parametrize("mirror", [(-1, 1, 1), (-2, -0.5, 1), (-1, -3, -0.25)], ids=str)
def test_hard_case_34_mirrored_instances_have_the_same_hits_and_outward_normals(build, mirror):
    mesh, generator = meshes.make_icosphere(2), np.random.default_rng(34)
    turn = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    centres = 10.0 * np.arange(6)[:, np.newaxis] * ALONG_X
    caster = build(placed(mesh, [affine(turn @ np.diag(mirror), centre) for centre in centres]))
    pick = np.arange(240) % 6
    origins = centres[pick] + generator.uniform(-0.1, 0.1, (240, 3))
    directions = generator.normal(size=(240, 3))
    hits = judge(caster, origins, directions)
    np.testing.assert_array_equal(hits.instance, pick)
    surface = surfaces_of(caster, origins, directions, hits)
    assert not surface.front.any()  # seen from inside: the normals of all point away, mirrored or not


def test_hard_case_35_sheared_instances_do_not_hit_themselves(build):
    mesh, generator = meshes.make_icosphere(2), np.random.default_rng(35)
    shears = [np.array([(s, 3 * s, 0), (0, s, -2 * s), (0.5 * s, 0, s)]) for s in (1e-4, 1.0, 1e4)]
    for number, shear in enumerate(shears):
        caster = build(placed(mesh, [affine(shear, (7.3, -1.1, 2.9))] * 1))
        origins = generator.uniform(-0.2, 0.2, (300, 3)) @ shear.T + (7.3, -1.1, 2.9)
        directions = generator.normal(size=(300, 3))
        hits = judge(caster, origins, directions)
        assert hits.hit.all(), number
        # Leaving through the surface nothing more is hit; going back the way it came, not the triangle it leaves.
        surface = surfaces_of(caster, origins, directions, hits)
        assert not caster.any_hit(spawn_origin(surface, directions), directions).any()
        back = judge(caster, spawn_origin(surface, -directions), -directions)
        assert back.hit.all()
        assert (back.primitive != hits.primitive).all()


def test_hard_case_36_tangent_of_a_sphere_hits_once(build):
    origins = [(-3, 1, 0), (-3, 0, -1), (-3, -0.6, 0.8), (-3, 0, 0)]
    caster = build(sphere_scene(UNIT))
    hits = judge(caster, origins, np.tile(ALONG_X, (4, 1)))
    np.testing.assert_array_equal(hits.distance[[0, 1, 3]], [3, 3, 2])
    past = judge(caster, origins, np.tile(ALONG_X, (4, 1)), t_min=np.nextafter(3, 4))
    np.testing.assert_array_equal(past.hit[[0, 1, 3]], [False, False, True])


def test_hard_case_37_near_tangents_at_a_distance_are_told_apart(build):
    y = 1 + np.array([-1e-11, 1e-11, -1e-15, 1e-15, 0])
    origins = np.stack([np.full(5, -1e6), y, np.zeros(5)], axis=1)
    hits = judge(build(sphere_scene(UNIT)), origins, np.tile(ALONG_X, (5, 1)))
    np.testing.assert_array_equal(hits.hit, [True, False, True, False, True])
    tilted = np.random.default_rng(37).normal(size=(200, 3)) * (0, 2e-12, 2e-12) + ALONG_X
    origins = np.array([(-1e6, 1 - 1e-11, 0)]) + np.zeros((200, 1))
    assert 0 < judge(build(sphere_scene(UNIT)), origins, tilted).hit.sum() < 200


def test_hard_case_38_small_sphere_far_away_keeps_its_hits(build):
    generator = np.random.default_rng(38)
    origins = generator.uniform((-1e8, -1.1, -1.1), (-1e8, 1.1, 1.1), (500, 3))
    hits = judge(build(sphere_scene(UNIT)), origins, np.tile(ALONG_X, (500, 1)))
    np.testing.assert_array_equal(hits.hit, [Fraction(y) ** 2 + Fraction(z) ** 2 <= 1 for _, y, z in origins])
    small = judge(build(sphere_scene(((0, 0, 0), 0.1))), [(-1e7, 0.095, 0)], [ALONG_X])
    assert small.distance[0] == pytest.approx(1e7 - np.sqrt(0.1**2 - 0.095**2), rel=1e-15)


@pytest.mark.parametrize("height", [1e-3, 1e-6])
def test_hard_case_39_huge_sphere_is_hit_exactly_from_just_above(build, height):
    generator = np.random.default_rng(39)
    origins = np.tile((0, 0, 1e6 + height), (300, 1))
    directions = generator.normal(size=(300, 3)) * (1, 1, 0) + (0, 0, -0.5)
    hits = judge(build(sphere_scene(((0, 0, 0), 1e6))), origins, directions)
    assert hits.hit.all()
    # Plain float64 is off by 1e-4 of the distance from 1e-6 above; the certified bound stays near the last place.
    assert (hits.distance_error <= 1e-12 * hits.distance).all()


def test_hard_case_40_origin_inside_at_the_centre_and_on_a_sphere(build):
    origins = [(0.5, 0, 0), (0, 0, 0), (-1, 0, 0), (1, 0, 0), (0, 1, 0), (0.6, 0.8, 0), (1, 0, 0)]
    directions = np.array([ALONG_X] * 6 + [(0, 1, 0)])
    caster = build(sphere_scene(UNIT))
    hits = judge(caster, origins, directions)
    np.testing.assert_array_equal(hits.distance[[0, 1, 2, 3, 4, 6]], [0.5, 1, 0, 0, 0, 0])
    hits = judge(caster, origins, directions, t_min=5e-324)
    np.testing.assert_array_equal(hits.distance[[0, 1, 2, 3, 4, 6]], [0.5, 1, 2, np.inf, np.inf, np.inf])


def crowded_scene(generator):
    """Instances mirrored and sheared, a mesh of many triangles, spheres: something of everything."""
    soup, ball = meshes.make_soup(generator, 300), meshes.make_icosphere(2, radius=0.5)
    matrices = [affine(generator.normal(size=(3, 3)), generator.uniform(-2, 2, 3)) for _ in range(12)]
    return raytracer.Scene(
        meshes=[raytracer.Mesh(*soup), raytracer.Mesh(*ball)],
        instances=raytracer.Instances([0, *([1] * 12)], [np.eye(4), *matrices]),
        spheres=raytracer.Spheres(generator.uniform(-2, 2, (20, 3)), generator.uniform(0.05, 0.5, 20)),
    )


@pytest.mark.parametrize("precision", ["certified", "float64", "float32"])
def test_hard_case_41_a_batch_equals_its_rays_one_at_a_time(build, precision):
    generator = np.random.default_rng(41)
    caster = build(crowded_scene(generator), precision=precision)
    origins, directions = meshes.random_rays(generator, 200)
    batch = caster.closest_hit(origins, directions)
    for ray in range(200):
        single = caster.closest_hit(origins[ray], directions[ray])
        assert_same_hits(select_hits(batch, [ray]), single)


@pytest.mark.parametrize("precision", ["certified", "float64", "float32"])
def test_hard_case_42_every_accelerator_equals_brute_force(build, precision):
    generator = np.random.default_rng(42)
    scene = crowded_scene(generator)
    caster, twin = build(scene, precision=precision), build_with("brute_force", scene, precision)
    for rays in (meshes.random_rays(generator, 1000), meshes.random_rays(generator, 1000, size=20.0)):
        assert_same_hits(caster.closest_hit(*rays), twin.closest_hit(*rays))
        np.testing.assert_array_equal(caster.any_hit(*rays, 0.1, 0.5), twin.any_hit(*rays, 0.1, 0.5))
        if precision == "certified":
            judge_hits(caster, caster.closest_hit(*rays), *rays)
            exact = pack_scene(scene).any_hit(*rays, 0.1, 0.5)
            np.testing.assert_array_equal(caster.any_hit(*rays, 0.1, 0.5), exact)


def test_hard_case_43_float32_input_is_promoted_without_welding_vertices(build):
    # Two sheets one float32 ulp apart, in float32: both remain, in their order, with all their own vertices.
    positions, triangles = meshes.make_grid(4)
    lower, upper = np.float32(positions), np.float32(positions)
    lower[:, 2], upper[:, 2] = 1, np.nextafter(np.float32(1), np.float32(2))
    mesh = meshes.join_meshes([(lower, triangles), (upper, triangles)])
    assert mesh[0].dtype == np.float32
    scene = mesh_scene(mesh)
    np.testing.assert_array_equal(scene.meshes[0].positions, mesh[0].astype(np.float64), strict=True)
    origins = np.float32(positions * (0.9, 0.9, 0) + (0.01, 0.02, 3))
    hits = judge(build(scene), origins, np.tile(np.float32((0, 0, -1)), (len(origins), 1)))
    assert (hits.primitive >= len(triangles)).all()
    hits = judge(build(scene), origins - np.float32((0, 0, 6)), np.tile(np.float32((0, 0, 1)), (len(origins), 1)))
    assert (hits.primitive < len(triangles)).all()
