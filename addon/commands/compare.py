"""Compare with Cycles, or with Blender's ray_cast, on a .blend file."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from . import interrupts
from .command_line import CommandError, check_replaceable_picture, first_line, hide_python_output, open_blend
from .render import parse_positive, parse_size

DEFAULT_SIZE = (192, 108)
DEFAULT_SAMPLES = {"cycles": 64, "ray_cast": 4096}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `compare`."""
    parser.add_argument("file", metavar="FILE.blend", help="the scene")
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
        help="samples per pixel (default 64); with ray_cast: random, vertex and edge rays each (default 4096)",
    )
    parser.add_argument(
        "-o", "--output", metavar="OUT.png", help="with cycles: ours, Cycles' and the FLIP error as PNG"
    )
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")


def run(arguments: argparse.Namespace) -> None:
    """Run `compare`: print the numbers, write the picture if asked."""
    if arguments.output:
        check_picture(arguments)
    bpy = open_blend(arguments.file)
    samples = arguments.samples or DEFAULT_SAMPLES[arguments.other]
    compare = run_cycles if arguments.other == "cycles" else run_ray_cast
    with hide_python_output():
        numbers = compare(bpy, arguments.size, samples, arguments.output)
    interrupts.check()  # what Blender's callbacks have swallowed
    if arguments.json:
        print(json.dumps(numbers), flush=True)
    else:
        print_numbers(numbers)


def check_picture(arguments: argparse.Namespace) -> None:
    """Raise CommandError where the picture asked for could not be written, before minutes of rendering."""
    path = Path(arguments.output)
    if arguments.other != "cycles":
        raise CommandError("-o: only a comparison with cycles has a picture")
    if path.suffix.lower() != ".png":
        raise CommandError(f"{path}: expected a name that ends in .png")
    check_replaceable_picture(path)


def run_cycles(bpy: Any, size: tuple[int, int], samples: int, output: str | None) -> dict[str, Any]:
    """Compare pictures with Cycles; return the numbers."""
    from ..compare.cycles.comparison import compare_with_cycles

    try:
        comparison = compare_with_cycles(bpy.context.scene, bpy.context.view_layer, *size, samples)
    except RuntimeError as error:  # what an engine reports, the operator raises
        raise CommandError(first_line(str(error))) from None
    if output:
        comparison.save_picture(output)
    return comparison.summarise()


def run_ray_cast(bpy: Any, size: tuple[int, int], samples: int, output: str | None) -> dict[str, Any]:
    """Compare hits with Scene.ray_cast; return the numbers."""
    from ..compare.ray_cast.comparison import compare_with_ray_cast

    depsgraph = bpy.context.evaluated_depsgraph_get()
    comparison, _ = compare_with_ray_cast(bpy.context.scene, depsgraph, *size, samples)
    return comparison.summarise()


def print_numbers(numbers: dict[str, Any]) -> None:
    """Print one number a line, those of the passes by their names."""
    for name, value in numbers.items():
        rows = (
            [(f"{name} {key}", entry) for key, entry in value.items()] if isinstance(value, dict) else [(name, value)]
        )
        for label, number in rows:
            print(f"{label:24} {number:.6g}" if isinstance(number, float) else f"{label:24} {number}", flush=True)
