"""Photometric data of luminaires: IES files (LM-63) as tables of intensity over two angles.

References
----------
ANSI/IES LM-63-19, "Standard File Format for the Electronic Transfer of Photometric Data".
Blender, intern/cycles/util/ies.cpp, kernel/svm/ies.h: the unit, how types A and B are laid on the sphere of type C,
what is mirrored, and cubic interpolation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats

# Watts of a lamp in Cycles for each candela: 4 pi over the 177.83 lumens of a watt of daylight (D65).
WATTS_PER_CANDELA = 0.0706650768394
TYPE_C, TYPE_B, TYPE_A = 1, 2, 3
# Degrees within which angles are the same, and radians within which a table begins at the pole.
SAME_ANGLE, POLE = 1e-4, 1e-7
# What Cycles shines with where there is no table.
MISSING = 100.0


class Luminaire(NamedTuple):
    """Intensity over directions.

    horizontal : (h,) radians around the axis, ascending; vertical : (v,) radians from straight down, ascending
    intensity : (h, v) watts of a lamp that shines as strongly all around
    """

    horizontal: Floats
    vertical: Floats
    intensity: Floats


def read_ies(text: str) -> Luminaire:
    """Return the table of a file.

    Raises
    ------
    ValueError
        If the text is no LM-63 data, is cut off, or of an unknown photometric type.
    """
    numbers = _list_numbers(text)
    if len(numbers) < 13:
        raise ValueError(f"IES data: expected a line TILT= with 13 numbers or more after it, got {len(numbers)}")
    v_count, h_count, kind = (int(numbers[k]) for k in (3, 4, 5))
    factor = numbers[2] * numbers[10] * numbers[11] * WATTS_PER_CANDELA  # multiplier and two ballast factors
    if kind not in (TYPE_A, TYPE_B, TYPE_C):
        raise ValueError(f"IES data: expected photometric type 1, 2 or 3, got {kind}")
    needed = 13 + v_count + h_count + v_count * h_count
    if min(v_count, h_count) < 1 or len(numbers) < needed:
        raise ValueError(f"IES data: expected {needed} numbers for {v_count} x {h_count} angles, got {len(numbers)}")
    vertical, horizontal, values = np.split(numbers[13:needed], (v_count, v_count + h_count))
    table = Luminaire(horizontal, vertical, factor * values.reshape(h_count, v_count))
    laid = {TYPE_A: _lay_type_a, TYPE_B: _lay_type_b, TYPE_C: _lay_type_c}[kind](table)
    return Luminaire(np.radians(laid.horizontal), np.radians(laid.vertical), laid.intensity)


def _list_numbers(text: str) -> NDArray[np.float64]:
    """Return the numbers behind the line that begins with TILT=, without those of a tilt."""
    lines = text.replace(",", " ").splitlines()
    start = next((number for number, line in enumerate(lines) if line.startswith("TILT=")), None)
    if start is None:
        return np.empty(0)
    numbers = []
    for word in " ".join(lines[start + 1 :]).split():
        try:
            numbers.append(float(word))
        except ValueError:
            break
    if lines[start].startswith("TILT=INCLUDE") and len(numbers) > 1:
        numbers = numbers[2 + 2 * int(numbers[1]) :]  # how the lamp lies, how many angles, these and their factors
    return np.array(numbers)


def _is(angle: float, other: float) -> bool:
    return abs(angle - other) < SAME_ANGLE


def _lay_type_a(table: Luminaire) -> Luminaire:
    """-90 to 90 degrees across the front become 270 to 90; what begins at 0 is mirrored there."""
    horizontal, intensity = 180.0 - table.horizontal[::-1], table.intensity[::-1]
    if _is(table.horizontal[0], 0.0):
        horizontal = np.concatenate([horizontal, 180.0 + table.horizontal[1:]])
        intensity = np.concatenate([intensity, table.intensity[1:]])
    return Luminaire(horizontal, table.vertical + 90.0, intensity)


def _lay_type_b(table: Luminaire) -> Luminaire:
    """The angles change places, for the axis lies; each begins at -90, or is mirrored at 0."""
    horizontal, vertical, intensity = table.vertical, table.horizontal, table.intensity.T
    if _is(horizontal[0], 0.0):
        horizontal = np.concatenate([-horizontal[:0:-1], horizontal])
        intensity = np.concatenate([intensity[:0:-1], intensity])
    if _is(vertical[0], 0.0):
        vertical = np.concatenate([-vertical[:0:-1], vertical])
        intensity = np.concatenate([intensity[:, :0:-1], intensity], axis=1)
    return Luminaire(horizontal + 90.0, vertical + 90.0, intensity)


def _lay_type_c(table: Luminaire) -> Luminaire:
    """A quarter or a half is mirrored to go round, one column turned; a missing last column is the first."""
    horizontal, vertical, intensity = table
    if _is(horizontal[0], 90.0):
        horizontal = horizontal - 90.0
    if len(horizontal) == 1:
        return Luminaire(np.array((0.0, 360.0)), vertical, np.repeat(intensity, 2, axis=0))
    for border in (90.0, 180.0):
        if _is(horizontal[-1], border):
            horizontal = np.concatenate([horizontal, 2.0 * border - horizontal[-2::-1]])
            intensity = np.concatenate([intensity, intensity[-2::-1]])
    gap = 360.0 - horizontal[-1]
    if _is(horizontal[0], 0.0) and not _is(gap, 0.0):
        steps = horizontal[-1] - horizontal[-2], horizontal[1] - horizontal[0]
        if any(_is(step, gap) for step in steps):
            horizontal, intensity = np.append(horizontal, 360.0), np.concatenate([intensity, intensity[:1]])
    return Luminaire(horizontal, vertical, intensity)


def find_intensity(table: Luminaire, around: Floats, down: Floats) -> Floats:
    """Return the intensity (n,) at angles (n,) around the axis and from straight down: cubic in both, never negative.

    0 beyond the table. What the cubic asks for beside its border is what stands at the border, but below the pole at 0
    the second row, and behind the last column the one before it: as measured in Blender 4.2 to 5.0.
    """
    horizontal, vertical, intensity = table
    if min(len(horizontal), len(vertical)) < 2:
        return np.zeros(len(around))
    inside = (down >= vertical[0]) & (down < vertical[-1]) & (around >= horizontal[0]) & (around < horizontal[-1])
    columns = np.concatenate([intensity[:1], intensity, intensity[-2:-1]])  # (h + 2, v)
    below = 1 if vertical[0] < POLE else 0
    padded = np.concatenate([columns[:, below : below + 1], columns, columns[:, -1:]], axis=1)
    row, across = _find_cell(horizontal, around)
    column, along = _find_cell(vertical, down)
    parts = [_interpolate([padded[row + k, column + j] for j in range(4)], along) for k in range(4)]
    return np.where(inside, np.maximum(_interpolate(parts, across), 0.0), 0.0)


def _find_cell(angles: Floats, wanted: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Return the cell (n,) that each angle lies in, and where in it, 0 to 1."""
    cell = np.clip(np.searchsorted(angles, wanted) - 1, 0, len(angles) - 2)
    width = angles[cell + 1] - angles[cell]
    return cell, np.divide(wanted - angles[cell], width, out=np.zeros(len(wanted)), where=width != 0)


def _interpolate(values: list[Floats], place: Floats) -> Floats:
    """The cubic of Catmull and Rom through four values, between the second and the third."""
    a, b, c, d = values
    slope = (d + 3.0 * (b - c) - a) * place + (2.0 * a - 5.0 * b + 4.0 * c - d)
    return 0.5 * (slope * place + (c - a)) * place + b
