"""Arguments of the add-on's commands, from text to numbers.

`raytracer.commands.arguments` has those of the ray tracer's own: to import it would load all of the ray tracer, and
`--help` could not answer at once.
"""

from __future__ import annotations

import argparse
import re


def parse_frames(text: str) -> range:
    """Return the frames of 'A-B', both included."""
    match = re.fullmatch(r"(-?\d+)-(-?\d+)", text)
    if not match or int(match[1]) > int(match[2]):
        raise argparse.ArgumentTypeError(f"expected first-last, such as 1-24, got {text!r}")
    return range(int(match[1]), int(match[2]) + 1)


def parse_size(text: str) -> tuple[int, int]:
    """Return (width, height) of 'WxH'; Blender renders from 4 to 65536 pixels a side."""
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    if not match or not all(4 <= int(side) <= 65536 for side in match.groups()):
        raise argparse.ArgumentTypeError(f"expected WxH with sides from 4 to 65536, such as 640x360, got {text!r}")
    return int(match[1]), int(match[2])


def parse_count(text: str, lowest: int = 0) -> int:
    """Return a whole number of at least `lowest`."""
    if not re.fullmatch(r"\d+", text) or int(text) < lowest:
        raise argparse.ArgumentTypeError(f"expected a whole number of {lowest} or more, got {text!r}")
    return int(text)


def parse_positive(text: str) -> int:
    """Return a whole number of at least 1."""
    return parse_count(text, lowest=1)


def parse_share(text: str) -> float:
    """Return the share that 'P%' or a number between 0 and 1 stands for."""
    match = re.fullmatch(r"(\d*\.?\d+)(%?)", text)
    share = float(match[1]) / (100 if match[2] else 1) if match else 0.0
    if not 0 < share < 1:
        raise argparse.ArgumentTypeError(f"expected a share between 0% and 100%, such as 1%, got {text!r}")
    return share


def parse_seconds(text: str) -> float:
    """Return a number of seconds above 0."""
    if not re.fullmatch(r"\d+(\.\d+)?", text) or float(text) == 0:
        raise argparse.ArgumentTypeError(f"expected a number of seconds above 0, got {text!r}")
    return float(text)


def parse_names(text: str) -> tuple[str, ...]:
    """Return the names of a list with commas; at least one."""
    names = tuple(name.strip() for name in text.split(","))
    if not all(names):
        raise argparse.ArgumentTypeError(f"expected names with commas between them, such as Depth,Normal, got {text!r}")
    return names


def parse_tile(text: str) -> tuple[int, int]:
    """Return (i, n) of 'I/N'."""
    match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text)
    if not match or not 1 <= int(match[1]) <= int(match[2]):
        raise argparse.ArgumentTypeError(f"expected I/N, such as 3/64, the third of 64 tiles, got {text!r}")
    return int(match[1]), int(match[2])


def parse_period(text: str) -> float:
    """Return seconds, 0 or more."""
    if not re.fullmatch(r"\d{1,9}(\.\d*)?", text):
        raise argparse.ArgumentTypeError(f"expected seconds, such as 60, got {text!r}")
    return float(text)
