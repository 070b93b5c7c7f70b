"""Stills that outlive Esc and a crash: where the scene asks for it, a render keeps its film in a file beside
the .blend, and *Render > Resume Render* goes on from there.

The file is that of a frame and view layer. It goes when the frame is complete: what it is for has then been done.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy
from bpy.app.handlers import persistent

from raytracer.files.replacing import check_replaceable
from raytracer.film.film import Film
from raytracer.film.film_file import load_film
from raytracer.film.picture_key import describe_difference

from .. import handlers
from ..properties import ENGINE
from .orders import KeepFilm
from .stereo import list_views

SUFFIX = ".checkpoint.npz"
# Letters that tell view layers and scenes of a file apart: their names may be too long for a file's, or have others.
LETTERS = 8
# Bytes that a file's name has of the .blend's: there is room for 255 in all.
LONGEST_STEM = 160


class _Session:
    is_resuming = False
    spent: tuple[Path, ...] = ()  # files of a frame that is traced, and not yet with Blender


def find_path(scene: Any, view_layer: str, view: str = "") -> Path:
    """Return the file of a view layer, or one of its stereo views, of the current frame: in the folder that the scene
    names, or a temporary one where that is beside a .blend that has never been saved.

    Its name tells files apart that share a folder: those of other .blends with the same name, and of other users.
    """
    folder, blend = scene.reference_raytracer.checkpoint_folder or "//", bpy.data.filepath
    is_beside = bool(folder.startswith("//") and blend)
    parent = Path(tempfile.gettempdir() if folder.startswith("//") and not blend else bpy.path.abspath(folder))
    stem = Path(blend).stem or "untitled"
    short = stem.encode()[:LONGEST_STEM].decode(errors="ignore")
    owner = (stem if short != stem else "") if is_beside else blend or f"user {find_user()}"
    name = "\0".join((scene.name, view_layer, view, owner)).rstrip("\0")
    names = hashlib.sha256(name.encode()).hexdigest()[:LETTERS]
    return parent / f"{short}_{scene.frame_current:04}_{names}{SUFFIX}"


def find_user() -> int:
    """Return the number of the user, or 0 on Windows, where each has a temporary folder."""
    return os.getuid() if sys.platform != "win32" else 0


def list_files(scene: Any) -> list[Path]:
    """Return the files of the current frame that are there."""
    layers = [layer.name for layer in scene.view_layers if layer.use]
    paths = (find_path(scene, name, view) for name in layers for view in list_views(scene))
    return [file for path in paths for file in (path, find_aside(path)) if file.is_file()]


def can_resume(scene: Any) -> bool:
    """Return whether a render of the current frame was left unfinished."""
    is_asked_for = scene.render.engine == ENGINE and scene.reference_raytracer.use_checkpoints
    return bool(is_asked_for and list_files(scene))


def is_wanted(engine: Any, scene: Any) -> bool:
    """Return whether a render keeps its films: previews and animations do not."""
    return scene.reference_raytracer.use_checkpoints and not (engine.is_preview or engine.is_animation)


def make_order(engine: Any, scene: Any, view_layer: str, view: str = "") -> KeepFilm:
    """Return the order to keep the film of a view layer, or of one of its stereo views, or raise OSError where its file
    could not be written.

    A fault that comes later, a full disk, is a warning: it costs the file, and not the picture.
    """
    path = find_path(scene, view_layer, view)
    path.parent.mkdir(parents=True, exist_ok=True)
    check_replaceable(path)
    aside = find_aside(path)
    if not _Session.is_resuming and path.exists():
        path.replace(aside)
    elif _Session.is_resuming and aside.exists() and not path.exists():  # the render that set it aside wrote nothing
        aside.replace(path)

    def warn(error: OSError) -> None:
        engine.report({"WARNING"}, f"Checkpoint not saved: {path}: {error.strerror}")

    every = float(scene.reference_raytracer.checkpoint_interval)
    return KeepFilm(path, every=every, on_fault=warn, must_write=False)


def find_aside(path: Path) -> Path:
    """Return where a render that begins anew keeps the file of the one before: the user may have meant to resume."""
    return path.with_name(f"{path.name.removesuffix(SUFFIX)}.before.npz")


def settle(path: Path, film: Film) -> None:
    """Put back a file that was set aside where a render of the same picture was stopped with fewer samples: all that it
    has is in there. Else the file goes."""
    aside = find_aside(path)
    with suppress(OSError):  # what stays is found by the next render
        if film.cancelled and aside.exists() and is_ahead(aside, film):
            aside.replace(path)
        aside.unlink(missing_ok=True)


def is_ahead(path: Path, film: Film) -> bool:
    """Return whether a file holds a film of the same picture as `film`, with more samples."""
    try:
        other = load_film(path)
    except ValueError:
        return False
    if film.key is None or other.key is None or other.samples <= film.samples:
        return False
    return not describe_difference(other.key, film.key)


def spend_files(scene: Any) -> None:
    """Let the files of a frame that is traced go once it is complete: Blender still denoises, composites and writes the
    picture, and a crash leaves them."""
    _Session.spent = tuple(list_files(scene))


@persistent
def remove_spent(*_: Any) -> None:
    """Remove the files of a frame that is complete; the picture is worth more than one that stays, with a warning."""
    for path in _Session.spent:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            print(f"Warning: Checkpoint not removed: {path}: {error.strerror}", flush=True)
    forget()


def resume() -> None:
    """Let the next render go on from the files that are there."""
    _Session.is_resuming = True


@persistent
def forget(*_: Any) -> None:
    """Let renders begin anew, and the files stay that are there."""
    _Session.is_resuming, _Session.spent = False, ()


def register() -> None:
    """Watch for the ends of renders."""
    handlers.join(remove_spent, handlers.HANDLERS.render_complete)
    handlers.join(forget, *handlers.RENDER_STOPS)


def unregister() -> None:
    """Watch no more."""
    forget()
    handlers.leave(remove_spent, handlers.HANDLERS.render_complete)
    handlers.leave(forget, *handlers.RENDER_STOPS)
