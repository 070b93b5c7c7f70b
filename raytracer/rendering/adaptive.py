"""The sweeps of adaptive sampling: an even pilot, then some pixels several times and others now and then.

How many samples a pixel gets over the average follows from the pilot (`allocation`), once. With the density r, it has
floor(j r + u) samples of a replication after j more sweeps, where u is a number of its own between 0 and 1.

The density is relative to the pilot of all the film: tiles decide each for itself. Put together they are right on
average, but not the whole's bits, nor can they go on as one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from raytracer.arrays.types import Floats, Indices, Words
from raytracer.film.film import Film
from raytracer.film.sums import PILOT, split_pilot
from raytracer.integrator.settings import Settings
from raytracer.rendering.allocation import Scatter, allocate, measure_scatter
from raytracer.rendering.block_plan import BlockPlan
from raytracer.rendering.blocks import Block, BlockResult, FrameWindow, ListedBlock, number_pixels
from raytracer.rendering.ending import EndedBy, Ending
from raytracer.sampling.dimensions import ALLOCATION_DIMENSION
from raytracer.sampling.sobol import REPLICATIONS, SobolSamples, join_numbers


class AdaptivePlan(BlockPlan):
    """Cuts the sweeps into blocks: those of the pilot as BlockPlan does, the others as lists of samples."""

    def __init__(
        self, film: Film, window: FrameWindow, settings: Settings, sweeps: int, growth: float | None = None
    ) -> None:
        pixels, even = film.width * film.height, min(film.pilot, sweeps)
        super().__init__(
            pixels,
            even,
            settings.block_size,
            growth,
            workers=settings.workers,
            done=film.samples,
            ahead=film.ahead,
            seconds=settings.seconds,
        )
        self._film, self._total = film, sweeps
        self._offset = draw_offsets(film, window, settings.seed)

    def phases(self) -> Iterator[Iterator[Block | ListedBlock]]:
        """Yield the pilot's blocks; and, once they are in the film, those that follow from them."""
        yield iter(self)
        if self._film.samples >= self._film.pilot:
            self.sweeps = self._total
            self._join_rest()
            density = decide_density(self._film)
            if (density == 1.0).all():  # as if there had been no pilot: whole sweeps take less time than lists
                self._done = self._film.samples, self._film.ahead, self._film.ahead_samples
                yield iter(self)
            else:
                yield self._list_blocks(density)

    def _join_rest(self) -> None:
        """Have one block for what follows the pilot, where there is room for it and nobody to share it with: the pilot
        has taken one that even samples have not."""
        rest = (self.sweeps - self._film.samples) * self.pixels
        if self._workers == 1 and rest <= self._largest:
            self._size = self._largest

    def ends_sweep(self, block: Block | ListedBlock) -> bool:
        """Return True where at least one sweep is done with this block."""
        return bool(block.ends) if isinstance(block, ListedBlock) else super().ends_sweep(block)

    def count_done(self, block: Block | ListedBlock) -> float:
        """Return the number of sweeps that are done with this block."""
        return block.sample + len(block.ends) if isinstance(block, ListedBlock) else super().count_done(block)

    def _list_blocks(self, density: Floats) -> Iterator[ListedBlock]:
        """Yield lists of as many whole sweeps as fit into a block: one more would make two of half the size."""
        sweep, offset, pilot = self._film.samples, self._offset, self._film.pilot
        pixels, numbers = list_sweep(density, offset, sweep, pilot)
        pixels, numbers = pixels[self._film.ahead :], numbers[self._film.ahead :]
        while sweep < self.sweeps:
            lists: list[tuple[Indices, Words]] = []
            most, first, count, size = self._limit_sweeps(sweep), sweep, 0, self.size
            if self._workers > 1:
                size = min(size, self._share(sweep, 0))
            while sweep - first < most and (not lists or count + len(pixels) <= size):
                lists.append((pixels, numbers))
                count += len(pixels)
                sweep += 1
                pixels, numbers = list_sweep(density, offset, sweep, pilot)
            yield from cut_lists(first, lists, size)


def decide_density(film: Film) -> Floats:
    """Return (pixels, 2) samples of each pixel over the average, of both replications, by the pilot in the film."""
    sums, shape = film.arrays[PILOT].reshape(-1, REPLICATIONS, 2, 3), (film.height, film.width)
    densities = [allocate(*measure_parts(sums[:, k], film.pilot), shape, film.pilot) for k in range(REPLICATIONS)]
    return np.stack(densities[::-1], axis=1)


def measure_parts(sums: Floats, pilot: int) -> tuple[Scatter, list[Scatter]]:
    """Return what one replication's pilot knows, all of it and its two parts, of sums (pixels, 2, 3)."""
    first, count = split_pilot(pilot), pilot // REPLICATIONS
    parts = [measure_scatter(sums[:, k], samples) for k, samples in enumerate((first, count - first))]
    return measure_scatter(sums.sum(axis=1), count), parts


def draw_offsets(film: Film, window: FrameWindow, seed: int) -> Floats:
    """Return (pixels,) where between two sweeps each pixel begins, 0 to 1."""
    pixel = number_pixels(window, np.arange(film.width * film.height))[0]
    return SobolSamples(pixel, 0, seed).uniform(ALLOCATION_DIMENSION)


def check_counts(film: Film, window: FrameWindow, seed: int) -> None:
    """Raise ValueError unless a film's numbers of samples are those that follow from its pilot.

    Those of tiles that were put together after it do not: samples would be taken twice, and others never.
    """
    density, offset = decide_density(film), draw_offsets(film, window, seed)
    expected = count_listed(density, offset, film.samples, film.pilot)
    pixels, numbers = list_sweep(density, offset, film.samples, film.pilot)
    np.add.at(expected, (pixels[: film.ahead], numbers[: film.ahead] % REPLICATIONS), 1)
    if not np.array_equal(film.sums.counts.read(slice(None)), expected):
        raise ValueError(
            f"{film.label or 'film'} cannot go on: its samples are not those that its pilot asks for, as those of "
            "adaptive tiles that were merged are not; render them to the end before they are merged"
        )


def count_listed(density: Floats, offset: Floats, sweep: int, pilot: int) -> Indices:
    """Return (pixels, 2) the numbers of samples after so many sweeps, of both replications."""
    turns = (sweep - pilot + 1 - np.arange(REPLICATIONS)) // REPLICATIONS
    return pilot // REPLICATIONS + np.floor(turns * density + offset[:, np.newaxis]).astype(np.int64)


def list_sweep(density: Floats, offset: Floats, sweep: int, pilot: int) -> tuple[Indices, Words]:
    """Return the pixels (n,) and the numbers of their samples (n,) of one sweep, those of a pixel in order."""
    turn, replication = divmod(sweep - pilot, REPLICATIONS)
    first = np.floor(turn * density[:, replication] + offset).astype(np.int64)
    count = np.floor((turn + 1) * density[:, replication] + offset).astype(np.int64) - first
    pixels = np.repeat(np.arange(len(density)), count)
    within = np.arange(len(pixels)) - np.repeat(np.cumsum(count) - count, count)
    sample = pilot // REPLICATIONS + first[pixels] + within
    return pixels, join_numbers(sample.astype(np.uint32), replication)


def cut_lists(first: int, lists: Sequence[tuple[Indices, Words]], size: int) -> Iterator[ListedBlock]:
    """Yield the samples of sweeps from `first` on in even blocks of at most `size`."""
    pixels, numbers = (np.concatenate(parts) for parts in zip(*lists, strict=True))
    ends = np.cumsum([len(part) for part, _ in lists])
    pieces = max(1, -(-len(pixels) // size))
    stops = np.arange(1, pieces + 1) * len(pixels) // pieces
    done, start = 0, 0
    for stop in stops:
        ended = ends[done:][ends[done:] <= stop] - start
        yield ListedBlock(first + done, pixels[start:stop], numbers[start:stop], tuple(ended.tolist()))
        done, start = done + len(ended), stop


def add_listed(film: Film, result: BlockResult, ending: Ending) -> EndedBy | None:
    """Add what a ListedBlock saw to the film, sweep by sweep, until that ends it; return what did, or None."""
    block, start = result.block, 0
    assert isinstance(block, ListedBlock)
    for stop in dict.fromkeys((*block.ends, len(block))):
        rows = slice(start, stop)
        if start < stop:
            values = {name: seen[rows] for name, seen in result.values.items()}
            film.add(block.chosen[rows], values, int(block.numbers[start]) % REPLICATIONS, repeated=True)
        film.ahead += stop - start
        for _ in range(block.ends.count(stop)):
            film.samples, film.ahead = film.samples + 1, 0
            ended_by = ending.find(film, is_amid=stop < block.ends[-1])
            if ended_by:
                return ended_by
        start = stop
    return None
