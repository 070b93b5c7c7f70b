"""The Normal pass of a surface does not depend on what lies beside it in a batch."""

import numpy as np

import raytracer
from raytracer.integrator.settings import Settings
from raytracer.rendering import blocks
from tests.raytracer.rendering.rendering_fixtures import make_lit_scene


def test_normals_of_diffuse_surfaces_are_the_same_beside_mirrors_and_alone() -> None:
    scene, settings = make_lit_scene(), Settings(samples=12, passes=("Normal",), seed=3)
    window = blocks.make_window(scene, 8, 6, settings)
    tracer = blocks.BlockTracer(scene, raytracer.build(scene), window, settings)
    together = tracer(blocks.Block(0, 0, 48, 12)).values["Normal"].reshape(12, 48, 3)
    for sample in range(12):
        for pixel in range(48):
            alone = tracer(blocks.Block(sample, pixel, pixel + 1)).values["Normal"][0]
            np.testing.assert_array_equal(alone, together[sample, pixel])
