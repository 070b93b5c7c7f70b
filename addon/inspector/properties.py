"""The rows of the lists in the panels, kept with the window manager: of the session, not of the scene."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import CollectionProperty, IntProperty, PointerProperty, StringProperty

from . import drawing


def choose_row(state: Any, context: Any) -> None:
    """Draw the lines of the row that was clicked thicker (Blender's callback)."""
    if state.ray_index < len(state.rays):
        drawing.choose_ray(state.rays[state.ray_index].number)


class ReferenceRaytracerRay(bpy.types.PropertyGroup):
    """A row of the list of rays; `name` says what it is and hits."""

    number: IntProperty(name="Number", description="Number of the ray within its tree")  # type: ignore[valid-type]
    kind: StringProperty(name="Kind", description="How the ray was spawned")  # type: ignore[valid-type]
    depth: IntProperty(  # type: ignore[valid-type]
        name="Depth", description="Number of rays between this one and the camera's"
    )


class ReferenceRaytracerSession(bpy.types.PropertyGroup):
    """What the panels show of this session's inspected rays."""

    rays: CollectionProperty(  # type: ignore[valid-type]
        type=ReferenceRaytracerRay, name="Rays", description="The camera ray and all rays it spawns"
    )
    ray_index: IntProperty(  # type: ignore[valid-type]
        name="Ray", description="Row of the ray whose details are shown below the list", min=0, update=choose_row
    )


CLASSES = (ReferenceRaytracerRay, ReferenceRaytracerSession)


def register() -> None:
    """Add the rows to the window manager."""
    for row in CLASSES:
        bpy.utils.register_class(row)
    bpy.types.WindowManager.reference_raytracer = PointerProperty(
        type=ReferenceRaytracerSession, name="Reference Ray Tracer", description="Inspected rays of this session"
    )


def unregister() -> None:
    """Take them out."""
    del bpy.types.WindowManager.reference_raytracer
    for row in reversed(CLASSES):
        bpy.utils.unregister_class(row)
