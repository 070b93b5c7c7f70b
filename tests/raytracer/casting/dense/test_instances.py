"""Instances in the dense form give the hits of the four-wide tree and of brute force, bit for bit.

Tried, each turned red: entries beyond a ray's nearest left out, ids of a joined mesh not shifted, lanes of the second
tree walked in the first, corners of opened children not transformed, directions of any length believed (LONGEST).
"""

from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.casting.brute_force import offer_all
from raytracer.casting.bvh import hierarchy
from raytracer.casting.dense import instances as instances_module
from raytracer.casting.dense import offer as dense_offer
from raytracer.casting.dense import walk_instances
from raytracer.casting.dense.offer import DenseOffer
from raytracer.casting.geometry import instance_corners
from tests import meshes
from tests.oracle.judging import assert_same_hits, build_with

COUNT = 21


@pytest.fixture(autouse=True)
def _small(monkeypatch):
    """Nothing is flattened, and few rays are enough for all stages."""
    monkeypatch.setattr(hierarchy, "FLATTEN_LIMIT", 0)
    monkeypatch.setattr(walk_instances, "FEWEST_LANES", 400)
    monkeypatch.setattr(walk_instances, "MOST_PAIRS", 40000)
    monkeypatch.setattr(walk_instances, "MOST_LANES", 1000)


@pytest.fixture(params=["whole", "opened"])
def entries(request, monkeypatch):
    """Whole instances and the children of their meshes' roots."""
    if request.param == "opened":
        monkeypatch.setattr(instances_module, "OPENED_LOAD", 0.0)


def turn(rng, count):
    return np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]


def sizes(kind, rng):
    """(COUNT, 3, 3) linear parts."""
    linear = turn(rng, COUNT)
    if kind == "mirrored":
        return linear @ np.diag([1.0, -1.0, 1.0])
    if kind == "sheared":
        return linear @ np.array([[1, 3, 0], [0, 1, -2], [0, 0, 1]])
    if kind == "uneven":
        return linear @ np.diag([1.0, 1e-3, 30.0]) @ turn(rng, COUNT)
    if kind == "badly conditioned":
        return linear @ np.diag([1.0, 1e-4, 1.0]) @ turn(rng, COUNT)
    return linear * {"tiny": 1e-7, "huge": 1e5, "plain": 1.0}[kind]


KINDS = ("plain", "mirrored", "sheared", "uneven", "badly conditioned", "tiny", "huge")


def place(kind, rng, spread, offset):
    """A scene of COUNT instances of three meshes, of which two have trees of equal levels."""
    matrices = np.tile(np.eye(4), (COUNT, 1, 1))
    matrices[:, :3, :3] = sizes(kind, rng)
    scale = np.abs(matrices[:, :3, :3]).max()
    matrices[:, :3, 3] = rng.normal(size=(COUNT, 3)) * spread * scale + offset
    grid = meshes.make_grid(24, 2.0)
    scene = raytracer.Scene(
        meshes=[raytracer.Mesh(*mesh) for mesh in (meshes.make_icosphere(3), meshes.make_torus(), grid)],
        instances=raytracer.Instances(np.arange(COUNT) % 3, matrices),
    )
    return scene, scale


def aim(rng, caster, scale, count=300):
    """Rays at vertices, at edges and inside of triangles, some exactly from one point of a surface to another."""
    corners = np.concatenate([instance_corners(caster.geometry, each) for each in range(COUNT)])
    weights = rng.dirichlet((0.5, 0.5, 0.5), count)
    weights[::3] = np.eye(3)[rng.integers(3, size=len(weights[::3]))]
    weights[1::3, 0] = 0
    weights /= weights.sum(axis=1, keepdims=True)
    targets = np.einsum("nc,nck->nk", weights, corners[rng.integers(len(corners), size=count)])
    origins = targets + rng.normal(size=targets.shape) * scale * rng.choice([0.5, 3, 30], (count, 1))
    origins[::4] = np.roll(targets, 1, axis=0)[::4]
    directions = targets - origins
    directions[::5] = rng.normal(size=directions[::5].shape)
    directions[::7, 0], directions[::11, 1] = 0.0, -0.0
    return origins, directions


def build_both(scene):
    dense, other = build_with("dense", scene), build_with("bvh", scene)
    assert not dense.primitives.flattened.any()
    return dense, other


def assert_agree(dense, other, *rays):
    hits = dense.closest_hit(*rays)
    assert_same_hits(hits, other.closest_hit(*rays))
    np.testing.assert_array_equal(dense.any_hit(*rays), hits.hit)
    return hits


@pytest.mark.parametrize(("spread", "offset"), [(0.0, 0.0), (3.0, 148376.0)])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.usefixtures("entries")
def test_instances_agree(rng, kind, spread, offset):
    scene, scale = place(kind, rng, spread, offset)
    dense, other = build_both(scene)
    origins, directions = aim(rng, dense, scale)
    hits = assert_agree(dense, other, origins, directions)
    assert hits.hit.mean() > 0.3
    few = slice(0, 30)
    assert_same_hits(hits.select(few), replace(other, offer=offer_all).closest_hit(origins[few], directions[few]))
    # Ranges that begin or end at the hit, or an ulp beside it.
    ends = np.nextafter(np.where(hits.hit, hits.distance, 1.0), rng.choice([0.0, 1.0, np.inf], len(hits)))
    assert_agree(dense, other, origins, directions, 0.0, ends)
    assert_agree(dense, other, origins, directions, ends)


@pytest.mark.parametrize("flattens", [False, True])
@pytest.mark.parametrize("away", [1e4, 1e8, 1e12])
def test_rays_from_afar_with_long_and_short_directions_agree(rng, monkeypatch, away, flattens):
    """Where a certain hit would be in doubt without the tree, it is measured in integers nevertheless."""
    if flattens:
        monkeypatch.setattr(hierarchy, "FLATTEN_LIMIT", 1 << 20)
    scene, scale = place("plain", rng, 3.0, 0.0)
    dense, other = build_with("dense", scene), build_with("bvh", scene)
    assert dense.primitives.flattened.all() == flattens
    origins, directions = aim(rng, dense, scale, 1000 if away < 1e8 else 12)
    origins = origins - directions * away
    assert_agree(dense, other, origins, directions * 10.0 ** rng.integers(-200, 200, (len(origins), 1)))


def test_what_is_flattened_and_what_is_not_agree(rng, monkeypatch):
    """A matrix that cannot be inverted is flattened; ids of rows in the dense tree are not their places there."""
    scene, scale = place("plain", rng, 3.0, 0.0)
    matrices = scene.instances.world_from_object.copy()
    matrices[[0, 5, 20], 2, :3] = 0
    scene = replace(scene, instances=raytracer.Instances(scene.instances.mesh, matrices))
    dense, other = build_with("dense", scene), build_with("bvh", scene)
    assert np.flatnonzero(dense.primitives.flattened).tolist() == [0, 5, 20]
    rays = aim(rng, dense, scale)
    hits = dense.closest_hit(*rays)
    assert np.isin(hits.instance, [0, 5, 20]).any()
    assert_same_hits(hits, other.closest_hit(*rays))
    np.testing.assert_array_equal(dense.any_hit(*rays), hits.hit)
    # Built as a scene's caster would be, by the first large batch.
    monkeypatch.setattr(dense_offer, "SMALLEST_BATCH", 50)
    caster = raytracer.build(scene)
    assert isinstance(caster.offer, DenseOffer)
    assert_same_hits(caster.closest_hit(*rays), hits)
    assert caster.offer.built.instances is not None


def test_hits_after_hits_and_crossings_agree(rng):
    """Instances at one place: rays go on behind what they have met, each surface once."""
    scene, scale = place("plain", rng, 0.0, 0.0)
    dense, other = build_with("dense", scene), build_with("bvh", scene)
    rays = aim(rng, dense, scale, 150)
    first, second = dense.closest_hit(*rays), other.closest_hit(*rays)
    for _ in range(6):
        assert_same_hits(first, second)
        first, second = dense.closest_hit(*rays, after=first), other.closest_hit(*rays, after=second)
    np.testing.assert_array_equal(dense.crossings(*rays), other.crossings(*rays))


def test_overlapping_instances_are_opened(rng, monkeypatch):
    """Where the boxes of instances overlap much, their meshes' boxes take their place."""
    monkeypatch.setattr(instances_module, "OPENED_LOAD", 10.0)
    scene, _ = place("plain", rng, 0.0, 0.0)
    built = dense_offer.build_scene(build_with("dense", scene).primitives).instances
    assert (built.child != instances_module.WHOLE).all()
    assert len(built.child) > 4 * COUNT
    scene, _ = place("plain", rng, 9.0, 0.0)
    built = dense_offer.build_scene(build_with("dense", scene).primitives).instances
    assert (built.child == instances_module.WHOLE).all()


def test_instances_are_culled(rng):
    """Little is left to `query`, and a ray enters few of what lies behind its hit."""
    scene, scale = place("plain", rng, 9.0, 0.0)
    caster = build_with("dense", scene)
    # Those that do not start on a triangle.
    origins = aim(rng, caster, scale, 2700)[0][np.arange(2700) % 4 > 0]
    entered, offered = [], []
    original = walk_instances.place_rays
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(walk_instances, "place_rays", lambda *lanes: entered.append(len(lanes[2])) or original(*lanes))
        patch.setattr(raytracer.casting.query.Query, "offer", lambda self, ray, item: offered.append(len(ray)) or ray)
        hits = caster.closest_hit(origins, rng.normal(size=origins.shape))
    assert hits.hit.sum() > 100
    assert sum(entered) < 3 * len(hits)
    assert sum(offered) < 0.05 * len(hits)
    # Slots that nothing fills make no node larger.
    built = dense_offer.build_scene(caster.primitives).instances
    assert (built.slots < 0).any()
    assert all(np.abs(level[..., :2]).max() < 2 for level in built.levels[:-1])
