"""Surfaces at hits: positions within their bound, spawned rays that neither hit what they left nor leak."""

from fractions import Fraction

import numpy as np
import pytest

import raytracer
from raytracer.casting.geometry import pack_geometry, world_corners
from raytracer.casting.rays import Hits, make_rays
from raytracer.integrator.features import derive_features
from raytracer.lecture import barycentric, dot
from raytracer.surfaces import surface_tables
from raytracer.surfaces.departing import spawn_origin, step_towards
from raytracer.surfaces.surface import make_surface
from raytracer.surfaces.surface_tables import make_surface_tables
from tests import meshes

RIGHT_TRIANGLE = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]


def surface_of(scene, hits, directions=(0.0, 0.0, -1.0), origins=(0.0, 0.0, 1.0), uvs=False):
    features = derive_features(scene)
    tables = make_surface_tables(scene, pack_geometry(scene), features.smooth_normals, uvs)
    count = len(hits)
    rays = make_rays(np.broadcast_to(origins, (count, 3)), np.broadcast_to(directions, (count, 3)))
    return make_surface(tables, rays, hits)


def hits_at(barycentric_weights, instance=0, primitive=0, distance=1.0):
    weights = np.atleast_2d(np.asarray(barycentric_weights, dtype=np.float64))
    count = len(weights)
    return Hits(
        distance=np.full(count, distance),
        distance_error=np.zeros(count),
        instance=np.full(count, instance, dtype=np.int32),
        primitive=np.full(count, primitive, dtype=np.int32),
        barycentric=weights,
        valid=np.ones(count, dtype=bool),
    )


def exact_plane_distance_squared(point, a, b, c):
    """((p - a) . n)^2 / n . n in rational arithmetic."""
    p, a, b, c = ([Fraction(float(x)) for x in v] for v in (point, a, b, c))
    e, f = [y - x for x, y in zip(a, b, strict=True)], [y - x for x, y in zip(a, c, strict=True)]
    n = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]]
    height = sum((x - y) * z for x, y, z in zip(p, a, n, strict=True))
    return height * height / sum(x * x for x in n)


def test_steps_are_those_of_nextafter(rng):
    """Also from zero, from the largest number and from what is none, to either side or to none."""
    special = [0.0, -0.0, 5e-324, -5e-324, 2.0**-1022, 1.0, -1.0, np.finfo(float).max, -np.finfo(float).max]
    points = np.concatenate([[*special, np.inf, -np.inf], rng.normal(size=19) * 10.0 ** rng.uniform(-300, 300, 19)])
    points = np.repeat(points, 4).reshape(-1, 3)
    side = np.tile([1e-3, -7.0, 0.0, -0.0], points.size // 4).reshape(-1, 3)
    with np.errstate(over="ignore", under="ignore"):
        expected = np.where(side == 0, points, np.nextafter(points, np.copysign(np.inf, side)))
    np.testing.assert_array_equal(step_towards(points, side), expected)
    assert (expected != points).sum() >= points.size / 2 - 2


@pytest.mark.parametrize("offset", [0.0, 1e3, 1e6, 1e9])
def test_make_surface_position_stays_within_its_error_of_the_exact_plane(offset):
    rng = np.random.default_rng(1)
    corners = rng.normal(size=(3, 3)) + offset
    scene = raytracer.Scene(meshes=[raytracer.Mesh(corners, [[0, 1, 2]])])
    weights = rng.dirichlet([1, 1, 1], size=50)[:, 1:]
    surface = surface_of(scene, hits_at(weights))
    for point, error in zip(surface.position, surface.position_error, strict=True):
        assert exact_plane_distance_squared(point, *corners) <= Fraction(float(error)) ** 2
    assert (surface.position_error < 1e-14 * max(offset, 1.0) * 10).all()


def test_make_surface_position_is_the_lectures_barycentric_point():
    rng = np.random.default_rng(2)
    corners = rng.normal(size=(3, 3))
    scene = raytracer.Scene(meshes=[raytracer.Mesh(corners, [[0, 1, 2]])])
    weights = rng.dirichlet([1, 1, 1], size=20)
    surface = surface_of(scene, hits_at(weights[:, 1:]))
    np.testing.assert_allclose(barycentric(surface.position, *corners), weights, atol=1e-14)


@pytest.mark.parametrize(("centre", "radius", "distance"), [(0.0, 1.0, 3.0), (1e6, 0.1, 1e6), (1e3, 1e6, 1e8)])
def test_make_surface_sphere_position_stays_within_its_error(centre, radius, distance):
    scene = raytracer.Scene(spheres=[raytracer.Spheres([[centre, -centre, 2 * centre]], [radius])])
    rng = np.random.default_rng(3)
    normals = rng.normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    target = np.array([centre, -centre, 2 * centre]) + radius * normals
    hits = hits_at(np.zeros((50, 2)), distance=distance)
    surface = surface_of(scene, hits, directions=-normals, origins=target + distance * normals)
    for point, error in zip(surface.position, surface.position_error, strict=True):
        offset = [Fraction(float(x)) - Fraction(y) for x, y in zip(point, (centre, -centre, 2 * centre), strict=True)]
        square = sum(x * x for x in offset)
        r, e = Fraction(radius), Fraction(float(error))
        assert max(r - e, Fraction(0)) ** 2 <= square <= (r + e) ** 2
    np.testing.assert_allclose(dot(surface.geometric_normal, normals), 1.0, atol=1e-9)


@pytest.mark.parametrize("precision", ["certified", "float64"])
@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_spawn_origin_neither_hits_itself_nor_leaks_through_a_thin_wall(precision, offset):
    rng = np.random.default_rng(4)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    square = np.array([[-3.0, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]])
    wall = np.concatenate([square, square - [0, 0, 1e-4]]) @ turn.T + offset
    mesh = raytracer.Mesh(wall, [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    scene = raytracer.Scene(meshes=[mesh])
    caster = raytracer.build(scene, precision)
    count = 500
    target = (np.c_[rng.uniform(-2, 2, (count, 2)), np.zeros(count)] @ turn.T) + offset
    away = turn[:, 2] * np.sign(turn[:, 2] @ turn[:, 2])
    origins = target + 5.0 * away + rng.normal(size=(count, 3))
    rays = make_rays(origins, target - origins)
    hits = caster.closest_hit(rays.origins, rays.directions)
    assert hits.hit.all()
    features = derive_features(scene)
    surface = make_surface(make_surface_tables(scene, caster.geometry, features.smooth_normals, False), rays, hits)
    outward = rng.normal(size=(count, 3))
    outward *= np.sign(outward @ away)[:, None]
    assert not caster.any_hit(spawn_origin(surface, outward), outward).any()
    inward = rays.directions
    through = caster.closest_hit(spawn_origin(surface, inward), inward)
    assert (through.primitive >= 2).all()  # the back of the wall, and never the front again


@pytest.mark.parametrize("precision", ["certified", "float64"])
def test_spawn_origin_leaves_a_sphere_of_any_size(precision):
    rng = np.random.default_rng(5)
    for centre, radius in (([0.0, 0, 0], 1.0), ([1e6, 2e6, 0], 0.05), ([0, 0, -1e6], 1e6)):
        scene = raytracer.Scene(spheres=[raytracer.Spheres([centre], [radius])])
        caster = raytracer.build(scene, precision)
        normals = rng.normal(size=(300, 3))
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        origins = np.array(centre) + 3 * radius * normals
        rays = make_rays(origins, -normals + 0.1 * rng.normal(size=(300, 3)))
        hits = caster.closest_hit(rays.origins, rays.directions)
        rays, hits = rays.select(hits.hit), hits.select(hits.hit)
        surface = make_surface(make_surface_tables(scene, caster.geometry, False, False), rays, hits)
        away = rng.normal(size=(len(rays), 3))
        away *= np.sign(dot(away, surface.geometric_normal))[:, None]
        assert not caster.any_hit(spawn_origin(surface, away), away).any()


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_make_surface_normals_follow_the_inverse_transpose_also_in_mirrored_instances(mirror):
    rng = np.random.default_rng(6)
    matrix = np.eye(4)
    matrix[:3, :3] = rng.normal(size=(3, 3))
    matrix[:3, :3] *= mirror * np.sign(np.linalg.det(matrix[:3, :3]))
    corner_normals = rng.normal(size=(3, 3))
    corner_normals /= np.linalg.norm(corner_normals, axis=1)[:, None]
    mesh = raytracer.Mesh(RIGHT_TRIANGLE, [[0, 1, 2]], normals=corner_normals)
    scene = raytracer.Scene(meshes=[mesh], instances=raytracer.Instances([0], [matrix]))
    surface = surface_of(scene, hits_at([[0.2, 0.3]]))
    turned = np.linalg.inv(matrix[:3, :3]).T

    def unit(v):
        return v / np.linalg.norm(v)

    np.testing.assert_allclose(surface.geometric_normal[0], unit(turned @ [0, 0, 1.0]), atol=1e-12)
    smooth = unit(0.5 * corner_normals[0] + 0.2 * corner_normals[1] + 0.3 * corner_normals[2])
    np.testing.assert_allclose(surface.shading_normal[0], unit(turned @ smooth), atol=1e-12)


def test_make_surface_without_smooth_normals_shares_one_array():
    scene = raytracer.Scene(meshes=[raytracer.Mesh(RIGHT_TRIANGLE, [[0, 1, 2]])])
    surface = surface_of(scene, hits_at([[0.2, 0.2]]))
    assert surface.shading_normal is surface.geometric_normal
    assert surface.uv is None


def test_make_surface_tells_the_front_from_the_back():
    scene = raytracer.Scene(meshes=[raytracer.Mesh(RIGHT_TRIANGLE, [[0, 1, 2]])])
    assert surface_of(scene, hits_at([[0.2, 0.2]]), directions=(0, 0, -1)).front.all()
    assert not surface_of(scene, hits_at([[0.2, 0.2]]), directions=(0, 0, 1)).front.any()


def test_make_surface_gathers_materials_and_uvs_of_meshes_instances_and_spheres():
    uvs = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0]])
    first = raytracer.Mesh(RIGHT_TRIANGLE, [[0, 1, 2], [0, 2, 1]], material=[2, 1], uvs=uvs)
    second = raytracer.Mesh(RIGHT_TRIANGLE, [[0, 1, 2]], material=3)
    scene = raytracer.Scene(
        meshes=[second, first],
        instances=raytracer.Instances([1, 0, 1], [np.eye(4)] * 3),
        spheres=[
            raytracer.Spheres([[0, 0, 0]], [1.0], material=4),
            raytracer.Spheres(np.zeros((2, 3)), [1, 1], [0, 5]),
        ],
        materials=[raytracer.Material()] * 6,
    )
    for instance, primitive, material in ((0, 1, 1), (1, 0, 3), (2, 0, 2), (3, 0, 4), (4, 0, 0), (4, 1, 5)):
        surface = surface_of(scene, hits_at([[0.25, 0.5]], instance, primitive), uvs=True)
        assert surface.material[0] == material
        has_uv = instance in (0, 2)
        weights = [0.25, 1.0] if primitive == 0 else [0.5, 0.5]
        np.testing.assert_allclose(surface.uv[0], weights if has_uv else [np.nan, np.nan])


def test_make_surface_normal_of_a_tiny_triangle_does_not_underflow():
    scene = raytracer.Scene(meshes=[raytracer.Mesh(np.array(RIGHT_TRIANGLE) * 1e-200, [[0, 1, 2]])])
    surface = surface_of(scene, hits_at([[0.2, 0.2]]))
    np.testing.assert_array_equal(surface.geometric_normal, [[0, 0, 1]])
    corners = world_corners(pack_geometry(scene), np.zeros(1, np.int32), np.zeros(1, np.int32))
    assert corners[1][0, 0] == 1e-200


def test_make_surface_is_the_same_with_and_without_a_table_of_triangles(monkeypatch):
    """Scenes of many triangles have no table; every number is the same bit for bit."""
    rng = np.random.default_rng(8)
    mesh = raytracer.Mesh(rng.normal(size=(90, 3)), np.arange(90).reshape(30, 3))
    matrices = np.tile(np.eye(4), (3, 1, 1))
    matrices[:, :3] = rng.normal(size=(3, 3, 4))
    scene = raytracer.Scene(meshes=[mesh], instances=raytracer.Instances([0, 0, 0], matrices))
    caster = raytracer.build(scene)
    rays = make_rays(rng.normal(size=(2000, 3)), rng.normal(size=(2000, 3)))
    hits = caster.closest_hit(rays.origins, rays.directions)
    rays, hits = rays.select(hits.hit), hits.select(hits.hit)
    assert len(hits) > 500
    surfaces = []
    for limit in (90, 89):
        monkeypatch.setattr(surface_tables, "LARGEST_TABLE", limit)
        tables = make_surface_tables(scene, caster.geometry, False, False, roundoff=caster.roundoff)
        assert (tables.triangles is None) == (limit == 89)
        surfaces.append(make_surface(tables, rays, hits))
    for name in ("position", "position_error", "geometric_normal"):
        np.testing.assert_array_equal(getattr(surfaces[0], name), getattr(surfaces[1], name))


@pytest.mark.parametrize("precision", ["certified", "float64", "float32"])
@pytest.mark.parametrize("scale", [1.0, 1e6])
def test_rays_leaving_a_convex_mesh_do_not_meet_it_again(rng, precision, scale):
    """In every precision: with bounds of float64, half of the rays of float32 were blocked by their own triangle."""
    positions, triangles = meshes.make_icosphere(3)
    scene = raytracer.Scene(meshes=[raytracer.Mesh(positions * scale + scale, triangles)])
    caster = raytracer.build(scene, precision)
    origins = (positions[rng.integers(len(positions), size=2000)] * 3 + 1) * scale
    directions = scale * (1 + 0.9 * rng.uniform(-0.5, 0.5, (2000, 3))) - origins
    rays = make_rays(origins, directions)
    hits = caster.closest_hit(origins, directions)
    rays, hits = rays.select(hits.hit), hits.select(hits.hit)
    tables = make_surface_tables(scene, caster.geometry, False, False, roundoff=caster.roundoff)
    points = make_surface(tables, rays, hits)
    away = points.geometric_normal + 0.9 * rng.uniform(-0.5, 0.5, (len(rays), 3))
    assert len(rays) > 1000
    assert caster.any_hit(spawn_origin(points, away), away).sum() == 0
