"""Paths of small waves wait for others, and what they see stays the same."""

from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.casting.rays import make_rays
from raytracer.integrator import loop
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.sampling.sobol import SobolSamples
from raytracer.scene.materials import Closure, Material
from tests.raytracer.integrator.media_scenes import fill, make_box

PASSES = ("Combined", "Depth", "Diffuse Direct", "Glossy Indirect", "Volume Direct", "Shadow Catcher")
FLOOR = raytracer.Mesh([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2), (0, 2, 3)])


def make_scene():
    """Return a floor that catches shadows, a glossy and half transparent box, and fog in another, under two lights."""
    matrix = np.eye(4)
    matrix[2, 3] = 6.0
    fog = fill(raytracer.VolumeClosure("scatter", density=0.7))
    coat = Closure("principled", roughness=0.2, alpha=0.7)
    boxes = [make_box(0.8, (-1.0, 0.3, 1.5), 1), make_box(0.9, (1.0, -0.4, 1.5), 2)]
    return raytracer.Scene(
        meshes=[FLOOR, *boxes],
        instances=raytracer.Instances(np.arange(3), [np.eye(4)] * 3, shadow_catcher=[True, False, False]),
        materials=[Material((Closure("diffuse", color=0.6),)), Material((coat,)), fog],
        lights=[
            raytracer.PointLight((0, 2, 5), 90, radius=0.3),
            raytracer.AreaLight((2, 0, 5), (1, 0, 0), (0, 1, 0), 40),
        ],
        world=raytracer.World(0.3),
        camera=raytracer.Camera(matrix),
    )


@pytest.mark.parametrize("interleaving", [0, 2])
@pytest.mark.parametrize(("set_out", "full"), [(40, 1), (40, 15), (7, 10**6)])
def test_what_paths_see_does_not_depend_on_whom_they_wait_for(monkeypatch, set_out, full, interleaving):
    scene = make_scene()
    settings = {"integrator": "path", "passes": PASSES, "volume_bounces": 2, "interleaving": interleaving}
    settings |= {"clamp_indirect": 2.0, "filter_glossy": 1.0}
    expected = raytracer.render(scene, 12, 8, 2, **settings)
    monkeypatch.setattr(loop, "SET_OUT", set_out)
    monkeypatch.setattr(loop, "FULL_WAVE", full)
    found = raytracer.render(scene, 12, 8, 2, **settings)
    for name, values in expected.passes.items():
        assert values.any(), name
        np.testing.assert_array_equal(found[name], values, err_msg=name)
    assert found.statistics.rays == expected.statistics.rays


@pytest.mark.parametrize(
    ("full", "expected"), [(3, [16, 4] * 4), (8, [16, 16, 8] * 2), (100, [16] * 4 + [16]), (9, [16, 16, 16, 12, 16, 4])]
)
def test_paths_of_a_small_wave_wait_until_they_are_enough_or_all_have_set_out(monkeypatch, full, expected):
    """Of 16 rays 4 meet a mirror; the others, and all that it reflects, miss."""
    monkeypatch.setattr(loop, "SET_OUT", 16)
    monkeypatch.setattr(loop, "FULL_WAVE", full)
    mirror = Material((Closure("glossy", roughness=0.0),))
    scene = raytracer.Scene(meshes=[FLOOR], materials=[mirror], world=raytracer.World(0.3))
    integrator, casts = prepare(scene, raytracer.build(scene), Settings()), []

    def cast(rays, classes):
        casts.append(len(rays))
        return integrator.cast(rays, classes)

    down = np.arange(64) % 4 == 1
    rays = make_rays(np.full((64, 3), (0.5, 0.2, 3.0)), np.c_[np.zeros((64, 2)), np.where(down, -1.0, 1.0)])
    samples = SobolSamples(np.arange(64, dtype=np.uint32), 0, 0)
    values = trace(replace(integrator, cast=cast), rays, samples)
    assert casts == expected
    np.testing.assert_array_equal(values["Combined"], trace(integrator, rays, samples)["Combined"])


def test_rays_set_out_in_even_parts(monkeypatch):
    scene = make_scene()
    integrator = prepare(scene, raytracer.build(scene), Settings())
    for count, size, expected in ((0, 5, []), (5, 5, [5]), (6, 5, [3, 3]), (11, 5, [4, 4, 3])):
        monkeypatch.setattr(loop, "SET_OUT", size)
        rays = make_rays(np.zeros((count, 3)), np.ones((count, 3)))
        parts = [paths.row for paths, _ in loop.set_out(integrator, rays, None)]
        assert [len(rows) for rows in parts] == expected
        assert np.concatenate([*parts, np.zeros(0, np.intp)]).tolist() == list(range(count))
