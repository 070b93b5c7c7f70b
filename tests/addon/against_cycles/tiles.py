"""Whole tiles of pictures, of which one of hundreds fails by chance now and then: a difference fails again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy

from addon.compare.cycles import metrics
from addon.compare.cycles.rendering import Request, render_both

OTHER_SEED = 100
TILE = 8
# So many more pictures are taken where a tile fails: what made it fail is seen with twice the certainty, if it is real.
MORE = 4


def assert_tiles_agree(scene: Any, request: Request, ours: Any, cycles: Any) -> None:
    """Hold tiles of two sets of pictures to agree; where one does not, those of four times as many others, all of them.

    A difference that the first set has seen is twice as many standard errors of the second: the tests lose no power.
    """
    summed = request.samples * request.cycles_factor
    if metrics.share_failing_tiles(ours, cycles, summed, size=TILE) > 0.0:
        more = replace(request, seed=OTHER_SEED, batches=MORE * request.batches)
        pictures = [side.passes["Combined"] for side in render_both(scene, bpy.context.view_layer, more)]
        assert metrics.share_failing_tiles(*pictures, summed, size=TILE) == 0.0
