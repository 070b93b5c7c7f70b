"""How wrong a film is: what `error` tells from its sums, a part of its pixels at a time.

A large film leaves no room for a number of each pixel beside its sums, so none is kept: what is asked for twice is told
anew.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Protocol

import numpy as np

from raytracer.arrays.rows import mean_column
from raytracer.arrays.types import Counts, Floats, Indices
from raytracer.film.counts import iterate_parts
from raytracer.film.error import (
    PictureError,
    Scatter,
    find_deviations,
    measure_error,
    share_with_neighbors,
    spread_samples,
    square_errors,
    weigh_difference,
)
from raytracer.film.missed import measure_missed, sort_probes
from raytracer.film.pixel_parts import PART, Parts
from raytracer.film.sums import DEVIATIONS, DIFFERENCE, SQUARES, Sums
from raytracer.film.unmet import find_unmet

# How often estimates of pixels are shared with neighbors. Once, 1.96 standard errors hold 90% of the errors of pixels
# that are no fireflies, twice 92 to 94%, three times 92 to 95%, but edges are spread wider.
SHARED = 2
FLOAT32_ROUNDOFF = float(np.finfo(np.float32).eps) / 2.0


class SummedFilm(Protocol):
    """What a film tells its error from; fields as those of `Film`."""

    width: int
    height: int
    catches: bool
    interleaving: int
    time_side: int
    near_misses: tuple[int, ...]
    probes: tuple[float, ...]
    samples: int
    left: int
    bottom: int
    pilot: int
    sums: Sums

    def iterate_rows(self) -> Iterator[slice]:
        """Yield the pixels of one row after the other."""

    def read_pixels(self, name: str, pixels: slice | Indices) -> Floats:
        """Return the values (n, channels) of a pass in some pixels."""

    def show_replication(self, pixels: slice, replication: int) -> Floats:
        """Return Combined's colors (n, 3) in some pixels, as one replication alone has them."""


def measure_film(film: SummedFilm) -> PictureError:
    """Return how wrong a film's Combined is; all is unknown (inf) before the second sample of each pixel."""
    if not np.isfinite(square_film(film, slice(0, 1))).all():
        return PictureError()
    with np.errstate(over="ignore", invalid="ignore"):  # of what is infinite nothing is known
        level = np.mean([film.read_pixels("Combined", row)[:, :3].mean() for row in film.iterate_rows()])
    sides = [side for side in (film.interleaving, film.time_side) if side]
    squares = Parts(film.width * film.height, lambda pixels: square_film(film, pixels))
    found = measure_error(squares, float(level), film.width, min(sides, default=0), measure_scatter(film))
    x, y = found.worst
    return replace(found, worst=(film.left + x, film.bottom + y))


def square_film(film: SummedFilm, pixels: slice) -> Floats:
    """Return (n,) estimates of the square of the error of Combined in some pixels, the mean of its colors' channels.

    Unbiased, each with one degree of freedom (`error`); inf where a replication has no sample.
    """
    counts = film.sums.counts.read(pixels)
    weight = weigh_difference(counts[:, 0], counts[:, 1], even=film.pilot > 0)
    with np.errstate(over="ignore", invalid="ignore"):  # of what is infinite nothing is known
        if film.sums.tells_difference:
            squares = square_differences(film.sums, pixels, counts, weight).mean(axis=1)
        else:
            first, second = (film.show_replication(pixels, number) for number in range(2))
            squares = square_errors(*forget_rounding(first, second, counts), weight).mean(axis=1)
    squares[np.isnan(squares)] = np.inf
    return squares


def square_differences(sums: Sums, pixels: slice, counts: Counts, weight: Floats) -> Floats:
    """Return d^2 (n, 3) of pixels, by the difference D of the sums of their replications and the sum T of both.

    Of m and n samples their means are (T + D) / 2 m and (T - D) / 2 n. D is known to 2 u sum |v| (`sums`), sum |v| of
    colors is |T|, and so the difference of the means to u |T| (m + n) / m n, below which it is 0.
    """
    first, second = np.maximum(counts, 1).T.astype(np.float64)[:, :, np.newaxis]
    total, difference = sums.arrays["Combined"][pixels], sums.read(DIFFERENCE, pixels)
    means = (total + difference) / (2.0 * first) - (total - difference) / (2.0 * second)
    rounding = FLOAT32_ROUNDOFF * np.abs(total) * ((first + second) / (first * second))
    means[np.abs(means) <= rounding] = 0.0
    return square_errors(means, np.zeros_like(means), weight)


def forget_rounding(first: Floats, second: Floats, counts: Counts) -> tuple[Floats, Floats]:
    """Return means (n, 3) of replications of m and n samples, equal where they differ by no more than rounding.

    A sum of N = m + n samples is known to N eps of itself. The first replication's is what the second's leaves of it:
    its mean is known to N eps (|A| + |B| n / m), which is below N eps (|A| + |B|) N / min(m, n).
    """
    total, fewest = counts.sum(axis=1), np.maximum(counts.min(axis=1), 1)
    rounding = (np.finfo(np.float64).eps * total * (total / fewest))[:, np.newaxis]
    apart = np.abs(first - second)
    alike = (apart <= rounding * (np.abs(first) + np.abs(second))) & np.isfinite(apart)
    return first, np.where(alike, first, second)


def measure_scatter(film: SummedFilm) -> Scatter | None:
    """Return how Combined's samples scatter; None where what shadow catchers show is no mean of samples."""
    if film.catches:
        return None
    pixels, largest, fewest = film.width * film.height, 0.0, np.inf
    for part in iterate_parts(pixels, PART):
        largest = max(largest, float(read_deviations(film.sums, part).max()))
        fewest = min(fewest, float(np.maximum(film.sums.counts.read(part), 1).sum(axis=1).min()))
    squares = Parts(pixels, lambda part: spread_samples(read_deviations(film.sums, part), film.sums.counts.read(part)))
    largest = float(np.sqrt(largest))
    missed = find_missed(film, largest) if film.probes else (0.0, 0.0)
    return Scatter(squares, find_unmet(film.near_misses, largest) / fewest, missed)


def find_missed(film: SummedFilm, largest: float) -> tuple[float, float]:
    """Return the sum of the squares of the light that a film's probes show to be missing, and its upper end (`missed`).

    largest : by how much a sample stands out of its pixel, the most of all
    """
    probes = sort_probes(film.probes)
    row, column = probes[:, 3] - film.bottom, probes[:, 2] - film.left
    inside = (row >= 0) & (row < film.height) & (column >= 0) & (column < film.width)
    pixel = (row * film.width + column)[inside].astype(np.intp)
    with np.errstate(over="ignore", invalid="ignore"):  # of what is infinite nothing is known
        return measure_missed(probes[inside], pixel, film.read_pixels("Combined", pixel)[:, :3], largest, film.samples)


def read_deviations(sums: Sums, pixels: slice) -> Floats:
    """Return sum (x - mean)^2 (n,) of the samples of pixels; 0 where that may be rounding alone, and of what is
    infinite."""
    with np.errstate(over="ignore", invalid="ignore"):
        counts = sums.counts.read(pixels)
        means = mean_column(sums.arrays["Combined"][pixels])
        if SQUARES in sums.arrays:
            return find_deviations(means, sums.arrays[SQUARES][pixels, 0], counts)
        deviations = sums.read(DEVIATIONS, pixels)[:, 0].astype(np.float64)
        # Of a constant: of each mean so far, of up to N sums, N + 3 roundings with the mean of channels.
        count = np.maximum(counts.sum(axis=1), 1)
        rounding = (count + 3.0) * np.finfo(np.float64).eps * np.abs(means) / count
        return np.where(deviations > count * rounding * rounding, deviations, 0.0)


def smooth_errors(film: SummedFilm) -> Floats:
    """Return (pixels,) standard errors of Combined.

    One pixel's own estimate says little. Neighbors scatter alike, from sample to sample; so they share what they
    know of that, and each divides it by its own number of samples.
    """
    first, second = film.sums.counts.read(slice(None)).T.astype(np.float64)
    counts = first * second / np.maximum(first + second, 1.0)
    squares = np.concatenate([square_film(film, part) for part in iterate_parts(len(counts), PART)])
    scatter = (squares * np.maximum(counts, 0.5)).reshape(film.height, film.width)
    for _ in range(SHARED):
        scatter = share_with_neighbors(scatter)
    return np.sqrt(scatter.ravel() / np.maximum(counts, 0.5))
