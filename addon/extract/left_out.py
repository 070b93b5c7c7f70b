"""What is missing, and what is said of a file as a whole and not honoured, named in warnings."""

from __future__ import annotations

from typing import Any

from .. import versions
from .warnings import WarningList


def warn_missing(depsgraph: Any, warnings: WarningList) -> None:
    """Name data that a missing library left as placeholders."""
    for data in depsgraph.ids:
        original = data.original
        if original.is_missing:
            path = f" from '{original.library.filepath}'" if original.library else ""
            kind = original.bl_rna.name
            warnings.add(f"{kind} '{original.name}' is linked{path}, which is missing: left out")


def warn_working_space(warnings: WarningList) -> None:
    """Name a working space that is not the one which colors are made in here."""
    space = versions.find_working_space()
    if space != "Linear Rec.709":
        warnings.add(
            f"working space '{space}' is not supported: images of bytes, skies and blackbodies keep the numbers that "
            "they have in Linear Rec.709"
        )


def warn_transparent_film(scene: Any, warnings: WarningList) -> None:
    """Name Cycles' transparent glass, which shows on a transparent film alone."""
    if scene.render.film_transparent and getattr(getattr(scene, "cycles", None), "film_transparent_glass", False):
        warnings.add("Transparent Glass is not supported: alpha is that of opaque glass")
