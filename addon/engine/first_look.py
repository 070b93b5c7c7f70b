"""The first look at a picture: in large pixels, until every pixel of the real one has a sample.

Blender shows a checkerboard where nothing is; a sweep over a large picture may take a minute.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import raytracer
from raytracer.rendering.progressive import Picture, Target, develop, render_coarse

from .output import Border, RenderOutput

# Sides of the pixels of one look after the other. Together they take a twelfth of the time of one sweep.
FACTORS = (16, 8, 4)
# Pixels of a border below which a sweep is there as soon.
SMALLEST_PICTURE = 1 << 16


def show_first_look(
    output: RenderOutput,
    scene: raytracer.Scene,
    caster: raytracer.Caster,
    frame: tuple[int, int],
    border: Border,
    settings: dict[str, Any],
    is_cancelled: Callable[[], bool],
) -> None:
    """Write Combined in ever smaller pixels, one sample of each, and let Blender draw it.

    frame : width and height of the whole frame, pixels
    settings : keywords of `raytracer.render`
    """
    if border.width * border.height < SMALLEST_PICTURE or scene.camera is None:
        return
    plain = {**settings, "passes": ("Combined",), "error": None, "seconds": None}
    for name in ("samples", "border", "workers"):  # a target has its own
        plain.pop(name, None)
    target = Target(scene.camera, *frame, border=border, samples=1, settings=plain)
    for factor in FACTORS:
        film = render_coarse(replace(scene, motion=None), caster, target, factor, 1, lambda *_: None, is_cancelled)
        if film.cancelled:
            return
        output.write({"Combined": enlarge(develop(film, target, factor, (0, 1)), factor, border)})
        output.show()


def enlarge(picture: Picture, factor: int, border: Border) -> NDArray[np.float32]:
    """Return a coarse picture in the pixels of the border, (h, w, 4), row 0 at the top."""
    fine = picture.pixels.repeat(factor, axis=0).repeat(factor, axis=1)
    bottom, left = border.y_min - picture.bottom, border.x_min - picture.left
    return fine[bottom : bottom + border.height, left : left + border.width][::-1]
