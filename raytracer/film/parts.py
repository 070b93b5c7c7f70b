"""Parts of a picture: tiles that are rendered apart from one another, and the whole that they make.

A part is a film that knows its picture and how far it is. Tiles lie beside each other; the samples of a tile are a
chain, in which one render goes on from another's film. A sample's value depends on pixel, number and seed alone, so the
whole is the same bit for bit as if it had been rendered in one go. Adaptive tiles are as right, but each has spread its
own samples: the whole has other bits, and cannot go on.

Tiles that an error has ended have different numbers of samples, and each the error that was asked for, over its own
mean level. Of the whole that is another share: with the mean levels L of n equal tiles, all of the error e, it is
e sqrt(n sum L^2) / sum L, which is e where all are alike and e sqrt(n) at most, where one has all the light.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from raytracer.arrays.types import Indices
from raytracer.film.film import Film, Statistics
from raytracer.film.picture_key import describe_difference
from raytracer.film.unmet import add_near_misses

Border = tuple[int, int, int, int]
# What has ended a whole of several tiles: the first of these that has ended one of them. An error, if they all have it.
ENDINGS = ("cancelled", "time", "samples", "error")
# What ends a film for good, before it has all its samples.
LIMITS = ("time", "error")


def cut(width: int, height: int, count: int, border: Border | None = None) -> list[Border]:
    """Return the borders of `count` tiles that cover a picture, or the part of it inside `border`.

    They are strips of whole rows, from the lowest up, of which no two differ by more than a row.

    Raises
    ------
    ValueError
        If there are fewer rows than tiles.

    Examples
    --------
    >>> cut(640, 360, 3)
    [(0, 0, 640, 120), (0, 120, 640, 240), (0, 240, 640, 360)]
    """
    x_min, y_min, x_max, y_max = border or (0, 0, width, height)
    rows = y_max - y_min
    if not 1 <= count <= rows:
        raise ValueError(f"cut: expected from 1 to {rows} tiles, as many as the picture has rows, got {count}")
    edges = [y_min + number * rows // count for number in range(count + 1)]
    return [(x_min, low, x_max, high) for low, high in itertools.pairwise(edges)]


def merge(films: Sequence[Film]) -> Film:
    """Return the whole picture that films of its tiles make, in any order.

    Raises
    ------
    ValueError
        If a part is missing, there twice, of another picture, or not finished: where not all have as many samples, an
        error or a limit of time must have ended those with fewer, and these or its samples the others; one sentence
        names it.

    Examples
    --------
    >>> import numpy, raytracer
    >>> scene = raytracer.Scene(camera=raytracer.Camera(numpy.eye(4)), world=raytracer.World(1.0))
    >>> tiles = [raytracer.render(scene, 4, 6, samples=2, tile=(number, 3)) for number in (1, 2, 3)]
    >>> whole = raytracer.merge(tiles)
    >>> whole.width, whole.height, whole.samples
    (4, 6, 2)
    """
    films = [films] if isinstance(films, Film) else list(films)
    if not films:
        raise ValueError("merge: expected one or more films, got none")
    for number, film in enumerate(films, 1):
        if not isinstance(film, Film):
            raise ValueError(f"merge: film {number}: expected a Film, such as load_film returns, got {film!r:.80}")
    names = [film.label or f"film {number}" for number, film in enumerate(films, 1)]
    check_alike(films, names)
    x_min, y_min, x_max, y_max = measure_whole(films[0])
    check_cover(films, names, (x_min, y_min, x_max, y_max))
    whole = replace(
        films[0],
        width=x_max - x_min,
        height=y_max - y_min,
        left=x_min,
        bottom=y_min,
        cancelled=any(film.cancelled for film in films),
        ended_by=next((ending for ending in ENDINGS if any(film.ended_by == ending for film in films)), ""),
        samples=min(film.samples for film in films),
        total=max(film.total for film in films),
        near_misses=functools.reduce(add_near_misses, (film.near_misses for film in films)),
        probes=tuple(itertools.chain.from_iterable(film.probes for film in films)),
        label="",
        statistics=add_statistics(films),
    )
    for film in films:
        whole.sums.take(number_pixels(film, x_min, y_min, whole.width), film.sums, slice(None))
    return whole


def check_alike(films: Sequence[Film], names: Sequence[str]) -> None:
    """Raise ValueError unless all films are finished parts of the first one's picture."""
    first = films[0]
    for film, name in zip(films, names, strict=True):
        if film.key is None or first.key is None:
            raise ValueError(f"merge: {name}: expected a film of raytracer.render")
        difference = describe_difference(film.key, first.key)
        if not difference and measure_whole(film) != measure_whole(first):
            difference = f"border is {film.border}, not {first.border}"
        if not difference and film.pilot != first.pilot:
            difference = f"its adaptive samples follow the first {film.pilot}, not {first.pilot}"
        if difference:
            raise ValueError(f"merge: {name} is no part of the picture of {names[0]}: {difference}")
    numbers = [film.samples for film in films]
    most = max(numbers)
    for film, name in zip(films, names, strict=True):
        is_done = film.ended_by in LIMITS or (film.ended_by == "samples" and film.samples == most)
        if film.ahead or not (is_done or min(numbers) == most):
            raise ValueError(f"merge: {name} is not finished: {film.samples} samples of {max(most, film.total)}")


def describe_endings(films: Sequence[Film]) -> list[str]:
    """Return a line for each film, what ended it, where they do not all have the same samples; else nothing."""
    if len({film.samples for film in films}) == 1:
        return []
    names = [film.label or f"film {number}" for number, film in enumerate(films, 1)]
    return [
        f"{name}: {film.samples} samples, ended by {film.ended_by}" for name, film in zip(names, films, strict=True)
    ]


def check_cover(films: Sequence[Film], names: Sequence[str], whole: Border) -> None:
    """Raise ValueError unless every pixel of the whole is in just one of the films."""
    x_min, y_min, x_max, y_max = whole
    owner = np.full((y_max - y_min, x_max - x_min), -1, dtype=np.int32)
    for number, film in enumerate(films):
        left, bottom = film.left - x_min, film.bottom - y_min
        if left < 0 or bottom < 0 or left + film.width > owner.shape[1] or bottom + film.height > owner.shape[0]:
            raise ValueError(f"merge: {names[number]} reaches over the picture's edge")
        tile = owner[bottom : bottom + film.height, left : left + film.width]
        if (tile >= 0).any():
            raise ValueError(f"merge: {names[number]} and {names[tile.max()]} are of the same pixels")
        tile[...] = number
    rows, columns = np.nonzero(owner < 0)
    if len(rows):
        raise ValueError(
            f"merge: a part is missing: {len(rows)} pixels, of columns {x_min + columns.min()} to "
            f"{x_min + columns.max()} and rows {y_min + rows.min()} to {y_min + rows.max()} from below"
        )


def measure_whole(film: Film) -> Border:
    """Return the border of the picture that a film is a part of."""
    assert film.key is not None
    return film.border or (0, 0, film.key.choices["width"], film.key.choices["height"])


def number_pixels(film: Film, x_min: int, y_min: int, width: int) -> Indices:
    """Return the numbers (n,) of a film's pixels among those of the whole, which is `width` pixels wide."""
    rows = np.arange(film.bottom - y_min, film.bottom - y_min + film.height)
    columns = np.arange(film.left - x_min, film.left - x_min + film.width)
    return (rows[:, np.newaxis] * width + columns).reshape(-1)


def add_statistics(films: Sequence[Film]) -> Statistics:
    """Return what all renders took together."""
    taken = [film.statistics for film in films]
    return Statistics(
        rays=sum(one.rays for one in taken),
        build_seconds=sum(one.build_seconds for one in taken),
        trace_seconds=sum(one.trace_seconds for one in taken),
    )
