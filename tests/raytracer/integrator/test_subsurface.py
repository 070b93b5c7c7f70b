"""Light below surfaces: closed forms of slabs, walks in balls against walks without any art, and what scenes without
pay for it: nothing.

Means must lie within 4.5 standard errors.
"""

import numpy as np
import pytest

import raytracer
from raytracer.bsdfs.subsurface import Medium
from raytracer.casting.ray_visibility import make_inside_cast
from raytracer.casting.rays import Rays, make_rays
from raytracer.casting.subset_caster import SubsetCaster
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.integrator.subsurface import random_walk
from raytracer.integrator.subsurface.random_walk import LAST_ANISOTROPIC, walk
from raytracer.sampling.sampler import Sampler
from raytracer.sampling.sobol import SobolSamples
from raytracer.scene.materials import Closure, Material
from tests.forbidding import forbid
from tests.raytracer.bsdfs.half_space import normal_albedo

SIGMAS = 4.5
CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
CUBE_TRIANGLES = [
    *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
    *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
]
COLOR = np.array([0.2, 0.5, 0.8])
# A mean free path that makes a cube of 2 metres half a space: what leaves by its sides is lost in the noise.
THIN = 1 / 1000
# An index of refraction of nearly 1 and facets without roughness: light enters straight.
STRAIGHT = {"subsurface_ior": 1.01, "roughness": 0.0}


def radius_of(free_path):
    """Return the radius of a mean free path."""
    return free_path * 4 * np.pi


def make_scene(*closures, world=1.0, **fields):
    mesh = raytracer.Mesh(CUBE, CUBE_TRIANGLES)
    return raytracer.Scene(meshes=[mesh], materials=[Material(closures)], world=raytracer.World(world), **fields)


def look_down(scene, count, passes=("Combined",), **settings):
    """Return what `count` rays see straight from above."""
    rays = make_rays(np.broadcast_to([0.1, 0.05, 5.0], (count, 3)), np.broadcast_to([0.0, 0, -1], (count, 3)))
    samples = SobolSamples(np.arange(count, dtype=np.uint32), 0, 1)
    settings = Settings(passes=passes, **settings)
    return trace(prepare(scene, raytracer.build(scene), settings), rays, samples)


def assert_mean(values, expected, slack=0.0):
    error = values.std(axis=0) / np.sqrt(len(values))
    assert (np.abs(values.mean(axis=0) - expected) <= SIGMAS * error + slack).all(), (values.mean(axis=0), expected)


# Only what the scene needs -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stage", ["walk", "scatter_below", "find_medium", "make_inside_cast", "split_radii"])
def test_a_scene_without_subsurface_calls_none_of_it_and_one_with_all(monkeypatch, stage):
    forbid(monkeypatch, stage)
    plain = (Closure("principled"), Closure("diffuse"))
    for integrator in ("direct", "path"):
        assert look_down(make_scene(*plain), 8, integrator=integrator)["Combined"].any()
        with pytest.raises(AssertionError, match="does not need"):
            look_down(make_scene(Closure("principled", subsurface=0.5)), 8, integrator=integrator)


@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_an_object_with_subsurface_leaves_the_others_alone_in_light(integrator):
    """What no ray meets takes numbers from no other: pictures of constant light stay as they are to the last bit."""
    plain = make_scene(Closure("diffuse", color=0.5))
    buried = Material((Closure("subsurface"),))
    more = raytracer.Scene(meshes=plain.meshes, materials=[*plain.materials, buried], world=plain.world)
    found = [look_down(scene, 16, integrator=integrator)["Combined"] for scene in (plain, more)]
    np.testing.assert_array_equal(*found)


# Closed forms --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("integrator", ["direct", "path"])
@pytest.mark.parametrize("similar", [0.0, 1.0])
def test_a_thick_slab_sends_back_what_chandrasekhar_says(monkeypatch, integrator, similar):
    """From straight above an isotropic half space of albedo a sends back 1 - H(1) sqrt(1 - a) of even light."""
    monkeypatch.setattr(random_walk, "LONGEST_WALK", 4096)
    closure = Closure("subsurface", color=COLOR, radius=radius_of(THIN), similar=similar, **STRAIGHT)
    seen = look_down(make_scene(closure), 20000, integrator=integrator)["Combined"][:, :3]
    expected = [normal_albedo(channel, bool(similar)) for channel in COLOR]
    assert_mean(seen, expected)


@pytest.mark.parametrize("free_path", [0.2, 1.0, 5.0])
@pytest.mark.parametrize("anisotropy", [0.0, 0.5])
def test_a_white_body_in_a_white_world_is_not_seen(free_path, anisotropy):
    """All that goes in comes out, but for a millionth at each scattering and for walks that take too long."""
    radius = radius_of(free_path)
    closure = Closure("subsurface", color=1.0, radius=radius, subsurface_anisotropy=anisotropy, **STRAIGHT)
    seen = look_down(make_scene(closure), 2000, integrator="path", max_bounces=0)["Combined"][:, :3]
    assert_mean(seen, 1.0, slack=2e-4)


def test_what_is_mixed_is_seen_in_its_shares():
    """Two media and a matte surface, all of known albedo."""
    media = [Closure("subsurface", 0.5, weight, radius=radius_of(THIN), similar=1, **STRAIGHT) for weight in (0.2, 0.3)]
    seen = look_down(make_scene(*media, Closure("diffuse", color=0.4, weight=0.5)), 20000, integrator="path")
    assert_mean(seen["Combined"][:, :3], 0.5 * normal_albedo(0.5, True) + 0.2, slack=1e-4)


# Walks ---------------------------------------------------------------------------------------------------------------


def walk_in_a_ball(extinction, albedo, anisotropy, count, rng):
    """Return where light leaves a ball of radius 1 (n, 3) that enters at the top towards (0, 0.6, -0.8), and its weight
    (n,): by the phase function and the distances of one channel, nothing else."""
    origin, direction = np.tile([0.0, 0.0, 1.0], (count, 1)), np.tile([0.0, 0.6, -0.8], (count, 1))
    weight, found = np.ones(count), np.zeros((count, 3))
    inside = np.arange(count)
    for number in range(random_walk.LONGEST_WALK):
        if number == LAST_ANISOTROPIC + 1:
            scattering = albedo * extinction
            absorption = extinction - scattering
            scattering, anisotropy = scattering * (1 - anisotropy), 0.0
            extinction, albedo = scattering + absorption, scattering / (scattering + absorption)
        if number > 0:
            direction[inside] = scatter_directions(direction[inside], anisotropy, rng)
        o, d = origin[inside], direction[inside]
        along = (o * d).sum(axis=1)
        out = -along + np.sqrt(along**2 - (o * o).sum(axis=1) + 1)
        step = rng.exponential(1 / extinction, len(inside))
        leaves = out <= step
        found[inside[leaves]] = (o + out[:, None] * d)[leaves]
        origin[inside] = o + step[:, None] * d
        inside = inside[~leaves]
        weight[inside] *= albedo
    weight[inside] = 0.0
    return found, weight


def scatter_directions(directions, g, rng):
    """Return directions at Henyey and Greenstein's angles, by drawing what lies across at random."""
    u = rng.random(len(directions))
    cosine = 1 - 2 * u if g == 0 else (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * u)) ** 2) / (2 * g)
    across = rng.normal(size=directions.shape)
    across -= (across * directions).sum(axis=1, keepdims=True) * directions
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return cosine[:, None] * directions + np.sqrt(np.maximum(1 - cosine**2, 0))[:, None] * across


@pytest.mark.parametrize("anisotropy", [0.0, 0.8, -0.4])
@pytest.mark.parametrize("thickness", [0.5, 4.0])
def test_walks_end_where_those_without_any_art_do(anisotropy, thickness):
    """Three channels at once, guided, cast and cut short, against one at a time in a ball that needs no casts: how much
    light leaves, and how much of it where."""
    count, albedo = 20000, np.array([0.3, 0.7, 0.95])
    extinction = thickness * np.array([1.0, 2.0, 0.5])
    ball = raytracer.Scene(spheres=[raytracer.Spheres([[0, 0, 0]], [1.0])])
    same = np.ones((count, 1))
    medium = Medium(extinction * same, albedo * same, np.full(count, anisotropy))
    exits = walk(
        make_inside_cast(raytracer.build(ball)),
        medium,
        np.array([0.0, 0.0, 1.0 - 1e-12]) * same,
        np.array([0.0, 0.6, -0.8]) * same,
        np.array([0.0, 0.0, 1.0]) * same,
        np.zeros(count, np.int32),
        np.ones((count, 3)),
        Sampler(SobolSamples(np.arange(count, dtype=np.uint32), 0, 0), None, 0),
    )
    distance = np.where(exits.hits.hit, exits.hits.distance, 0.0)
    position = exits.rays.origins + distance[:, None] * exits.rays.directions
    for channel in range(3):
        rng = np.random.default_rng(channel)
        place, weight = walk_in_a_ball(extinction[channel], albedo[channel], anisotropy, 40000, rng)
        ours, theirs = (
            np.c_[w, w[:, None] * p[:, 1:], w * p[:, 2] ** 2]
            for w, p in ((exits.throughput[:, channel], position), (weight, place))
        )
        error = np.hypot(ours.std(axis=0) / np.sqrt(count), theirs.std(axis=0) / np.sqrt(len(theirs)))
        assert (np.abs(ours.mean(axis=0) - theirs.mean(axis=0)) <= SIGMAS * error).all(), channel


def test_rays_inside_an_object_meet_nothing_else():
    """As if only the object were there: cubes one inside the other, and one at the same place."""
    rng = np.random.default_rng(1)
    cubes = [raytracer.Mesh(size * CUBE, CUBE_TRIANGLES) for size in (1.0, 0.5, 1.0, 0.7)]
    caster = raytracer.build(raytracer.Scene(meshes=cubes))
    rays = make_rays(rng.uniform(-1, 1, (500, 3)), rng.normal(size=(500, 3)), 0.0, rng.exponential(0.5, 500))
    for own in range(4):
        found = make_inside_cast(caster)(rays, np.full(500, own))
        alone = SubsetCaster(caster, np.arange(4) == own).closest_hit(
            rays.origins, rays.directions, rays.t_min, rays.t_max
        )
        for name in ("distance", "instance", "primitive"):
            np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))


# Paths and passes ----------------------------------------------------------------------------------------------------


def test_a_path_sees_the_same_in_any_batch():
    closures = Closure("principled", subsurface=0.5, radius=(1.0, 0.4, 0.2)), Closure("subsurface", skin=1)
    scene = make_scene(*closures, lights=[raytracer.PointLight((0, 0, 4), 100, radius=0.5)])
    rng = np.random.default_rng(2)
    rays = make_rays(np.c_[rng.uniform(-1, 1, (64, 2)), np.full(64, 3.0)], [0.1, 0, -1.0])
    samples = SobolSamples(np.arange(64, dtype=np.uint32), 3, 5)
    integrator = prepare(scene, raytracer.build(scene), Settings(integrator="path"))
    together = trace(integrator, rays, samples)["Combined"]
    rows = rng.permutation(64)[:20]
    np.testing.assert_array_equal(
        together[rows], trace(integrator, rays.select(rows), samples.select(rows))["Combined"]
    )


LIGHT_PASSES = [f"{part} {way}" for part in ("Diffuse", "Glossy", "Transmission") for way in ("Direct", "Indirect")]


def test_what_comes_from_below_is_diffuse_light():
    scene = make_scene(Closure("subsurface", color=COLOR, weight=0.5), lights=[raytracer.PointLight((0, 2, 4), 100)])
    names = ("Combined", *LIGHT_PASSES, "Diffuse Color")
    seen = look_down(scene, 200, passes=names, integrator="path")
    np.testing.assert_allclose(seen["Diffuse Color"], np.tile(0.5 * COLOR, (200, 1)))
    np.testing.assert_allclose(seen["Diffuse Direct"], seen["Combined"][:, :3], rtol=1e-12)
    assert not any(seen[name].any() for name in LIGHT_PASSES if name != "Diffuse Direct")


def test_a_radius_of_nothing_is_a_matte_surface():
    """To the last bit where there is none in any channel; in one channel else."""
    matte = make_scene(Closure("diffuse", color=COLOR))
    scene = make_scene(Closure("subsurface", color=COLOR, radius=0.0))
    np.testing.assert_array_equal(*(look_down(item, 16)["Combined"] for item in (matte, scene)))
    mixed = make_scene(Closure("subsurface", color=COLOR, radius=(0.0, 1.0, 0.0)))
    seen = look_down(mixed, 64)["Combined"][:, :3]
    np.testing.assert_allclose(seen.mean(axis=0)[[0, 2]], COLOR[[0, 2]], rtol=0.05)


def test_an_open_mesh_lets_no_walk_go_on_for_ever():
    plane = raytracer.Mesh([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2], [0, 2, 3]])
    scene = raytracer.Scene(meshes=[plane], materials=[Material((Closure("subsurface"),))], world=raytracer.World(1.0))
    seen = look_down(scene, 32, integrator="path")["Combined"]
    assert np.isfinite(seen).all()


def test_rays_of_a_walk_are_those_that_were_cast():
    """The last step leads from inside to what it has hit."""
    scene = make_scene(Closure("subsurface"))
    cast, kept = make_inside_cast(raytracer.build(scene)), []

    def keep(rays, inside):
        kept.append(len(rays))
        return cast(rays, inside)

    count = 100
    same = np.ones((count, 1))
    exits = walk(
        keep,
        Medium(2.0 * np.ones((count, 3)), 0.9 * np.ones((count, 3)), np.zeros(count)),
        np.array([0.1, 0.2, 0.99]) * same,
        np.array([0.0, 0.0, -1.0]) * same,
        np.array([0.0, 0.0, 1.0]) * same,
        np.zeros(count, np.int32),
        np.ones((count, 3)),
        Sampler(SobolSamples(np.arange(count, dtype=np.uint32), 0, 0), None, 0),
    )
    assert kept[0] == count
    assert kept == sorted(kept, reverse=True)
    rows = np.flatnonzero(exits.hits.hit)
    again = cast(
        Rays(*(getattr(exits.rays.select(rows), name) for name in ("origins", "directions", "t_min", "t_max"))),
        np.zeros(len(rows), np.int32),
    )
    np.testing.assert_array_equal(again.distance, exits.hits.distance[rows])
