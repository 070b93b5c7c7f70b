"""Pixels and lights take points that are good together: soft shadows are less noisy, emissive triangles lit as one."""

from __future__ import annotations

import numpy as np
import pytest

import raytracer
from raytracer import Camera, Closure, Material, Mesh, Scene
from raytracer.integrator import emissive_source
from raytracer.rendering import blocks
from raytracer.sampling import sampler
from tests.raytracer.rendering.error_scenes import make_penumbra

SQUARE = [(0, 1, 2), (0, 2, 3)]
FLOOR = Mesh([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], SQUARE)
ABOVE = np.array([(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 12), (0, 0, 0, 1.0)])
SHINING = Material((Closure("emission", color=(5.0, 5.0, 5.0)),))


def measure_noise(scene: Scene, **settings: object) -> float:
    """Return the variance of renders of a few seeds, the mean of all pixels."""
    caster = raytracer.build(scene)
    films = [raytracer.render(scene, 12, 8, 128, caster=caster, seed=seed, **settings) for seed in range(6)]
    return float(np.var([film["Combined"] for film in films], axis=0, ddof=1).mean())


@pytest.mark.parametrize("interleaving", [0, 2])
def test_penumbras_are_less_noisy_than_with_points_that_are_shuffled(monkeypatch, interleaving):
    """Measured 0.69 and 0.58."""
    scene = make_penumbra()
    joined = measure_noise(scene, interleaving=interleaving)
    monkeypatch.setattr(sampler, "find_wave_pair", lambda wave: None)
    monkeypatch.setattr(blocks, "FILTER_PAIR", None)
    shuffled = measure_noise(scene, interleaving=interleaving)
    assert joined < 0.85 * shuffled


def test_few_emissive_triangles_are_lit_by_points_that_are_even_over_all_of_them(monkeypatch):
    """Measured 0.49: a square is as good as one light, though it is two triangles; and as bright."""
    lamp = Mesh([(-2, -2, 2), (2, -2, 2), (2, 2, 2), (-2, 2, 2)], SQUARE, material=1)
    scene = Scene(meshes=[FLOOR, lamp], materials=[Material((Closure("diffuse"),)), SHINING], camera=Camera(ABOVE))
    even = measure_noise(scene)
    bright = raytracer.render(scene, 12, 8, 256)["Combined"].mean()
    monkeypatch.setattr(emissive_source, "MOST_BY_PAIR", 0)
    by_itself = measure_noise(scene)
    assert even < 0.85 * by_itself
    assert raytracer.render(scene, 12, 8, 256)["Combined"].mean() == pytest.approx(bright, rel=0.005)
