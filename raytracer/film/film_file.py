"""Films as files: what each pixel adds up to so far, in float64, so that a render can go on from it elsewhere.

An .npz: an outline in JSON, with what decides the picture's bits, and the film's arrays by name, not compressed. Every
entry has a checksum, and the outline's key is one over what the picture is of.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.files.archive import Archive, open_archive, take_table, write_archive
from raytracer.files.unfinished import NAME
from raytracer.film.counts import MOST_RUNS
from raytracer.film.film import Film, Statistics
from raytracer.film.missed import is_table
from raytracer.film.passes import is_pass
from raytracer.film.picture_key import PictureKey, restore_key
from raytracer.film.sums import DEVIATIONS, DIFFERENCE
from raytracer.film.unmet import STEPS
from raytracer.scene.scene_file import is_scene_file

FILE_FORMAT = "reference-raytracer-film-2"

# Fields of a film that are no part of what it is and how far.
NOT_STORED = ("statistics", "key", "label")
# How many samples pixels have: of each pixel, or where there are few, of runs of pixels (`SampleCounts.list_runs`).
COUNTS, RUNS = "Sample Count", "Sample Count of Runs"
# Pixels are numbered in 32 bits (`Settings`).
MOST_PIXELS = 2**32


def save_film(film: Film, path: str | Path) -> None:
    """Write a film as one .npz, whole or not at all, so that `load_film` gives the same one.

    Raises
    ------
    ValueError
        If the film does not come from `render`.
    OSError
        If it cannot be written, naming the file.

    Examples
    --------
    >>> import tempfile, pathlib, numpy, raytracer
    >>> scene = raytracer.Scene(camera=raytracer.Camera(numpy.eye(4)), world=raytracer.World(1.0))
    >>> film = raytracer.render(scene, 4, 3, samples=8)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "film.npz"
    ...     raytracer.save_film(film, path)
    ...     film = raytracer.load_film(path)
    >>> film = raytracer.render(scene, 4, 3, samples=32, film=film)
    >>> film.samples
    32
    """
    if film.key is None:
        raise ValueError("save_film: expected a film of raytracer.render, got one that says nothing of its picture")
    fields = {name: getattr(film, name) for name in list_stored_fields()}
    outline = {
        "format": FILE_FORMAT,
        "key": film.key.digest,
        "choices": film.key.choices,
        "scene": film.key.scene,
        "film": fields,
        "statistics": dataclasses.asdict(film.statistics),
        "arrays": sorted(film.arrays),
    }
    counts = film.sums.counts
    numbers = {RUNS: counts.list_runs()} if counts.is_by_runs else {COUNTS: counts.spread()}
    write_archive(path, {"outline": np.array(json.dumps(outline)), **film.arrays, **numbers})


def load_film(path: str | Path) -> Film:
    """Read a film written by `save_film`.

    Raises
    ------
    ValueError
        If the file is not one, or broken, naming the file.
    OSError
        If it cannot be read, naming the file.
    """
    with open_archive(path, f"a film written by raytracer.save_film ({FILE_FORMAT})") as archive:
        outline = archive.read_outline(FILE_FORMAT)
        film = restore_film(outline, archive.size)
        film.key = restore_picture_key(outline)
        read_arrays(film, outline, archive)
    film.label = str(path)
    return film


def load_films(paths: Iterable[str | Path]) -> list[Film]:
    """Read films; a folder stands for all the films in it, beside which scenes may lie, and what a killed process has
    left unfinished.

    Raises
    ------
    ValueError, OSError
        As `load_film` does.
    """
    places = [Path(path) for path in paths]
    files: list[Path] = []
    for path in places:
        inside = [file for file in sorted(path.glob("*.npz")) if not (NAME.fullmatch(file.name) or is_scene_file(file))]
        files += inside if path.is_dir() else [path]
    if not files:
        raise ValueError(f"{', '.join(map(str, places))}: expected one or more films, found none")
    return [load_film(file) for file in files]


def list_stored_fields() -> list[str]:
    """Return the names of the fields of a film that a file keeps."""
    return [item.name for item in dataclasses.fields(Film) if item.init and item.name not in NOT_STORED]


def restore_film(outline: dict[str, Any], size: int) -> Film:
    """Return an empty film of the outline's fields; ValueError where a file of `size` bytes cannot hold it."""
    fields = take_table(outline.get("film"))
    if set(fields) != set(list_stored_fields()):
        raise ValueError("a film with other fields")
    fields = {name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()}
    width, height, names = fields["width"], fields["height"], fields["names"]
    numbers = (width, height, *(fields[name] for name in ("samples", "ahead", "total", "left", "bottom", "time_side")))
    if any(type(number) is not int or number < 0 for number in numbers):
        raise ValueError(f"a film of the size {width} x {height}")
    is_ahead = fields["ahead"] > width * height and not fields["pilot"]  # a sweep of adaptive samples may have more
    if not 0 < width * height <= min(size, MOST_PIXELS) or is_ahead:
        raise ValueError(f"{width} x {height} pixels, which the file does not hold")
    near = fields["near_misses"]
    if not isinstance(near, tuple) or len(near) not in (0, STEPS) or any(type(n) is not int or n < 0 for n in near):
        raise ValueError(f"near misses counted as {near!r:.80}")
    if not is_table(fields["probes"]):
        raise ValueError(f"probes listed as {fields['probes']!r:.80}")
    if not isinstance(names, tuple) or not all(is_pass(name) for name in names):
        raise ValueError(f"the passes {names}")
    return Film(**fields, statistics=Statistics(**take_table(outline.get("statistics"))))


def restore_picture_key(outline: dict[str, Any]) -> PictureKey:
    """Return the outline's key; ValueError where it is not that of what the outline says."""
    key = restore_key(take_table(outline.get("choices")), take_table(outline.get("scene")))
    if key.digest != outline.get("key"):
        raise ValueError("a key that is not that of its settings and scene")
    return key


def read_arrays(film: Film, outline: dict[str, Any], archive: Archive) -> None:
    """Fill the film with the arrays of a file."""
    sums, stored = film.sums, outline.get("arrays")
    names = set(stored) if isinstance(stored, list) else set()
    optional = [sums.alphas, *([name] for name in (DIFFERENCE, DEVIATIONS) if sums.tells_difference)]
    for group in optional:
        if names.issuperset(group):
            sums.hold(group)
    if names != set(film.arrays):
        raise ValueError(f"arrays named {stored}")
    for name, array in film.arrays.items():
        array[...] = read_array(archive, name, array.shape, array.dtype)
    pixels = film.width * film.height
    if archive.has(RUNS):
        runs = archive.read(RUNS, 3 * 8 * MOST_RUNS, keep=False)
        if runs.ndim != 2 or runs.shape[1] != 3 or runs.dtype != np.int64:
            raise ValueError(f"{RUNS} of {runs.shape} {runs.dtype}")
        film.sums.counts.set_runs(runs)
    else:
        film.sums.counts.put(slice(None), read_array(archive, COUNTS, (pixels, 2), np.dtype(np.int32)))
    if not sums.is_complete():
        raise ValueError(f"arrays named {stored}, which are too few for its numbers of samples")


def read_array(archive: Archive, name: str, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return an array of a file, or raise ValueError where it is of another shape or type."""
    array = archive.read(name, math.prod(shape) * dtype.itemsize, keep=False)
    if array.shape != shape or array.dtype != dtype:
        raise ValueError(f"{name} of {array.shape} {array.dtype}, not {shape} {dtype}")
    return array
