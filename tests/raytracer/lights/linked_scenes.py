"""Scenes whose objects are in sets, seen from above."""

from __future__ import annotations

from typing import Any

import numpy as np

import raytracer
from raytracer.arrays.types import Floats
from raytracer.rendering.render import render


def look_down(
    meshes: list[Any], materials: list[Any], height: float, spheres: Any = (), lights: Any = (), **sets: Any
) -> Any:
    """Return a scene that an orthographic camera sees from a height; sets : of its instances."""
    matrix = np.eye(4)
    matrix[2, 3] = height
    matrices = np.tile(np.eye(4), (len(meshes), 1, 1))
    return raytracer.Scene(
        meshes=meshes,
        instances=raytracer.Instances(np.arange(len(meshes)), matrices, **sets),
        materials=materials,
        lights=lights,
        spheres=spheres,
        camera=raytracer.Camera(matrix, projection="orthographic", ortho_scale=4.0),
    )


def see(scene: Any, **settings: Any) -> Floats:
    """Return a small picture's colors."""
    return render(scene, 8, 6, 4, filter_width=0.0, **settings)["Combined"][..., :3]
