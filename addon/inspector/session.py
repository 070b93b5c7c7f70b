"""What was inspected last: in memory, of this session, as plain records."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
from bpy.app.handlers import persistent

import raytracer
from raytracer.integrator.inspect_ray import Inspector, make_inspector
from raytracer.integrator.traced_rays import TracedRay

from ..extract.scene import Extraction, extract_scene
from ..handlers import HANDLERS, join, leave
from ..properties import settings_keywords
from . import drawing
from .describe import find_depth, order_rays, title_ray
from .names import Names, find_names
from .segments import make_segments


@dataclass(frozen=True, eq=False)
class Inspected:
    """A tree of rays, with the names of what they met; where it begins, in words, and what its first ray is called."""

    tree: list[TracedRay]
    names: Names
    place: str
    first: str = "Camera"


_inspected: Inspected | None = None


def find_inspected() -> Inspected | None:
    """Return what was inspected last, or None."""
    return _inspected


def read_inspector(depsgraph: Any, space: Any = None) -> tuple[Inspector, Extraction]:
    """Return what looks at the rays of the scene as a depsgraph shows it.

    space : the 3D view that it is seen in, which needs no camera and may hide objects; None as the camera sees it

    Raises
    ------
    ValueError
        If the scene cannot be rendered.
    """
    extraction = extract_scene(depsgraph, space=space)
    settings = raytracer.Settings(**settings_keywords(depsgraph.scene_eval))
    caster = raytracer.build(extraction.scene, settings.precision)
    return make_inspector(extraction.scene, caster, settings, find_resolution(depsgraph.scene_eval)), extraction


def find_resolution(scene: Any) -> tuple[int, int]:
    """Return width and height of the scene's full picture, pixels, cut off in whole numbers as Blender does."""
    render = scene.render
    width, height = (
        max(1, side * render.resolution_percentage // 100) for side in (render.resolution_x, render.resolution_y)
    )
    return width, height


def inspect_pixel(depsgraph: Any, x: int, y: int, resolution: tuple[int, int] | None = None) -> Inspected:
    """Inspect the camera's ray through the centre of a pixel, column x and row y from the lower left corner.

    resolution : width and height of the full picture, pixels; None takes the scene's
    """
    width, height = resolution or find_resolution(depsgraph.scene_eval)
    if not (0 <= x < width and 0 <= y < height):
        raise ValueError(f"pixel {x}, {y} lies outside of the picture of {width} x {height}")
    inspector, extraction = read_inspector(depsgraph)
    tree = inspector.inspect_pixel(width, height, x + 0.5, y + 0.5)
    return keep(Inspected(tree, find_names(extraction, tree), f"Pixel {x}, {y} of {width} x {height}"))


def inspect_ray(
    depsgraph: Any, origin: Any, direction: Any, place: str, first: str = "Ray", space: Any = None
) -> Inspected:
    """Inspect the ray o + t d, t >= 0; world space, metres.

    place, first : as in Inspected; space : as in `read_inspector`
    """
    inspector, extraction = read_inspector(depsgraph, space)
    tree = inspector.inspect_ray(origin, direction)
    return keep(Inspected(tree, find_names(extraction, tree), place, first))


def keep(inspected: Inspected) -> Inspected:
    """Show it in the sidebar and in the 3D views."""
    global _inspected
    _inspected = inspected
    for manager in bpy.data.window_managers:
        rows = manager.reference_raytracer.rays
        rows.clear()
        for number in order_rays(inspected.tree):
            row, ray = rows.add(), inspected.tree[number]
            row.number, row.name, row.kind = number, title_ray(ray, inspected.names, inspected.first), ray.kind
            row.depth = find_depth(inspected.tree, number)
        manager.reference_raytracer.ray_index = 0
    drawing.show_segments(make_segments(inspected.tree))
    return inspected


@persistent
def clear(*_: Any) -> None:
    """Forget the rays and draw them no more; called when a file is loaded, too."""
    global _inspected
    _inspected = None
    drawing.clear_segments()
    for manager in bpy.data.window_managers:
        manager.reference_raytracer.rays.clear()


def register() -> None:
    """Clear whenever another file is loaded."""
    join(clear, HANDLERS.load_post)


def unregister() -> None:
    """Forget all, and do not listen any more."""
    leave(clear, HANDLERS.load_post)
    clear()
