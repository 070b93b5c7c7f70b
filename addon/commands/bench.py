"""Measure speed against error, side by side with the other ray casters that are installed.

The benchmark itself lives beside the exact oracle it judges by, in the repository's tests (`tests.benchmarks`): it is
no part of the installed extension. This module is the command.
"""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path

from .arguments import parse_names, parse_positive, parse_size
from .command_line import CommandError

PICTURES = ("convergence", "equal_error", "ablation", "memory", "workers")
SECTIONS = ("accuracy", "spheres", "cost", "speed", *PICTURES)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `bench`."""
    parser.add_argument(
        "--sections", nargs="+", choices=SECTIONS, default=list(SECTIONS), metavar="SECTION",
        help=f"what to measure, some of {', '.join(SECTIONS)}; default: everything",
    )  # fmt: skip
    parser.add_argument(
        "--rays", type=parse_positive, default=4096, metavar="N", help="rays per set of the accuracy; default 4096"
    )
    parser.add_argument(
        "--speed-rays", type=parse_positive, default=1 << 18, metavar="N",
        help="rays that are timed together; default 262144",
    )  # fmt: skip
    parser.add_argument(
        "--rounds",
        type=parse_positive,
        default=3,
        metavar="N",
        help="timed casts of which the median counts; default 3",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of all random numbers; default 0")
    parser.add_argument(
        "--large", action="store_true", help="speed on a million triangles and equal error on every scene, too"
    )
    add_picture_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")


def add_picture_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of section equal_error."""
    parser.add_argument(
        "--picture-size", type=parse_size, default=(240, 160), metavar="WxH",
        help="pixels of the pictures of equal_error; default 240x160",
    )  # fmt: skip
    parser.add_argument(
        "--picture-samples", type=parse_positive, default=256, metavar="N",
        help="most samples per pixel of equal_error, 16 or more; default 256",
    )  # fmt: skip
    parser.add_argument(
        "--picture-renders", type=parse_positive, default=8, metavar="N",
        help="renders of each number of samples of equal_error, 5 or more; default 8",
    )  # fmt: skip
    parser.add_argument(
        "--scenes", type=parse_names, default=(), metavar="A,B", help="scenes of equal_error; default: a choice"
    )
    parser.add_argument(
        "--keep", type=Path, metavar="FILE",
        help="keep the rows of equal_error in FILE as they come, and do not measure again what is there",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> None:
    """Run `bench`: print JSON or tables."""
    try:
        benchmark = import_module("tests.benchmarks.run")
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] != "tests":
            raise
        raise CommandError("bench: the benchmark is part of the repository's tests; run it from there") from None
    benchmark.run(arguments)
