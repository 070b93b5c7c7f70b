"""Caustics in pictures: as paths find them, where they can; nothing changes where none are asked for."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import raytracer
from raytracer.casting.rays import make_rays
from raytracer.integrator import caustics
from raytracer.integrator.loop import trace
from raytracer.integrator.paths import join_paths, start_paths
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.sampling.sobol import SobolSamples
from tests.forbidding import forbid
from tests.raytracer.caustics.glass_scenes import UP, make_ball, make_glass, make_pane, make_waves

COUNT = 4000
FLOOR = raytracer.Mesh([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2), (0, 2, 3)])
PAPER = raytracer.Material([raytracer.Closure("diffuse", color=0.8)])
CLEAR = make_glass("refraction", (1.0, 0.9, 0.8))  # which reflects nothing
WAVES = make_waves()
FLAGS = {"caustics_caster": [False, True], "caustics_receiver": [True, False]}
LAMP = raytracer.PointLight((0.3, 0.2, 4.0), 100.0)


def make_scene(lamp=LAMP, glass=WAVES, material=CLEAR, **flags):
    meshes = [FLOOR, glass.with_material(1)]
    instances = raytracer.Instances([0, 1], [np.eye(4)] * 2, **flags)
    return raytracer.Scene(meshes=meshes, instances=instances, materials=[PAPER, material], lights=[lamp])


def look_down(scene, count=COUNT, seed=0, half=0.8, **settings):
    """Return what rays see of the floor, (n, 3), in a square from below the glass."""
    places = np.random.default_rng(5).uniform(-half, half, (count, 2))
    origins = np.column_stack([places, np.full(count, 0.5)])
    samples = SobolSamples(np.arange(count, dtype=np.uint32), 0, seed)
    settings = {"integrator": "path", "max_bounces": 3, **settings}
    integrator = prepare(scene, raytracer.build(scene), Settings(**settings))
    return trace(integrator, make_rays(origins, -UP), samples)["Combined"][:, :3]


LAMPS = {
    "ball": raytracer.PointLight((0.3, 0.2, 4.0), 100.0, radius=1.2, soft_falloff=False),
    "spot": raytracer.SpotLight((0.3, 0.2, 4.0), 100.0, radius=1.0, soft_falloff=False, spot_size=1.2, spot_blend=0.5),
    "disk": raytracer.PointLight((0.3, 0.2, 4.0), 100.0, radius=0.7),
    "area": raytracer.AreaLight((0.3, 1.5, 4.0), (2, 0, 0), (0, 1.4, -1.4), 100.0, spread=2.6),
    "sun": raytracer.SunLight((0.1, 0.05, 1.0), 3.0, angle=0.8),
}


@pytest.mark.parametrize("name", LAMPS)
def test_caustics_are_those_that_paths_find(name):
    """Below gentle waves one way leads from each point to each light, so that nothing is left out."""
    lamp = LAMPS[name]
    bent = look_down(make_scene(replace(lamp, caustics=True), **FLAGS))
    found = np.concatenate([look_down(make_scene(lamp), 5 * COUNT, seed) for seed in range(4)])
    error = np.hypot(bent.std() / len(bent) ** 0.5, found.std() / len(found) ** 0.5)
    assert error < 0.03 * bent.mean()
    # A disk that faces the floor is not quite the one that faces the glass: by the square of its angle.
    unlike = (lamp.radius / 4.0) ** 2 if name == "disk" else 0.0
    assert abs(bent.mean() - found.mean()) < 4.0 * error + unlike * found.mean()
    assert bent.std() < 0.25 * found.std()
    assert_allclose(bent[:, 1] / bent[:, 0], 0.9**2)


def test_light_without_extent_is_bent_and_would_be_missed():
    """Below a pane, seen from straight below: I (1 - F)^2 J with 1 / J the square of h - t + t / eta."""
    pane = make_pane(1.0, 1.5)
    scene = make_scene(raytracer.PointLight((0, 0, 3.0), 100.0, caustics=True), pane, make_glass(), **FLAGS)
    seen = look_down(scene, 64, half=1e-9)
    intensity = 100.0 / (4.0 * np.pi)
    assert_allclose(seen, 0.8 / np.pi * intensity * 0.96**2 / (2.5 + 0.5 / 1.5) ** 2, rtol=1e-9)
    assert_array_equal(look_down(make_scene(LAMP, pane, make_glass()), 64), 0.0)


@pytest.mark.parametrize("missing", ["caster", "receiver", "light", "clear glass"])
def test_nothing_is_looked_for_where_something_is_missing(missing, monkeypatch):
    flags = {name: value for name, value in FLAGS.items() if not name.endswith(missing)}
    lamp = replace(LAMP, radius=0.5, caustics=missing != "light")
    material = make_glass() if missing != "clear glass" else raytracer.Material([raytracer.Closure("glass")])
    plain = look_down(make_scene(replace(lamp, caustics=False), material=material), 400)
    forbid(monkeypatch, "find_seeds", "note_receivers", "weigh_bent")
    assert_array_equal(look_down(make_scene(lamp, material=material, **flags), 400), plain)


def test_light_from_beside_the_glass_is_as_without_caustics():
    lamp = replace(LAMP, radius=0.5)
    ball = make_ball(0.5, np.array([30.0, 0.0, 1.5]), 8)
    plain = look_down(make_scene(lamp, ball), 400)
    assert_array_equal(look_down(make_scene(replace(lamp, caustics=True), ball, **FLAGS), 400), plain)


def test_paths_leave_a_light_that_is_bent_alone():
    """Most of what is seen otherwise is light that paths have met; what is left is what light sampling brings."""
    lamp = replace(LAMPS["ball"], caustics=True)
    scene = make_scene(lamp, **FLAGS)
    integrator = prepare(scene, raytracer.build(scene), Settings(integrator="path"))
    assert integrator.caustics is not None
    paths = replace(start_paths(make_rays(np.zeros((4, 3)), UP)), scatterer=np.array([0, 1, 1, 0], np.int32))
    first = caustics.note_receivers(integrator.caustics, paths, np.array([True, True, False, False]))
    assert_array_equal(first.received, [caustics.RECEIVED, 0, 0, 0])
    assert not integrator.caustics.leaves(lamp, first).any()
    second = replace(first, scatterer=np.array([1, 1, 1, 1], np.int32))
    second = caustics.note_receivers(integrator.caustics, second, np.ones(4, np.bool_))
    assert_array_equal(integrator.caustics.leaves(lamp, second), [True, False, False, False])
    assert not integrator.caustics.leaves(LAMP, second).any()
    assert_array_equal(join_paths([paths, second]).received, [0, 0, 0, 0, 3, 0, 0, 0])


def test_limits_of_bounces_end_caustics():
    """A diffuse bounce and two surfaces: as Cycles counts, that takes two bounces, and a transmission."""
    scene = make_scene(replace(LAMP, caustics=True), **FLAGS)
    assert look_down(scene, 64, max_bounces=2).min() > 0
    for limits in ({"max_bounces": 1}, {"diffuse_bounces": 0}, {"transmission_bounces": 0}):
        assert_array_equal(look_down(scene, 64, **{"max_bounces": 4, **limits}), 0.0)


def test_passes_of_light_add_up():
    scene = make_scene(replace(LAMPS["area"], caustics=True), **FLAGS)
    passes = ("Combined", "Diffuse Direct", "Diffuse Indirect", "Diffuse Color")
    film = raytracer.render(
        replace(scene, camera=raytracer.Camera(np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1.0]]))),
        *(8, 8, 4),
        integrator="path",
        passes=passes,
    )
    total = (np.asarray(film["Diffuse Direct"]) + film["Diffuse Indirect"]) * film["Diffuse Color"]
    assert_allclose(total, np.asarray(film["Combined"])[..., :3], rtol=1e-5)
    assert total.min() > 0


def test_no_light_is_bent_where_there_are_media(monkeypatch):
    forbid(monkeypatch, "find_seeds")
    fog = raytracer.Volume(raytracer.VolumeClosure("absorption", density=0.1))
    scene = replace(make_scene(replace(LAMP, caustics=True), **FLAGS), world=raytracer.World(0.0, volume=fog))
    assert_array_equal(look_down(scene, 16), 0.0)
