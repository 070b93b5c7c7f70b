"""What Cycles shows of a surface by chance: where it is seen, and which of its values are compared.

Depth, Position and the indices are of one path, the first of a pixel. Behind a medium that is a path that was not
scattered, of the probability of its transmittance or, from Blender 5.0 on, of one between that and a half; any other
path shows the background. This engine shows what lies there. So a pixel agrees where some of Cycles' paths show the
same surface, however few: what they show is no chance, and is compared as it is elsewhere.

References
----------
Blender, intern/cycles/kernel/film/data_passes.h (written by the first sample alone, over what was there, and not once a
path has been scattered) and kernel/integrator/shade_volume.h (the probability of being scattered).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans

from .rendering import CYCLES, Request, matched_settings, render_batches

# Cycles' depth where a ray hits nothing.
BACKGROUND_DEPTH = 1e10
# Renders that are made before what they show is looked at, and in all of one question. A surface of which a path in
# 1000 shows something is missed by so many with a probability of 36%; each takes a tenth of a second.
ASKED_BATCHES, MOST_ASKED = 8, 1024


class Answer(NamedTuple):
    """What more paths of Cycles show: a batch of each pass (1, h, w, c), and where they show a surface (1, h, w)."""

    passes: dict[str, NDArray[np.floating]]
    seen: Booleans


def find_seen(depth: NDArray[np.floating]) -> Booleans:
    """Return (k, h, w): where batches of Depth (k, h, w, 1) are of a surface."""
    seen: Booleans = depth[..., 0] < BACKGROUND_DEPTH
    return seen


def find_doubtful(ours: Booleans, cycles: Booleans) -> Booleans:
    """Return (h, w): pixels whose surface Cycles never shows, in a picture where it shows others now and then.

    ours, cycles : (k, h, w), where they show a surface
    """
    shown = cycles.any(axis=0)
    if (shown == cycles.all(axis=0)).all():  # there is no chance
        return np.zeros_like(shown)
    return ours.all(axis=0) & ~shown


def ask_again(scene: Any, view_layer: Any, request: Request, doubtful: Booleans, enough: float) -> Answer:
    """Let Cycles render passes until all doubtful pixels (h, w) but a share `enough` of the picture showed a surface.

    It marches through media, which takes no time and leaves the surfaces behind where they are. It gives up after
    `MOST_ASKED` renders, and where as many again as there were have shown no more: that is not chance.
    """
    left, count = doubtful.copy(), 0
    shown: dict[str, NDArray[np.floating]] = {}
    marching = replace(request, batches=ASKED_BATCHES, marches=True)
    with matched_settings(scene, view_layer, marching):
        look, before = ASKED_BATCHES, np.inf
        while left.mean() > enough and count < MOST_ASKED:
            asked = replace(marching, seed=request.seed + count)
            passes = render_batches(scene, view_layer, CYCLES, asked).passes
            seen = find_seen(passes["Depth"]) & left
            for name, values in passes.items():
                first = take_first(values, seen)
                shown[name] = np.where(seen.any(axis=0)[..., np.newaxis], first, shown.get(name, first))
            left &= ~seen.any(axis=0)
            count += ASKED_BATCHES
            if count == look:
                if left.sum() == before:
                    break
                look, before = 2 * look, left.sum()
    return Answer({name: values[np.newaxis] for name, values in shown.items()}, (doubtful & ~left)[np.newaxis])


def take_first(values: NDArray[np.floating], seen: Booleans) -> NDArray[np.floating]:
    """Return of batches (k, h, w, c) those values (h, w, c) that are the first of a surface (k, h, w), or of all."""
    return np.take_along_axis(values, seen.argmax(axis=0)[np.newaxis, ..., np.newaxis], axis=0)[0]
