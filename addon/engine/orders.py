"""What a command asks of the render engine besides a picture: to keep a film in a file, to write the scene as a file,
or to show a film that is there already.

All go through Blender's render operator, so that they see the scene as a render does: its modifiers, its visibility,
its frame. One order is given at a time, and holds for the renders inside its block.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import raytracer
from raytracer.film.film import Film
from raytracer.rendering.blocks import say_nothing
from raytracer.rendering.checkpoints import EVERY_SECONDS, render_into

from .. import interrupts

# What the machine that renders decides.
NOT_EXPORTED = ("workers",)


@dataclass(frozen=True)
class KeepFilm:
    """Render into a film's file, and go on from it where it exists.

    tile, until : as in `raytracer.render`; without a tile the film is all of the picture, what is inside its border
    every : seconds between two writes
    on_fault, must_write : as in `render_into`
    """

    path: Path
    tile: tuple[int, int] | None = None
    until: int | None = None
    every: float = EVERY_SECONDS
    on_fault: Callable[[OSError], None] = say_nothing
    must_write: bool = True

    def render(self, *arguments: Any, is_cancelled: Callable[[], bool], **keywords: Any) -> Film:
        """Render as `raytracer.render` does; Ctrl-C ends it with what there is, in the file."""

        def is_over() -> bool:
            return interrupts.is_noted() or is_cancelled()

        writing: dict[str, Any] = {"every": self.every, "on_fault": self.on_fault, "must_write": self.must_write}
        settings = {"tile": self.tile or (1, 1), "until": self.until, "is_cancelled": is_over, **writing, **keywords}
        with interrupts.poll():
            film = render_into(self.path, *arguments, **settings)
        interrupts.check()
        return film


@dataclass(frozen=True)
class ExportScene:
    """Write the scene, and the settings of its render, instead of rendering."""

    path: Path

    def export(self, scene: raytracer.Scene, width: int, height: int, settings: dict[str, Any]) -> Film:
        """Write it; return a film that nothing was rendered into."""
        chosen = {name: value for name, value in settings.items() if name not in NOT_EXPORTED}
        raytracer.save(scene, self.path, {"width": width, "height": height, **chosen})
        x_min, y_min, x_max, y_max = settings["border"]
        return Film(x_max - x_min, y_max - y_min, settings["passes"])


@dataclass(frozen=True, eq=False)
class ShowFilm:
    """Take the picture from a film instead of rendering."""

    film: Film


Order = KeepFilm | ExportScene | ShowFilm

_orders: list[Order] = []


@contextlib.contextmanager
def give(order: Order) -> Iterator[None]:
    """Let the renders inside the block follow an order."""
    _orders.append(order)
    try:
        yield
    finally:
        _orders.pop()


def find_order() -> Order | None:
    """Return the order that holds, or None where a picture is all that is asked for."""
    return _orders[-1] if _orders else None
