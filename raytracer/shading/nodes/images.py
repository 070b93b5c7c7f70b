"""Image Texture: where on the image a point lies, and what is read there.

References
----------
Blender, intern/cycles/kernel/svm/image.h, kernel/camera/projection.h: the projections.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from raytracer.scene.programs import Image, TiledImage
from raytracer.shading.nodes.operation import Array, Operation, divide, saturate, spread
from raytracer.shading.site import Site
from raytracer.textures.image import map_sphere, sample_image
from raytracer.textures.image_set import ImageSet, sample_image_set

# What stands for a missing image: one magenta pixel, read as any other, so that it fades where images are clipped.
MISSING_IMAGE = Image(np.array([[(1.0, 0.0, 1.0, 1.0)]], dtype=np.float32), name="missing")


def _map_tube(x: Array, y: Array, z: Array) -> tuple[Array, Array]:
    """Angle and height of points around the z axis."""
    away = np.sqrt(x * x + y * y)
    u = (1.0 - np.arctan2(divide(x, away), divide(y, away)) / np.pi) / 2.0
    return np.where(away > 0, u, 0.0), np.where(away > 0, (z + 1.0) / 2.0, 0.0)


PROJECTIONS = {"SPHERE": map_sphere, "TUBE": _map_tube}


def read_texture(
    site: Site,
    vector: Any,
    *,
    image: Image | TiledImage | ImageSet | None,
    interpolation: str,
    extension: str,
    projection: str,
    projection_blend: float,
    unassociate: bool,
) -> tuple[Array, Array]:
    """Color and alpha of an image, or of each material's; None is a missing one."""
    count, shown = len(site), MISSING_IMAGE if image is None else image

    def read(u: Array, v: Array, rows: Any = slice(None)) -> Array:
        uv, settings = np.stack([u, v], axis=1), (interpolation, extension, unassociate)
        if isinstance(shown, ImageSet):
            return sample_image_set(shown, site.surface.material[rows], uv, *settings)
        return sample_image(shown, uv, *settings)

    x, y, z = np.broadcast_to(np.asarray(vector, float), (count, 3)).T
    if projection == "BOX":
        values = _read_box(read, (x, y, z), site.normal_to_object(site.normal), projection_blend)
    elif projection in PROJECTIONS:
        values = read(*PROJECTIONS[projection](2.0 * x - 1.0, 2.0 * y - 1.0, 2.0 * z - 1.0))
    else:
        values = read(x, y)
    return values[:, :3], values[:, 3]


def _read_box(read: Any, point: tuple[Array, Array, Array], normal: Array, blend: float) -> Array:
    """The image on each of the box's three pairs of sides, blended where the normal points between them."""
    weights = weigh_sides(np.abs(normal), blend)
    x, y, z = point
    sides = (
        (np.where(normal[:, 0] < 0, 1.0 - y, y), z),
        (np.where(normal[:, 1] > 0, 1.0 - x, x), z),
        (np.where(normal[:, 2] > 0, 1.0 - y, y), x),
    )
    values = np.zeros((len(normal), 4))
    for side, (u, v) in enumerate(sides):
        rows = np.flatnonzero(weights[:, side] > 0)
        if len(rows):
            values[rows] += weights[rows, side : side + 1] * read(u[rows], v[rows], rows)
    return values


def weigh_sides(normal: Array, blend: float) -> Array:
    """Return the weights (n, 3) of the sides of a box for normals (n, 3) without signs.

    The normal's components, made to add up to 1, are weights in a triangle: one side at each corner, two along each
    edge and all three in the middle, in a zone whose width is `blend`.
    """
    normal = normal / normal.sum(axis=1, keepdims=True)
    limit = 0.5 * (1.0 + blend)
    weights = np.zeros_like(normal)
    open_ = np.ones(len(normal), dtype=np.bool_)
    for side in range(3):
        first, second = normal[:, (side + 1) % 3], normal[:, (side + 2) % 3]
        own = normal[:, side]
        alone = open_ & (own > limit * (own + first)) & (own > limit * (own + second))
        weights[alone, side] = 1.0
        open_ &= ~alone
    if blend <= 0:
        weights[open_, 0] = 1.0
        return weights
    for left_out, side, other in ((2, 0, 1), (0, 1, 2), (1, 0, 2)):
        both = normal[:, side] + normal[:, other]
        edge = open_ & (normal[:, left_out] < (1.0 - limit) * both)
        share = saturate((divide(normal[:, side], both) - 0.5 * (1.0 - blend)) / blend)
        weights[edge, side], weights[edge, other] = share[edge], 1.0 - share[edge]
        open_ &= ~edge
    middle = ((2.0 - limit) * normal + (limit - 1.0)) / (2.0 * limit - 1.0)
    return np.where(spread(open_) != 0, middle, weights)


OPERATIONS = {
    "TEX_IMAGE": Operation(
        read_texture,
        ("Vector",),
        ("Color", "Alpha"),
        ("image", "interpolation", "extension", "projection", "projection_blend", "unassociate"),
        reads_site=True,
        links={"Vector": "ATTRIBUTE Vector uv"},
    ),
}
