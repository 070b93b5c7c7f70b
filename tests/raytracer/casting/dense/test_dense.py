"""The dense tree gives the hits of the four-wide tree and of brute force, bit for bit, on hard rays and triangles.

Tried: all but a ray's nearest child of the root left out, what is in doubt taken for certain; each turned red.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import raytracer
from raytracer.casting.brute_force import offer_all
from raytracer.casting.bvh.hierarchy import build_hierarchy
from raytracer.casting.bvh.traverse import offer_traversed
from raytracer.casting.dense import offer as dense_offer
from raytracer.casting.dense import tree as dense_tree
from raytracer.casting.dense import walk as dense_walk
from raytracer.casting.dense.offer import DenseOffer
from raytracer.casting.dense.walk import FEW_RAYS, LARGE_ROUND
from tests import meshes
from tests.oracle.judging import assert_same_hits, build_with

OFFSETS = [0.0, 148376.0, 1e6]


def assert_all_agree(mesh, origins, directions, t_min=0.0, t_max=np.inf):
    """Cast with the dense tree, the four-wide one and, where that is not too much, brute force; return the hits."""
    scene = raytracer.Scene(meshes=[raytracer.Mesh(*mesh)])
    dense, other = build_with("dense", scene), build_with("bvh", scene)
    hits = dense.closest_hit(origins, directions, t_min, t_max)
    assert_same_hits(hits, other.closest_hit(origins, directions, t_min, t_max))
    np.testing.assert_array_equal(dense.any_hit(origins, directions, t_min, t_max), hits.hit)
    if len(hits) <= FEW_RAYS:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(dense_walk, "FEW_RAYS", 0)
            patch.setattr(dense_walk, "MANY_RAYS", 10)
            patch.setattr(dense_walk, "TRIED_RAYS", 5)
            assert_same_hits(hits, dense.closest_hit(origins, directions, t_min, t_max))
            np.testing.assert_array_equal(dense.any_hit(origins, directions, t_min, t_max), hits.hit)
    some = np.arange(min(len(hits), 300))
    pick = (np.broadcast_to(values, (len(hits), *np.shape(values)[1:]))[some] for values in (t_min, t_max))
    everything = replace(other, offer=offer_all)
    assert_same_hits(
        hits.select(some),
        everything.closest_hit(np.asarray(origins)[some], np.asarray(directions)[some], *pick),
    )
    return hits


@pytest.mark.parametrize("offset", OFFSETS)
def test_rays_at_vertices_and_edges_of_a_closed_mesh_agree(rng, offset):
    mesh = meshes.make_icosphere(4, centre=(offset, -offset, offset / 3))
    inside = np.add((0.1, 0.2, 0.3), (offset, -offset, offset / 3))
    for origins, directions in (meshes.rays_at_vertices(mesh, inside), meshes.rays_at_edges(mesh, inside, rng, 2000)):
        assert assert_all_agree(mesh, origins, directions).hit.all()
        # From outside, to the point itself: t = 1 is in range or not by an ulp.
        assert_all_agree(mesh, origins + 3 * directions, -directions, 0.0, 2.0)


@pytest.mark.parametrize(
    ("size", "length"),
    [
        (1e-310, 1.0),
        (1e-40, 1e300),
        (1e-30, 1e-300),
        (1e-6, 1.0),
        (1.0, 1e-310),
        (1.0, 1e308),
        (1e12, 1e-300),
        (1e150, 1),
    ],
)
def test_scales_of_scenes_and_directions_agree(rng, size, length):
    positions, triangles = meshes.make_grid(24)
    origins = np.add(positions[:60], (0.013, 0.021, 5.0)) * size
    directions = np.broadcast_to((0.1, 0.05, -1.0), origins.shape) * length
    assert assert_all_agree((positions * size, triangles), origins, directions).hit.any()


def test_grid_in_a_plane_agrees_where_rays_run_in_it_along_it_and_start_on_it(rng):
    grid = meshes.make_grid(24)
    points = grid[0][::5]
    above = np.add(points, (0, 0, 5))
    down = np.broadcast_to((0.0, 0.0, -1.0), points.shape)
    assert assert_all_agree(grid, above, down).hit.all()
    assert assert_all_agree(grid, above, -np.abs(down)).hit.all()
    assert not assert_all_agree(grid, points - (40, 0, 0), np.broadcast_to((1.0, 0.0, 0.0), points.shape)).hit.any()
    assert assert_all_agree(grid, points, rng.normal(size=points.shape)).hit.all()
    assert_all_agree(grid, np.add(points, (0, 0, 1e9)), down)
    assert_all_agree(grid, np.add(points * 50, (0, 0, 1e3)), rng.normal(size=points.shape))


@pytest.mark.parametrize("away", [3.0, 1e4, 1e8, 1e10, 1e13])
def test_origins_from_near_and_far_agree(rng, away):
    """Beyond some 1e8 sizes nothing is culled; before, origins are moved to the scene."""
    mesh = meshes.make_icosphere(4)
    positions = mesh[0]
    # Integers decide the farthest, which takes milliseconds each.
    count = 600 if away < 1e8 else 60
    origins = rng.normal(size=(count, 3)) * away
    targets = positions[rng.integers(len(positions), size=count)] + rng.choice([0, 1e-3, 1e-9], (count, 1))
    assert assert_all_agree(mesh, origins, targets - origins).hit.any()
    # Past it, away from it, and to where the range ends just about at the surface.
    assert_all_agree(mesh, origins, rng.normal(size=(count, 3)) * away)
    assert_all_agree(mesh, origins, origins)
    assert_all_agree(mesh, origins, targets - origins, 0.0, 1.0)


def test_large_triangles_and_rays_that_pass_the_scene_agree(rng):
    """Walls are in no block; far rays beside them and away from them must not meet them."""
    room, soup = meshes.make_cube(3.0), meshes.make_soup(rng, 900, 0.1)
    mesh = meshes.join_meshes([room, soup])
    scene = raytracer.Scene(meshes=[raytracer.Mesh(*mesh)])
    tree = dense_tree.build_dense_tree(*_corners_of(scene))
    assert set(tree.large) == set(range(12))
    inside = rng.uniform(-2.9, 2.9, (800, 3))
    assert assert_all_agree(mesh, inside, rng.normal(size=inside.shape)).hit.all()
    # Enough of them: their lines cross the scene behind them, or pass beside it.
    far = rng.normal(size=(800, 3)) * 60
    assert_all_agree(mesh, far, far + rng.normal(size=far.shape))
    assert_all_agree(mesh, far, np.roll(far, 1, axis=1) * (1, -1, 1))


def _corners_of(scene):
    primitives = raytracer.build(scene).primitives
    return primitives.corners, primitives.bounds


def test_needles_and_degenerate_triangles_agree(rng):
    positions, triangles = meshes.make_icosphere(4)
    flat = positions * (1, 1, 1e-6)
    assert_all_agree(
        (flat, triangles), rng.uniform(-2, 2, (800, 3)) * (1, 1, 1e-5), rng.normal(size=(800, 3)) * (1, 1, 1e-5)
    )
    some = rng.integers(0, len(triangles), 300)
    triangles = triangles.copy()
    triangles[some[:100], 2] = triangles[some[:100], 1]
    triangles[some[100:200]] = triangles[some[100:200], :1]
    positions = positions.copy()
    positions[triangles[some[200:], 2]] = positions[triangles[some[200:], :2]].mean(axis=1)
    origins = rng.uniform(-2, 2, (900, 3))
    targets = positions[triangles[np.tile(some, 3)]].mean(axis=1)
    assert_all_agree((positions, triangles), origins, targets - origins)
    lens = meshes.make_needle_lens(aspect=1e7)
    assert assert_all_agree(lens, *meshes.rays_at_vertices(lens, (0.05, 0.02, 0.01))).hit.all()


def test_ties_go_to_the_lowest_triangle(rng):
    """Every triangle three times, in different blocks."""
    positions, triangles = meshes.make_icosphere(3)
    mesh = positions, np.concatenate([triangles, triangles[::-1], triangles])
    hits = assert_all_agree(mesh, *meshes.rays_at_edges((positions, triangles), (0.1, 0.2, 0.3), rng, 800))
    assert hits.hit.all()
    assert (hits.primitive < len(triangles)).all()


def test_ranges_agree(rng):
    mesh = meshes.make_torus()
    origins, directions = meshes.random_rays(rng, 3000)
    hits = assert_all_agree(mesh, origins, directions)
    t = np.where(hits.hit, hits.distance, 1.0)
    for t_min, t_max in (
        (t, np.inf),
        (np.nextafter(t, np.inf), np.inf),
        (0.0, t),
        (0.0, np.nextafter(t, 0.0)),
        (t, t),
        (2.0, 1.0),
        (rng.uniform(0, 2, len(t)), rng.uniform(0, 4, len(t))),
        (5e-324, 1e-320),
        (1e300, 1e308),
    ):
        assert_all_agree(mesh, origins, directions, t_min, t_max)


def test_zero_components_agree(rng):
    mesh = meshes.make_icosphere(4)
    origins, directions = meshes.random_rays(rng, 2000)
    directions[:800, 0], directions[400:1200, 1], directions[1000:1400, 2] = 0.0, -0.0, 1e-310
    origins[::3] = np.round(origins[::3], 1)
    assert assert_all_agree(mesh, origins, directions).hit.any()


@pytest.mark.parametrize("count", [1, 2, 25, 40, 129, 600, 5000])
def test_trees_of_any_size_agree(rng, count):
    """One block, one level, two, three; blocks that are not full."""
    mesh = meshes.make_soup(rng, count, 2.0 / count ** (1 / 3))
    origins, directions = meshes.random_rays(rng, 1000)
    assert_all_agree(mesh, origins, directions)


def test_batch_equals_its_single_rays(rng):
    scene = raytracer.Scene(meshes=[raytracer.Mesh(*meshes.make_torus())])
    caster = build_with("dense", scene)
    origins, directions = meshes.random_rays(rng, 300)
    together = caster.closest_hit(origins, directions, 0.5, 3.0)
    for ray in range(len(origins)):
        assert_same_hits(together.select([ray]), caster.closest_hit(origins[ray], directions[ray], 0.5, 3.0))
        assert caster.any_hit(origins[ray], directions[ray], 0.5, 3.0)[0] == together.hit[ray]


def test_rays_are_culled(rng):
    """Not all that is offered: a tenth of the blocks a ray, and little that `query` must decide."""
    caster = build_with("dense", raytracer.Scene(meshes=[raytracer.Mesh(*meshes.make_icosphere(5))]))
    tree = dense_tree.build_dense_tree(caster.primitives.corners, caster.primitives.bounds)
    opened, offered = [], []
    rays = meshes.random_rays(rng, 4000)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(raytracer.casting.dense.walk.Walk, "_open_blocks", _counting(opened))
        patch.setattr(raytracer.casting.query.Query, "offer", lambda self, ray, item: offered.append(len(ray)) or ray)
        caster.closest_hit(*rays)
    assert sum(opened) < 0.05 * 4000 * len(tree.items)
    assert sum(offered) < 0.02 * 4000


def _counting(opened):
    original = raytracer.casting.dense.walk.Walk._open_blocks

    def count(walk, pairs):
        opened.append(len(pairs.row))
        original(walk, pairs)

    return count


def test_dense_tree_is_built_by_the_first_large_batch(rng, monkeypatch):
    """Scenes of many triangles with only pencils, crossings or a few rays do not pay for it."""
    monkeypatch.setattr(dense_offer, "SMALLEST_BATCH", 50)
    monkeypatch.setattr(dense_offer, "FEW_TRIANGLES", 0)
    caster = raytracer.build(raytracer.Scene(meshes=[raytracer.Mesh(*meshes.make_torus())]))
    assert isinstance(caster.offer, DenseOffer)
    assert caster.offer.other.latest is None
    origins, directions = meshes.random_rays(rng, 50)
    few = caster.closest_hit(origins[:49], directions[:49])
    caster.crossings(origins, directions)
    assert caster.offer.built is None
    many = caster.closest_hit(origins, directions)
    assert caster.offer.built is not None
    assert_same_hits(many.select(slice(0, 49)), few)


def test_few_triangles_are_in_a_dense_tree_whatever_the_batch():
    """It is built as quickly as the other, and quicker for one ray as well."""
    caster = raytracer.build(raytracer.Scene(meshes=[raytracer.Mesh(*meshes.make_torus())]))
    caster.closest_hit((3.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
    assert caster.offer.built is not None
    assert caster.offer.other.latest is None


@pytest.mark.parametrize("stopped", [False, True])
def test_rays_go_on_in_order_where_some_that_are_tried_are_stopped(rng, monkeypatch, stopped):
    mesh = meshes.make_icosphere(5)
    caster = build_with("dense", raytracer.Scene(meshes=[raytracer.Mesh(*mesh)]))
    monkeypatch.setattr(dense_walk, "MANY_RAYS", 2000)
    monkeypatch.setattr(dense_walk, "TRIED_RAYS", 100)
    starts = rng.normal(size=(2000, 3))
    starts *= 1.001 / np.linalg.norm(starts, axis=1, keepdims=True)
    opened = []
    open_blocks = dense_walk.Walk._open_blocks
    monkeypatch.setattr(
        dense_walk.Walk, "_open_blocks", lambda walk, pairs: (opened.append(len(pairs.row)), open_blocks(walk, pairs))
    )
    found = caster.any_hit(starts, rng.normal(size=(2000, 3)) * 0.1 + (-starts if stopped else starts))
    assert np.mean(found) > 0.9 if stopped else np.mean(found) < 0.1
    some, at_once, others = opened[0], opened[2], sum(opened[3:])
    assert 0 < some < 0.15 * sum(opened)
    # In order: rays that their nearest block stops open no others.
    assert others > 0 if stopped else others == 0
    assert sum(opened) < 1.5 * at_once if stopped else sum(opened) == some + at_once


def test_rays_that_large_triangles_stop_go_no_further(rng, monkeypatch):
    """Any hit: each wall behind the first few is tested with what is left, and the tree is entered by no ray."""
    walls = np.concatenate([[(-9, -9, z), (9, -9, z), (0, 9, z)] for z in np.linspace(1, 2, 20)])
    crumbs = rng.uniform((-0.01, -0.01, 2.99), (0.01, 0.01, 3.01), (900, 3))
    triangles = np.arange(len(walls) + len(crumbs)).reshape(-1, 3)
    tested, original = [], dense_walk.cross_triangles
    monkeypatch.setattr(dense_walk, "cross_triangles", lambda *args: tested.append(args[0].shape) or original(*args))
    caster = raytracer.build(raytracer.Scene(meshes=[raytracer.Mesh(np.concatenate([walls, crumbs]), triangles)]))
    origins = rng.uniform(-0.1, 0.1, (100, 3))
    assert caster.any_hit(origins, (0, 0, 1)).all()
    assert len(caster.offer.built.tree.large) == 20
    assert [shape[1] // 3 for shape in tested] == [LARGE_ROUND]
    tested.clear()
    blocked = caster.any_hit(origins, (0, 0, 1), 0.0, 1.5)
    np.testing.assert_array_equal(blocked, caster.closest_hit(origins, (0, 0, 1), 0.0, 1.5).hit)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_plain_precisions_have_no_dense_tree(precision):
    mesh = raytracer.Mesh(*meshes.make_torus())
    assert not isinstance(raytracer.build(raytracer.Scene(meshes=[mesh]), precision).offer, DenseOffer)


@pytest.mark.parametrize(("moved", "kept"), [(0.0, True), (1e-3, True), (3.0, False)])
def test_tree_of_what_moved_is_taken_from_the_last(rng, monkeypatch, moved, kept):
    """Unmoved it is the same tree; moved a little it keeps its blocks; moved far it is built anew."""
    monkeypatch.setattr(dense_offer, "SMALLEST_BATCH", 50)
    positions, triangles = meshes.make_icosphere(4)
    rays = meshes.random_rays(rng, 500)
    first = raytracer.build(raytracer.Scene(meshes=[raytracer.Mesh(positions, triangles)]))
    first.closest_hit(*rays)
    positions = positions + moved * rng.normal(size=positions.shape)
    scene = raytracer.Scene(meshes=[raytracer.Mesh(positions, triangles)])
    second = raytracer.build(raytracer.Scene(meshes=[raytracer.Mesh(positions, triangles)]), last=first)
    third = raytracer.build(scene, last=second)  # which no ray has asked for a tree
    hits = third.closest_hit(*rays)
    assert (third.offer.built is first.offer.built) == (moved == 0.0)
    assert np.array_equal(third.offer.built.tree.items, first.offer.built.tree.items) == kept
    other = partial(offer_traversed, build_hierarchy(third.primitives))
    assert_same_hits(hits, replace(third, offer=other).closest_hit(*rays))
