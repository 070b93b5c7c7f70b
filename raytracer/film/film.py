"""The film: what the samples of each pixel add up to, pass by pass.

What passes hold follows Cycles (`kernel/film/data_passes.h` and `read.h` in its
source): light, colors, Normal and UV are means over a pixel's samples, in which a ray that hit nothing counts as 0;
Depth, Position, Vector and the indices come from the one ray through the pixel's centre, for a mean of two surfaces
lies on neither.

Combined is also summed for every replication of the samples (`sampling.sobol`) by itself, which is what its error is
told from (`error`), and so are the squares of its samples: together 8 bytes for each pixel and channel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import mean_column
from raytracer.arrays.types import Floats, Indices
from raytracer.film.error import (
    PictureError,
    Scatter,
    measure_error,
    measure_scatter,
    share_with_neighbors,
    square_errors,
    weigh_difference,
)
from raytracer.film.mattes import add_tables, sort_slots
from raytracer.film.on_demand import PassesOnDemand
from raytracer.film.passes import (
    CAUGHT,
    LENGTH,
    NEAR_MISS,
    find_pass,
    matte_pass,
    matte_table,
    select_mattes,
    select_passes,
)
from raytracer.film.picture_key import PictureKey
from raytracer.film.shown import divide_by_color, find_shadows, show_shadows
from raytracer.film.unmet import add_near_misses, count_near_misses

# In `Film.arrays`, what is after the name of a pass whose sum is that of the second replication alone.
SECOND = ", second replication"
# The sum of the squares of Combined's samples, each the mean of its colors.
SQUARES = "Squares"
# What tells how the samples of an adaptive film's pilot scatter: the sums of the mean of their channels, of its square,
# and of their paths' lengths, of each replication, of its first samples and of its last ones.
PILOT = "Pilot"
# How often estimates of pixels are shared with neighbors. Once, 1.96 standard errors hold 90% of the errors of pixels
# that are no fireflies, twice 92 to 94%, three times 92 to 95%, but edges are spread wider.
SHARED = 2
# Pixels whose means are held at a time.
PART = 1 << 16

LARGEST = np.finfo(np.float32).max
# What `arrays` calls the number of samples of each pixel.
COUNTS = "Sample Count"


def square_means(values: Floats) -> Floats:
    """Return the squares (n, 1) of the means of the colors of samples (n, channels)."""
    with np.errstate(over="ignore", invalid="ignore"):
        mean = mean_column(values[:, :3])
        return (mean * mean)[:, np.newaxis]


def split_pilot(pilot: int) -> int:
    """Return how many samples of each replication are the first part of a pilot of so many sweeps."""
    return pilot // 4


@dataclass
class Statistics:
    """What a render took.

    rays : rays cast, of every kind
    build_seconds, trace_seconds : preparing the caster; everything after that, by the clock
    """

    rays: int = 0
    build_seconds: float = 0.0
    trace_seconds: float = 0.0


@dataclass(eq=False)
class Film:
    """The picture, or the part of it inside a border, as it accumulates.

    A pixel's samples are added in float64 in the order of their numbers, so the sums do not depend on how the picture
    was divided among blocks or workers. Only the passes asked for are stored.

    width, height : pixels
    names : the passes, names that `passes.find_pass` knows
    samples : finished sweeps over the whole film
    cancelled : True where the render was stopped before it was done
    ended_by : what it was done by, 'samples', 'error' or 'time'; 'cancelled' where the user stopped it, '' before
    catches : True where Combined is completed by what shadow catchers show
    interleaving : side of the squares of pixels that take different points of lights, 0 where none are shared
    time_side : side of the squares of pixels that take different times, 0 where nothing moves
    near_misses : how many samples would have seen how much of light that their paths came near to (`unmet`)
    pilot : where samples are adaptive, the sweeps that are even, from which the others follow; 0 where all are
    ahead : pixels, the first ones, that have samples of the next sweeps already, `ahead_samples` each
    total : the samples that the picture is to have
    left, bottom : the film's lower left pixel in the full picture
    border : (x_min, y_min, x_max, y_max), the part of the full picture that this film and others are tiles of; None
        is all of it
    key : what decides the picture's bits; None where a film is no part of a picture
    label : what sentences call it, the path of the file that it came from
    exposure : factor of all light where it is shown
    arrays : all that a film holds, by name, (pixels, channels); pixels are numbered along rows from the LOWER left, as
        the camera counts. The sums of passes that are means and the values of the others, float64; 'Sample Count',
        (pixels, 2) int32, of both replications

    Examples
    --------
    >>> film = Film(2, 1, ("Combined",))
    >>> for number, value in enumerate((1.0, 3.0)):
    ...     film.add(slice(0, 2), {"Combined": np.full((2, 4), value)}, replication=number)
    >>> film["Combined"][0, 0].tolist(), film.error
    ([2.0, 2.0, 2.0, 2.0], 0.5)
    """

    width: int
    height: int
    names: tuple[str, ...]
    samples: int = 0
    cancelled: bool = False
    ended_by: str = ""
    catches: bool = False
    interleaving: int = 0
    time_side: int = 0
    near_misses: tuple[int, ...] = ()
    pilot: int = 0
    ahead: int = 0
    total: int = 0
    left: int = 0
    bottom: int = 0
    border: tuple[int, int, int, int] | None = None
    key: PictureKey | None = None
    label: str = ""
    exposure: float = 1.0
    statistics: Statistics = field(default_factory=Statistics)
    arrays: dict[str, NDArray[Any]] = field(init=False)

    def __post_init__(self) -> None:
        pixels = self.width * self.height
        sampled = select_passes(self.names, from_centre=False)
        self._means = tuple(name for name in sampled if not find_pass(name).matte) + ((CAUGHT,) if self.catches else ())
        # Adaptive, a pixel is the mean of both replications' means; else only the error needs them apart.
        self._seconds = tuple(name for name in self._means if self.pilot or name in ("Combined", CAUGHT))
        stored = (*self._means, *select_passes(self.names, from_centre=True))
        self.arrays = {name: np.zeros((pixels, find_pass(name).channels)) for name in stored}
        self.arrays |= {name + SECOND: np.zeros((pixels, self._count_seconds(name))) for name in self._seconds}
        if "Combined" in self._means:
            self.arrays[SQUARES] = np.zeros((pixels, 1))
        self._mattes = select_mattes(self.names)
        self.arrays |= {matte_table(kind): np.zeros((pixels, 2 * slots)) for kind, slots in self._mattes.items()}
        self.arrays["Sample Count"] = np.zeros((pixels, 2), dtype=np.int32)
        if self.pilot:
            self.arrays[PILOT] = np.zeros((pixels, 2 * 2 * 3))

    @property
    def ahead_samples(self) -> int:
        """How many samples those pixels that are ahead of the others have more than these."""
        return int(self.arrays[COUNTS][0].sum()) - self.samples if self.ahead and not self.pilot else 1

    def _count_seconds(self, name: str) -> int:
        """Return how many channels are summed by replication: alpha has an error that nobody asks for."""
        is_shown = self.pilot or self.catches
        return find_pass(name).channels if is_shown or name != "Combined" else 3

    def add(
        self, pixels: slice | Indices, values: Mapping[str, Floats], replication: int, repeated: bool = False
    ) -> None:
        """Add one sample of each mean pass to some pixels.

        Parameters
        ----------
        pixels : of the film
        values : (n, channels) float64 for each mean pass of the film
        replication : 0 or 1, which of the two the sample belongs to
        repeated : True where a pixel may be there several times, which takes longer
        """
        if NEAR_MISS in values:
            self.near_misses = add_near_misses(self.near_misses, count_near_misses(values[NEAR_MISS]))
        if self.samples < self.pilot:
            self._note_pilot(pixels, values, replication)
        sums = [(name, values[name]) for name in self._means]
        if replication:
            sums += [(name + SECOND, values[name][:, : self._count_seconds(name)]) for name in self._seconds]
        if SQUARES in self.arrays:
            sums.append((SQUARES, square_means(values["Combined"])))
        for kind in self._mattes:
            self._add_matte(matte_table(kind), pixels, values[matte_table(kind)], repeated)
        counts = self.arrays["Sample Count"][:, replication]
        if repeated:
            assert not isinstance(pixels, slice)
            for name, added in sums:  # column by column: of whole rows `add.at` takes five times as long
                for column in range(added.shape[1]):
                    np.add.at(self.arrays[name][:, column], pixels, added[:, column])
            np.add.at(counts, pixels, 1)
            return
        for name, added in sums:
            self.arrays[name][pixels] += added
        counts[pixels] += 1

    def _add_matte(self, name: str, pixels: slice | Indices, values: Floats, repeated: bool) -> None:
        rows = np.arange(len(self.arrays[name]))[pixels]
        while len(rows):
            first = np.unique(rows, return_index=True)[1] if repeated else slice(None)
            add_tables(self.arrays[name], rows[first], values[first])
            if not repeated:
                return
            rows, values = np.delete(rows, first), np.delete(values, first, axis=0)

    def _note_pilot(self, pixels: slice | Indices, values: Mapping[str, Floats], replication: int) -> None:
        """Add what tells how samples scatter."""
        value = values["Combined"][:, :3].mean(axis=1)
        with np.errstate(over="ignore"):
            noted = np.stack([value, value * value, values[LENGTH][:, 0]], axis=1)
        done = int(self.arrays[COUNTS][pixels, replication].max(initial=0))  # as many of all these pixels
        column = 3 * (2 * replication + (done >= split_pilot(self.pilot)))
        self.arrays[PILOT][pixels, column : column + 3] += noted

    def set_centre(self, pixels: slice | Indices, values: Mapping[str, Floats]) -> None:
        """Store the passes that come from the pixel's centre; parameters as `add`."""
        for name in select_passes(self.names, from_centre=True):
            self.arrays[name][pixels] = values[name]

    def cut_strip(self, pixels: slice | Indices) -> Film:
        """Return a film of some of the pixels, a row, with what they hold of all passes but those from the centre; for
        samples to be added elsewhere, and `put_strip`."""
        names = select_passes(self.names, from_centre=False)
        count = len(self.arrays[COUNTS][pixels])
        strip = Film(count, 1, names, self.samples, catches=self.catches, pilot=self.pilot)
        for name, array in strip.arrays.items():
            array[...] = self.arrays[name][pixels]
        return strip

    def put_strip(self, pixels: slice | Indices, strip: Film) -> None:
        """Put what `cut_strip` returned back, with what has been added to it."""
        self.near_misses = add_near_misses(self.near_misses, strip.near_misses)
        for name, array in strip.arrays.items():
            self.arrays[name][pixels] = array

    @property
    def passes(self) -> Mapping[str, NDArray[np.float32]]:
        """Every pass by name, (h, w, channels) float32, made anew whenever it is asked for: all at once would take half
        of what the sums do."""
        return PassesOnDemand(self.names, self.__getitem__)

    def __getitem__(self, name: str) -> NDArray[np.float32]:
        """Return one pass, (h, w, channels) float32; row 0 is the TOP row of the picture.

        The mean of the samples so far; 0 where there are none yet. What is too large for float32 is its largest number.
        """
        if name not in self.names:
            raise KeyError(f"the film has no pass {name!r}; it has {', '.join(self.names)}")
        picture = np.empty((self.height, self.width, find_pass(name).channels), dtype=np.float32)
        errors = self._smooth_errors() if name == "Error" else None
        for row in range(self.height):  # a row at a time: a large film leaves no room for a second one in float64
            pixels = slice(row * self.width, (row + 1) * self.width)
            values = self._read(name, pixels) if errors is None else errors[pixels, np.newaxis]
            if find_pass(name).exposed and self.exposure != 1.0:
                values = values * np.where(np.arange(values.shape[1]) < 3, self.exposure, 1.0)  # alpha is no light
            picture[self.height - 1 - row] = np.clip(values, -LARGEST, LARGEST)  # float32 has no more
        return picture

    def _read(self, name: str, pixels: slice) -> Floats:
        """Return the values (n, channels) of a pass other than Error in some pixels."""
        if name == "Sample Count":
            return self.arrays[name][pixels].sum(axis=1, keepdims=True, dtype=np.float64)
        if find_pass(name).from_centre:
            return self.arrays[name][pixels]
        if find_pass(name).matte:
            return self._read_matte(name, pixels)
        return self._show(name, lambda stored: self._average(stored, pixels))

    def _read_matte(self, name: str, pixels: slice) -> Floats:
        """Return two slots (n, 4) of each pixel's table, hash and share of its samples in turn."""
        kind = find_pass(name).matte
        table = sort_slots(self.arrays[matte_table(kind)][pixels])
        first = 4 * int(name.removeprefix(matte_pass(kind, 0)[:-2]))
        shown = table[:, first : first + 4].copy()
        shown[:, 1::2] /= np.maximum(self.arrays["Sample Count"][pixels].sum(axis=1, keepdims=True), 1)
        return shown

    def _show(self, name: str, average: Callable[[str], Floats]) -> Floats:
        """Return what is seen of a pass, (n, channels), by its mean."""
        if name == "Shadow Catcher":
            return find_shadows(average(CAUGHT)) if self.catches else np.ones((len(average("Combined")), 3))
        if name == "Combined" and self.catches and "Shadow Catcher" not in self.names:
            return show_shadows(average(name), average(CAUGHT))
        color = find_pass(name).color
        if color:
            return divide_by_color(average(name), average(color))
        return average(name)

    def _average(self, name: str, pixels: slice) -> Floats:
        """Return the mean (n, channels) of a pass in some pixels: of its samples, or adaptive of its replications."""
        counts = self.arrays["Sample Count"][pixels]
        if self.pilot and counts.all():
            return (self._average_replication(name, pixels, 0) + self._average_replication(name, pixels, 1)) / 2.0
        return self.arrays[name][pixels] / np.maximum(counts.sum(axis=1), 1)[:, np.newaxis]

    def _average_replication(self, name: str, pixels: slice, replication: int) -> Floats:
        sums = self.arrays[name + SECOND][pixels]
        sums = sums if replication else self.arrays[name][pixels, : sums.shape[1]] - sums
        return sums / np.maximum(self.arrays["Sample Count"][pixels, replication], 1)[:, np.newaxis]

    def _show_replication(self, pixels: slice, replication: int) -> Floats:
        """Return Combined's colors (n, 3) in some pixels, as one replication alone has them."""
        return self._show("Combined", lambda stored: self._average_replication(stored, pixels, replication))[:, :3]

    def square_errors(self) -> Floats:
        """Return (pixels,) estimates of the square of the error of Combined, the mean of its colors' channels.

        Unbiased, each with one degree of freedom (`error`); inf where a replication has no sample.
        """
        squares = np.empty(self.width * self.height)
        for start in range(0, len(squares), PART):
            pixels = slice(start, start + PART)
            counts = self.arrays["Sample Count"][pixels]
            weight = weigh_difference(counts[:, 0], counts[:, 1], even=self.pilot > 0)
            with np.errstate(over="ignore", invalid="ignore"):  # of what is infinite nothing is known
                first, second = (self._show_replication(pixels, number) for number in range(2))
                squares[pixels] = square_errors(first, second, weight).mean(axis=1)
        squares[np.isnan(squares)] = np.inf
        return squares

    def measure_error(self) -> PictureError:
        """Return how wrong Combined is, by what its samples say; all is unknown (inf) before the second sample.

        Raises
        ------
        KeyError
            If the film does not hold Combined.
        """
        if "Combined" not in self._means:
            raise KeyError(f"the film has no pass 'Combined', which has an error; it has {', '.join(self.names)}")
        with np.errstate(over="ignore", invalid="ignore"):  # of what is infinite nothing is known
            level = np.mean([self._read("Combined", pixels)[:, :3].mean() for pixels in self._rows()])
        sides = [side for side in (self.interleaving, self.time_side) if side]
        return measure_error(
            self.square_errors(), float(level), self.width, min(sides, default=0), self._measure_scatter()
        )

    def _measure_scatter(self) -> Scatter | None:
        """Return how Combined's samples scatter; None where what shadow catchers show is no mean of samples."""
        if self.catches:
            return None
        with np.errstate(over="ignore", invalid="ignore"):
            sums = mean_column(self.arrays["Combined"][:, :3])
            return measure_scatter(sums, self.arrays[SQUARES][:, 0], self.arrays[COUNTS], self.near_misses)

    @property
    def error(self) -> float:
        """The root mean square error of Combined's colors, over their mean level."""
        return self.measure_error().error

    @property
    def error_interval(self) -> tuple[float, float]:
        """(low, high), which hold the error of this picture with 95% confidence."""
        return self.measure_error().interval

    def _rows(self) -> Iterator[slice]:
        return (slice(start, start + self.width) for start in range(0, self.width * self.height, self.width))

    def _smooth_errors(self) -> Floats:
        """Return (pixels,) standard errors of Combined.

        One pixel's own estimate says little. Neighbors scatter alike, from sample to sample; so they share what they
        know of that, and each divides it by its own number of samples.
        """
        first, second = self.arrays["Sample Count"].T.astype(np.float64)
        counts = first * second / np.maximum(first + second, 1.0)
        scatter = (self.square_errors() * np.maximum(counts, 0.5)).reshape(self.height, self.width)
        for _ in range(SHARED):
            scatter = share_with_neighbors(scatter)
        return np.sqrt(scatter.ravel() / np.maximum(counts, 0.5))
