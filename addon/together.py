"""What is added to Blender together: all of it, or nothing where a part of it fails."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any

import bpy


def register_all(parts: Sequence[Any]) -> None:
    """Call `register` of each part; where one fails, take out those before it."""
    with ExitStack() as undo:
        for part in parts:
            part.register()
            undo.callback(part.unregister)
        undo.pop_all()


def unregister_all(parts: Sequence[Any]) -> None:
    """Call `unregister` of each part, in the reverse order; where one fails, of the others too."""
    with ExitStack() as undo:
        for part in parts:
            undo.callback(part.unregister)


@dataclass(frozen=True)
class _Class:
    kind: type

    def register(self) -> None:
        bpy.utils.register_class(self.kind)

    def unregister(self) -> None:
        bpy.utils.unregister_class(self.kind)


def make_registrars(classes: Sequence[type]) -> tuple[Callable[[], None], Callable[[], None]]:
    """Return two functions that register classes, and unregister them."""
    parts = tuple(_Class(kind) for kind in classes)
    return partial(register_all, parts), partial(unregister_all, parts)
