"""Points of lamps that many pixels share: the right density and light, rays that meet, and a rule when to share."""

import numpy as np
import pytest

import raytracer
from raytracer.casting.rays import Rays, make_rays
from raytracer.integrator import loop, shadow_rays
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.lights.lights import evaluate_light, sample_light
from raytracer.lights.shared_points import (
    INTERLEAVING,
    SMALLEST_CALL,
    choose_interleaving,
    is_near,
    is_shareable,
    sample_shared,
    share_points,
)
from raytracer.sampling.sampler import share_samples
from raytracer.sampling.sobol import SobolSamples, split_numbers
from raytracer.scene.materials import Closure, Material

FLOOR = raytracer.Mesh([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2], [0, 2, 3]])
SHAPE = {"position": (0.4, -0.3, 3.0), "axis_u": (1.2, 0.1, 0.0), "axis_v": (-0.15, 1.8, 0.3), "power": (40, 30, 20)}
LAMPS = {
    "ball": raytracer.PointLight((0.2, 0.5, 3), (40, 30, 20), radius=0.7, soft_falloff=False),
    "disk": raytracer.PointLight((0.2, 0.5, 3), (40, 30, 20), radius=0.7),
    "rectangle": raytracer.AreaLight(**SHAPE),
    "ellipse": raytracer.AreaLight(**SHAPE, shape="ellipse"),
    "sun": raytracer.SunLight((0.3, 0.2, 0.9), (2, 3, 4), angle=0.4),
}
MATERIALS = {
    "diffuse": Closure("diffuse", color=0.7),
    "rough": Closure("principled", color=0.7, roughness=0.35, metallic=0.5),
}
POSITION = np.array([0.9, -0.4, 0.1])
COUNT = 1 << 16


def share(sets, sample=0, seed=0):
    """Return the samples that `sets` sets of pixels share, one pixel each."""
    group = np.zeros(sets, np.uint8)
    number, replication = split_numbers(np.arange(sets, dtype=np.uint32) + np.uint32(sample))
    return share_samples(SobolSamples(np.zeros(sets, np.uint32), number, seed, group, replication))


def sample_at(lamp, weigh=True):
    shared = share(COUNT)
    points = share_points(lamp, shared, 3)
    return sample_shared(lamp, np.broadcast_to(POSITION, (COUNT, 3)), points, weigh)


@pytest.mark.parametrize("weigh", [True, False])
@pytest.mark.parametrize("name", LAMPS)
def test_shared_points_bring_the_light_that_own_points_bring(name, weigh):
    """Irradiance on a tilted plane, by a grid of own samples and by a Sobol sequence of shared ones."""
    lamp, normal = LAMPS[name], np.array([0.6, 0.0, 0.8])
    middle = (np.arange(256) + 0.5) / 256
    pairs = np.stack(np.meshgrid(middle, middle), axis=-1).reshape(-1, 2)
    own = sample_light(lamp, np.broadcast_to(POSITION, (len(pairs), 3)), pairs)
    shared = sample_at(lamp, weigh)
    expected, found = (
        (samples.weight * np.maximum(samples.direction @ normal, 0)[:, None]).mean(axis=0) for samples in (own, shared)
    )
    # Both are quasi-random sums of 2^16 values, whose errors are below N^-3/4 of the values' size.
    np.testing.assert_allclose(found, expected, rtol=4 * COUNT**-0.75)


@pytest.mark.parametrize("name", ["ball", "disk"])
def test_shared_points_in_a_ball_cover_its_cone_with_the_density_they_report(name):
    """The mean of 1 / density over the samples is the solid angle that they cover."""
    lamp = LAMPS[name]
    samples = sample_at(lamp)
    offset = lamp.position - POSITION
    square = offset @ offset
    cosine = np.sqrt(1 - lamp.radius**2 / square) if name == "ball" else np.sqrt(square / (square + lamp.radius**2))
    radiance = evaluate_light(lamp, POSITION[None], (offset / np.sqrt(square))[None]).radiance[0]
    np.testing.assert_allclose(samples.weight.mean(axis=0) / radiance, 2 * np.pi * (1 - cosine), rtol=4 * COUNT**-0.75)


@pytest.mark.parametrize("name", LAMPS)
def test_shared_samples_stop_at_the_lamp_and_report_the_density_of_own_samples(name):
    lamp, samples = LAMPS[name], sample_at(LAMPS[name])
    seen = evaluate_light(lamp, np.broadcast_to(POSITION, (COUNT, 3)), samples.direction)
    taken = samples.density > 0
    np.testing.assert_array_equal(samples.density, seen.density)
    np.testing.assert_allclose(samples.distance[taken], seen.distance[taken], rtol=1e-12)
    if samples.target is not None:
        end = POSITION + samples.reach[taken, None] * (samples.target - POSITION)[taken]
        np.testing.assert_allclose(end, POSITION + (seen.distance[:, None] * samples.direction)[taken], atol=1e-12)


def see(scene, group):
    """Trace one pixel; returns the means (16, 3) of runs of 64 samples."""
    count = 16 * 64
    rays = make_rays(np.tile([0.9, -0.4, 3.0], (count, 1)), np.tile([0, 0.1, -1.0], (count, 1)))
    samples = SobolSamples(np.zeros(count, np.uint32), np.arange(count, dtype=np.uint32), 0, group)
    colors = trace(prepare(scene, raytracer.build(scene), Settings()), rays, samples)["Combined"][:, :3]
    return colors.reshape(16, 64, 3).mean(axis=1)


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("name", [*LAMPS, "emitter"])
def test_sharing_is_unbiased_beside_reflected_rays_and_behind_edges(name, material):
    """The same pixel with own points and with shared ones: in a penumbra."""
    edge = raytracer.Mesh([[-1, -9, 1], [0.9, -9, 1], [0.9, 9, 1], [-1, 9, 1]], [[0, 1, 2], [0, 2, 3]])
    shine = raytracer.Mesh([[-1, -1, 3], [1, -1, 3], [1, 1, 3.5], [-1, 1, 3]], [[0, 1, 2], [0, 2, 3]], material=1)
    scene = raytracer.Scene(
        meshes=[FLOOR, edge, *([shine] if name == "emitter" else [])],
        materials=[Material((MATERIALS[material],)), Material((Closure("emission", color=2.0),))],
        lights=[] if name == "emitter" else [LAMPS[name]],
    )
    own, shared = see(scene, None), see(scene, np.ones(16 * 64, np.uint8))
    error = np.sqrt((own.var(axis=0) + shared.var(axis=0)) / 15)
    assert (np.abs(own.mean(axis=0) - shared.mean(axis=0)) < 5 * error).all()
    assert (error < 0.02 * own.mean(axis=0)).all()  # a share of the light that was lost would show


def test_points_near_a_lamp_take_their_own():
    lamp = LAMPS["disk"]
    distance = np.array([0.5, 1.39, 1.41, 5.0])
    positions = lamp.position - distance[:, None] * np.array([0, 0, 1.0])
    assert is_near(lamp, positions).tolist() == [True, True, False, False]
    assert not is_near(LAMPS["sun"], positions).any()


@pytest.mark.parametrize(
    ("lamp", "shareable"),
    [
        *((lamp, True) for lamp in LAMPS.values()),
        (raytracer.PointLight((0, 0, 1), 1), False),
        (raytracer.SunLight((0, 0, 1), 1), False),
        (raytracer.AreaLight(**SHAPE, spread=1.0), False),
    ],
)
def test_lamps_with_extent_are_shared(lamp, shareable):
    assert is_shareable(lamp) == shareable


class Spy:
    """A caster that notes the shadow rays of every call."""

    def __init__(self, caster):
        self._caster, self.calls = caster, []

    def __getattr__(self, name):
        return getattr(self._caster, name)

    def any_hit(self, origins, directions, t_min, t_max):
        self.calls.append(Rays(origins, directions, t_min, t_max))
        return self._caster.any_hit(origins, directions, t_min, t_max)


def spy_on(lights, group, world=None, count=64):
    scene = raytracer.Scene(meshes=[FLOOR], lights=lights, world=world)
    caster = Spy(raytracer.build(scene))
    rng = np.random.default_rng(3)
    rays = make_rays(np.c_[rng.uniform(-2, 2, (count, 2)), np.full(count, 3.0)], [0.1, 0, -1.0])
    samples = SobolSamples(np.arange(count, dtype=np.uint32), 5, 1, group)
    trace(prepare(scene, caster, Settings()), rays, samples)
    return caster.calls


def test_many_shadow_rays_of_one_point_come_in_one_call_and_end_there(monkeypatch):
    monkeypatch.setattr(shadow_rays, "SMALLEST_SHARED", 16)
    group = np.arange(64, dtype=np.uint8) % 4
    point, area = raytracer.PointLight((0, 0, 4), 9), raytracer.AreaLight((1, 1, 4), (1, 0, 0), (0, 1, 0), 9)
    calls = spy_on([point, area, LAMPS["sun"]], group, raytracer.World(0.5))
    assert sorted(map(len, calls)) == [16] * 8 + [64] * 2  # the world's share nothing, the point lamp's all
    for rays in calls:
        ends = rays.origins + rays.t_max[:, None] * rays.directions
        shares_end = np.isfinite(ends).all() and np.ptp(ends, axis=0).max() <= 8 * np.finfo(float).eps
        shares_direction = (rays.directions == rays.directions[0]).all()
        assert shares_end or shares_direction or len(rays) == 64


def test_few_shadow_rays_come_in_one_call(monkeypatch):
    """Also the parts of a wave, each with rays of its own to the same point."""
    group = np.arange(64, dtype=np.uint8) % 4
    assert [len(rays) for rays in spy_on([LAMPS["rectangle"], LAMPS["sun"]], group)] == [2 * 64]
    monkeypatch.setattr(shadow_rays, "SMALLEST_SHARED", 16)
    monkeypatch.setattr(loop, "PART_SIZE", 32)
    assert [len(rays) for rays in spy_on([LAMPS["rectangle"], LAMPS["sun"]], group)] == [16] * 8


def test_without_sets_the_rays_of_lamps_with_extent_are_cast_together():
    calls = spy_on([LAMPS["rectangle"], LAMPS["sun"]], None, raytracer.World(0.5))
    assert [len(rays) for rays in calls] == [3 * 64]


def test_neighbours_take_different_points_and_sets_the_same():
    group = np.array([0, 1, 2, 3, 0, 1], np.uint8)
    shared = share_samples(SobolSamples(np.arange(6, dtype=np.uint32), 9, 0, group))
    pairs = shared.uniform_pair(2)
    assert len(np.unique(pairs[:, 0])) == 4
    np.testing.assert_array_equal(shared.key, group)


def test_a_set_takes_the_same_point_in_any_batch():
    group = np.array([0, 1, 2, 3] * 3, np.uint8)
    sample = np.repeat(np.arange(7, 10, dtype=np.uint32), 4)
    samples = SobolSamples(np.arange(12, dtype=np.uint32), sample, 4, group)
    whole = share_samples(samples)
    for rows in ([5], [11, 4], [2, 7, 9]):
        part = share_samples(samples.select(np.array(rows)))
        np.testing.assert_array_equal(part.uniform_pair(1)[part.key], whole.uniform_pair(1)[whole.key[rows]])
        np.testing.assert_array_equal(part.uniform(1)[part.key], whole.uniform(1)[whole.key[rows]])


def test_choose_interleaving_weighs_pixels_against_triangles():
    small = raytracer.Scene(meshes=[FLOOR])
    triangles = np.zeros((10 * SMALLEST_CALL * 4, 3), np.int32)
    many = raytracer.Scene(meshes=[raytracer.Mesh(np.zeros((3, 3)), triangles)])
    assert choose_interleaving(4 * SMALLEST_CALL, small) == INTERLEAVING
    assert choose_interleaving(4 * SMALLEST_CALL - 1, small) == 0
    assert choose_interleaving(16 * SMALLEST_CALL, many) == INTERLEAVING
    assert choose_interleaving(16 * SMALLEST_CALL - 1, many) == 0
