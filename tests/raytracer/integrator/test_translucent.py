"""Light that comes through surfaces diffusely, with either integrator: closed forms."""

import numpy as np
import pytest

from raytracer import Closure, Material, Mesh, Scene, SunLight, World
from tests.raytracer.integrator.media_scenes import INTEGRATORS, assert_close, look, measure

ALBEDO = np.array([0.8, 0.5, 0.2])
LEAF = Material((Closure("translucent", color=ALBEDO),))
PAINT = Material((Closure("diffuse", color=0.5),))

# What leaves a sheet misses another one, 1 m away, once in 1e10 times.
FAR = 1e5


def make_sheet(y: float, material: int = 0) -> Mesh:
    """A square across the camera's way, which is along +y."""
    positions = [(-FAR, y, -FAR), (FAR, y, -FAR), (FAR, y, FAR), (-FAR, y, FAR)]
    return Mesh(positions=positions, triangles=[(0, 1, 2), (0, 2, 3)], material=material)


@INTEGRATORS
@pytest.mark.parametrize("bounces", [0, 2])
def test_a_leaf_shows_the_world_behind_it(integrator: str, bounces: int) -> None:
    scene = Scene(meshes=[make_sheet(0.0)], materials=[LEAF], camera=look(), world=World(0.7))
    found = measure(scene, 16, integrator=integrator, max_bounces=bounces)
    assert_close(found, 0.7 * ALBEDO, least=1e-6)


@INTEGRATORS
def test_light_comes_through_leaf_after_leaf(integrator: str) -> None:
    """Two leaves wherever one looks: with a bounce for each but the last the world comes through both."""
    scene = Scene(meshes=[make_sheet(0.0), make_sheet(1.0)], materials=[LEAF], camera=look(), world=World(0.7))
    assert measure(scene, 4, integrator=integrator, max_bounces=0)[0].max() == 0.0
    assert_close(measure(scene, 64, integrator=integrator, max_bounces=1), 0.7 * ALBEDO**2, least=1e-6)


def test_with_leaves_walls_still_reflect_nothing_of_walls() -> None:
    """A floor that the sun lights sends light to a wall that it does not: by the path integrator alone."""
    floor = Mesh([(-9, -9, -1), (9, -9, -1), (9, 9, -1), (-9, 9, -1)], [(0, 1, 2), (0, 2, 3)], material=1)
    leaf = make_sheet(500.0)
    sun = SunLight((0.0, 0.0, 1.0), 1.0)
    for meshes in ([make_sheet(0.0, 1), floor, leaf], [make_sheet(0.0, 1), floor]):
        scene = Scene(meshes=meshes, materials=[LEAF, PAINT], camera=look(), lights=sun)
        assert (measure(scene, 4, integrator="direct", max_bounces=3)[0] == 0.0).all()
        assert (measure(scene, 4, integrator="path", max_bounces=3)[0] > 0.0).all()
