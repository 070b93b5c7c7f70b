"""Environment Texture and Sky Texture: pictures of all directions.

References
----------
Blender, intern/cycles/kernel/camera/projection.h: the mirror ball; kernel/svm/sky.h: the sun in the sky.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from raytracer.arrays.rows import split_columns
from raytracer.arrays.vectors import normalize, transform
from raytracer.lecture import length
from raytracer.sampling.direction_map import find_equirectangular
from raytracer.scene.programs import Image
from raytracer.shading.nodes.images import MISSING_IMAGE
from raytracer.shading.nodes.operation import Array, Operation, spread
from raytracer.shading.site import Site
from raytracer.textures.daylight import evaluate_hosek_wilkie, evaluate_preetham
from raytracer.textures.image import sample_image
from raytracer.textures.sky import fade_below


def find_mirror_ball(directions: Array) -> tuple[Array, Array]:
    """Where a ball that mirrors shows directions (n, 3) to one who looks along +y: its normal is half way to -y."""
    x, y, z = directions.T
    length = 2.0 * np.sqrt(np.maximum(0.5 * (1.0 - y), 0.0))
    length = np.where(length > 0, length, 1.0)
    return 0.5 * (x / length + 1.0), 0.5 * (z / length + 1.0)


PROJECTIONS = {"EQUIRECTANGULAR": find_equirectangular, "MIRROR_BALL": find_mirror_ball}


def read_environment(site: Site, vector: Any, *, image: Image | None, interpolation: str, projection: str) -> Array:
    """The color of an image in the direction of `vector`; None is a missing one."""
    directions = normalize(np.broadcast_to(np.asarray(vector, float), (len(site), 3)))
    u, v = PROJECTIONS[projection](directions)
    shown = MISSING_IMAGE if image is None else image
    return sample_image(shown, np.stack([u, v], axis=1), interpolation, "REPEAT")[:, :3]


LIMB_DARKENING = 0.6


def read_sky(
    site: Site,
    vector: Any,
    *,
    image: Image,
    elevation: float,
    rotation: float,
    sun_size: float,
    sun_bottom: Array,
    sun_top: Array,
    horizon: float,
    ground: bool,
) -> Array:
    """A clear sky, tabulated in `image`, with the sun's disc; colors that no mixture of red, green and blue is are cut.

    elevation, rotation, sun_size : radians, of the sun; size 0 has no disc
    sun_bottom, sun_top : colors of the disc's lowest and highest points; horizon : radians, below it the disc is hidden
    ground : True where the table holds what lies below the horizon, and the sun shines through the sky, as since
        Blender 5.0; False fades what is below, and shows the sun instead of the sky, which the horizon cuts
    """
    directions = np.broadcast_to(np.asarray(vector, float), (len(site), 3))
    x, y, z = split_columns(directions)
    z = np.clip(z, -1.0, 1.0)
    height = np.pi / 2 - np.arccos(z)
    u = (rotation - np.pi / 2 - np.arctan2(y, x)) / (2.0 * np.pi) % 1.0
    level = np.copysign(np.sqrt(np.abs(height) / (np.pi / 2)), height)
    shown = sample_image(image, np.stack([u, 0.5 + 0.5 * level], axis=1), "Linear", "EXTEND")[:, :3]
    if not ground:
        shown *= spread(fade_below(z))
    if sun_size > 0:
        across = np.cos(elevation)
        sun = np.array([-across * np.sin(rotation), across * np.cos(rotation), np.sin(elevation)])
        away = 2.0 * np.arctan2(length(directions - sun), length(directions + sun)) / (sun_size / 2)
        disc = (away < 1.0) & (height > horizon if ground else z >= 0)
        lowest = elevation - sun_size / 2 if ground else max(elevation - sun_size / 2, 0.0)
        part = spread((height - lowest) / (elevation + sun_size / 2 - lowest))
        limb = 1.0 - LIMB_DARKENING * (1.0 - np.sqrt(1.0 - np.where(disc, away, 0.0) ** 2))
        disc_light = (sun_bottom + part * (np.asarray(sun_top) - sun_bottom)) * spread(limb)
        shown = np.where(spread(disc), disc_light + (shown if ground else 0.0), shown)
    return np.maximum(shown, 0.0)


def read_preetham(site: Site, vector: Any, *, sun: Array, turbidity: float, rgb_from_xyz: Array) -> Array:
    """Preetham's sky; colors that no mixture of red, green and blue is are cut. sun : (3,) unit."""
    directions = np.broadcast_to(np.asarray(vector, float), (len(site), 3))
    return np.maximum(transform(rgb_from_xyz, evaluate_preetham(directions, sun, turbidity)), 0.0)


def read_hosek_wilkie(
    site: Site, vector: Any, *, sun: Array, turbidity: float, ground_albedo: float, rgb_from_xyz: Array
) -> Array:
    """Hosek and Wilkie's sky, as `read_preetham`."""
    directions = np.broadcast_to(np.asarray(vector, float), (len(site), 3))
    light = evaluate_hosek_wilkie(directions, sun, turbidity, ground_albedo)
    return np.maximum(transform(rgb_from_xyz, light), 0.0)


_GENERATED = {"Vector": "ATTRIBUTE Vector generated"}

OPERATIONS = {
    "TEX_SKY PREETHAM": Operation(
        read_preetham, ("Vector",), ("Color",), ("sun", "turbidity", "rgb_from_xyz"), reads_site=True, links=_GENERATED
    ),
    "TEX_SKY HOSEK_WILKIE": Operation(
        read_hosek_wilkie,
        ("Vector",),
        ("Color",),
        ("sun", "turbidity", "ground_albedo", "rgb_from_xyz"),
        reads_site=True,
        links=_GENERATED,
    ),
    "TEX_SKY": Operation(
        read_sky,
        ("Vector",),
        ("Color",),
        ("image", "elevation", "rotation", "sun_size", "sun_bottom", "sun_top", "horizon", "ground"),
        reads_site=True,
        links=_GENERATED,
    ),
    "TEX_ENVIRONMENT": Operation(
        read_environment,
        ("Vector",),
        ("Color",),
        ("image", "interpolation", "projection"),
        reads_site=True,
        links={"Vector": "NEW_GEOMETRY Position"},
    ),
}
