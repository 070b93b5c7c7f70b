"""Compare with Cycles, or with Blender's ray_cast, on a .blend file."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from .arguments import parse_positive, parse_share, parse_size
from .command_line import (
    CommandError,
    add_file,
    check_replaceable_picture,
    first_line,
    hide_python_output,
    open_blend,
    warn_blocked,
)
from .render import finite, make_bar

DEFAULT_SIZE = (192, 108)
DEFAULT_SAMPLES = {"cycles": 64, "ray_cast": 4096}
# Exit codes of --require; 1 and 2 are those of errors.
CODES = {"differs": 3, "undecided": 4}
# With --to, samples per pixel at which the comparison gives up.
MOST_SAMPLES = 1 << 16
EPILOG = """
With cycles the verdict is "agrees", "differs" or "undecided": nothing differs by more than noise, but noise would hide
the difference asked for, 1% or that of --to, in a tile or in the whole picture. "reason" says why. The smallest
differences that would have been found, with a probability of 90%, are "pixel_detectable", "tile_detectable" (tiles of
16x16 pixels) and "picture_detectable": shares of the level of the tile or of the picture, the brighter of both, in 95%
of the tiles. Pictures that are equal are said to differ with a probability of 1%. "z_fail_share": pixels that differ by
more than noise; the verdict forgives each a quarter of the difference asked for, and more than 0.25% is a difference
then. "passes": pixels of each pass that differ; more than 0.1% is one. "tile_error", "tile_noise", "tile_bias": the
largest difference of a tile, its standard error, the share of the tile's level that noise does not explain.
"picture_error", "picture_noise", "picture_bias": the same of the whole picture. Both engines render without clamping,
Filter Glossy, border, stereoscopy and compositing, with a pixel filter of one pixel's box. With ray_cast, which sees
meshes alone, as Blender's own rays do (no hair, point clouds, volumes or displacement by materials), the verdict is
"agrees" where exact arithmetic finds all of ours right that it judged.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `compare`."""
    parser.epilog = EPILOG
    add_file(parser, "the scene")
    parser.add_argument(
        "--with", dest="other", required=True, choices=tuple(DEFAULT_SAMPLES), help="what to compare to"
    )
    parser.add_argument(
        "--size",
        type=parse_size,
        default=DEFAULT_SIZE,
        metavar="WxH",
        help="pixels, or rays of the camera; default: {}x{}".format(*DEFAULT_SIZE),
    )
    parser.add_argument(
        "--samples",
        type=parse_positive,
        metavar="N",
        help=f"samples per pixel (default 64; with --to at most so many, default {MOST_SAMPLES}); "
        "with ray_cast: random, vertex and edge rays each (default 4096)",
    )
    parser.add_argument(
        "--to", type=parse_share, metavar="P%", help="with cycles: add samples until a difference of P%% would be found"
    )
    parser.add_argument(
        "--require",
        action="store_true",
        help="exit with code {differs} where the verdict is differs, with {undecided} where it is undecided".format(
            **CODES
        ),
    )
    parser.add_argument(
        "-o", "--output", metavar="OUT.png", help="with cycles: ours, Cycles' and the FLIP error as PNG"
    )
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")


def run(arguments: argparse.Namespace) -> None:
    """Run `compare`: print the numbers, write the picture if asked, fail where agreement is required and not there."""
    if arguments.output:
        check_picture(arguments)
    if arguments.to and arguments.other != "cycles":
        raise CommandError("--to: only a comparison with cycles takes samples")
    bpy = open_blend(arguments.file, arguments.scripts)
    if arguments.other == "cycles":
        with show_renders(bpy, arguments.json) as on_look, hide_python_output():
            numbers = run_cycles(bpy, arguments, on_look)
    else:
        with hide_python_output():
            numbers = run_ray_cast(bpy, arguments)
    warn_blocked(bpy)
    if arguments.json:
        print(json.dumps(list_finite(numbers), allow_nan=False), flush=True)
    else:
        print_numbers(numbers)
    if arguments.require and numbers["verdict"] in CODES:
        raise CommandError(f"{numbers['verdict']}: {numbers['reason']}", CODES[numbers["verdict"]])


def check_picture(arguments: argparse.Namespace) -> None:
    """Raise CommandError where the picture asked for could not be written, before minutes of rendering."""
    path = Path(arguments.output)
    if arguments.other != "cycles":
        raise CommandError("-o: only a comparison with cycles has a picture")
    if path.suffix.lower() != ".png":
        raise CommandError(f"{path}: expected a name that ends in .png")
    check_replaceable_picture(path)


@contextlib.contextmanager
def show_renders(bpy: Any, as_json: bool) -> Iterator[Callable[[str, int], None]]:
    """Show on standard error how far a comparison is: on a terminal a progress bar of the renders.

    Gives a function that says why samples are added, to people alone: on a terminal, and where no JSON is asked for.
    """
    from ..compare.cycles.comparison import FIRST_RENDERS

    stream, bar = sys.stderr, make_bar("compare", FIRST_RENDERS)
    speaks = stream.isatty() or not as_json

    def count(*_: Any) -> None:
        if bar is not None:
            bar.total = max(bar.total, bar.n + 1)  # where passes are asked again nobody knows how often
            bar.update(1)

    def on_look(text: str, renders: int) -> None:
        if bar is not None:
            bar.total += renders
        if speaks:
            (print if bar is None else bar.write)(text, file=stream)

    bpy.app.handlers.render_complete.append(count)
    try:
        with contextlib.nullcontext() if bar is None else bar:
            yield on_look
    finally:
        bpy.app.handlers.render_complete.remove(count)


def run_cycles(bpy: Any, arguments: argparse.Namespace, on_look: Callable[[str, int], None]) -> dict[str, Any]:
    """Compare pictures with Cycles, and write them if asked; return the numbers.

    on_look : of `compare_until`
    """
    from ..compare.cycles.comparison import compare_until, compare_with_cycles

    scene, view_layer = bpy.context.scene, bpy.context.view_layer
    (width, height), samples = arguments.size, DEFAULT_SAMPLES["cycles"]
    try:
        if arguments.to:
            comparison = compare_until(
                *(scene, view_layer, width, height, arguments.to, samples, arguments.samples or MOST_SAMPLES),
                on_look=on_look,
            )
        else:
            comparison = compare_with_cycles(scene, view_layer, width, height, arguments.samples or samples)
    except RuntimeError as error:  # what an engine reports, the operator raises
        raise CommandError(first_line(str(error))) from None
    if arguments.output:
        comparison.save_picture(arguments.output)
    return comparison.summarise()


def run_ray_cast(bpy: Any, arguments: argparse.Namespace) -> dict[str, Any]:
    """Compare hits with Scene.ray_cast; return the numbers."""
    from ..compare.ray_cast.comparison import compare_with_ray_cast

    depsgraph = bpy.context.evaluated_depsgraph_get()
    (width, height), samples = arguments.size, arguments.samples or DEFAULT_SAMPLES["ray_cast"]
    comparison, _ = compare_with_ray_cast(bpy.context.scene, depsgraph, width, height, samples)
    return comparison.summarise()


def list_finite(numbers: dict[str, Any]) -> dict[str, Any]:
    """Return numbers as JSON knows them: null for what is infinite, as a share of black is, or no number."""
    return {name: finite(value) if isinstance(value, float) else value for name, value in numbers.items()}


def print_numbers(numbers: dict[str, Any]) -> None:
    """Print one number a line, those of the passes by their names."""
    for name, value in numbers.items():
        rows = (
            [(f"{name} {key}", entry) for key, entry in value.items()] if isinstance(value, dict) else [(name, value)]
        )
        for label, number in rows:
            print(f"{label:24} {number:.6g}" if isinstance(number, float) else f"{label:24} {number}", flush=True)
