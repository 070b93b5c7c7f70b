"""Renders in parts: films that are kept in files, tiles, frames that are there already, films that become pictures.

raytracer is imported where it is used, so that `--help` answers at once.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from .. import interrupts
from .arguments import parse_period, parse_positive, parse_tile
from .command_line import CommandError, check_replaceable_picture, first_line, hide_python_output, list_blocked


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of renders in parts."""
    parser.add_argument("--part", metavar="P.npz", help="keep the film in this file, and go on from it where it exists")
    parser.add_argument(
        "--tile", type=parse_tile, metavar="I/N", help="render the I-th, from 1, of N tiles into a film"
    )
    parser.add_argument("--until", type=parse_positive, metavar="K", help="stop when every pixel has K of all samples")
    parser.add_argument("--every", type=parse_period, metavar="SECONDS", help="between two writes of the film")
    parser.add_argument("--skip-existing", action="store_true", help="leave out frames whose file is there and whole")


def is_film(path: Path) -> bool:
    """Return whether a path is that of a film and not of a picture."""
    return path.suffix.lower() == ".npz"


def check_arguments(arguments: argparse.Namespace) -> None:
    """Raise CommandError where the arguments do not fit each other."""
    output = Path(arguments.output)
    if arguments.part and (is_film(output) or not is_film(Path(arguments.part))):
        raise CommandError(f"--part {arguments.part}: expected an .npz beside a picture, which -o names")
    if arguments.tile and not is_film(output):
        raise CommandError(f"{output}: a tile is no picture yet; -o P.npz takes its film, and `merge` joins them")
    if arguments.until and not find_film(output, arguments.part):
        raise CommandError(f"--until {arguments.until}: expected a film to go on from, -o P.npz or --part P.npz")
    if arguments.part:
        check_replaceable_picture(Path(arguments.part))


def find_film(output: Path, part: str | None) -> Path | None:
    """Return the film's file that a render into `output` keeps, or None."""
    return output if is_film(output) else Path(part) if part else None


def is_done(path: Path, film: Path | None, until: int | None, scene: Any) -> bool:
    """Return whether a frame's picture, or film, is there and whole, and the film that is kept has what is asked for.

    film : of `find_film`; without its file a picture that is whole is enough
    until : the samples that are asked for; None asks for all
    """
    from raytracer.files.pictures import check_picture
    from raytracer.film.film_file import load_film

    from ..engine.output import measure_picture

    try:
        if film is not None and (is_film(path) or film.exists()):
            kept = load_film(film)
            is_enough = until is not None and kept.samples >= until
            if not (is_enough or is_finished(kept, scene.reference_raytracer)):
                return False
        if not is_film(path):
            check_picture(path, *measure_picture(scene.render))
    except (OSError, ValueError):
        return False
    return True


def is_finished(film: Any, settings: Any) -> bool:
    """Return whether a film has all samples, or has been ended by what may end it still: an error, or a time."""
    if film.samples >= settings.samples:
        return True
    if film.ended_by == "error":
        return bool(settings.use_noise_threshold and film.error <= settings.noise_threshold / 100.0)
    return bool(film.ended_by == "time" and settings.time_limit > 0)


@contextlib.contextmanager
def keep_film(path: Path | None, arguments: argparse.Namespace) -> Iterator[None]:
    """Let the render inside the block keep its film in `path`, also where it is told to end."""
    if path is None:
        yield
        return
    from raytracer.commands.render import list_notices
    from raytracer.rendering.checkpoints import EVERY_SECONDS, describe_fault

    from ..engine.orders import KeepFilm, give

    every = EVERY_SECONDS if arguments.every is None else arguments.every
    told = sys.stderr  # which the render hides

    def warn(error: OSError) -> None:
        print(f"warning: {describe_fault(error)}", file=told)

    order = KeepFilm(path, arguments.tile, arguments.until, every, warn)
    with contextlib.ExitStack() as stack:
        for number in list_notices():
            stack.enter_context(interrupts.listen_for(number))
        stack.enter_context(give(order))
        yield


def render_film(bpy: Any, scene: Any, path: Path) -> Any:
    """Render the current frame into a film's file alone, as the order of the block says; return its Statistics."""
    from ..engine.statistics import forget_all

    forget_all()
    with interrupts.hold(), hide_python_output():
        try:
            bpy.ops.render.render(write_still=False, scene=scene.name)
        except RuntimeError as error:
            raise CommandError(first_line(str(error))) from None
    return read_statistics(bpy, scene, path)


def read_statistics(bpy: Any, scene: Any, path: Path) -> Any:
    """Return the Statistics of the render that has just ended, with a warning where scripts were not run."""
    from ..engine.statistics import last_render
    from ..extract.warnings import Warning

    taken = last_render(scene)
    if taken is None:
        raise CommandError(f"{path}: the scene's video sequencer made the picture, not the render engine")
    return replace(taken, warnings=(*taken.warnings, *map(Warning, list_blocked(bpy))))
