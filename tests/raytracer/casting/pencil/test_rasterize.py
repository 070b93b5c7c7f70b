"""Rays that share a point or a direction: projection finds every candidate; results are brute force's, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.casting.brute_force import offer_all
from raytracer.casting.pencil.pencil import find_pencil, make_views
from raytracer.casting.pencil.projection import project
from raytracer.casting.pencil.rasterize import offer_projected
from raytracer.casting.pencil.screen import Screen
from raytracer.casting.query import Query
from raytracer.casting.rays import make_rays
from tests import meshes
from tests.oracle.judging import assert_same_hits, judge, mesh_scene


def place(mesh, scale=1.0, offset=(0.0, 0.0, 0.0)):
    return mesh[0] * scale + offset, mesh[1]


def make_room():
    """A closed room with a torus and two spheres in it."""
    torus = raytracer.Mesh(*place(meshes.make_torus(10, 6), 0.3, (0.2, -0.1, -0.4)))
    room = raytracer.Mesh(*meshes.make_cube(1.0))
    spheres = raytracer.Spheres([(-0.5, 0.4, -0.6), (0.5, 0.5, 0.4)], [0.3, 0.2])
    return raytracer.Scene(meshes=[room, torus], spheres=[spheres])


def make_turned_instances():
    matrices = np.tile(np.eye(4), (3, 1, 1))
    matrices[1, :3, :3] = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0] * (0.5, 1.0, -2.0)
    matrices[1, :3, 3], matrices[2, :3, 3] = (2.0, 0.0, 0.5), (-1.0, 1.0, 0.0)
    mesh = raytracer.Mesh(*meshes.make_icosphere(1))
    return raytracer.Scene(meshes=[mesh], instances=raytracer.Instances([0, 0, 0], matrices))


SCENES = {
    "room": make_room,
    "icosphere": lambda: mesh_scene(meshes.make_icosphere(2)),
    "instances": make_turned_instances,
    "needle lens": lambda: mesh_scene(meshes.make_needle_lens()),
    "shells": lambda: mesh_scene(
        *[place(meshes.make_icosphere(1), scale) for scale in (1.0, np.nextafter(1.0, 2.0), 0.5)]
    ),
    "dust": lambda: mesh_scene(*[place(meshes.make_icosphere(1), 2e-15, (0.3, 0.1 * k, 0.2)) for k in range(5)]),
    "far away": lambda: mesh_scene(place(meshes.make_torus(8, 6), 1.0, (1e6, -1e6, 2e6))),
    "tiny": lambda: mesh_scene(place(meshes.make_icosphere(1), 1e-30)),
    "huge": lambda: mesh_scene(place(meshes.make_icosphere(1), 1e30)),
}


def describe_extent(scene):
    """Centre and size of everything in a scene, and its corners (k, 3)."""
    caster = raytracer.build(scene)
    corners = caster.primitives.corners.reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    return (low + high) / 2, float((high - low).max()), corners


def make_targets(rng, scene, count):
    """Points (count, 3): corners, points of edges and of faces, and points anywhere."""
    centre, size, corners = describe_extent(scene)
    triangles = corners.reshape(-1, 3, 3)
    weights = rng.dirichlet(np.ones(3), size=count)
    weights[: count // 3] = np.eye(3)[rng.integers(3, size=count // 3)]
    weights[count // 3 : count // 2, 2] = 0.0
    points = np.einsum("nk,nki->ni", weights, triangles[rng.integers(len(triangles), size=count)])
    anywhere = slice(3 * count // 4, None)
    points[anywhere] = centre + size * rng.uniform(-1, 1, size=points[anywhere].shape)
    return points


def make_point(rng, scene, where):
    centre, size, corners = describe_extent(scene)
    if where == "corner":
        return corners[len(corners) // 2]
    return centre + size * np.array({"inside": (0.11, -0.07, 0.05), "outside": (1.3, -2.1, 0.7)}[where])


def compare_with_brute_force(scene, origins, directions, t_min=0.0, t_max=np.inf):
    """Cast by projection and by brute force; return the hits. Fails if the rays are not taken for a pencil."""
    caster = raytracer.build(scene)
    projecting, brute = (
        replace(caster, offer=None, smallest_pencil=0),
        replace(caster, offer=offer_all, smallest_pencil=None),
    )
    arguments = origins, directions, t_min, t_max
    hits, true = projecting.closest_hit(*arguments), brute.closest_hit(*arguments)
    assert_same_hits(hits, true)
    np.testing.assert_array_equal(projecting.any_hit(*arguments), true.hit)
    return hits


@pytest.mark.parametrize("where", ["inside", "outside", "corner"])
@pytest.mark.parametrize("name", SCENES)
def test_rays_from_a_point_hit_what_brute_force_hits(rng, name, where):
    scene = SCENES[name]()
    point = make_point(rng, scene, where)
    directions = make_targets(rng, scene, 900) - point
    directions = directions[(directions != 0).any(axis=1)]
    origins = np.tile(point, (len(directions), 1))
    hits = compare_with_brute_force(scene, origins, directions)
    assert hits.hit.sum() > 100 or where == "corner"
    compare_with_brute_force(scene, origins, directions, 0.5, rng.uniform(0.5, 1.5, len(directions)))
    # Ranges that end, or begin, with the hit as computed.
    met = np.flatnonzero(hits.hit)
    arguments = origins[met], directions[met]
    compare_with_brute_force(scene, *arguments, 0.0, hits.distance[met])
    compare_with_brute_force(scene, *arguments, hits.distance[met], np.inf)


@pytest.mark.parametrize("where", ["inside", "outside", "corner"])
@pytest.mark.parametrize("name", SCENES)
def test_rays_to_a_point_are_blocked_as_by_brute_force(rng, name, where):
    """Shadow rays, with directions of length one as a renderer casts them; their ends differ by roundings."""
    scene = SCENES[name]()
    point = make_point(rng, scene, where)
    origins = make_targets(rng, scene, 900)
    directions = point - origins
    distance = np.linalg.norm(directions / np.abs(directions).max(), axis=1) * np.abs(directions).max()
    apart = distance > 1e-3 * distance.max()
    origins, directions, distance = origins[apart], (directions[apart].T / distance[apart]).T, distance[apart]
    compare_with_brute_force(scene, origins, directions, 0.0, distance)
    compare_with_brute_force(scene, origins, directions, distance * 1e-9, distance)
    # To a point within a lamp: they end before it, on the lamp's surface.
    compare_with_brute_force(scene, origins, point - origins, 0.0, rng.uniform(0.2, 1.0, len(origins)))


def test_rays_to_a_point_meet_what_is_nearer_to_it_than_their_ends(rng):
    """Rays that end at the corners of a mesh no larger than the scatter of their ends."""
    lamp, triangles = place(meshes.make_icosphere(1), 1e-9, (0.1, 0.2, 0.3))
    scene = mesh_scene((lamp, triangles), place(meshes.make_cube(0.2), 1.0, (0.0, 0.0, -1.0)))
    origins = rng.normal(size=(500, 3)) * (1.0, 1.0, 0.2) + (0.0, 0.0, 2.0)
    directions = lamp[rng.integers(len(lamp), size=500)] - origins
    pencil = find_pencil(make_rays(origins, directions, 0.0, 1.0))
    assert pencil.spread > 1e-10
    hits = compare_with_brute_force(scene, origins, directions, 0.0, 1.0)
    assert hits.hit.mean() > 0.5


@pytest.mark.parametrize("heading", [(0.0, 0.0, -1.0), (0.0, 2.0, 0.0), (0.3, -0.5, 0.7), (1.0, 1e-9, 0.0)])
@pytest.mark.parametrize("name", SCENES)
def test_parallel_rays_hit_what_brute_force_hits(rng, name, heading):
    scene = SCENES[name]()
    heading = np.array(heading)
    size = describe_extent(scene)[1]
    origins = make_targets(rng, scene, 600) - heading * size * rng.choice([0.1, 2.0], size=(600, 1))
    directions = np.tile(heading, (600, 1))
    compare_with_brute_force(scene, origins, directions)
    compare_with_brute_force(scene, origins, directions, 0.25 * size, rng.uniform(0.25, 2.0, 600) * size)


def test_camera_rays_of_a_picture_are_exact(rng):
    """A pinhole camera's rows of pixels at a mesh of thousands of triangles, judged by integers; a thousand of them."""
    scene = mesh_scene(meshes.make_icosphere(4))
    x, y = np.meshgrid(np.linspace(-0.35, 0.35, 80), np.linspace(-0.35, 0.35, 80))
    directions = np.stack([x.ravel(), np.ones(x.size), y.ravel()], axis=1)
    origins = np.tile((0.1, -3.0, 0.2), (x.size, 1))
    hits = compare_with_brute_force(scene, origins, directions)
    some = rng.choice(x.size, 1000, replace=False)
    exact = judge(replace(raytracer.build(scene), smallest_pencil=0), origins[some], directions[some])
    np.testing.assert_array_equal(exact.distance, hits.distance[some])


def test_candidates_are_few(rng):
    """What reaches the float64 test is little more than what is hit, in front of a deep stack of meshes."""
    scene = mesh_scene(*[place(meshes.make_icosphere(3), 1.0, (0.0, 2.5 * k, 0.0)) for k in range(6)])
    x, y = np.meshgrid(np.linspace(-0.3, 0.3, 128), np.linspace(-0.3, 0.3, 128))
    directions = np.stack([x.ravel(), np.ones(x.size), y.ravel()], axis=1)
    rays = make_rays((0.0, -4.0, 0.0), directions)
    primitives = raytracer.build(scene).primitives
    offered = []
    query = Query(primitives, rays, any_hit=False)
    query.offer = lambda ray, primitive_id: offered.append(len(ray)) or Query.offer(query, ray, primitive_id)
    [view] = make_views(find_pencil(rays), rays, 1.0)
    offer_projected(view, project(view, primitives), query, slice(0, len(rays)))
    assert sum(offered) < 1.1 * query.closest().hit.sum()


def test_pencils_are_told_apart(rng):
    points = rng.normal(size=(50, 3))
    other = rng.normal(size=(50, 3))
    assert find_pencil(make_rays(points, other)) is None
    assert find_pencil(make_rays(points, other, 0.0, 1.0)) is None
    leaving = find_pencil(make_rays(points[0], other))
    assert not leaving.parallel
    assert not leaving.arriving
    assert find_pencil(make_rays(points, other[0])).parallel
    arriving = find_pencil(make_rays(points, other[0] - points, 0.0, 1.0))
    assert arriving.arriving
    assert 0 < arriving.spread < 1e-14
    ending_before = make_rays(points, other[0] - points, 0.0, rng.uniform(0.5, 1.0, 50))
    np.testing.assert_array_equal(find_pencil(ending_before).reach, 1.0)
    passing_through = make_rays(points, other[0] - points, 0.0, rng.uniform(0.5, 1.5, 50))
    assert find_pencil(passing_through) is None
    # A lamp a thousandth of the distance wide is not a point.
    assert find_pencil(make_rays(points, other[0] + 1e-3 * other - points, 0.0, 1.0)) is None


@pytest.mark.parametrize("everywhere", [False, True])
def test_views_hold_every_ray_once(rng, everywhere):
    directions = rng.normal(size=(1000, 3)) + (0.0 if everywhere else np.array([9.0, -7.0, 8.0]))
    rays = make_rays((1.0, 2.0, 3.0), directions)
    views = list(make_views(find_pencil(rays), rays, 0.5))
    assert len(views) == (6 if everywhere else 1)
    index = np.concatenate([np.arange(len(rays))[view.pick(0, len(view))] for view in views])
    assert sorted(index.tolist()) == list(range(1000))
    for view in views:
        chosen = directions[view.pick(0, len(view))]
        mapped = chosen @ view.matrix.T
        np.testing.assert_allclose(mapped[:, :2] / mapped[:, 2:], view.image.T, atol=2.0**-23)
        assert np.abs(view.image).max() <= 1.0 + 2.0**-23


def test_screen_numbers_cells_tile_by_tile(rng):
    rays = make_rays((0.0, 0.0, 0.0), np.concatenate([rng.uniform(-0.4, 0.4, (5000, 2)), np.ones((5000, 1))], axis=1))
    [view] = make_views(find_pencil(rays), rays, 1.0)
    screen = Screen(view, slice(0, 5000), np.zeros(5000), np.full(5000, np.inf))
    assert sorted(screen.ray.tolist()) == list(range(5000))
    cell = screen.number_cells(screen.find_cells(screen.x, 0), screen.find_cells(screen.y, 1))
    assert (np.diff(cell) >= 0).all()
    np.testing.assert_array_equal(screen.first, np.searchsorted(cell, np.arange(len(screen.first))))
    assert cell.max() < (screen.tiles_x * screen.tiles_y) * 64
