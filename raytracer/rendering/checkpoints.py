"""Renders that outlive their process: a film's file is kept up to date, and the next render goes on from it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from raytracer.film.film import Film
from raytracer.film.film_file import load_film, save_film
from raytracer.integrator.settings import Settings
from raytracer.processes.workers import WorkerError
from raytracer.rendering.blocks import say_nothing
from raytracer.rendering.render import prepare_film, render
from raytracer.scene.scene import Scene

# Seconds between two writes, where nothing else is said, and the share of the time that they may take.
EVERY_SECONDS = 60.0
WRITING_SHARE = 0.05


class Checkpoints:
    """Writes a film now and then. Where that fails (a disk that is full for a minute, on Windows anybody who has the
    file open), `on_fault` is called, and the next time tries again."""

    def __init__(self, film: Film, path: Path, every: float, on_fault: Callable[[OSError], None]) -> None:
        self._film, self._path, self._every, self._on_fault = film, path, every, on_fault
        self._next = time.monotonic() + every

    def consider(self) -> None:
        """Write the film if it is time. After w seconds of that, at least w / share - w go by until the next time."""
        started = time.monotonic()
        if started < self._next:
            return
        try:
            self.write()
        except OSError as error:
            self._on_fault(error)
        finished = time.monotonic()
        self._next = finished + max(self._every, (finished - started) * (1.0 / WRITING_SHARE - 1.0))

    def write(self) -> None:
        """Write the film, or raise OSError."""
        save_film(self._film, self._path)


def render_into(
    path: Path,
    scene: Scene,
    width: int,
    height: int,
    samples: int,
    *,
    every: float = EVERY_SECONDS,
    on_fault: Callable[[OSError], None] = say_nothing,
    must_write: bool = True,
    on_progress: Callable[[float], None] = say_nothing,
    **keywords: Any,
) -> Film:
    """Render as `render` does, with a film's file that is written every so often, and once more at the end.

    Where the file exists, the render goes on from it: the same call again ends what the last one did not.

    Parameters
    ----------
    path : of the film's file
    every : seconds between two writes, which take no more than WRITING_SHARE of the time
    on_fault : called with the error where the file cannot be written meanwhile, which is tried again
    must_write : False where the film is worth more than its file: `on_fault` is told of the last write, too
    keywords : those of `render`, and settings

    Raises
    ------
    ValueError
        If the file is no film, or of another picture.
    OSError
        If the file cannot be read, or in the end not be written.
    """
    film = resume(path, scene, width, height, samples, keywords)
    checkpoints = Checkpoints(film, path, every, on_fault)

    def write() -> None:
        try:
            checkpoints.write()
        except OSError as error:
            if must_write:
                raise
            on_fault(error)

    def tell(share: float) -> None:
        checkpoints.consider()
        try:
            on_progress(share)
        except BaseException:  # between two blocks the film is whole: what ends the render here loses nothing
            write()
            raise

    try:
        render(scene, width, height, samples, film=film, on_progress=tell, **keywords)
    except WorkerError:  # this, too, comes between two blocks
        write()
        raise
    write()
    return film


def describe_fault(error: OSError) -> str:
    """Return a warning of a write that failed, and will be tried again."""
    return f"{error.filename}: not written, which is tried again: {error.strerror}"


def resume(path: Path, scene: Scene, width: int, height: int, samples: int, keywords: dict[str, Any]) -> Film:
    """Return the film of a file that is of this picture, or an empty one where there is no file."""
    names = [name for name in Settings.__dataclass_fields__ if name != "workers"]
    settings = Settings(samples=samples, **{name: keywords[name] for name in names if name in keywords})
    return prepare_film(scene, width, height, settings, load_film(path) if path.exists() else None)[0]
