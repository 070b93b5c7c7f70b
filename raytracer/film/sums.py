"""What a film holds: what the samples of each pixel add up to, and no more than somebody will ask for.

Sums are float64. Of Combined 24 bytes a pixel are held, three colors, and what follows from them is not:

    alpha, while every sample has had an alpha of 1: it is their number then;
    what tells the error, before the second sample of a pixel, and half of it before the third;
    how many samples each pixel has, where runs of pixels have as many (`counts`).

What tells the error is held in float32, 16 bytes: of each color the difference D of the sums of both replications, and
how the samples x of a pixel, each the mean of its colors, scatter: M = sum (x - mean)^2, to which the sample after k
others adds (x - mean of those)^2 k / (k + 1) (B. P. Welford). Both are sums of what is small where the error is small.
So their rounding is no more than that of the picture, which is float32 itself: with u = 2^-24, a sum of N samples v has

    |error of D| <= u sum_k (|v_k| + |D_k|),

about 2 u sum |v| where replications take turns, which is 2 u of the pixel's mean in the error that D / N tells. A
sample is rounded before it is added, so D is exactly 0 where both replications have the same samples.

Adaptive, a pixel is the mean of its replications' means, so their sums are of the picture: float64, of every pass. Of
what shadow catchers show, too: a quotient of sums, of which no difference tells.

References
----------
B. P. Welford, "Note on a Method for Calculating Corrected Sums of Squares and Products", 1962.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import mean_column
from raytracer.arrays.types import Counts, Floats, Indices
from raytracer.film.counts import SampleCounts, iterate_parts
from raytracer.film.mattes import add_tables
from raytracer.film.passes import CAUGHT, LENGTH, find_pass, matte_table
from raytracer.film.pixel_parts import PART

# What is after the name of a pass whose sum is that of the second replication alone.
SECOND = ", second replication"
# The sum of Combined's alpha, apart from its colors.
ALPHA = "Alpha"
# By how much the sum of the first replication is more than that of the second, and M.
DIFFERENCE, DEVIATIONS = "Difference of Replications", "Squared Deviations"
# Adaptive, in place of M: the sum of the squares of Combined's samples, each the mean of its colors.
SQUARES = "Squares"
# What tells how the samples of an adaptive film's pilot scatter: the sums of the mean of their channels, of its square,
# and of their paths' lengths, of each replication, of its first samples and of its last ones.
PILOT = "Pilot"
# Channels of what is held from where it does not follow from other arrays.
CHANNELS = {ALPHA: 1, ALPHA + SECOND: 1, DIFFERENCE: 3, DEVIATIONS: 1}


class Sums:
    """What the samples of pixels add up to.

    arrays : what is held, by name, (pixels, channels)
    counts : how many samples there are
    """

    def __init__(
        self,
        pixels: int,
        means: Sequence[str],
        centre: Sequence[str],
        mattes: Mapping[str, int],
        pilot: int = 0,
    ) -> None:
        """Hold nothing yet.

        Parameters
        ----------
        means, centre : names of passes that are means of samples, and of those that come from the pixel's centre
        mattes : slots of the tables of Cryptomatte, by kind
        pilot : as of `Film`
        """
        self.counts = SampleCounts(pixels)
        self._means, self._mattes, self._pilot = tuple(means), dict(mattes), pilot
        # Passes of which the second replication's sum is held: all that the picture is made of.
        shown = ("Combined", CAUGHT) if CAUGHT in means else ()
        self.seconds = tuple(name for name in means if pilot or name in shown)
        # What follows from other arrays at first: alphas together, and where there is no second sum, the difference.
        self.alphas = (ALPHA, ALPHA + SECOND)[: 1 + bool(self.seconds)] if "Combined" in means else ()
        self.tells_difference = bool(self.alphas) and not self.seconds
        self.arrays: dict[str, NDArray[Any]] = {}
        for name in (*means, *centre):
            self.arrays[name] = np.zeros((pixels, count_channels(name)))
        for name in self.seconds:
            self.arrays[name + SECOND] = np.zeros((pixels, count_channels(name)))
        for kind, slots in mattes.items():
            self.arrays[matte_table(kind)] = np.zeros((pixels, 2 * slots))
        if pilot:
            self.arrays[PILOT] = np.zeros((pixels, 2 * 2 * 3))
            self.arrays |= {SQUARES: np.zeros((pixels, 1))} if self.alphas else {}

    def add(
        self, pixels: slice | Indices, values: Mapping[str, Floats], replication: int, repeated: bool = False
    ) -> None:
        """Add one sample; parameters as `Film.add`."""
        if repeated and not self._pilot:
            assert not isinstance(pixels, slice)
            for rows in part_repeated(pixels):
                self.add(pixels[rows], {name: part[rows] for name, part in values.items()}, replication)
            return
        sums = [(name, values[name][:, : count_channels(name)]) for name in self._means]
        if self.alphas:
            sums += self._split_combined(pixels, values["Combined"], replication)
        if replication:
            sums += [(name + SECOND, added) for name, added in sums if name + SECOND in self.arrays]
        for name, added in sums:
            add_rows(self.arrays[name], pixels, added, repeated)
        for kind in self._mattes:
            self._add_matte(matte_table(kind), pixels, values[matte_table(kind)], repeated)
        self.counts.add(pixels, replication, repeated)

    def _split_combined(
        self, pixels: slice | Indices, values: Floats, replication: int
    ) -> list[tuple[str, NDArray[Any]]]:
        """Return what a sample of Combined (n, 4) adds besides its colors."""
        added: list[tuple[str, NDArray[Any]]] = []
        colors, alpha = values[:, :3], values[:, 3:]
        if ALPHA not in self.arrays and (alpha != 1.0).any():
            self.hold(self.alphas)
        if ALPHA in self.arrays:
            added.append((ALPHA, alpha))
        if self._pilot:
            added.append((SQUARES, square_means(colors)))
        if self.tells_difference:
            added += self._compare(pixels, colors, replication)
        return added

    def _compare(self, pixels: slice | Indices, colors: Floats, replication: int) -> list[tuple[str, NDArray[Any]]]:
        """Return what colors (n, 3) add to the difference of replications and to squared deviations."""
        counts = self.counts.read_columns(pixels)
        count = counts[0] + counts[1]
        if DIFFERENCE not in self.arrays and count.any():
            self.hold([DIFFERENCE])
        if DEVIATIONS not in self.arrays and counts[replication].any():
            self.hold([DEVIATIONS])
        with np.errstate(over="ignore", invalid="ignore"):  # of what is infinite nothing is known
            before = mean_column(self.arrays["Combined"][pixels]) / np.maximum(count, 1)
            deviation = mean_column(colors) - before
            deviation *= deviation * (count / (count + 1.0))
            signed = colors.astype(np.float32)
            added = {
                DIFFERENCE: np.negative(signed, out=signed) if replication else signed,
                DEVIATIONS: deviation[:, np.newaxis].astype(np.float32),
            }
        return [(name, part) for name, part in added.items() if name in self.arrays]

    def _add_matte(self, name: str, pixels: slice | Indices, values: Floats, repeated: bool) -> None:
        rows = np.arange(len(self.arrays[name]))[pixels]
        for part in part_repeated(rows) if repeated else (slice(None),):
            add_tables(self.arrays[name], rows[part], values[part])

    def note_pilot(self, pixels: slice | Indices, values: Mapping[str, Floats], replication: int) -> None:
        """Add what tells how samples scatter, of the sample that is to be added next."""
        value = values["Combined"][:, :3].mean(axis=1)
        with np.errstate(over="ignore"):
            noted = np.stack([value, value * value, values[LENGTH][:, 0]], axis=1)
        done = int(self.counts.read(pixels)[:, replication].max(initial=0))  # as many of all these pixels
        column = 3 * (2 * replication + (done >= split_pilot(self._pilot)))
        self.arrays[PILOT][pixels, column : column + 3] += noted

    def hold(self, names: Sequence[str]) -> None:
        """Hold from now on what has followed from other arrays."""
        pixels = self.counts.pixels
        for name in names:
            array = np.empty((pixels, CHANNELS[name]), self.read(name, slice(0, 0)).dtype)
            for part in iterate_parts(pixels, PART):
                array[part] = self.read(name, part)
            self.arrays[name] = array

    def read(self, name: str, pixels: slice | Indices) -> NDArray[Any]:
        """Return an array (n, channels) of some pixels, held or not."""
        if name in self.arrays:
            return self.arrays[name][pixels]
        counts = self.counts.read(pixels)
        if name == ALPHA:
            return counts.sum(axis=1, keepdims=True, dtype=np.float64)
        if name == ALPHA + SECOND:
            return counts[:, 1:].astype(np.float64)
        if name == DIFFERENCE:  # of one sample at most, of the one or the other replication
            return round_sums(self.arrays["Combined"][pixels], counts)
        # Of one sample x and y of each replication at most: (x - y)^2 / 2.
        with np.errstate(over="ignore", invalid="ignore"):
            apart = np.where((counts > 0).all(axis=1), mean_column(self.read(DIFFERENCE, pixels)), np.float32(0.0))
            return (apart * apart / np.float32(2.0))[:, np.newaxis]

    def read_sums(self, name: str, pixels: slice | Indices, second: bool = False) -> Floats:
        """Return the sums (n, channels) of a pass, all of its channels; second : of the second replication alone."""
        end = SECOND if second else ""
        found: Floats = self.arrays[name + end][pixels]
        return np.concatenate([found, self.read(ALPHA + end, pixels)], axis=1) if name == "Combined" else found

    def is_complete(self) -> bool:
        """Return whether what tells the error is held, or follows from the rest."""
        held = DIFFERENCE in self.arrays, DEVIATIONS in self.arrays
        most, most_of_one = self.counts.find_most()
        return not self.tells_difference or ((held[0] or most < 2) and (held[1] or most_of_one < 2))

    def cut_off(self, pixels: int) -> None:
        """Let go of all pixels but the first ones."""
        for array in self.arrays.values():
            array.resize((pixels, array.shape[1]), refcheck=False)  # in place: the end's memory is free at once
        self.counts.cut_off(pixels)

    def take(self, pixels: slice | Indices, other: Sums, taken: slice | Indices) -> None:
        """Put what other pixels have, those `taken` of another film, in place of what some have; of arrays that both
        can have."""
        for name in CHANNELS:
            if name in other.arrays and name not in self.arrays:
                self.hold([name])
        for name, array in self.arrays.items():
            if name in other.arrays or name in CHANNELS:
                array[pixels] = other.read(name, taken)
        self.counts.put(pixels, other.counts.read(taken))


def count_channels(name: str) -> int:
    """Return how many channels of a pass are summed: alpha is apart."""
    return 3 if name == "Combined" else find_pass(name).channels


def split_pilot(pilot: int) -> int:
    """Return how many samples of each replication are the first part of a pilot of so many sweeps."""
    return pilot // 4


def square_means(colors: Floats) -> Floats:
    """Return the squares (n, 1) of the means of the colors (n, 3) of samples."""
    with np.errstate(over="ignore", invalid="ignore"):
        mean = mean_column(colors)
        return (mean * mean)[:, np.newaxis]


def round_sums(sums: Floats, counts: Counts) -> NDArray[np.float32]:
    """Return sums (n, 3) of one sample each, or none, as the difference of replications."""
    with np.errstate(over="ignore"):
        rounded = sums.astype(np.float32)
    np.negative(rounded, out=rounded, where=counts[:, 1:] > 0)
    return rounded


def add_rows(sums: NDArray[Any], pixels: slice | Indices, added: NDArray[Any], repeated: bool) -> None:
    """Add rows (n, k) to those of some pixels; repeated : True where a pixel may be there several times."""
    if not repeated or isinstance(pixels, slice):
        with np.errstate(over="ignore", invalid="ignore"):  # float32 ends earlier than what it is the difference of
            sums[pixels] += added
        return
    for column in range(added.shape[1]):  # one by one: of whole rows `add.at` takes five times as long
        np.add.at(sums[:, column], pixels, added[:, column])


def part_repeated(pixels: Indices) -> Iterator[Indices]:
    """Yield rows of a list of pixels, parts in which none is twice, each pixel's in order."""
    left = np.arange(len(pixels))
    while len(left):
        first = np.unique(pixels[left], return_index=True)[1]
        yield left[first]
        left = np.delete(left, first)
