"""What is missing, named in warnings."""

from __future__ import annotations

from typing import Any

from .warnings import WarningList


def warn_missing(depsgraph: Any, warnings: WarningList) -> None:
    """Name data that a missing library left as placeholders."""
    for data in depsgraph.ids:
        original = data.original
        if original.is_missing:
            path = f" from '{original.library.filepath}'" if original.library else ""
            kind = original.bl_rna.name
            warnings.add(f"{kind} '{original.name}' is linked{path}, which is missing: left out")
