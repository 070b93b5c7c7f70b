"""What the integrator looks up by instance, by material, or in the camera: gathered from a scene's records."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Numbers, Vectors
from raytracer.arrays.vectors import normalize
from raytracer.film.mattes import hash_name, hash_to_float
from raytracer.film.passes import matte_table
from raytracer.lecture import dot, length
from raytracer.scene.fields import ALL_SETS, SEEN_BY_ALL
from raytracer.scene.scene import Scene
from raytracer.shading.site_tables import choose_axes

# Depths (n,) of points (n, 3).
MeasureDepth = Callable[[Vectors], Numbers]


def gather_records(scene: Scene, name: str, dtype: type) -> NDArray[Any]:
    """Return a property of all instances, then of all groups."""
    instances = None if scene.instances is None else getattr(scene.instances, name)
    if instances is None:
        default = {"seen_by": SEEN_BY_ALL, "receivers": ALL_SETS, "blockers": ALL_SETS}.get(name, 0)
        instances = np.full(scene.instance_count, default, dtype)
    return np.concatenate([instances, np.array([getattr(group, name) for group in scene.groups], dtype=dtype)])


def find_identities(scene: Scene, kind: str) -> Numbers:
    """Return the hashes, as floats, that Cryptomatte knows materials, or instances and then groups, by.

    Of the latter they are properties of the name that `matte_table` gives; 0 where there are none.
    """
    if kind == "Material":
        return np.array([hash_to_float(hash_name(material.name)) for material in scene.materials] or [0.0])
    name, count = matte_table(kind), scene.instance_count
    instances = {} if scene.instances is None else scene.instances.properties
    identities = np.zeros(count + len(scene.groups))
    if name in instances:
        identities[:count] = instances[name][:, 0]
    identities[count:] = [group.properties[name][0] if name in group.properties else 0.0 for group in scene.groups]
    return identities


def find_eye(scene: Scene) -> Vectors | None:
    """Return the point (3,) that a camera's rays come from; None where there is none."""
    if scene.camera is None or scene.camera.projection == "orthographic":
        return None
    return scene.camera.world_from_camera[:3, 3]


def find_camera_axes(scene: Scene) -> Vectors | None:
    """Return the world directions (3, 3) of x, y and z in camera space, as nodes have it; None without a camera."""
    if scene.camera is None:
        return None
    columns, signs = choose_axes(scene.camera)
    return scene.camera.world_from_camera[:3, columns].T * signs[:, np.newaxis]


def find_depth_measure(scene: Scene) -> MeasureDepth | None:
    """Return what tells how far points are before the camera, of a panorama how far away; None without a camera.

    References
    ----------
    Cycles, kernel/camera/camera.h: camera_z_depth.
    """
    if scene.camera is None:
        return None
    eye, forward = scene.camera.world_from_camera[:3, 3], -normalize(scene.camera.world_from_camera[:3, 2])
    return partial(_measure_depth, eye, None if scene.camera.panorama is not None else forward)


def _measure_depth(eye: Vectors, forward: Vectors | None, points: Vectors) -> Numbers:
    offset = points - eye
    return length(offset) if forward is None else dot(offset, forward)
