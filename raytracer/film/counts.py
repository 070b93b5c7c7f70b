"""How many samples the pixels of a film have, of both replications: by runs of pixels that have as many.

Where all pixels have the same samples that is one run, of a picture in the middle of a sweep two; only where numbers
differ from pixel to pixel, as adaptive samples and moments do, each pixel has its own, of 8 bytes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Counts, Indices

# With more runs than these, pixels have numbers of their own.
MOST_RUNS = 256


class SampleCounts:
    """Numbers of samples (pixels, 2) of both replications.

    Examples
    --------
    >>> counts = SampleCounts(5)
    >>> counts.add(slice(0, 5), 0)
    >>> counts.add(slice(1, 3), 1)
    >>> counts.read(slice(None)).tolist(), counts.is_by_runs
    ([[1, 0], [1, 1], [1, 1], [1, 0], [1, 0]], True)
    """

    def __init__(self, pixels: int) -> None:
        self.pixels = pixels
        self._stops: Indices = np.array([pixels], dtype=np.intp)
        self._runs: Counts = np.zeros((1, 2), dtype=np.int32)
        self._each: Counts | None = None

    @property
    def is_by_runs(self) -> bool:
        """True where no pixel has numbers of its own."""
        return self._each is None

    def read(self, pixels: slice | Indices) -> Counts:
        """Return the numbers (n, 2) int32 of some pixels, a copy."""
        if self._each is not None:
            return self._each[pixels].copy()
        if not isinstance(pixels, slice):
            return self._runs[np.searchsorted(self._stops, pixels, side="right")]
        start, stop, _ = pixels.indices(self.pixels)
        lengths = np.diff(np.clip(self._stops, start, max(start, stop)), prepend=start)
        return np.repeat(self._runs, lengths, axis=0)

    def read_columns(self, pixels: slice | Indices) -> Counts:
        """Return the numbers (2, n) of some pixels, as `read`; (2, 1) where they are one run, and have all the same."""
        if self._each is None and isinstance(pixels, slice):
            start, stop, _ = pixels.indices(self.pixels)
            run = int(np.searchsorted(self._stops, start, side="right"))
            if start < stop <= self._stops[run]:
                return self._runs[run : run + 1].T
        return self.read(pixels).T

    def add(self, pixels: slice | Indices, replication: int, repeated: bool = False) -> None:
        """Count one more sample of a replication; repeated : True where a pixel may be there several times."""
        if self._each is None and isinstance(pixels, slice):
            runs = self._cut(pixels)
            self._runs[runs, replication] += 1
            self._join()
        elif repeated and not isinstance(pixels, slice):
            np.add.at(self.spread()[:, replication], pixels, 1)
        else:
            self.spread()[pixels, replication] += 1

    def put(self, pixels: slice | Indices, counts: Counts) -> None:
        """Set the numbers of some pixels to `counts` (n, 2)."""
        if not isinstance(pixels, slice) and is_run(pixels):
            pixels = slice(int(pixels[0]), int(pixels[0]) + len(pixels))
        stops = find_stops(counts)
        if self._each is None and isinstance(pixels, slice) and len(stops) <= MOST_RUNS:
            start = pixels.indices(self.pixels)[0]
            for first, stop in zip((0, *stops[:-1]), stops, strict=True):
                runs = self._cut(slice(start + first, start + stop))
                self._runs[runs] = counts[first]
            self._join()
        else:
            self.spread()[pixels] = counts

    def list_runs(self) -> NDArray[np.int64]:
        """Return (k, 3) where each run stops, and the numbers of its pixels."""
        return np.column_stack([self._stops, self._runs]).astype(np.int64)

    def set_runs(self, runs: NDArray[np.int64]) -> None:
        """Set all numbers to what `list_runs` returned; ValueError where runs (k, 3) are of other pixels."""
        lengths = np.diff(runs[:, 0], prepend=0)
        if not len(runs) or (lengths <= 0).any() or runs[-1, 0] != self.pixels or (runs[:, 1:] < 0).any():
            raise ValueError(f"runs of pixels that do not make {self.pixels}")
        self._each, self._stops, self._runs = None, runs[:, 0].astype(np.intp), runs[:, 1:].astype(np.int32)

    def find_most(self) -> tuple[int, int]:
        """Return the most samples of a pixel, and the most of one of its replications."""
        counts = self._runs if self._each is None else self._each
        return int(counts.sum(axis=1).max()), int(counts.max())

    def spread(self) -> Counts:
        """Return the numbers (pixels, 2) themselves, which each pixel has of its own from now on."""
        if self._each is None:
            self._each = self.read(slice(None))
        return self._each

    def cut_off(self, pixels: int) -> None:
        """Let go of all pixels but the first ones."""
        if self._each is not None:
            self._each = self._each[:pixels].copy()
        runs = self._cut(slice(0, pixels))
        self.pixels, self._stops, self._runs = pixels, self._stops[runs], self._runs[runs]

    def _cut(self, pixels: slice) -> slice:
        """Return which runs some pixels are, after cutting those that reach over their ends."""
        start, stop, _ = pixels.indices(self.pixels)
        for edge in (start, stop):
            run = int(np.searchsorted(self._stops, edge))
            if edge > 0 and self._stops[run] != edge:
                self._stops = np.insert(self._stops, run, edge)
                self._runs = np.insert(self._runs, run, self._runs[run], axis=0)
        first, last = np.searchsorted(self._stops, [start, max(start, stop)])
        return slice(int(first) + (start > 0), int(last) + 1) if stop > start else slice(0, 0)

    def _join(self) -> None:
        """Make one of neighboring runs that are alike; where many are left, let pixels have numbers of their own."""
        last = np.append((self._runs[1:] != self._runs[:-1]).any(axis=1), True)
        self._stops, self._runs = self._stops[last], self._runs[last]
        if len(self._stops) > MOST_RUNS:
            self.spread()


def is_run(pixels: Indices) -> bool:
    """True where pixels are numbered one after the other."""
    return len(pixels) > 0 and bool((np.diff(pixels) == 1).all())


def find_stops(counts: Counts) -> list[int]:
    """Return where runs of equal numbers (n, 2) stop."""
    changes: Booleans = (counts[1:] != counts[:-1]).any(axis=1)
    return [*(np.flatnonzero(changes) + 1).tolist(), len(counts)] if len(counts) else []


def iterate_parts(pixels: int, size: int) -> Iterator[slice]:
    """Yield so many pixels in parts of at most `size`."""
    return (slice(start, min(start + size, pixels)) for start in range(0, pixels, size))
