"""Render a .blend into a PNG or EXR file.

The picture comes from Blender's own render operator, so it is the one that F12 and `blender -b` give: a PNG has the
scene's view transform, an EXR is scene linear, 32 bits, with layers where passes are asked for. bpy is imported where
it is used.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import re
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from .. import interrupts
from . import parts
from .arguments import parse_count, parse_frames, parse_names, parse_positive, parse_seconds, parse_share, parse_size
from .command_line import CommandError, add_file, check_replaceable_picture, first_line, hide_python_output, open_blend

SUFFIXES = (".png", ".exr")
PRECISIONS = ("certified", "float64", "float32")
# With --error and no --samples: as many as Cycles takes with a noise threshold.
SAMPLES_FOR_ERROR = 4096
# What --bounces sets.
BOUNCES = ("max_bounces", "diffuse_bounces", "glossy_bounces", "transmission_bounces", "volume_bounces")
JSON_KEYS = (
    *("passes", "width", "height", "samples", "triangles", "rays"),
    *("build_seconds", "trace_seconds", "total_seconds", "peak_memory_mb", "warnings"),
    *("error", "error_interval", "error_p99", "error_note", "ended_by", "denoised"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `render`."""
    add_file(parser, "the scene")
    parser.add_argument(
        *("-o", "--output"), required=True, metavar="OUT.png|.exr|.npz", help="the picture, or film, to write"
    )
    frames = parser.add_mutually_exclusive_group()
    frames.add_argument("--frame", type=int, metavar="N", help="frame to render; default: the file's current one")
    frames.add_argument(
        "--frames", type=parse_frames, metavar="A-B", help="frames to render; #### in OUT, or its end, takes the number"
    )
    add_scene_arguments(parser)
    parser.add_argument("--workers", type=parse_count, metavar="N", help="processes; 0: one for each processor")
    parts.add_arguments(parser)
    parser.add_argument("--denoise", action="store_true", help="take the noise out of the picture, by OpenImageDenoise")
    parser.add_argument("--json", action="store_true", help="print what the render took, one line for each frame")


def add_scene_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that stand in for settings of the scene."""
    parser.add_argument("--size", type=parse_size, metavar="WxH", help="pixels; default: the file's, as in the rest")
    parser.add_argument("--samples", type=parse_positive, metavar="N", help="samples per pixel")
    parser.add_argument(
        "--error",
        type=parse_share,
        metavar="E%",
        help="end at this error, the root mean square over the mean level; "
        f"takes at most {SAMPLES_FOR_ERROR} samples, or --samples",
    )
    parser.add_argument("--min-samples", type=parse_count, metavar="N", help="samples before --error may end it")
    parser.add_argument("--adaptive", action="store_true", help="give more samples to noisy pixels")
    parser.add_argument("--seconds", type=parse_seconds, metavar="S", help="end after so many seconds of tracing")
    parser.add_argument("--bounces", type=parse_count, metavar="N", help="most bounces of a path, of any kind")
    parser.add_argument("--passes", type=parse_names, metavar="A,B", help="passes of a multilayer EXR: Depth,Normal")
    parser.add_argument("--precision", choices=PRECISIONS, help="how intersections are computed")


def run(arguments: argparse.Namespace) -> None:
    """Render the frames asked for; print one line for each."""
    parts.check_arguments(arguments)
    output = check_output(Path(arguments.output), arguments.passes)
    check_denoising(output, arguments)
    bpy = open_blend(arguments.file, arguments.scripts)
    scene = bpy.context.scene
    check_limits(scene, arguments)
    apply_arguments(scene, arguments)
    check_view_layers(scene)
    frames = arguments.frames or [scene.frame_current if arguments.frame is None else arguments.frame]
    for frame in frames:
        path, part = output, arguments.part
        if arguments.frames:
            path, part = number_path(output, frame), part and str(number_path(Path(part), frame))
        film = parts.find_film(path, part)
        if arguments.skip_existing and parts.is_done(path, film, arguments.until, scene):
            continue
        with interrupts.hold():
            scene.frame_set(frame)
        with parts.keep_film(film, arguments):
            taken = (parts.render_film if parts.is_film(path) else render_frame)(bpy, scene, path)
        print_result(path, taken, arguments.json)


def check_output(path: Path, passes: tuple[str, ...] | None) -> Path:
    """Return `path`, or raise CommandError where a picture could not be written to it after a long render."""
    if path.suffix.lower() not in (*SUFFIXES, ".npz"):
        raise CommandError(f"{path}: expected a name that ends in {', '.join(SUFFIXES)} or .npz")
    if passes and path.suffix.lower() == ".png":
        raise CommandError(f"{path}: passes need an .exr file")
    check_replaceable_picture(path)
    return path


def check_denoising(path: Path, arguments: argparse.Namespace) -> None:
    """Raise CommandError where a denoised picture is asked for and cannot be had."""
    if not arguments.denoise:
        return
    if parts.is_film(path):
        raise CommandError("--denoise: expected a picture, .png or .exr, as output: a film holds samples")
    from ..denoising.process import NO_DENOISER
    from ..versions import has_denoiser

    if not has_denoiser():
        raise CommandError(f"--denoise: {NO_DENOISER}")


def check_limits(scene: Any, arguments: argparse.Namespace) -> None:
    """Raise CommandError where a number is larger than Blender's property for it."""
    settings = scene.reference_raytracer.bl_rna.properties
    names = ("samples", "min_samples", "workers")
    properties = {name: settings[name] for name in names} | {"bounces": settings[BOUNCES[0]]}
    for name, limits in properties.items():
        check_limit(f"--{name.replace('_', '-')}", getattr(arguments, name), limits)
    smallest = round(settings["noise_threshold"].hard_min, 6)  # the property is a float32
    if arguments.error and 100.0 * arguments.error < smallest:
        raise CommandError(f"--error: expected {smallest:g}% or more, got {100.0 * arguments.error:g}%")
    frames = scene.bl_rna.properties["frame_current"]
    check_limit("--frame", arguments.frame, frames)
    for frame in (arguments.frames.start, arguments.frames.stop - 1) if arguments.frames else ():
        check_limit("--frames", frame, frames)


def check_limit(option: str, value: int | None, limits: Any) -> None:
    """Raise CommandError unless the value of an option is one that the property `limits` takes."""
    if value is not None and not limits.hard_min <= value <= limits.hard_max:
        raise CommandError(f"{option}: expected a number from {limits.hard_min} to {limits.hard_max}, got {value}")


def check_view_layers(scene: Any) -> None:
    """Raise CommandError where nothing would be rendered: Blender writes a picture all the same, or crashes."""
    if not any(layer.use for layer in scene.view_layers):
        raise CommandError(f"scene '{scene.name}': no view layer is used for rendering (Use for Rendering is off)")


def apply_arguments(scene: Any, arguments: argparse.Namespace) -> None:
    """Set what the command line asks for on a Blender scene; the rest stays as the file has it."""
    from ..properties import ENGINE
    from ..versions import set_image_format

    render, settings = scene.render, scene.reference_raytracer
    render.engine = ENGINE
    if arguments.size:
        render.resolution_x, render.resolution_y = arguments.size
        render.resolution_percentage = 100
    for name, value in (
        ("samples", arguments.samples or (arguments.error and max(settings.samples, SAMPLES_FOR_ERROR))),
        ("use_noise_threshold", arguments.error and True),
        ("noise_threshold", arguments.error and 100.0 * arguments.error),
        ("min_samples", arguments.min_samples),
        ("use_adaptive_sampling", arguments.adaptive or None),
        ("time_limit", arguments.seconds),
        *((name, arguments.bounces) for name in BOUNCES),
        ("workers", arguments.workers),
        ("use_denoising", getattr(arguments, "denoise", None) or None),
        ("precision", arguments.precision and arguments.precision.upper()),
        ("use_checkpoints", False),  # a switch of the window: --part says here what is kept
    ):
        if value is not None:
            setattr(settings, name, value)
    if arguments.passes:
        enable_named_passes(scene, arguments.passes)
    if Path(arguments.output).suffix.lower() == ".png":
        set_image_format(render.image_settings, "PNG")
    else:
        set_image_format(render.image_settings, "OPEN_EXR_MULTILAYER" if arguments.passes else "OPEN_EXR")
        render.image_settings.color_depth = "32"
    render.image_settings.color_mode = "RGBA" if render.film_transparent else "RGB"
    render.image_settings.color_management = "FOLLOW_SCENE"
    render.use_multiview = False


def enable_named_passes(scene: Any, names: tuple[str, ...]) -> None:
    """Switch on the passes `names` in every view layer, and no others but those that view layers name themselves."""
    from raytracer.film.passes import PASSES, find_layer_name

    from ..passes import enable_passes, list_named

    named = {find_layer_name(name) for view_layer in scene.view_layers for name in list_named(view_layer)}
    unknown = [name for name in names if name not in PASSES and name not in named]
    if unknown:
        raise CommandError(f"unknown pass {unknown[0]!r}: expected some of {', '.join(PASSES)}")
    for view_layer in scene.view_layers:
        enable_passes(view_layer, tuple(name for name in names if name in PASSES))


def number_path(path: Path, frame: int) -> Path:
    """Return the file of one frame: its number in place of the last run of #, else four digits before the suffix."""
    digits = re.findall("#+", path.stem)
    stem = path.stem if digits else path.stem + "####"
    width = len(digits[-1]) if digits else 4
    before, after = stem.rsplit("#" * width, 1)
    return path.with_name(f"{before}{frame:0{width}}{after}{path.suffix}")


def render_frame(bpy: Any, scene: Any, path: Path) -> Any:
    """Render the current frame into `path`; return its Statistics.

    Blender's FINISHED proves nothing, not even that the disk had room for the whole picture: only one that can be read
    to its end takes the place of what was there.
    """
    from raytracer.files.pictures import check_picture
    from raytracer.files.replacing import replace_file

    from ..engine.output import measure_picture
    from ..engine.statistics import forget_all
    from ..versions import escape_path

    forget_all()
    width, height = measure_picture(scene.render)
    with replace_file(path, lambda picture: check_picture(picture, width, height), keep_unmoved=True) as picture:
        scene.render.filepath = escape_path(str(picture))
        scene.render.use_file_extension = False
        tidying = interrupts.tidying(lambda: picture.unlink(missing_ok=True))
        with tidying, interrupts.hold(), show_progress(path.name), hide_python_output():
            try:
                bpy.ops.render.render(write_still=True, scene=scene.name)
            except RuntimeError as error:
                raise CommandError(first_line(str(error)).replace(str(picture), str(path))) from None
        return parts.read_statistics(bpy, scene, path)


@contextlib.contextmanager
def show_progress(label: str) -> Iterator[None]:
    """Show a progress bar on standard error while rendering: on a terminal, where tqdm is installed.

    A Ctrl-C that was raised where nothing hands it on (Python's own callbacks) ends the render here.
    """
    from ..engine.progress import progress_listeners

    with contextlib.ExitStack() as stack:
        bar = make_bar(label)
        if bar is not None:
            stack.enter_context(bar)

        def listener(share: float) -> None:
            interrupts.check()
            if bar is not None:
                bar.update(share - bar.n)

        progress_listeners.append(listener)
        stack.callback(progress_listeners.remove, listener)
        yield


def make_bar(label: str, total: float = 1.0) -> Any:
    """Return a progress bar of tqdm up to `total`, or None where it is not installed."""
    try:
        from tqdm import tqdm
    except ImportError:
        return None
    layout = "{desc}: {percentage:3.0f}%|{bar}| {elapsed} < {remaining}"
    return tqdm(total=total, desc=label, file=sys.stderr, disable=None, bar_format=layout)


def print_result(path: Path, taken: Any, as_json: bool) -> None:
    """Print the picture's path on standard output and its warnings on standard error, or all as one line of JSON."""
    if as_json:
        values = {**asdict(taken), "warnings": list(map(str, taken.warnings))}
        values |= {"error": finite(taken.error), "error_p99": finite(taken.error_p99)}
        values["error_interval"] = list(map(finite, taken.error_interval))
        print(json.dumps({key: values[key] for key in JSON_KEYS}), flush=True)
        return
    for warning in taken.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    if taken.error_note:
        print(f"note: {taken.error_note}", file=sys.stderr)
    print(path, flush=True)


def finite(number: float) -> float | None:
    """Return a number as JSON knows it, or None for what is unknown."""
    return number if math.isfinite(number) else None
