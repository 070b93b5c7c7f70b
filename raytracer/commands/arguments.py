"""Arguments of commands, from text to numbers."""

from __future__ import annotations

import argparse
import re


def parse_size(text: str) -> tuple[int, int]:
    """Return (width, height) of 'WxH'."""
    match = re.fullmatch(r"([1-9]\d{0,9})x([1-9]\d{0,9})", text)
    if not match:
        raise argparse.ArgumentTypeError(f"expected WxH, such as 640x360, got {text!r}")
    return int(match[1]), int(match[2])


def parse_positive(text: str) -> int:
    """Return a whole number of at least 1."""
    if not re.fullmatch(r"\d{1,18}", text) or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number of 1 or more, got {text!r}")
    return int(text)


def parse_tile(text: str) -> tuple[int, int]:
    """Return (i, n) of 'I/N', the i-th of n tiles, from 1."""
    match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text)
    if not match or not 1 <= int(match[1]) <= int(match[2]):
        raise argparse.ArgumentTypeError(f"expected I/N, such as 3/64, the third of 64 tiles, got {text!r}")
    return int(match[1]), int(match[2])


def parse_seconds(text: str) -> float:
    """Return seconds, 0 or more."""
    if not re.fullmatch(r"\d+(\.\d*)?", text):
        raise argparse.ArgumentTypeError(f"expected seconds, such as 60, got {text!r}")
    return float(text)


def parse_share(text: str) -> float:
    """Return the share that 'P%' or a number between 0 and 1 stands for."""
    match = re.fullmatch(r"(\d{0,9}\.?\d{1,18})(%?)", text)
    share = float(match[1]) / (100.0 if match[2] else 1.0) if match else 0.0
    if not 0.0 < share < 1.0:
        raise argparse.ArgumentTypeError(f"expected a share between 0% and 100%, such as 1%, got {text!r}")
    return share


def parse_names(text: str) -> tuple[str, ...]:
    """Return the names of a list with commas."""
    return tuple(name.strip() for name in text.split(","))
