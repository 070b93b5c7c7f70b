"""What of objects is left out, or missing, named in warnings."""

from __future__ import annotations

from typing import Any

from .. import versions
from .warnings import WarningList


def warn_left_out(source: Any, view_layer: Any, warnings: WarningList) -> None:
    """Name what an object has and rendering leaves out: hair that the view layer shows, adaptive subdivision."""
    for system in source.particle_systems if view_layer.use_strand else ():
        if system.settings.type == "HAIR" and system.settings.render_type == "PATH":
            warnings.add(f"particle hair '{system.name}' is not supported, left out", source.name)
    if versions.subdivides_adaptively(source):
        warnings.add("adaptive subdivision is not supported, the modifier's own levels are used", source.name)


def warn_missing(depsgraph: Any, warnings: WarningList) -> None:
    """Name data that a missing library left as placeholders."""
    for data in depsgraph.ids:
        original = data.original
        if original.is_missing:
            path = f" from '{original.library.filepath}'" if original.library else ""
            kind = original.bl_rna.name
            warnings.add(f"{kind} '{original.name}' is linked{path}, which is missing: left out")
