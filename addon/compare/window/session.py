"""The outcome of the last comparison, and the verdict on the ray chosen last; of this session only."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent

from raytracer.integrator.traced_rays import TracedRay

from ...handlers import HANDLERS, join, leave
from ...inspector import session as inspector
from ..ray_cast.verdict import Verdict, judge_ray
from ..results import Outcome, Worst
from .heat_map import show_heat_map

_outcome: Outcome | None = None
_scene = 0  # the `session_uid` of its scene
_size = (0, 0)
_trouble = ""
_verdicts: tuple[Verdict, Verdict] | None = None


def find_outcome(scene: Any = None) -> Outcome | None:
    """Return the outcome of the last comparison, or None; of a scene, if that was compared."""
    return _outcome if scene is None or scene.session_uid == _scene else None


def find_trouble() -> str:
    """Return why the entry of the list chosen last could not be inspected; empty where it could."""
    return _trouble


def find_verdicts() -> tuple[Verdict, Verdict] | None:
    """Return the last verdicts on this caster and on Scene.ray_cast, or None."""
    return _verdicts


def find_verdicts_on(ray: TracedRay) -> tuple[Verdict, Verdict] | None:
    """Return the verdicts where they are on this ray, or None."""
    if _verdicts is None:
        return None
    judged = _verdicts[0]
    same = np.array_equal(judged.origin, ray.origin) and np.array_equal(judged.direction, ray.direction)
    return _verdicts if same else None


def keep(outcome: Outcome, scene: int) -> Any:
    """Show numbers, list and map; return the map's image.

    scene : `session_uid` of what was compared
    """
    global _outcome, _scene, _size, _trouble
    _outcome, _scene, _trouble = outcome, scene, ""
    _size = outcome.heat.shape[1], outcome.heat.shape[0]
    for manager in bpy.data.window_managers:
        rows = manager.reference_raytracer_comparison.worst
        rows.clear()
        for entry in outcome.worst:
            row = rows.add()
            row.apart, row.place, row.object, row.ours, row.theirs = entry.columns
            row.name = "   ".join(entry.columns)
    return show_heat_map(outcome.heat * np.float32(outcome.gain))


def inspect_worst(context: Any, index: int) -> None:
    """Inspect the ray of an entry of the list, and judge it; Blender's callback of a click cannot report an error."""
    global _trouble
    outcome, _trouble = find_outcome(context.scene), ""
    if outcome is None or not 0 <= index < len(outcome.worst):
        return
    try:
        _inspect(context, outcome.worst[index])
    except ValueError as error:
        _trouble = str(error)


def _inspect(context: Any, entry: Worst) -> None:
    depsgraph = context.evaluated_depsgraph_get()
    if entry.origin:
        inspected = inspector.inspect_ray(
            depsgraph, entry.origin, entry.direction, f"Ray at {entry.object} ({entry.place})"
        )
    else:
        inspected = inspector.inspect_pixel(depsgraph, entry.x, entry.y, _size)
    judge(context, inspected.tree[0].origin, inspected.tree[0].direction)


def judge(context: Any, origin: Any, direction: Any) -> None:
    """Judge both casters' answers to one ray in exact arithmetic."""
    global _verdicts
    _verdicts = judge_ray(context.scene, context.evaluated_depsgraph_get(), origin, direction)


@persistent
def clear(*_: Any) -> None:
    """Forget all; called when a file is loaded, too. The image stays: it belongs to the file by now."""
    global _outcome, _verdicts, _trouble
    _outcome = _verdicts = None
    _trouble = ""
    for manager in bpy.data.window_managers:
        manager.reference_raytracer_comparison.worst.clear()
        manager.reference_raytracer_comparison.is_running = False  # as a file may say that was saved meanwhile


def register() -> None:
    """Clear whenever another file is loaded."""
    join(clear, HANDLERS.load_post)


def unregister() -> None:
    """Forget all, and do not listen any more."""
    leave(clear, HANDLERS.load_post)
    clear()
