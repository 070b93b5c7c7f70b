"""Put the tiles of a picture together into a PNG or EXR, as `render` writes them: with the scene's view transform."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from .. import interrupts
from .command_line import CommandError, add_file, check_replaceable_picture, open_blend, warn_blocked
from .render import SUFFIXES, apply_arguments, check_limits, check_view_layers, render_frame


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `merge`."""
    add_file(parser, "the scene, for its view transform and compositing")
    parser.add_argument("films", nargs="+", metavar="P.npz", help="the films of all tiles, or folders of them")
    parser.add_argument("-o", "--output", required=True, metavar="OUT.png|.exr", help="the picture to write")
    parser.add_argument("--frame", type=int, metavar="N", help="frame of the films; default: the file's current one")
    parser.set_defaults(size=None, samples=None, bounces=None, workers=None, precision=None, frames=None)
    parser.set_defaults(error=None, min_samples=None, seconds=None, adaptive=False)


def run(arguments: argparse.Namespace) -> None:
    """Merge; print the picture's path."""
    import raytracer
    from raytracer.film.film_file import load_films
    from raytracer.film.parts import describe_endings

    output = Path(arguments.output)
    if output.suffix.lower() not in SUFFIXES:
        raise CommandError(f"{output}: expected a name that ends in {' or '.join(SUFFIXES)}")
    check_replaceable_picture(output)
    films = load_films(arguments.films)
    film = raytracer.merge(films)
    if "Combined" not in film.names:
        raise CommandError(
            f"{arguments.films[0]}: expected Combined, the picture, among the passes of the films, got "
            f"{', '.join(film.names)}; `python -m raytracer merge` writes any passes"
        )
    for line in describe_endings(films):
        print(line, file=sys.stderr)
    several = len(film.names) > 1 and output.suffix.lower() == ".exr"
    arguments.passes = film.names if several else None
    bpy = open_blend(arguments.file, arguments.scripts)
    from ..engine.orders import ShowFilm, give

    scene = bpy.context.scene
    check_limits(scene, arguments)
    apply_arguments(scene, arguments)
    if arguments.frame is not None:
        with interrupts.hold():
            scene.frame_set(arguments.frame)
    fit_scene(scene, film)
    check_view_layers(scene)
    with give(ShowFilm(film)):
        render_frame(bpy, scene, output)
    warn_blocked(bpy)
    print(output, flush=True)


def fit_scene(scene: Any, film: Any) -> None:
    """Let a Blender scene's picture have the film's size."""
    from ..engine.output import read_border

    render, choices = scene.render, film.key.choices
    render.resolution_x, render.resolution_y, render.resolution_percentage = choices["width"], choices["height"], 100
    expected = read_border(render, render.resolution_x, render.resolution_y)
    found = (film.left, film.bottom, film.left + film.width, film.bottom + film.height)
    if tuple(expected) != found:
        raise CommandError(f"the films are of the border {found}, the scene's render border is {tuple(expected)}")
