"""The built-in panels that the engine joins, and leaves again.

A panel is shown for the engines in its `COMPAT_ENGINES`. Most of Blender's carry BLENDER_RENDER, the mark of settings
that any engine may follow; those for things this engine does not follow are left out. The few of EEVEE's that edit
what every engine shares (shader nodes, light, lens) are joined too, so that they look as in the Blender at hand.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy

from ..properties import ENGINE

# Built-in panels marked BLENDER_RENDER for what the engine does not follow, or replaced by a better one of its own.
LEFT_OUT = (
    "DATA_PT_light",
    "EEVEE_MATERIAL_PT_viewport_settings",
    "NODE_DATA_PT_light",
)
LEFT_OUT_GROUPS = ("DATA_PT_lightprobe", "RENDER_PT_simplify")

# EEVEE's panels for what all engines share.
BORROWED = (
    "DATA_PT_EEVEE_light",
    "DATA_PT_camera_dof",
    "DATA_PT_camera_dof_aperture",
    "EEVEE_MATERIAL_PT_context_material",
    "EEVEE_MATERIAL_PT_surface",
    "EEVEE_MATERIAL_PT_volume",
    "MATERIAL_PT_preview",
)

_joined: list[Any] = []


def find_panels() -> list[Any]:
    """Return the built-in panels that this engine joins."""
    return [panel for panel in all_subclasses(bpy.types.Panel) if is_joined(panel)]


def is_joined(panel: Any) -> bool:
    """Return whether the engine shows a built-in panel."""
    name, engines = panel.__name__, getattr(panel, "COMPAT_ENGINES", None)
    if name in BORROWED:
        return True
    left_out = name in LEFT_OUT or name.startswith(LEFT_OUT_GROUPS)
    # Panels of other add-ons may list them in a tuple.
    return isinstance(engines, set) and "BLENDER_RENDER" in engines and not left_out


def all_subclasses(kind: Any) -> Iterator[Any]:
    """Yield the classes that derive from `kind`, directly or not."""
    for subclass in kind.__subclasses__():
        yield subclass
        yield from all_subclasses(subclass)


def join() -> None:
    """Join the built-in panels."""
    _joined[:] = find_panels()
    for panel in _joined:
        panel.COMPAT_ENGINES.add(ENGINE)


def leave() -> None:
    """Leave them as they were."""
    for panel in _joined:
        panel.COMPAT_ENGINES.discard(ENGINE)
    _joined.clear()
