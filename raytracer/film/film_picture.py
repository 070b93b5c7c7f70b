"""A film as a picture: one OpenEXR, scene linear, with a layer for each pass."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from raytracer.files.exr import write_exr
from raytracer.film.film import Film
from raytracer.film.passes import find_layer_name

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


def list_channels(film: Film) -> Iterator[tuple[str, NDArray[np.float32]]]:
    """Yield the names of channels, and their values (h, w)."""
    for name in film.names:
        values = film[name]
        letters = LETTERS.get(name, COLOR_LETTERS[values.shape[2]])
        layer = "" if name == "Combined" else f"{find_layer_name(name)}."
        for channel, letter in enumerate(letters):
            yield f"{layer}{letter}", values[..., channel]
