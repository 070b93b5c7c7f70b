"""Every way of finding candidates gives the hits of brute force, bit for bit, and a batch those of its single rays."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import raytracer
from raytracer.casting import caster as caster_module
from raytracer.casting import choose
from raytracer.casting.brute_force import offer_all
from raytracer.casting.bvh import clustering, culling, hierarchy, traverse, tree_table
from raytracer.casting.bvh.traverse import offer_traversed
from raytracer.casting.bvh.tree import NO_ITEM, REFERENCE_ROW, WIDTH, build_tree, make_frame, to_bounds
from raytracer.casting.caster import Caster
from raytracer.casting.geometry import instance_corners, pack_geometry, world_corners
from raytracer.casting.primitives import instance_bounds, make_primitives
from raytracer.casting.query import Query
from raytracer.casting.rays import make_rays
from tests.meshes import make_grid, make_icosphere, make_soup

FIELDS = ("distance", "distance_error", "instance", "primitive", "barycentric", "valid")


def assert_same_hits(hits, expected):
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(hits, name), getattr(expected, name), err_msg=name)


def brute_force(caster):
    everything = np.ones(caster.scene.instance_count, dtype=bool)
    primitives = make_primitives(caster.geometry, caster.primitives.precision, everything)
    return Caster(caster.scene, primitives, offer_all)


def mixed_rays(rng, count, targets, scale=1.0, offset=0.0):
    """Half aimed at given points, half random; some with zero components of both signs, some on round coordinates."""
    origins = rng.normal(size=(count, 3)) * 3 * scale + offset
    directions = targets[rng.integers(len(targets), size=count)] - origins
    directions[count // 2 :] = rng.normal(size=(count - count // 2, 3)) * scale
    directions[::7, 0], directions[::11, 1] = 0.0, -0.0
    return origins, directions


def random_matrices(rng, count, offset=0.0):
    """Rotated, sheared, mirrored, unevenly scaled placements; one is flattened to a plane."""
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3] = rng.normal(size=(count, 3, 3))
    matrices[:, :3, 3] = rng.normal(size=(count, 3)) * 4 + offset
    matrices[1, :3, :3] *= 1e-4
    matrices[2, 2, :3] = 0
    return matrices


@pytest.mark.parametrize("precision", ["certified", "float64"])
@pytest.mark.parametrize(
    ("scale", "offset", "length"),
    [(1, 0, 1), (1e-30, 0, 1e30), (1e25, 0, 1e-30), (1, 1e6, 1), (1, 1e9, 1e5), (1e-40, 0, 1)],
)
def test_tree_equals_brute_force_at_any_scale(rng, precision, scale, offset, length):
    positions, triangles = make_grid(14)
    mesh = raytracer.Mesh(positions * scale + offset, triangles)
    centres = rng.normal(size=(40, 3)) * scale + offset
    spheres = raytracer.Spheres(centres, (0.3 * rng.random(40) + 1e-3) * scale)
    caster = raytracer.build(raytracer.Scene(meshes=[mesh], spheres=spheres), precision)
    origins, directions = mixed_rays(rng, 500, mesh.positions, scale, offset)
    rays = (origins, directions * length)
    assert_same_hits(caster.closest_hit(*rays), brute_force(caster).closest_hit(*rays))
    np.testing.assert_array_equal(caster.any_hit(*rays), brute_force(caster).any_hit(*rays))


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_placed_instances_equal_flattened_ones(rng, monkeypatch, offset):
    monkeypatch.setattr(hierarchy, "FLATTEN_LIMIT", 0)
    meshes = [raytracer.Mesh(*make_grid(10)), raytracer.Mesh(*make_icosphere(1))]
    matrices = random_matrices(rng, 30, offset)
    scene = raytracer.Scene(meshes=meshes, instances=raytracer.Instances(np.arange(30) % 2, matrices))
    caster = raytracer.build(scene)
    # Only the plane-flattened matrix cannot be brought back into object space.
    assert np.flatnonzero(caster.primitives.flattened).tolist() == [2]
    targets = np.concatenate([instance_corners(caster.geometry, i).reshape(-1, 3) for i in range(30)])
    rays = mixed_rays(rng, 800, targets, offset=offset)
    assert_same_hits(caster.closest_hit(*rays), brute_force(caster).closest_hit(*rays))
    np.testing.assert_array_equal(caster.any_hit(*rays), brute_force(caster).any_hit(*rays))
    np.testing.assert_array_equal(caster.crossings(*rays), brute_force(caster).crossings(*rays))


def test_batch_equals_single_rays(rng):
    caster = raytracer.build(raytracer.Scene(meshes=[raytracer.Mesh(*make_soup(rng, 60))]))
    origins, directions = mixed_rays(rng, 60, np.zeros((1, 3)))
    together = caster.closest_hit(origins, directions, 0.5, np.linspace(1, 9, 60))
    for ray, t_max in enumerate(np.linspace(1, 9, 60)):
        alone = caster.closest_hit(origins[ray], directions[ray], 0.5, t_max)
        for name in FIELDS:
            np.testing.assert_array_equal(getattr(alone, name)[0], getattr(together, name)[ray])


def test_batches_larger_than_one_block_keep_their_order(rng, monkeypatch):
    monkeypatch.setattr(caster_module, "BATCH_RAYS", 64)
    monkeypatch.setattr(caster_module, "DENSE_RAYS", 64)
    caster = raytracer.build(raytracer.Scene(meshes=[raytracer.Mesh(*make_grid(8))]))
    origins, directions = mixed_rays(rng, 300, np.zeros((1, 3)))
    directions[::17] = np.nan
    in_blocks = caster.closest_hit(origins, directions)
    monkeypatch.undo()
    assert_same_hits(in_blocks, caster.closest_hit(origins, directions))
    assert not in_blocks.valid[::17].any()


def test_identity_instances_equal_no_instances(rng):
    mesh = raytracer.Mesh(*make_icosphere(2))
    plain = raytracer.build(raytracer.Scene(meshes=[mesh]))
    placed = raytracer.build(raytracer.Scene(meshes=[mesh], instances=raytracer.Instances([0], [np.eye(4)])))
    rays = mixed_rays(rng, 200, mesh.positions)
    assert_same_hits(placed.closest_hit(*rays), plain.closest_hit(*rays))


def test_empty_scene_is_missed():
    hits = raytracer.build(raytracer.Scene()).closest_hit([[0, 0, 0]], [[0, 0, 1]])
    assert not hits.hit.any()
    assert hits.valid.all()
    assert hits.distance[0] == np.inf


def test_no_rays_give_no_hits():
    caster = raytracer.build(raytracer.Scene(meshes=[raytracer.Mesh(*make_grid(4))]))
    assert len(caster.closest_hit(np.zeros((0, 3)), np.zeros((0, 3)))) == 0
    assert len(caster.any_hit(np.zeros((0, 3)), np.zeros((0, 3)))) == 0


@pytest.mark.parametrize("leaf_size", [1, 4])
@pytest.mark.parametrize(("count", "spread"), [(1, 1), (3, 0), (9, 0), (100, 1), (3000, 1), (3000, 0)])
def test_tree_holds_every_item_once_inside_its_boxes(rng, count, spread, leaf_size):
    low = rng.normal(size=(count, 3)) * spread
    boxes = np.stack([low, low + spread * rng.random((count, 3))], axis=1)
    frame = make_frame(boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0))
    bounds = to_bounds(frame, boxes)
    assert (np.abs(bounds) <= 1).all()
    tree = build_tree(bounds, frame, leaf_size)
    visited, depth = _check_node(tree, bounds, leaf_size, 0)
    assert sorted(visited) == list(range(count))
    assert depth <= 2 + np.log2(count)


def _check_node(tree, bounds, leaf_size, node):
    """Return the items below a node and how deep they lie, after checking that boxes hold their items' boxes."""
    found, depth = [], 0
    references = tree.nodes[node, REFERENCE_ROW].view(np.int32)
    for slot in range(WIDTH):
        low, high = tree.nodes[node, :3, slot], tree.nodes[node, 3:6, slot]
        if np.isinf(low).any():
            continue
        if references[slot] >= 0:
            items, below = _check_node(tree, bounds, leaf_size, references[slot])
            depth = max(depth, below + 1)
        else:
            items = tree.leaves[~references[slot]]
            items = items[items != NO_ITEM].tolist()
            assert 0 < len(items) <= leaf_size
        assert (low <= bounds[:3, items].T).all()
        assert (high >= -bounds[3:, items].T).all()
        found.extend(items)
    return found, depth


def cluster(bounds):
    clusters = clustering.begin_clusters(bounds, clustering.sort_along_curve(bounds))
    clustering.merge_clusters(clusters)
    return clusters


def test_chains_of_clusters_that_prefer_the_one_before_are_merged_in_pairs():
    """Boxes that grow along a line: each is nearest to a smaller one, so that only the first two choose each other."""
    size = 1.01 ** np.arange(600)
    place = np.cumsum(size)
    boxes = np.zeros((600, 2, 3))
    boxes[:, 0, 0], boxes[:, 1] = place - size / 2, size[:, None]
    boxes[:, 1, 0] = place + size / 2
    frame = make_frame(boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0))
    clusters = cluster(to_bounds(frame, boxes))
    assert len(clusters.rounds) < 100
    assert clusters.count[-1] == 600


def test_clusters_lie_side_by_side_and_their_bounds_are_the_unions(rng):
    bounds = np.concatenate([rng.uniform(-1, 0, (3, 500)), rng.uniform(-1, 0, (3, 500))]).astype(np.float32)
    clusters = cluster(bounds)
    assert sorted(clusters.items) == list(range(500))
    for k in range(len(clusters.count)):
        items = clusters.items[clusters.first[k] : clusters.first[k] + clusters.count[k]]
        np.testing.assert_array_equal(bounds[:, items].min(axis=1), clusters.bounds[:, k])


def test_partners_waste_the_least_surface_of_all_neighbours(rng):
    bounds = np.concatenate([rng.uniform(-1, 0, (3, 300)), rng.uniform(-1, 0, (3, 300))]).astype(np.float32)
    surface = clustering.half_surface(bounds)
    for block in (7, 64, 1 << 14):
        clustering.BLOCK, keep = block, clustering.BLOCK
        try:
            partners = clustering._find_partners(bounds, np.arange(bounds.shape[1], dtype=np.int32))
        finally:
            clustering.BLOCK = keep
        for place in range(300):
            near = [k for k in range(place - 8, place + 9) if 0 <= k < 300 and k != place]
            union = clustering.half_surface(np.minimum(bounds[:, [place]], bounds[:, near]))
            waste = union - (surface[place] / 2 + surface[near] / 2)
            # 4 bits of 24 give way to the neighbour's code.
            assert waste[near.index(partners[place])] <= waste.min() * (1 + 2.0**-18)


def test_instance_boxes_hold_rounded_world_corners(rng):
    mesh = raytracer.Mesh(*make_icosphere(2))
    matrices = random_matrices(rng, 20, offset=1e6)
    scene = raytracer.Scene(meshes=[mesh], instances=raytracer.Instances(np.zeros(20, np.int32), matrices))
    geometry = pack_geometry(scene)
    boxes = instance_bounds(geometry, np.arange(20))
    for instance in range(20):
        corners = instance_corners(geometry, instance)
        assert (corners >= boxes[instance, 0]).all()
        assert (corners <= boxes[instance, 1]).all()


def test_world_corners_equal_flattened_corners_bit_for_bit(rng):
    mesh = raytracer.Mesh(*make_icosphere(1))
    instances = raytracer.Instances(np.zeros(5, np.int32), random_matrices(rng, 5))
    geometry = pack_geometry(raytracer.Scene(meshes=[mesh], instances=instances))
    primitive = np.arange(len(mesh.triangles))
    for instance in range(5):
        corners = world_corners(geometry, np.full(len(primitive), instance), primitive)
        np.testing.assert_array_equal(np.stack(corners, axis=1), instance_corners(geometry, instance))


def test_shared_mesh_arrays_are_packed_once():
    positions, triangles = make_grid(4)
    first = raytracer.Mesh(positions, triangles)
    second = raytracer.Mesh(first.positions, first.triangles, material=1)
    materials = [raytracer.Material(), raytracer.Material()]
    geometry = pack_geometry(raytracer.Scene(meshes=[first, second], materials=materials))
    assert len(geometry.triangles) == len(triangles)
    assert geometry.mesh_first.tolist() == [0, 0]


def test_rows_never_lose_a_point_of_the_ray(rng):
    """A point p = o + t d, in float64 as exact as it comes, lies within the row's slab interval of its own box."""
    frame = make_frame(np.array([-1.0, -2.0, 5e5]), np.array([3.0, 2.0, 5e5 + 3]))
    count = 2000
    points = rng.uniform([-1, -2, 5e5], [3, 2, 5e5 + 3], size=(count, 3))
    directions = rng.normal(size=(count, 3)) * 10.0 ** rng.integers(-20, 20, size=(count, 1))
    t = 10.0 ** rng.uniform(-3, 6, size=count) / np.abs(directions).max(axis=1)
    origins = points - t[:, None] * directions
    rays = culling.prepare_rays(frame, origins, directions)
    exact_points = origins.astype(np.longdouble) + t.astype(np.longdouble)[:, None] * directions.astype(np.longdouble)
    boxes = np.stack([exact_points, exact_points], axis=1).astype(np.float64)
    bounds = to_bounds(frame, boxes)
    low = (bounds[:3] - rays.rows[:3]) * rays.rows[6:9]
    high = (-bounds[3:] - rays.rows[3:6]) * rays.rows[6:9]
    entry = np.minimum(low, high).max(axis=0)
    leave = np.maximum(low, high).min(axis=0) * culling.SLACK
    assert (entry <= leave).all()
    assert (entry <= culling.to_row_distance(rays, np.arange(count), t)).all()
    assert (leave >= culling.to_row_start(rays, t)).all()


def test_unknown_precision_is_refused():
    with pytest.raises(ValueError, match=r"precision: expected one of certified, float64, float32, got 'double'"):
        raytracer.build(raytracer.Scene(), "double")


def test_what_is_no_scene_is_refused():
    with pytest.raises(ValueError, match="build: scene: expected a Scene, got Mesh"):
        raytracer.build(raytracer.Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)))


def test_crossings_need_certified_precision():
    with pytest.raises(ValueError, match="crossings: precision: expected 'certified'"):
        raytracer.build(raytracer.Scene(), "float64").crossings([0, 0, 0], [0, 0, 1])


@pytest.mark.parametrize(("side", "is_dense"), [(16, True), (120, False)])
def test_the_tree_that_the_first_rays_need_is_built_and_no_other(side, is_dense):
    """Few triangles have a dense tree alone; of many a single ray needs the four-wide one."""
    caster = raytracer.build(raytracer.Scene(meshes=[raytracer.Mesh(*make_grid(side))]))
    assert caster.offer.built is None
    assert caster.offer.other.latest is None
    caster.closest_hit((0.1, 0.2, 1.0), (0.0, 0.0, -1.0))
    assert (caster.offer.built is not None) == is_dense
    assert (caster.offer.other.latest is None) == is_dense


def scene_of_parts(moved=None, turned=0.0):
    """Three large meshes, two small ones, spheres and a forest of placed instances; one part may be moved."""
    names = ("left", "middle", "right", "small", "tiny")
    sizes = (14, 12, 13, 4, 3)
    meshes = []
    for k, (name, size) in enumerate(zip(names, sizes, strict=True)):
        positions, triangles = make_grid(size)
        shift = 0.25 if name == moved else 0.0
        meshes.append(raytracer.Mesh(positions * 0.2 + (2.0 * k - 4.0, shift, 0.1 * k), triangles))
    tree = raytracer.Mesh(*make_icosphere(2))
    matrices = np.tile(np.eye(4), (9, 1, 1))
    matrices[:, 0, 3], matrices[:, 2, 3] = np.linspace(-4, 4, 9), -2 - turned
    matrices = np.concatenate([np.tile(np.eye(4), (5, 1, 1)), matrices])
    spheres = raytracer.Spheres(np.array([[0.0, 2.0, 1.0], [1.0, -2.0, 1.0]]), np.array([0.5, 0.4]))
    instances = raytracer.Instances(np.array([0, 1, 2, 3, 4] + [5] * 9), matrices)
    return raytracer.Scene(meshes=[*meshes, tree], instances=instances, spheres=[spheres])


@pytest.mark.parametrize(
    ("moved", "turned", "grown"),
    [
        (None, 0.0, set()),
        ("middle", 0.0, {("instance", 1)}),
        ("tiny", 0.0, {("rest", 0)}),
        (None, 0.5, {("instances", 0)}),
    ],
)
def test_only_trees_of_what_moved_are_built_again(rng, monkeypatch, moved, turned, grown):
    monkeypatch.setattr(hierarchy, "FLATTEN_LIMIT", 0)
    monkeypatch.setattr(hierarchy, "PART_TRIANGLES", 200)
    before, after = (raytracer.build(scene) for scene in (scene_of_parts(), scene_of_parts(moved, turned)))
    last = hierarchy.build_hierarchy(before.primitives)
    names = {("instance", 0), ("instance", 1), ("instance", 2), ("rest", 0), ("instances", 0), ("parts", 0)}
    assert {name for name in last.trees if name[0] != "mesh"} == names
    sources = []
    for name in ("grow_tree", "grow_box_tree"):
        grow = getattr(tree_table, name)
        monkeypatch.setattr(tree_table, name, lambda source, grow=grow: sources.append(source) or grow(source))
    reused = hierarchy.build_hierarchy(after.primitives, last)
    assert reused.frame is last.frame
    assert {name for name, tree in reused.trees.items() if tree.source in sources} == grown | {("parts", 0)}
    assert not any(np.shares_memory(tree.source.corners, before.primitives.corners) for tree in reused.trees.values())
    rays = mixed_rays(rng, 800, np.concatenate([mesh.positions for mesh in after.scene.meshes]))
    caster = replace(after, offer=partial(offer_traversed, reused), smallest_pencil=None)
    assert_same_hits(caster.closest_hit(*rays), brute_force(after).closest_hit(*rays))
    # And once more from what was reused.
    again = replace(before, offer=partial(offer_traversed, hierarchy.build_hierarchy(before.primitives, reused)))
    assert_same_hits(replace(again, smallest_pencil=None).closest_hit(*rays), brute_force(before).closest_hit(*rays))


@pytest.mark.parametrize("asked", [True, False])
def test_caster_takes_trees_from_the_last_one(rng, monkeypatch, asked):
    """Also from the one before the last, where no ray asked for a tree in between."""
    monkeypatch.setattr(choose, "suits_dense", lambda primitives: False)
    monkeypatch.setattr(hierarchy, "PART_TRIANGLES", 200)
    first = raytracer.build(scene_of_parts())
    rays = mixed_rays(rng, 300, np.concatenate([mesh.positions for mesh in first.scene.meshes]))
    first.closest_hit(*rays)
    second = raytracer.build(scene_of_parts("middle"), last=first)
    if asked:
        second.closest_hit(*rays)
    third = raytracer.build(scene_of_parts("tiny"), last=second)
    assert_same_hits(third.closest_hit(*rays), brute_force(third).closest_hit(*rays))
    trees = [caster.offer.latest.trees for caster in (first, third)]
    large = [("instance", k) for k in range(3)]
    reused = [name for name in large if np.shares_memory(trees[0][name].leaves, trees[1][name].leaves)]
    assert reused == ([("instance", 0), ("instance", 2)] if asked else large)


def test_frame_is_left_when_the_scene_outgrows_it(rng):
    positions, triangles = make_grid(8)
    before, after = (
        raytracer.build(raytracer.Scene(meshes=[raytracer.Mesh(positions * size, triangles)])) for size in (1.0, 2.5)
    )
    last = hierarchy.build_hierarchy(before.primitives)
    grown = hierarchy.build_hierarchy(after.primitives, last)
    assert grown.frame is not last.frame
    rays = mixed_rays(rng, 200, after.scene.meshes[0].positions)
    caster = replace(after, offer=partial(offer_traversed, grown), smallest_pencil=None)
    assert_same_hits(caster.closest_hit(*rays), brute_force(after).closest_hit(*rays))


def test_rows_of_instances_are_forgotten_when_they_are_done_with(rng, monkeypatch):
    monkeypatch.setattr(hierarchy, "FLATTEN_LIMIT", 0)
    monkeypatch.setattr(traverse, "LEAF_BATCH", 64)
    matrices = np.tile(np.eye(4), (40, 1, 1))
    matrices[:, :3, 3] = rng.uniform(-6, 6, (40, 3))
    instances = raytracer.Instances(np.zeros(40, np.int32), matrices)
    caster = raytracer.build(raytracer.Scene(meshes=[raytracer.Mesh(*make_icosphere(2))], instances=instances))
    rays = make_rays(*mixed_rays(rng, 500, matrices[:, :3, 3]))
    query = Query(caster.primitives, rays, any_hit=False)
    traversal = traverse.Traversal(hierarchy.build_hierarchy(caster.primitives), query)
    before = []
    enter = traversal._enter_instances
    monkeypatch.setattr(traversal, "_enter_instances", lambda: (before.append(traversal.rows.count), enter()))
    traversal.run()
    assert before == [500] * len(before)
    assert len(before) > 2
    assert traversal.rows.count == 500
