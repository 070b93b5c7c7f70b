"""Images that points of different materials read at once: what is done for each of them is the reading of pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.scene.programs import Image
from raytracer.textures.image import Indices, blend_pixels, finish_colors, scale_stored


@dataclass(frozen=True, eq=False)
class ImageSet:
    """Images of one type of pixels and one encoding.

    row : (materials,) int64, of the image that each material reads
    """

    images: tuple[Image, ...]
    row: Indices


def sample_image_set(
    images: ImageSet,
    material: NDArray[np.integer],
    uv: Floats,
    interpolation: str = "Linear",
    extension: str = "REPEAT",
    unassociate: bool = False,
) -> Floats:
    """Return color and alpha (n, 4) at coordinates (n, 2) of materials (n,); as `sample_image`, bit for bit."""
    which = images.row[material]
    order = np.argsort(which, kind="stable")
    ends = np.cumsum(np.bincount(which, minlength=len(images.images)))
    starts = np.concatenate([[0], ends[:-1]])
    parts = [
        (image.pixels.reshape(-1, 4), start, end)
        for image, start, end in zip(images.images, starts.tolist(), ends.tolist(), strict=True)
        if end > start
    ]
    kind = images.images[0]

    def read(index: Indices) -> NDArray[np.generic]:
        ordered, found = index[order], np.empty((len(index), 4), kind.pixels.dtype)
        for pixels, start, end in parts:
            found[order[start:end]] = pixels.take(ordered[start:end], axis=0)
        return found

    height, width = np.array([image.pixels.shape[:2] for image in images.images])[which].T
    total = blend_pixels(read, height, width, uv, interpolation, extension)
    return finish_colors(scale_stored(total, kind), kind.encoding, unassociate)
