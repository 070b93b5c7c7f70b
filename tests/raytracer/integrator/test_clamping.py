"""Clamping and Filter Glossy: exact in closed forms, absent unless asked for."""

import numpy as np
import pytest

import raytracer
from raytracer.casting.rays import make_rays
from raytracer.integrator import clamping, loop
from raytracer.integrator.light_sources import GEOMETRY, LIGHT, find_chances
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.sampling.sobol import SobolSamples
from raytracer.scene.materials import Closure, Material

COUNT = 64
POWER, RADIUS = 50.0, 2.0
ALBEDO = np.array([0.2, 0.5, 0.8])
# Of the lamp in the centre of a sphere: what its wall sends on directly, and after each further bounce.
DIRECT = ALBEDO / np.pi * POWER / (4 * np.pi * RADIUS**2)
INDIRECT = DIRECT * ALBEDO


def look_at_wall(materials, lights=(), **settings):
    """Return what each ray sees of the wall of a sphere from inside, (n, 3)."""
    spheres = raytracer.Spheres([(0, 0, 0)], [RADIUS])
    scene = raytracer.Scene(spheres=spheres, materials=materials, lights=lights)
    rays = make_rays(np.full((COUNT, 3), 0.1), np.random.default_rng(3).normal(size=(COUNT, 3)))
    chosen = Settings(integrator="path", **{"max_bounces": 1, **settings})
    samples = SobolSamples(np.arange(COUNT, dtype=np.uint32), 0, 0)
    return trace(prepare(scene, raytracer.build(scene), chosen), rays, samples)["Combined"][:, :3]


def look_at_lit_wall(**settings):
    wall = Material((Closure("diffuse", color=ALBEDO),))
    return look_at_wall([wall], [raytracer.PointLight((0, 0, 0), POWER)], **settings)


def dim(light, limit):
    return light * min(1.0, 3 * limit / light.sum())


@pytest.mark.parametrize("direct", [0.0, 0.1, 100.0])
@pytest.mark.parametrize("indirect", [0.0, 0.1, 100.0])
def test_clamped_light_keeps_its_hue_and_its_limit(direct, indirect):
    seen = look_at_lit_wall(clamp_direct=direct, clamp_indirect=indirect)
    expected = dim(DIRECT, direct or np.inf) + dim(INDIRECT, indirect or np.inf)
    np.testing.assert_allclose(seen, np.broadcast_to(expected, seen.shape), rtol=1e-9)


def test_each_of_several_lamps_has_its_share_of_the_limit():
    """A lamp chosen of three would add three times its light, up to the limit, every third time."""
    wall = Material((Closure("diffuse", color=ALBEDO),))
    powers = (0.2, 0.5, 2.0)
    lamps = [raytracer.PointLight((0, 0, 0), power * POWER) for power in powers]
    seen = look_at_wall([wall], lamps, max_bounces=0, clamp_direct=0.1)
    expected = sum(dim(3 * power * DIRECT, 0.1) / 3 for power in powers)
    np.testing.assert_allclose(seen, np.broadcast_to(expected, seen.shape), rtol=1e-9)


@pytest.mark.parametrize(
    ("lamps", "geometry", "chances"), [(2, False, (0.5, 1)), (0, True, (1, 1)), (2, True, (0.25, 0.5))]
)
def test_shining_geometry_is_chosen_as_often_as_all_lamps(lamps, geometry, chances):
    found = find_chances(lamps, geometry)
    assert (found[LIGHT], found[GEOMETRY]) == chances


@pytest.mark.parametrize(
    ("limits", "expected"), [({"clamp_indirect": 0.2}, (2, 2, 0.2)), ({"clamp_direct": 0.2}, (0.2, 0.2, 2))]
)
def test_what_the_first_bounce_meets_is_direct_light(limits, expected):
    """A mirror that shines: seen straight, after the one bounce, and where the path ends after a second one."""
    wall = Material((Closure("emission", color=2.0), Closure("glossy", color=1.0, roughness=0.0)))
    np.testing.assert_allclose(look_at_wall([wall], **limits), sum(expected), rtol=1e-9)


@pytest.fixture
def shade_lobes(monkeypatch):
    """Make the Shading of COUNT points with two lobes of a roughness, one of them stretched."""

    def shade(roughness):
        kept = []
        monkeypatch.setattr(loop, "blur_lobes", lambda shading, *rest: kept.append(shading) or shading)
        lobe = Closure("glossy", roughness=roughness)
        stretched = Closure("glossy", roughness=roughness, anisotropy=0.5, tangent=(1, 0, 0))
        look_at_wall([Material((lobe, stretched))], [raytracer.PointLight((0, 0, 0), POWER)])
        return kept[0]

    return shade


@pytest.mark.parametrize("roughness", [0.0, 0.3, 0.9])
def test_lobes_are_blurred_by_the_rarest_bounce(roughness, shade_lobes):
    shading = shade_lobes(roughness)
    rarest = np.linspace(0.0, 3.0, COUNT)
    blurred = clamping.blur_lobes(shading, rarest, 2.0)
    least = np.where(rarest < 2.0, 0.5 * np.sqrt(np.maximum(1 - rarest / 2.0, 0)), 0.0)
    for before, after in zip(shading.lobes, blurred.lobes, strict=True):
        if before.stretch is None:
            np.testing.assert_allclose(after.alpha, np.maximum(before.alpha, least[before.hit]), rtol=1e-12)
        else:
            for name in ("along", "across"):
                wide = np.maximum(getattr(before.stretch, name), least[before.hit])
                np.testing.assert_allclose(getattr(after.stretch, name), wide, rtol=1e-12)
            np.testing.assert_allclose(after.alpha**2, after.stretch.along * after.stretch.across, rtol=1e-12)


@pytest.mark.parametrize("roughness", [0.0, 0.5])
@pytest.mark.parametrize("kind", ["glass", "refraction"])
def test_what_bends_no_light_is_not_blurred(kind, roughness):
    """A white ball in a shell whose index of refraction is 1 looks like the world that it sees through it.

    Blurred, the facets of the shell had no half vectors, and the ball was nearly black.
    """
    shell = Material((Closure(kind, color=1.0, roughness=roughness, ior=1.0),))
    ball = Material((Closure("diffuse", color=1.0),))
    spheres = raytracer.Spheres([(0, 0, 0), (0, 0, 0)], [2 * RADIUS, RADIUS], material=[0, 1])
    scene = raytracer.Scene(spheres=spheres, materials=[shell, ball], world=raytracer.World(1.0))
    towards = np.random.default_rng(3).normal(size=(COUNT, 3))
    rays = make_rays(-9 * towards, towards)
    chosen = Settings(integrator="path", max_bounces=4, filter_glossy=1.0)
    samples = SobolSamples(np.arange(COUNT, dtype=np.uint32), 0, 0)
    seen = trace(prepare(scene, raytracer.build(scene), chosen), rays, samples)["Combined"][:, :3]
    np.testing.assert_allclose(seen, 1.0, rtol=1e-9)


def test_nothing_is_blurred_where_nothing_is_rare(shade_lobes):
    shading = shade_lobes(0.3)
    assert clamping.blur_lobes(shading, np.full(COUNT, np.inf), 2.0) is shading
    assert clamping.blur_lobes(shading, np.zeros(COUNT), 0.0) is shading


def test_limits_that_nothing_reaches_change_no_bit():
    np.testing.assert_array_equal(look_at_lit_wall(), look_at_lit_wall(clamp_direct=1e6, clamp_indirect=1e6))
