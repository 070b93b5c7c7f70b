"""Emissive meshes with several instances: picked by instance and triangle as if all triangles were listed."""

import tracemalloc

import numpy as np
import pytest

import raytracer
from raytracer.casting.geometry import Kind, pack_geometry, world_corners
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.lights.emitter_table import locate_emitters, make_emitters
from raytracer.lights.emitters import emitter_density, pick_emitters, sample_picked
from raytracer.scene.materials import Closure, Material
from raytracer.surfaces.surface_tables import make_surface_tables
from tests.raytracer.lights.test_lights import polygon_irradiance, surface_points

EPSILON = np.finfo(np.float64).eps
RADIANCE = np.array([[1.0, 1.0, 1.0], [0.0, 0.0, 0.0], [5.0, 0.0, 1.0]])
STRETCHES = {"turned": 0.0, "stretched": 1.0}


def make_matrices(rng, count, stretch):
    """Return matrices that turn, mirror, scale and move; and stretch, each in its own way."""
    matrices = np.tile(np.eye(4), (count, 1, 1))
    for matrix in matrices:
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        matrix[:3, :3] = rng.uniform(0.5, 2.0) * turn @ (np.eye(3) + stretch * np.diag(rng.uniform(-0.9, 2.0, 3)))
        matrix[:3, 3] = rng.uniform((-4.0, -4.0, 5.0), (4.0, 4.0, 13.0))
    return matrices


def make_scene(stretch):
    """Return two meshes with several instances, one with one, and spheres; materials 0 and 2 shine."""
    rng = np.random.default_rng(4)
    meshes = [
        raytracer.Mesh(rng.normal(size=(3 * count, 3)), np.arange(3 * count).reshape(-1, 3), material=material)
        for count, material in ((20, np.arange(20) % 3), (7, 0), (5, 2), (4, 1))
    ]
    order = [0, 1, 0, 2, 3, 1, 0, 3, 0]
    instances = raytracer.Instances(order, make_matrices(rng, len(order), stretch))
    balls = raytracer.Spheres(rng.normal(size=(3, 3)) + np.array([4, 0, 9]), [0.2, 0.3, 0.4], material=2)
    return raytracer.Scene(meshes=meshes, instances=instances, spheres=[balls], materials=[raytracer.Material()] * 3)


def make_tables(scene):
    return make_surface_tables(scene, pack_geometry(scene), False, False)


def measure_areas(tables, instance, primitive):
    flat = tables.geometry.belongs_to_kind(instance, Kind.TRIANGLE)
    a, b, c = world_corners(tables.geometry, instance[flat], primitive[flat])
    areas = np.empty(len(instance))
    areas[flat] = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    areas[~flat] = 4 * np.pi * tables.geometry.radii[primitive[~flat]] ** 2
    return areas


@pytest.fixture(params=STRETCHES)
def tables(request):
    return make_tables(make_scene(STRETCHES[request.param]))


def list_shining(tables):
    """Return (instance, primitive) of all that shines, and the share of the power of each."""
    listed = make_emitters(tables, RADIANCE)
    assert listed.instanced is None
    shares = np.diff(listed.cumulative, prepend=0.0)
    return listed.instance, listed.primitive, shares


def test_instances_are_picked_in_the_order_and_share_of_listed_triangles():
    """Where matrices are similarities a uniform number picks the same triangle in both ways, but for rounding."""
    tables = make_tables(make_scene(0.0))
    listed, instanced = make_emitters(tables, RADIANCE), make_emitters(tables, RADIANCE, largest=0)
    assert instanced.instanced is not None
    assert len(instanced.instance) == 5 + 3  # the mesh with one instance, and the spheres
    choice = np.random.default_rng(1).random(20000)
    rows = pick_emitters(listed, choice)
    instance, primitive = locate_emitters(instanced, pick_emitters(instanced, choice))
    np.testing.assert_array_equal(instance, listed.instance[rows])
    np.testing.assert_array_equal(primitive, listed.primitive[rows])
    assert set(instanced.records) == set(listed.records)


def test_instances_are_picked_with_the_density_that_is_reported(tables):
    """Even steps of the number: how many fall on a primitive is its probability times their count, to within one."""
    emitters, count = make_emitters(tables, RADIANCE, largest=0), 100_000
    picked = pick_emitters(emitters, (np.arange(count) + 0.5) / count)
    instance, primitive, _ = list_shining(tables)
    found = np.stack(locate_emitters(emitters, picked), axis=1)
    assert set(map(tuple, found)) == set(zip(instance.tolist(), primitive.tolist(), strict=True))
    keys, counts = np.unique(found, axis=0, return_counts=True)
    # From straight above the middle of a triangle at a metre the density per solid angle is that per area.
    flat = keys[:, 0] < len(tables.geometry.instance_mesh)
    a, b, c = world_corners(tables.geometry, *keys[flat].T)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    density = emitter_density(emitters, (a + b + c) / 3 + normal, -normal, *keys[flat].T)
    shares = density * measure_areas(tables, *keys[flat].T)
    assert np.abs(counts[flat] - count * shares).max() < 1.0 + count * 1e3 * EPSILON
    spheres = list_shining(tables)[2][instance >= len(tables.geometry.instance_mesh)]
    np.testing.assert_allclose(shares.sum() + spheres.sum(), 1.0, rtol=len(shares) * 1e3 * EPSILON)


def test_instances_report_the_same_density_to_rays_that_meet_them(tables):
    emitters, count = make_emitters(tables, RADIANCE, largest=0), 4000
    rng = np.random.default_rng(5)
    surface = surface_points(rng.normal(size=(count, 3)))
    picked = pick_emitters(emitters, rng.random(count))
    samples = sample_picked(emitters, surface, picked, rng.random((count, 2)))
    density = emitter_density(emitters, surface.position, samples.direction, *locate_emitters(emitters, picked))
    # The plane's cosine divides twice, and its rounding with it: none is below 1e-4.
    np.testing.assert_allclose(density, samples.density, rtol=16 * EPSILON * 1e8)


def test_instances_light_as_lamberts_formula(tables):
    """Against the sum of the closed forms of all triangles and spheres, within four standard errors (below 1%)."""
    emitters, count = make_emitters(tables, RADIANCE, largest=0), 400_000
    rng = np.random.default_rng(6)
    picked = pick_emitters(emitters, rng.random(count))
    samples = sample_picked(emitters, surface_points(np.zeros((count, 3))), picked, rng.random((count, 2)))
    values = samples.weight * np.maximum(samples.direction[:, 2:], 0.0)
    instance, primitive, _ = list_shining(tables)
    expected = np.zeros(3)
    for one, other in zip(instance, primitive, strict=True):
        radiance = RADIANCE[tables.material[tables.material_first[one] + tables.material_step[one] * other]]
        if one < len(tables.geometry.instance_mesh):
            corners = np.concatenate(world_corners(tables.geometry, np.array([one]), np.array([other])))
            assert (corners[:, 2] > 0).all()
            expected += np.abs(polygon_irradiance(np.zeros(3), corners, 1.0)) * radiance
        else:
            centre, radius = tables.geometry.centres[other], tables.geometry.radii[other]
            expected += np.pi * radius**2 * centre[2] / np.linalg.norm(centre) ** 3 * radiance
    error = values.std(axis=0) / np.sqrt(count)
    assert (error < 0.01 * expected).all()
    assert (np.abs(values.mean(axis=0) - expected) < 4 * error).all()


def test_instances_whose_radiance_varies_share_samples_like_listed_triangles():
    """Programs whose radiance is that of their material: the estimate is the same in both ways."""
    tables = make_tables(make_scene(1.0))
    radiance = RADIANCE.copy()
    radiance[2] = np.nan

    def find_radiance(surface, path):
        assert (surface.material == 2).all()
        return np.full((len(surface), 3), 7.0)

    listed = make_emitters(tables, radiance, find_radiance)
    instanced = make_emitters(tables, radiance, find_radiance, largest=0)
    np.testing.assert_allclose(instanced.power, listed.power, rtol=100 * EPSILON)
    np.testing.assert_allclose(instanced.power_density, listed.power_density, rtol=100 * EPSILON)


def test_meshes_without_instances_are_listed():
    tables = make_tables(make_scene(0.0))
    present = np.zeros(10, dtype=np.bool_)
    present[[0, 1, 3, 9]] = True  # one instance of each mesh
    assert make_emitters(tables, RADIANCE, present=present, largest=0).instanced is None


def make_ball(rings=16, sides=32):
    """Return a sphere of about 2 rings x sides triangles."""
    polar, turn = np.pi * np.arange(rings + 1) / rings, 2 * np.pi * np.arange(sides) / sides
    positions = np.stack(
        [
            np.outer(np.sin(polar), np.cos(turn)),
            np.outer(np.sin(polar), np.sin(turn)),
            np.outer(np.cos(polar), 0 * turn + 1),
        ],
        axis=-1,
    ).reshape(-1, 3)
    row, side = np.meshgrid(np.arange(rings), np.arange(sides), indexing="ij")
    a, b = row * sides + side, row * sides + (side + 1) % sides
    triangles = np.concatenate([np.stack([a, a + sides, b], -1), np.stack([b, a + sides, b + sides], -1)])
    return raytracer.Mesh(positions, triangles.reshape(-1, 3), material=1)


def make_picture_scene(meshes, mesh, count):
    """Return a floor below balls that shine, which `mesh` tells."""
    matrices = np.tile(np.eye(4), (count + 1, 1, 1))
    for number, matrix in enumerate(matrices[1:]):
        matrix[:3, :3] *= 0.1 + 0.1 * (number % 3)
        matrix[:3, 3] = (number % 9 - 4, number // 9 - 4, 0.5)
    floor = raytracer.Mesh([(-6, -6, 0), (6, -6, 0), (6, 6, 0), (-6, 6, 0)], [(0, 1, 2), (0, 2, 3)], material=0)
    floor_material = Material((Closure("glossy", roughness=0.3), Closure("diffuse", weight=0.5)))
    world_from_camera = np.eye(4)
    world_from_camera[:3, 3] = (0, 0, 9)
    return raytracer.Scene(
        meshes=[floor, *meshes],
        instances=raytracer.Instances([0, *mesh], matrices),
        materials=[floor_material, Material((Closure("emission", color=2.0),))],
        camera=raytracer.Camera(world_from_camera),
    )


def test_picture_with_instances_is_that_of_as_many_meshes():
    ball, count = make_ball(), 72
    assert count * len(ball.triangles) > 1 << 16
    pictures = []
    for meshes, mesh in (([ball], np.ones(count)), ([ball] * count, np.arange(count) + 1)):
        scene = make_picture_scene(meshes, mesh.astype(np.int32), count)
        integrator = prepare(scene, raytracer.build(scene), Settings())
        assert (integrator.emitters.instanced is None) == (len(meshes) > 1)
        pictures.append(raytracer.render(scene, 24, 16, 2, integrator="path")["Combined"])
    assert pictures[0][..., :3].max() > 1.0
    np.testing.assert_allclose(*pictures, rtol=np.finfo(np.float32).eps)


def test_instances_take_the_memory_of_their_mesh():
    ball, count = make_ball(), 600
    matrices = make_matrices(np.random.default_rng(7), count, 1.0)
    scene = raytracer.Scene(
        meshes=[ball], instances=raytracer.Instances([0] * count, matrices), materials=[raytracer.Material()] * 2
    )
    tables = make_tables(scene)
    tracemalloc.start()
    try:
        make_emitters(tables, RADIANCE[[1, 0]])
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # One triangle that is listed holds 9 float64 in its corners alone: 44 MB.
    assert peak < count * len(ball.triangles) * 9 * 8 / 4
