"""Whole tiles of pictures, of which one of hundreds fails by chance now and then: a difference fails again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy

from addon.compare.cycles import metrics
from addon.compare.cycles.rendering import Request, render_both

OTHER_SEED = 100
TILE = 8


def assert_tiles_agree(scene: Any, request: Request, ours: Any, cycles: Any) -> None:
    """Hold tiles of two sets of pictures to agree; where one does not, those of other samples, all of them."""
    summed = request.samples * request.cycles_factor
    if metrics.share_failing_tiles(ours, cycles, summed, size=TILE) > 0.0:
        sides = render_both(scene, bpy.context.view_layer, replace(request, seed=OTHER_SEED))
        pictures = [side.passes["Combined"] for side in sides]
        assert metrics.share_failing_tiles(*pictures, summed, size=TILE) == 0.0
