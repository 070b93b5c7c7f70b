"""A film as a picture: one OpenEXR, scene linear, with a layer for each pass.

Lines are made as they are written: all passes at once would take half of what the sums do.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from raytracer.files.exr import write_exr
from raytracer.film.film import Film
from raytracer.film.passes import find_layer_name, find_pass

# What channels are called where numbers are no colors; by number of channels where they are.
LETTERS = {"Depth": "Z", "Position": "XYZ", "Normal": "XYZ", "UV": "UVA"}
COLOR_LETTERS = {1: "V", 3: "RGB", 4: "RGBA"}


def save_picture(film: Film, path: str | Path) -> None:
    """Write all passes of a film as an .exr, whole or not at all; Combined is what programs show that know no layers.

    Raises
    ------
    OSError
        If it cannot be written, naming the file.
    """
    write_exr(path, dict(list_channels(film)))


class PassLines:
    """The lines of a pass, row 0 the top one, read from the film a few at a time."""

    def __init__(self, film: Film, name: str) -> None:
        self.shape = film.height, film.width
        self._read = film.open_pass(name)
        self._lines, self._values = slice(0, 0), np.zeros((0, 0, 0), dtype=np.float32)

    def read(self, lines: slice) -> NDArray[np.float32]:
        """Return lines (k, w, channels); the last ones are kept, for all of their channels."""
        if lines != self._lines:
            height, width = self.shape
            start, stop, _ = lines.indices(height)
            values = self._read(slice((height - stop) * width, (height - start) * width))
            self._lines, self._values = lines, values.reshape(stop - start, width, -1)[::-1]
        return self._values


class Channel:
    """One channel of a pass, (h, w)."""

    def __init__(self, lines: PassLines, number: int) -> None:
        self.shape = lines.shape
        self._lines, self._number = lines, number

    def __getitem__(self, lines: slice) -> NDArray[np.float32]:
        return self._lines.read(lines)[..., self._number]


def list_channels(film: Film) -> Iterator[tuple[str, Channel]]:
    """Yield the names of channels, and their values."""
    for name in film.names:
        letters = LETTERS.get(name, COLOR_LETTERS[find_pass(name).channels])
        layer = "" if name == "Combined" else f"{find_layer_name(name)}."
        lines = PassLines(film, name)
        for number, letter in enumerate(letters):
            yield f"{layer}{letter}", Channel(lines, number)
