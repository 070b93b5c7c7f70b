"""The film: what the samples of each pixel add up to, pass by pass.

What passes hold follows Cycles (`kernel/film/data_passes.h` and `read.h` in its
source): light, colors, Normal and UV are means over a pixel's samples, in which a ray that hit nothing counts as 0;
Depth, Position, Vector and the indices come from the one ray through the pixel's centre, for a mean of two surfaces
lies on neither.

What is held of Combined also tells its error (`error`), by the two replications of the samples (`sampling.sobol`): 40
bytes a pixel in all, of one sample 24 (`sums`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats, Indices
from raytracer.film.counts import iterate_parts
from raytracer.film.error import PictureError
from raytracer.film.film_error import measure_film, smooth_errors, square_film
from raytracer.film.mattes import sort_slots
from raytracer.film.on_demand import PassesOnDemand
from raytracer.film.passes import (
    CAUGHT,
    NEAR_MISS,
    find_pass,
    matte_pass,
    matte_table,
    select_mattes,
    select_passes,
)
from raytracer.film.picture_key import PictureKey
from raytracer.film.pixel_parts import PART
from raytracer.film.shown import divide_by_color, find_shadows, show_shadows
from raytracer.film.sums import Sums
from raytracer.film.unmet import add_near_misses, count_near_misses

LARGEST = np.finfo(np.float32).max


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
    probes : what was seen by rays aimed at small light (`missed`)
    pilot : where samples are adaptive, the sweeps that are even, from which the others follow; 0 where all are
    ahead : pixels, the first ones, that have samples of the next sweeps already, `ahead_samples` each; after a pilot
        samples, the first ones of the next sweep
    total : the samples that the picture is to have
    left, bottom : the film's lower left pixel in the full picture
    border : (x_min, y_min, x_max, y_max), the part of the full picture that this film and others are tiles of; None
        is all of it
    key : what decides the picture's bits; None where a film is no part of a picture
    label : what sentences call it, the path of the file that it came from
    exposure : factor of all light where it is shown
    sums : what it holds; pixels are numbered along rows from the LOWER left, as the camera counts. The sums of passes
        that are means and the values of the others, and how many samples each pixel has

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
    probes: tuple[float, ...] = ()
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
    sums: Sums = field(init=False)

    def __post_init__(self) -> None:
        means, centre = (select_passes(self.names, from_centre) for from_centre in (False, True))
        means = tuple(name for name in means if not find_pass(name).matte) + ((CAUGHT,) if self.catches else ())
        self.sums = Sums(self.width * self.height, means, centre, select_mattes(self.names), self.pilot)

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """What is held of the pixels besides their numbers of samples, by name, (pixels, channels)."""
        return self.sums.arrays

    @property
    def ahead_samples(self) -> int:
        """How many samples those pixels that are ahead of the others have more than these."""
        return int(self.sums.counts.read(slice(0, 1)).sum()) - self.samples if self.ahead and not self.pilot else 1

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
            self.sums.note_pilot(pixels, values, replication)
        self.sums.add(pixels, values, replication, repeated)

    def set_centre(self, pixels: slice | Indices, values: Mapping[str, Floats]) -> None:
        """Store the passes that come from the pixel's centre; parameters as `add`."""
        for name in select_passes(self.names, from_centre=True):
            self.arrays[name][pixels] = values[name]

    def cut_strip(self, pixels: slice | Indices) -> Film:
        """Return a film of some of the pixels, a row, with what they hold of all passes but those from the centre; for
        samples to be added elsewhere, and `put_strip`."""
        names = select_passes(self.names, from_centre=False)
        count = len(self.sums.counts.read(pixels))
        strip = Film(count, 1, names, self.samples, catches=self.catches, pilot=self.pilot)
        strip.sums.take(slice(None), self.sums, pixels)
        return strip

    def put_strip(self, pixels: slice | Indices, strip: Film) -> None:
        """Put what `cut_strip` returned back, with what has been added to it."""
        self.near_misses = add_near_misses(self.near_misses, strip.near_misses)
        self.sums.take(pixels, strip.sums, slice(None))

    def cut_off(self, height: int) -> None:
        """Let go of the rows from `height` on, and of their memory: what is left is a film of the lower ones."""
        self.sums.cut_off(height * self.width)
        self.height = height

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
        read = self.open_pass(name)
        for row, pixels in enumerate(self.iterate_rows()):  # one at a time: there is no room for all in float64
            picture[self.height - 1 - row] = read(pixels)
        return picture

    def open_pass(self, name: str) -> Callable[[slice], NDArray[np.float32]]:
        """Return what reads the values (n, channels) of a pass in some pixels, as `film[name]` has them."""
        errors = smooth_errors(self)[:, np.newaxis] if name == "Error" else None

        def read(pixels: slice) -> NDArray[np.float32]:
            values = self.read_pixels(name, pixels) if errors is None else errors[pixels]
            if find_pass(name).exposed and self.exposure != 1.0:
                values = values * np.where(np.arange(values.shape[1]) < 3, self.exposure, 1.0)  # alpha is no light
            return np.clip(values, -LARGEST, LARGEST).astype(np.float32)  # float32 has no more

        return read

    def read_pixels(self, name: str, pixels: slice | Indices) -> Floats:
        """Return the values (n, channels) of a pass other than Error in some pixels."""
        if name == "Sample Count":
            return self.sums.counts.read(pixels).sum(axis=1, keepdims=True, dtype=np.float64)
        if find_pass(name).from_centre:
            found: Floats = self.arrays[name][pixels]
            return found
        if find_pass(name).matte:
            return self._read_matte(name, pixels)
        return self._show(name, lambda stored: self._average(stored, pixels))

    def _read_matte(self, name: str, pixels: slice | Indices) -> Floats:
        """Return two slots (n, 4) of each pixel's table, hash and share of its samples in turn."""
        kind = find_pass(name).matte
        table = sort_slots(self.arrays[matte_table(kind)][pixels])
        first = 4 * int(name.removeprefix(matte_pass(kind, 0)[:-2]))
        shown = table[:, first : first + 4].copy()
        shown[:, 1::2] /= np.maximum(self.sums.counts.read(pixels).sum(axis=1, keepdims=True), 1)
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

    def _average(self, name: str, pixels: slice | Indices) -> Floats:
        """Return the mean (n, channels) of a pass in some pixels: of its samples, or adaptive of its replications, if a
        pixel has both."""
        counts = self.sums.counts.read(pixels)
        both = counts.all(axis=1)[:, np.newaxis] if self.pilot else np.zeros((1, 1), dtype=np.bool_)
        if not both.all():
            means = self.sums.read_sums(name, pixels) / np.maximum(counts.sum(axis=1), 1)[:, np.newaxis]
            if not both.any():
                return means
        halves = (self._average_replication(name, pixels, 0) + self._average_replication(name, pixels, 1)) / 2.0
        return halves if both.all() else np.where(both, halves, means)

    def _average_replication(self, name: str, pixels: slice | Indices, replication: int) -> Floats:
        sums = self.sums.read_sums(name, pixels, second=True)
        sums = sums if replication else self.sums.read_sums(name, pixels) - sums
        return sums / np.maximum(self.sums.counts.read(pixels)[:, replication], 1)[:, np.newaxis]

    def show_replication(self, pixels: slice, replication: int) -> Floats:
        """Return Combined's colors (n, 3) in some pixels, as one replication alone has them."""
        return self._show("Combined", lambda stored: self._average_replication(stored, pixels, replication))[:, :3]

    def square_errors(self) -> Floats:
        """Return (pixels,) estimates of the square of the error of Combined (`film_error.square_film`)."""
        return np.concatenate([square_film(self, part) for part in iterate_parts(self.width * self.height, PART)])

    def measure_error(self) -> PictureError:
        """Return how wrong Combined is, by what its samples say; all is unknown (inf) before the second sample.

        Raises
        ------
        KeyError
            If the film does not hold Combined.
        """
        if "Combined" not in self.arrays:
            raise KeyError(f"the film has no pass 'Combined', which has an error; it has {', '.join(self.names)}")
        return measure_film(self)

    @property
    def error(self) -> float:
        """The root mean square error of Combined's colors, over their mean level."""
        return self.measure_error().error

    @property
    def error_interval(self) -> tuple[float, float]:
        """(low, high), which hold the error of this picture with 95% confidence."""
        return self.measure_error().interval

    def iterate_rows(self) -> Iterator[slice]:
        """Yield the pixels of one row after the other, from the lowest up."""
        return iterate_parts(self.width * self.height, self.width)
