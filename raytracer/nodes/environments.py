"""Environment Texture: a picture of all directions.

Imports `directions`, `textures`, `operation`, `sites`.

References
----------
Blender, intern/cycles/kernel/camera/projection.h: the mirror ball.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from raytracer.directions import find_equirectangular
from raytracer.frames import normalize
from raytracer.nodes.images import MAGENTA
from raytracer.nodes.operation import Array, Operation
from raytracer.programs import Image
from raytracer.sites import Site
from raytracer.textures import sample_image


def find_mirror_ball(directions: Array) -> tuple[Array, Array]:
    """Where a ball that mirrors shows directions (n, 3) to one who looks along +y: its normal is half way to -y."""
    x, y, z = directions.T
    length = 2.0 * np.sqrt(np.maximum(0.5 * (1.0 - y), 0.0))
    length = np.where(length > 0, length, 1.0)
    return 0.5 * (x / length + 1.0), 0.5 * (z / length + 1.0)


PROJECTIONS = {"EQUIRECTANGULAR": find_equirectangular, "MIRROR_BALL": find_mirror_ball}


def read_environment(site: Site, vector: Any, *, image: Image | None, interpolation: str, projection: str) -> Array:
    """The color of an image in the direction of `vector`; None is a missing one."""
    if image is None:
        return MAGENTA[:3]
    directions = normalize(np.broadcast_to(np.asarray(vector, float), (len(site), 3)))
    u, v = PROJECTIONS[projection](directions)
    return sample_image(image, np.stack([u, v], axis=1), interpolation, "REPEAT")[:, :3]


OPERATIONS = {
    "TEX_ENVIRONMENT": Operation(
        read_environment,
        ("Vector",),
        ("Color",),
        ("image", "interpolation", "projection"),
        reads_site=True,
        links={"Vector": "NEW_GEOMETRY Position"},
    ),
}
