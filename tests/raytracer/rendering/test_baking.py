"""What is seen at given points: against closed forms, and the same for any number of workers."""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.casting.caster import Caster
from raytracer.integrator.settings import Settings
from raytracer.processes.workers import Workers
from raytracer.rendering import baking
from raytracer.rendering.baking import BakePoints, Eye, bake, fold_into_triangle
from raytracer.scene.lights import PointLight, World
from raytracer.scene.materials import Closure, Material
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Mesh

SQUARE = [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]
FACES = [[0, 1, 2], [0, 2, 3]]
ALBEDO = np.array([0.8, 0.4, 0.2])


def make_scene(*more: Mesh, **keywords) -> Scene:
    """A diffuse floor at z = 0, facing up, and more meshes of the second material, black."""
    materials = [Material((Closure("diffuse", color=ALBEDO),)), Material((Closure("diffuse", color=np.zeros(3)),))]
    return Scene(meshes=[Mesh(SQUARE, FACES), *more], materials=materials, **keywords)


def make_points(positions: np.ndarray) -> BakePoints:
    """The places (n, 2) of the floor, within its first triangle, of pixels without extent."""
    count = len(positions)
    corners = np.array(SQUARE, dtype=float)[FACES[0]][:, :2]
    system = np.vstack([corners.T, np.ones(3)])
    weights = np.linalg.solve(system, np.vstack([positions.T, np.ones(count)])).T
    zeros = np.zeros(count, np.int32)
    return BakePoints(np.arange(count, dtype=np.uint32), zeros, zeros, weights[:, :2], np.zeros((count, 2, 2)))


def settle(samples: int, *passes: str) -> Settings:
    """The settings of a bake."""
    return Settings(samples=samples, passes=passes or ("Combined",), integrator="path", max_bounces=4)


PLACES = np.array([[1.0, -2.0], [3.0, -3.5], [0.5, -0.75]])


def test_point_light_over_a_plane_is_its_formula():
    """A diffuse plane at a distance d under a point light of power P at height h: albedo P h / (4 pi^2 d^3)."""
    power, height = 100.0, 2.0
    scene = make_scene(lights=[PointLight([0, 0, height], power)])
    seen = bake(scene, raytracer.build(scene), settle(1), make_points(PLACES))
    assert seen is not None
    distance = np.sqrt((PLACES**2).sum(axis=1) + height**2)
    expected = ALBEDO * (power * height / (4 * np.pi**2 * distance**3))[:, np.newaxis]
    np.testing.assert_allclose(seen["Combined"][:, :3], expected, rtol=1e-9)


def test_white_furnace_gives_the_albedo_exactly_by_bounces():
    scene = make_scene(world=World([1.0, 1.0, 1.0]))
    seen = bake(scene, raytracer.build(scene), settle(64, "Combined", "Diffuse Color"), make_points(PLACES))
    assert seen is not None
    np.testing.assert_allclose(seen["Combined"][:, :3], np.tile(ALBEDO, (3, 1)), rtol=1e-6)
    np.testing.assert_allclose(seen["Diffuse Color"], np.tile(ALBEDO, (3, 1)), rtol=1e-12)


def test_openness_is_the_form_factor_of_what_is_open():
    """Of an endless wall 1 m high at a distance of 1 m: (1 + sin 45) / 2."""
    wall = Mesh([[0, -900, 0], [0, 900, 0], [0, 900, 1], [0, -900, 1]], FACES, material=1)
    scene = make_scene(wall)
    place = np.array([[1.0, -1.5]])
    points = make_points(np.repeat(place, 64, axis=0))
    far, near = (replace(settle(64, "Ambient Occlusion"), occlusion_distance=reach) for reach in (1e4, 0.99))
    seen = bake(scene, raytracer.build(scene), far, points)
    assert seen is not None
    assert abs(seen["Ambient Occlusion"].mean() - (1 + np.sqrt(0.5)) / 2) < 0.005
    seen = bake(scene, raytracer.build(scene), near, points)
    assert seen is not None
    np.testing.assert_array_equal(seen["Ambient Occlusion"], 1.0)  # nothing within reach


def test_position_and_normal_are_those_of_the_point():
    scene = make_scene()
    seen = bake(scene, raytracer.build(scene), settle(1, "Position", "Normal"), make_points(PLACES))
    assert seen is not None
    np.testing.assert_allclose(seen["Position"], np.pad(PLACES, ((0, 0), (0, 1))), atol=1e-14)
    np.testing.assert_array_equal(seen["Normal"], np.tile([0.0, 0.0, 1.0], (3, 1)))


def test_samples_spread_over_a_pixel_and_its_middle_is_their_mean():
    scene = make_scene()
    points = make_points(np.array([[4.0, -4.0]]))
    spread = BakePoints(
        points.pixel, points.instance, points.primitive, points.weights, np.array([[[0.1, 0.0], [0.0, 0.05]]])
    )
    caster = raytracer.build(scene)
    middle = bake(scene, caster, settle(1, "Position"), spread)
    mean = bake(scene, caster, settle(256, "Position"), spread)
    assert middle is not None
    assert mean is not None
    assert not np.array_equal(middle["Position"], mean["Position"])
    # 256 stratified points: their mean is off by far less than a sixteenth of the pixel, which is 1.8 m wide.
    np.testing.assert_allclose(mean["Position"], middle["Position"], atol=1.8 / 16 / 4)


def test_lights_between_a_surface_and_what_looks_at_it_are_not_seen():
    """The ray that comes to a point is none: a lamp as near as 0.5 m lights, and is not looked at."""
    small, far = (PointLight([1.0, -2.0, 0.5], 10.0, radius=radius) for radius in (0.1, 1e-6))
    seen = [
        bake(make_scene(lights=[light]), raytracer.build(make_scene(lights=[light])), settle(256), make_points(PLACES))
        for light in (small, far)
    ]
    assert seen[0] is not None
    assert seen[1] is not None
    np.testing.assert_allclose(seen[0]["Combined"][:1, :3], seen[1]["Combined"][:1, :3], rtol=0.05)


def test_an_eye_looks_from_above_the_surface_only():
    scene = make_scene()
    integrator = baking.PointTracer(scene, raytracer.build(scene), settle(1), make_points(PLACES), None, bool)
    hits = integrator._hit(make_points(PLACES), None)
    surface = baking.find_surface(integrator._integrator, hits)
    for eye in (
        Eye(np.array([0.0, 0.0, 5.0])),
        Eye(np.array([50.0, 0.0, -5.0])),
        Eye(None, np.array([0.0, 0.0, -1.0])),
    ):
        rays = baking.look_at(surface, eye)
        np.testing.assert_allclose(np.linalg.norm(rays.directions, axis=1), 1.0)
        assert (rays.directions[:, 2] < 0).all() or eye.place is None  # from straight behind nothing is left
    above = baking.look_at(surface, Eye(np.array([0.0, 0.0, 5.0])))
    expected = np.array([0.0, 0.0, 5.0]) - np.pad(PLACES, ((0, 0), (0, 1)))
    np.testing.assert_allclose(-above.directions, expected / np.linalg.norm(expected, axis=1, keepdims=True))


def test_workers_change_no_bit(monkeypatch):
    monkeypatch.setattr(baking, "BLOCK_SIZE", 2)
    scene = make_scene(world=World([0.5, 0.6, 0.7]), lights=[PointLight([0, 0, 2], 100.0, radius=0.5)])
    arguments = scene, raytracer.build(scene), settle(3), make_points(PLACES)
    alone = bake(*arguments)
    with Workers(2) as workers:
        shared = bake(*arguments, workers=workers)
    assert alone is not None
    assert shared is not None
    np.testing.assert_array_equal(alone["Combined"], shared["Combined"])


@pytest.mark.parametrize("as_number", [True, False])
def test_the_tree_is_built_before_workers_share_it(monkeypatch, as_number):
    """Each built one of its own; and of a number of workers none was started."""
    scene, told = make_scene(world=World([1, 1, 1])), []
    cast, load = Caster.closest_hit, Workers.load
    monkeypatch.setattr(Caster, "closest_hit", lambda *all, **named: told.append("cast") or cast(*all, **named))
    monkeypatch.setattr(Workers, "load", lambda *all: told.append("load") or load(*all))
    with contextlib.nullcontext(2) if as_number else Workers(2) as workers:
        bake(scene, raytracer.build(scene), settle(1), make_points(PLACES), workers=workers)
    assert told == ["cast", "load"]


def test_cancelling_returns_nothing():
    scene = make_scene(world=World([1, 1, 1]))
    assert bake(scene, raytracer.build(scene), settle(4), make_points(PLACES), is_cancelled=lambda: True) is None


@pytest.mark.parametrize("seed", range(4))
def test_folding_keeps_what_is_inside_and_reflects_the_rest(seed):
    random = np.random.default_rng(seed)
    inside = random.dirichlet([1, 1, 1], 100)[:, :2]
    np.testing.assert_allclose(fold_into_triangle(inside), inside, rtol=1e-12)
    folded = fold_into_triangle(random.uniform(-3, 3, (1000, 2)))
    assert (folded >= 0).all()
    assert (folded.sum(axis=1) <= 1 + 1e-15).all()
    corner = fold_into_triangle(np.array([[1.0, 0.25], [1.0, -0.25]]))
    np.testing.assert_array_equal(corner, [[1.0, 0.0], [1.0, 0.0]])
