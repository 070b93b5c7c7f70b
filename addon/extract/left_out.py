"""What of objects is left out, or missing, named in warnings."""

from __future__ import annotations

from typing import Any

from .. import versions
from .warnings import WarningList


def warn_left_out(source: Any, warnings: WarningList) -> None:
    """Name what an object has and rendering leaves out: adaptive subdivision."""
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
