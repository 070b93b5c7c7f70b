"""Verdicts and numbers of comparisons as lines of text."""

from __future__ import annotations

from collections.abc import Iterator
from decimal import Context, Decimal
from fractions import Fraction
from typing import Any

import numpy as np

from ...editors import wrap_text
from ..ray_cast.verdict import Surfaces, Verdict
from ..results import Outcome
from ..verdicts import AGREES, DIFFERS, UNDECIDED

Line = tuple[str, tuple[str, ...]]

EXACT_DIGITS = 20
# What the numbers of a comparison mean, and their units, in the order of the panel.
CYCLES_NUMBERS = {
    "flip": ("FLIP, mean", "{:.4f}"),
    "rmse": ("RMS error", "{:.3e}"),
    "rel_mse": ("Relative MSE", "{:.3e}"),
    "z_fail_share": ("Beyond noise", "{:.2%} of pixels"),
    "tile_error": ("Worst tile", "{:.3e}"),
    "ours_seconds": ("Ours", "{:.2f} s"),
    "cycles_seconds": ("Cycles", "{:.2f} s"),
}
RAY_CAST_NUMBERS = {
    "rays": ("Rays", "{:,}"),
    "wrong_hit": ("Hit or miss differs", "{:,}"),
    "wrong_object": ("Object differs", "{:,}"),
    "wrong_polygon": ("Polygon differs", "{:,}"),
    "max_position_error": ("Points apart", "{:.2e} m at most"),
    "judged": ("Judged exactly", "{:,}"),
    "ours_wrong": ("Ours wrong", "{:,}"),
    "blender_wrong": ("ray_cast wrong", "{:,}"),
    "ours_seconds": ("Ours", "{:.3f} s"),
    "blender_seconds": ("ray_cast", "{:.3f} s"),
}


# The verdict of a comparison as a headline, and its icon.
HEADLINES = {
    "cycles": {AGREES: "Agrees with Cycles", DIFFERS: "Differs from Cycles", UNDECIDED: "Too few samples to tell"},
    "ray_cast": {AGREES: "Right by exact arithmetic", DIFFERS: "Wrong by exact arithmetic"},
}
ICONS = {AGREES: "CHECKMARK", DIFFERS: "ERROR", UNDECIDED: "QUESTION"}


def describe_outcome(kind: str, numbers: dict[str, Any], letters: int) -> tuple[str, str, list[str]]:
    """Return the headline of a comparison's verdict, its icon, and the reason in lines of so many letters."""
    reason = numbers["reason"]
    lines = wrap_text(reason[:1].upper() + reason[1:], letters)
    return HEADLINES[kind][numbers["verdict"]], ICONS[numbers["verdict"]], lines


def describe_numbers(kind: str, numbers: dict[str, Any]) -> Iterator[Line]:
    """Yield the numbers of a comparison."""
    table = CYCLES_NUMBERS if kind == "cycles" else RAY_CAST_NUMBERS
    for key, (name, layout) in table.items():
        yield name, (layout.format(numbers[key]),)
    for name, share in numbers.get("passes", {}).items():
        yield name, (f"{share:.2%} of pixels differ",)


def describe_map(outcome: Outcome) -> str:
    """Return what the colors of the map mean."""
    if outcome.kind == "ray_cast":
        return "White: different surfaces; orange: farthest apart"
    factor = f", brightened {outcome.gain:g} times" if outcome.gain != 1.0 else ""
    return f"FLIP error{factor}: white is {1 / outcome.gain:g} or more"


def describe_exact(verdict: Verdict) -> Iterator[Line]:
    """Yield the truth about the ray that this ray tracer got."""
    if verdict.exact_distance is None:
        yield "Exact", ("the ray hits nothing",)
        return
    yield "Exact t", (format_fraction(verdict.exact_distance),)
    yield "Fraction", (f"a denominator of {len(str(verdict.exact_distance.denominator))} digits",)
    yield "Exact hit", (name_surfaces(verdict.exact_surfaces),)


def describe_verdict(verdict: Verdict) -> Iterator[Line]:
    """Yield one side's answer and how far from the truth it is."""
    yield "Answer", (f"{verdict.answer[0]}, polygon {verdict.answer[1]}" if verdict.answer else "a miss",)
    if not verdict.is_right and verdict.exact_distance is not None:
        yield "Right is", (name_surfaces(verdict.exact_surfaces),)
    if verdict.distance_error is not None and not np.isnan(verdict.t_error):
        yield "Error of t", (f"{verdict.t_error:.1e} (bound {verdict.distance_error:.1e})",)
    if not np.isnan(verdict.location_error):
        yield "Error of point", (f"{verdict.location_error:.1e} m",)


def name_surfaces(surfaces: Surfaces) -> str:
    """Return the polygons that a ray hits first; the numbers of one object together."""
    numbers: dict[str, list[str]] = {}
    for name, polygon in sorted(surfaces):
        numbers.setdefault(name, []).append(str(polygon))
    return " or ".join(f"{name}, polygon {' or '.join(own)}" for name, own in numbers.items()) or "nothing"


def format_fraction(number: Fraction) -> str:
    """Return a fraction as a decimal of EXACT_DIGITS significant digits."""
    return str(Context(prec=EXACT_DIGITS).divide(Decimal(number.numerator), Decimal(number.denominator)))
