"""What panels have in common."""

from __future__ import annotations

from typing import Any

from ..properties import ENGINE


class EnginePanel:
    """A panel of the properties editor, shown for this engine."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    COMPAT_ENGINES = {ENGINE}  # noqa: RUF012  (Blender prescribes the form)

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.engine in cls.COMPAT_ENGINES


class RenderPanel(EnginePanel):
    """A panel of the render tab."""

    bl_context = "render"


def split(panel: Any) -> Any:
    """Return a column with Blender's usual split of name and value."""
    panel.layout.use_property_split = True
    panel.layout.use_property_decorate = False
    return panel.layout.column()
