"""Render a scene file, or a tile of it, into a film or a picture; go on where the last render stopped.

The film's file is written every so often, and once more when the render ends or is told to (Ctrl-C, SIGTERM, on Windows
Ctrl-Break): the same command again goes on from there.
"""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

from raytracer.commands.arguments import (
    parse_names,
    parse_positive,
    parse_seconds,
    parse_share,
    parse_size,
    parse_tile,
)
from raytracer.files.replacing import check_replaceable
from raytracer.film.film import Film
from raytracer.film.film_picture import save_picture
from raytracer.film.parts import LIMITS
from raytracer.integrator.settings import Settings, check_known
from raytracer.rendering.checkpoints import EVERY_SECONDS, describe_fault, render_into
from raytracer.scene.scene_file import load_with_settings

SUFFIXES = (".npz", ".exr")
# With --error and no --samples: as many as Cycles takes with a noise threshold, at most.
SAMPLES_FOR_ERROR = 4096


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `render`."""
    parser.add_argument("file", metavar="S.npz", help="the scene, as raytracer.save and `python -m addon export` write")
    parser.add_argument("-o", "--output", required=True, metavar="P.npz|.exr", help="the film or the picture to write")
    parser.add_argument("--size", type=parse_size, metavar="WxH", help="pixels; default: the file's, as in the rest")
    parser.add_argument("--samples", type=parse_positive, metavar="N", help="samples per pixel of the whole picture")
    parser.add_argument("--until", type=parse_positive, metavar="K", help="stop when every pixel has K of them")
    parser.add_argument(
        "--error",
        type=parse_share,
        metavar="E%",
        help="end at this error, the root mean square over the mean level, of a tile over its own; "
        f"takes at most {SAMPLES_FOR_ERROR} samples, or --samples",
    )
    parser.add_argument("--seconds", type=parse_seconds, metavar="T", help="end after so many seconds of tracing")
    parser.add_argument("--adaptive", action="store_true", default=None, help="give more samples to noisy pixels")
    parser.add_argument("--tile", type=parse_tile, metavar="I/N", help="render the I-th, from 1, of N tiles")
    parser.add_argument("--passes", type=parse_names, metavar="A,B", help="passes, such as Combined,Depth,Normal")
    parser.add_argument("--workers", type=parse_positive, metavar="N", help="processes; default: 1")
    parser.add_argument(
        "--every",
        type=parse_seconds,
        default=EVERY_SECONDS,
        metavar="SECONDS",
        help=f"between two writes of the film, for at most a twentieth of the time; default: {EVERY_SECONDS:.0f}",
    )


def run(arguments: argparse.Namespace) -> None:
    """Render; print the path of what was written."""
    output = Path(arguments.output)
    if output.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{output}: expected a name that ends in {' or '.join(SUFFIXES)}")
    is_picture = output.suffix.lower() == ".exr"
    path = name_film(output) if is_picture else output
    for file in {path, output}:
        check_replaceable(file)
    scene, found = load_with_settings(arguments.file)
    keywords = choose_keywords(found, arguments)
    with listen() as is_stopped:
        film = render_into(path, scene, every=arguments.every, on_fault=warn, is_cancelled=is_stopped, **keywords)
    if film.cancelled:
        raise ValueError(f"interrupted: {path} has {describe_progress(film)}; the same command goes on from there")
    if is_picture:
        save_picture(film, output)
        if film.samples >= film.total or film.ended_by in LIMITS:  # nothing is left to go on for
            path.unlink(missing_ok=True)  # the same command, started twice, may have come first
    print(output, flush=True)


def warn(error: OSError) -> None:
    """Say that the film's file could not be written meanwhile."""
    print(f"warning: {describe_fault(error)}", file=sys.stderr)


def name_film(picture: Path) -> Path:
    """Return the file that the film of a picture is kept in while it is being made."""
    return picture.with_name(f"{picture.name}.npz")


def choose_keywords(found: dict[str, Any], arguments: argparse.Namespace) -> dict[str, Any]:
    """Return keywords of `render`: those of the scene's file, and what the command line says in their place."""
    check_known(found, arguments.file)
    keywords = dict(found)
    if arguments.size:
        keywords["width"], keywords["height"] = arguments.size
    if "width" not in keywords or "height" not in keywords:
        raise ValueError(f"{arguments.file}: says no size of its picture; --size WxH does")
    for name in ("samples", "until", "error", "seconds", "adaptive", "tile", "passes", "workers"):
        if getattr(arguments, name) is not None:
            keywords[name] = getattr(arguments, name)
    # The picture is what is inside the border, in one tile where no other is asked for.
    keywords = {"samples": Settings.samples, "tile": (1, 1), **keywords}
    if arguments.error and not arguments.samples:
        keywords["samples"] = max(keywords["samples"], SAMPLES_FOR_ERROR)
    return keywords


def describe_progress(film: Film) -> str:
    """Return how far a film is, for a sentence."""
    return f"{film.samples} of {film.total} samples"


def list_notices() -> list[signal.Signals]:
    """Return the signals by which others tell a process to end: on Windows, farms send Ctrl-Break."""
    return [getattr(signal, name) for name in ("SIGTERM", "SIGBREAK") if hasattr(signal, name)]


@contextlib.contextmanager
def listen() -> Iterator[Callable[[], bool]]:
    """Yield what tells whether the process has been told to end; a second time ends it at once."""
    stopped = threading.Event()
    # None stands for a handler in C, which no Python can bring back.
    before = {number: signal.getsignal(number) or signal.SIG_DFL for number in (signal.SIGINT, *list_notices())}

    def stop(number: int, frame: FrameType | None) -> None:
        stopped.set()
        signal.signal(number, before[signal.Signals(number)])

    if threading.current_thread() is not threading.main_thread():
        yield stopped.is_set
        return
    for number in before:
        signal.signal(number, stop)
    try:
        yield stopped.is_set
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
