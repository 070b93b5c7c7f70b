"""The film: what the samples of each pixel add up to, pass by pass.

What passes hold follows Cycles (`kernel/film/data_passes.h` and `read.h` in its
source): light, colors, Normal and UV are means over a pixel's samples, in which a ray that hit nothing counts as 0;
Depth, Position and the indices come from the one ray through the pixel's centre, for a mean of two surfaces lies on
neither.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats, Indices
from raytracer.film.passes import CAUGHT, PASSES, STORED, select_passes
from raytracer.film.picture_key import PictureKey

LARGEST = np.finfo(np.float32).max
# What `arrays` calls the number of samples of each pixel.
COUNTS = "Sample Count"


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
    names : the passes, names from PASSES
    samples : finished sweeps over the whole film
    cancelled : True where the render was stopped before the last sample
    catches : True where Combined is completed by what shadow catchers show
    interleaving : side of the squares of pixels that take different points of lights, 0 where none are shared
    ahead : pixels, the first ones, that have a sample of the next sweep already
    total : the samples that the picture is to have
    left, bottom : the film's lower left pixel in the full picture
    border : (x_min, y_min, x_max, y_max), the part of the full picture that this film and others are tiles of; None
        is all of it
    key : what decides the picture's bits; None where a film is no part of a picture
    label : what sentences call it, the path of the file that it came from

    Examples
    --------
    >>> film = Film(2, 1, ("Combined",))
    >>> for value in (1.0, 3.0):
    ...     film.add(slice(0, 2), {"Combined": np.full((2, 4), value)})
    >>> film["Combined"][0, 0].tolist()
    [2.0, 2.0, 2.0, 2.0]
    """

    width: int
    height: int
    names: tuple[str, ...]
    samples: int = 0
    cancelled: bool = False
    catches: bool = False
    interleaving: int = 0
    ahead: int = 0
    total: int = 0
    left: int = 0
    bottom: int = 0
    border: tuple[int, int, int, int] | None = None
    key: PictureKey | None = None
    label: str = ""
    statistics: Statistics = field(default_factory=Statistics)

    def __post_init__(self) -> None:
        pixels = self.width * self.height
        self._means = select_passes(self.names, from_centre=False) + ((CAUGHT,) if self.catches else ())
        stored = (*self._means, *select_passes(self.names, from_centre=True))
        self._sums = {name: np.zeros((pixels, STORED[name].channels)) for name in stored}
        self._counts = np.zeros(pixels, dtype=np.int32)

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that accumulates, by name, a row or number for each pixel: what files keep and `merge` puts together."""
        return {**self._sums, COUNTS: self._counts}

    def add(self, pixels: slice | Indices, values: Mapping[str, Floats]) -> None:
        """Add one sample of each mean pass to some pixels.

        Parameters
        ----------
        pixels : of the film, numbered along rows from the LOWER left, as the camera counts; none twice
        values : (n, channels) float64 for each mean pass of the film
        """
        for name in self._means:
            self._sums[name][pixels] += values[name]
        self._counts[pixels] += 1

    def set_centre(self, pixels: slice | Indices, values: Mapping[str, Floats]) -> None:
        """Store the passes that come from the pixel's centre; parameters as `add`."""
        for name in select_passes(self.names, from_centre=True):
            self._sums[name][pixels] = values[name]

    @property
    def passes(self) -> dict[str, NDArray[np.float32]]:
        """Every pass by name, (h, w, channels) float32."""
        return {name: self[name] for name in self.names}

    def __getitem__(self, name: str) -> NDArray[np.float32]:
        """Return one pass, (h, w, channels) float32; row 0 is the TOP row of the picture.

        The mean of the samples so far; 0 where there are none yet. What is too large for float32 is its largest number.
        """
        if name not in self.names:
            raise KeyError(f"the film has no pass {name!r}; it has {', '.join(self.names)}")
        picture = np.empty((self.height, self.width, PASSES[name].channels), dtype=np.float32)
        for row in range(self.height):  # a row at a time: a large film leaves no room for a second one in float64
            pixels = slice(row * self.width, (row + 1) * self.width)
            values = self._sums[name][pixels] if PASSES[name].from_centre else self._average(name, pixels)
            if name == "Combined" and self.catches:
                values = show_shadows(values, self._average(CAUGHT, pixels))
            picture[self.height - 1 - row] = np.clip(values, -LARGEST, LARGEST)  # float32 has no more
        return picture

    def _average(self, name: str, pixels: slice) -> Floats:
        return self._sums[name][pixels] / np.maximum(self._counts[pixels], 1)[:, np.newaxis]


def show_shadows(combined: Floats, caught: Floats) -> Floats:
    """Return what is seen in front of shadow catchers (n, 4) over their shadows over the background.

    The light of catchers, with all objects over without, as a factor of the footage behind the picture. What darkens
    it is shown as black of the alpha 1 - mean(factor); brightening, such as of caustics, cannot be shown.

    Parameters
    ----------
    combined, caught : (n, 4), (n, 11) float64, means of pixels, in the order of CAUGHT

    References
    ----------
    Blender, intern/cycles/kernel/film/read.h: film_calculate_shadow_catcher_matte_with_shadow.
    """
    lit, alone, opacity, backdrop = np.split(caught, (3, 6, 7), axis=1)
    factor = np.divide(lit, alone, out=np.ones_like(lit), where=alone != 0)
    factor = 1.0 + np.clip(opacity, 0.0, 1.0) * (factor - 1.0)
    shadow = 1.0 - np.clip(factor.mean(axis=1), 0.0, 1.0)
    shown = combined.copy()
    shown[:, 3] += (1.0 - combined[:, 3]) * shadow
    return shown + (1.0 - shown[:, 3:]) * backdrop
