"""Write the scene of a .blend, as it is rendered, into a file for machines without Blender: `python -m raytracer`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from .. import interrupts
from . import parts
from .command_line import CommandError, add_file, check_replaceable_picture, open_blend
from .render import add_scene_arguments, apply_arguments, check_limits, check_view_layers


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `export`."""
    add_file(parser, "the scene")
    parser.add_argument("-o", "--output", required=True, metavar="S.npz", help="the file to write")
    parser.add_argument("--frame", type=int, metavar="N", help="frame to export; default: the file's current one")
    add_scene_arguments(parser)
    parser.set_defaults(frames=None, workers=None)


def run(arguments: argparse.Namespace) -> None:
    """Write the scene; print the file's path, and warnings on standard error."""
    output = Path(arguments.output)
    if not parts.is_film(output):
        raise CommandError(f"{output}: expected a name that ends in .npz")
    check_replaceable_picture(output)
    bpy = open_blend(arguments.file, arguments.scripts)
    from ..engine.orders import ExportScene, give

    scene = bpy.context.scene
    check_limits(scene, arguments)
    apply_arguments(scene, arguments)
    check_view_layers(scene)
    if arguments.frame is not None:
        with interrupts.hold():
            scene.frame_set(arguments.frame)
    with give(ExportScene(output)):
        taken = parts.render_film(bpy, scene, output)
    for warning in taken.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    print(output, flush=True)
