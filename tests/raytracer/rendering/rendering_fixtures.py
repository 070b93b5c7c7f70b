"""A small scene with a bit of everything that makes samples differ, and films compared bit for bit."""

import numpy as np

from raytracer.film.film import Film
from raytracer.scene.camera import Camera
from raytracer.scene.lights import AreaLight, World
from raytracer.scene.materials import Closure, Material
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Mesh, Spheres


def make_lit_scene() -> Scene:
    """A mirror ball and a diffuse ball on a floor, under an area light and a sky."""
    floor = Mesh([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2], [0, 2, 3]])
    balls = Spheres([[-1, 0, 1], [1.2, 0, 1]], [1, 1], material=[1, 0])
    eye = np.array([[1, 0, 0, 0], [0, 0, -1, -8], [0, 1, 0, 1.5], [0, 0, 0, 1]])
    return Scene(
        meshes=[floor],
        spheres=[balls],
        materials=[Material((Closure("diffuse"),)), Material((Closure("glossy", roughness=0.1),))],
        lights=[AreaLight([0, -4, 6], [2, 0, 0], [0, 2, 0], 300.0)],
        world=World([0.1, 0.2, 0.3]),
        camera=Camera(eye),
    )


def same(one: Film, other: Film) -> bool:
    """True where two films hold the same bits and are as far."""
    if set(one.arrays) != set(other.arrays) or one.key.digest != other.key.digest:
        return False
    is_same = [np.array_equal(array, other.arrays[name]) for name, array in one.arrays.items()]
    is_same.append(np.array_equal(*(film.sums.counts.read(slice(None)) for film in (one, other))))
    return all(is_same) and (one.samples, one.ahead, one.total) == (other.samples, other.ahead, other.total)
