"""Six tiny scenes, each with a noise of its own, for the tests of errors and of adaptive sampling."""

from __future__ import annotations

import numpy as np

from raytracer import AreaLight, Camera, Closure, Material, Mesh, PointLight, Scene, Spheres, SunLight, World

WIDTH, HEIGHT = 24, 16
FLOOR = Mesh([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2], [0, 2, 3]])
# From the front, a little above the floor.
EYE = np.array([[1, 0, 0, 0], [0, 0, -1, -8], [0, 1, 0, 1.5], [0, 0, 0, 1.0]])


def make_balls(material: int = 0) -> Spheres:
    return Spheres([[-1, 0, 1], [1.2, 0, 1]], [1, 1], material=[material, 0])


def make_penumbra() -> Scene:
    """Soft shadows of two balls: the noise lies in the penumbras and on the balls."""
    return Scene(
        meshes=[FLOOR],
        spheres=[make_balls()],
        lights=[AreaLight([0, -4, 6], [2, 0, 0], [0, 2, 0], 300.0)],
        world=World([0.1, 0.2, 0.3]),
        camera=Camera(EYE),
    )


def make_silhouettes() -> Scene:
    """Hard edges alone: little but the filter makes noise."""
    balls = Spheres(np.random.default_rng(3).uniform((-3, -1, 0.3), (3, 3, 2.5), (40, 3)), np.full(40, 0.25))
    sun = SunLight([0.3, 0.4, -1.0], 3.0)
    return Scene(meshes=[FLOOR], spheres=[balls], lights=[sun], world=World(0.5), camera=Camera(EYE))


def make_glossy() -> Scene:
    """A rough mirror beside a diffuse ball."""
    glossy = Material((Closure("glossy", roughness=0.3),))
    return Scene(
        meshes=[FLOOR],
        spheres=[make_balls(1)],
        materials=[Material((Closure("diffuse"),)), glossy],
        lights=[AreaLight([0, -4, 6], [2, 0, 0], [0, 2, 0], 300.0)],
        world=World([0.1, 0.2, 0.3]),
        camera=Camera(EYE),
    )


def make_room() -> Scene:
    """A box that light goes around in, for the path integrator."""
    corners = [(x, y, z) for x in (-2, 2) for y in (-9, 2) for z in (0, 4)]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))]
    lamp = AreaLight([0, 0, 3.9], [1, 0, 0], [0, 1, 0], 60.0)
    return Scene(meshes=[Mesh(corners, triangles)], spheres=[make_balls()], lights=[lamp], camera=Camera(EYE))


def make_fireflies() -> Scene:
    """Glass and a mirror that find a small lamp now and then."""
    glass, mirror = Material((Closure("glass", ior=1.45),)), Material((Closure("glossy", roughness=0.02),))
    return Scene(
        meshes=[FLOOR],
        spheres=[Spheres([[-1, 0, 1], [1.2, 0, 1]], [1, 1], material=[1, 2])],
        materials=[Material((Closure("diffuse"),)), glass, mirror],
        lights=[PointLight([1, -3, 4], 300.0, radius=0.3)],
        world=World(0.2),
        camera=Camera(EYE),
    )


def make_blur() -> Scene:
    """Bright balls out of focus."""
    shining = Material((Closure("emission", color=20.0),))
    bulbs = Spheres([[-2, 5, 2], [0.5, 6, 3], [2, 4, 1]], np.full(3, 0.15), material=1)
    camera = Camera(EYE, aperture_radius=0.3, focus_distance=8.0)
    return Scene(
        meshes=[FLOOR],
        spheres=[make_balls(), bulbs],
        materials=[Material((Closure("diffuse"),)), shining],
        world=World(0.3),
        camera=camera,
    )


# The scene and the integrator.
SCENES = {
    "penumbra": (make_penumbra, "direct"),
    "silhouettes": (make_silhouettes, "direct"),
    "glossy": (make_glossy, "direct"),
    "room": (make_room, "path"),
    "fireflies": (make_fireflies, "path"),
    "blur": (make_blur, "path"),
}
