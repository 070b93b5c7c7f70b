"""The texture space of objects: what Generated coordinates are inside of them, where no vertices hold any."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class TextureSpace(NamedTuple):
    """Generated coordinates are scale * p + offset at the point p of object space, (3,) each."""

    scale: NDArray[np.float64]
    offset: NDArray[np.float64]


def read_texture_space(shown: Any) -> TextureSpace:
    """Return the texture space of an evaluated object: of a mesh its own, of a volume the box of its grids.

    References
    ----------
    Blender, intern/cycles/blender/util.h (mesh_texture_space), blender/volume.cpp (sync_volume_object).
    """
    if shown.type == "MESH":
        location, size = np.array(shown.data.texspace_location), 2.0 * np.array(shown.data.texspace_size)
        low = location - size / 2.0
    else:
        corners = np.array(shown.bound_box)  # (8, 3)
        low, size = corners.min(axis=0), np.ptp(corners, axis=0)
    scale = np.divide(1.0, size, out=np.zeros(3), where=size != 0)
    return TextureSpace(scale, np.where(size != 0, -low * scale, 0.5))
