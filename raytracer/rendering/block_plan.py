"""How sweeps over a picture are cut into blocks of work."""

from __future__ import annotations

import time
from collections.abc import Iterator

from raytracer.rendering.blocks import Block, BlockResult, ListedBlock

# Seconds of work between two signs of progress. (`is_cancelled` is asked at every cast, far more often.)
BLOCK_SECONDS = 2.0


# Camera rays; with fewer at a time NumPy's calls cost more than its arithmetic in the later waves of mirrors and glass.
# Blocks have this many until the pace is known, the smallest where it is slow. With mirrors and glass 2^18 rays take
# 4 to 12% less time than twice 2^17, and 2^19 up to 3% less again.
USUAL_BLOCK = 1 << 18
SMALLEST_BLOCK = 1 << 17
# Pixels of a picture beside whose film, of 40 bytes each and more, blocks stay at the usual size. What is held of a ray
# while it is traced takes up to 700 bytes: 2^19 of them as much as that film.
LARGE_PICTURE = 3 << 22
# Camera rays of the first blocks of long work, doubled until they are as large: a sign of progress, and of the pace,
# comes early. 2^18 rays in all take up to 1.4 times as long with such a start, where there are mirrors or glass.
FIRST_BLOCK = 1 << 14
LONG_WORK = 1 << 20
# Where any sweep may be the last: the most sweeps of the first block, and of each other one, over those before it.
FIRST_SWEEPS = 16
SWEEP_GROWTH = 0.25
# What a worker takes at least of a picture that has too little work for all.
SMALLEST_SHARE = 1 << 12
# Sweeps of which each of many workers takes a part and adds it up, where there is enough of them. To send a strip of
# the film there and back takes the parent 5 ns a sample then instead of 20, with five passes 10 instead of 80; of fewer
# than 8 sweeps more than their samples would.
GATHERED = 16
FEWEST_GATHERED = 8
MANY_WORKERS = 16
# Blocks of each worker at least until the same pixels come again: the film has what it adds to by then.
BLOCKS_OF_WORKER = 3


class BlockPlan:
    """Cuts the sweeps into blocks of about BLOCK_SECONDS, learning from those that are done.

    A sweep is one sample of every pixel; a block is several sweeps, or an even part of one or, for many workers, of
    some.

    pixels, sweeps : of the whole picture
    largest : most camera rays of a block
    growth : where any sweep may be the last, the most sweeps in a block, over those before it: what is traced beyond
        the last one is in vain
    workers : that share the work; none takes more of what is left than its part, so that all have some to the end
    done, ahead : sweeps that are done already, and the first pixels that have samples of the next ones
    ahead_samples : how many of them these have
    gathered : the most sweeps of which a worker takes a part of the picture
    seconds : after which the render ends; None sets no limit
    """

    def __init__(
        self,
        pixels: int,
        sweeps: int,
        largest: int,
        growth: float | None = None,
        *,
        workers: int = 1,
        done: int = 0,
        ahead: int = 0,
        ahead_samples: int = 1,
        gathered: int = 1,
        seconds: float | None = None,
    ) -> None:
        self.pixels = pixels
        self.sweeps = sweeps
        self._growth = growth
        self._workers = workers
        self._gathered = gathered
        self._done = (done, ahead, ahead_samples)
        self._begun, self._seconds = done, seconds
        self._started: float | None = None
        self._largest = largest if pixels < LARGE_PICTURE else min(largest, USUAL_BLOCK)
        self._size = min(largest, USUAL_BLOCK)
        self._has_begun = False

    def __iter__(self) -> Iterator[Block]:
        sample, start, together = self._done
        first = FIRST_BLOCK if self.pixels * self.sweeps > LONG_WORK else USUAL_BLOCK
        if self._has_begun:  # with a pilot, whose pace is known
            first = self._largest
        while sample < self.sweeps:
            size, first = min(self._size, first, self._share(sample, start)), 2 * first
            if start == 0:
                together = min(max(size // self.pixels, self._gather(sample)), self._limit_sweeps(sample))
            rest = self.pixels - start
            stop = start + -(-rest // -(-rest // max(1, size // together)))
            yield Block(sample, start, stop, together)
            start = stop % self.pixels
            sample += together if start == 0 else 0

    def _gather(self, sample: int) -> int:
        """Return the sweeps that are cut into parts together from `sample` on: no more than are done before, so that
        something is to be seen early, and only where all workers have something to do meanwhile."""
        sweeps = min(self._gathered, sample)
        enough = BLOCKS_OF_WORKER * self._workers * self._size
        return sweeps if sweeps >= FEWEST_GATHERED and sweeps * self.pixels >= enough else 1

    def _limit_sweeps(self, sample: int) -> int:
        """Return the most sweeps in a block that begins with `sample`."""
        left = self.sweeps - sample
        if self._growth is None:
            return left
        if self._seconds is not None:
            return min(left, self._fit_in(sample - self._begun, self._seconds, self._growth))
        return min(left, max(1, int(sample * self._growth)) if sample else FIRST_SWEEPS)

    def _fit_in(self, done: int, seconds: float, growth: float) -> int:
        """Return the most sweeps of the next block, after those `done`, where time may end the render: first one, which
        tells how long they take, then no more than before, at most as many as there is time for."""
        now = time.perf_counter()
        if self._started is None:
            self._started = now
            return 1
        taken = max(now - self._started, 1e-9)
        most = done if done < FIRST_SWEEPS else int(done * growth)
        return max(1, int(min(most, max(seconds - taken, 0.0) / taken * done)))

    def _share(self, sample: int, start: int) -> int:
        """Return a worker's part of what is left from a pixel of a sweep on."""
        left = (self.sweeps - sample) * self.pixels - start
        return left if self._workers == 1 else max(-(-left // self._workers), SMALLEST_SHARE)

    def observe(self, result: BlockResult) -> None:
        """Set the size of the next blocks by how long this one took; at most twice its size."""
        self._has_begun = True
        size = len(result.block) * result.block.samples
        if size < self._size // 2:
            return  # the short rest of a sweep says little about the others
        size = int(size * BLOCK_SECONDS / max(result.seconds, BLOCK_SECONDS / 2))
        self._size = min(max(size, SMALLEST_BLOCK), self._largest)

    @property
    def size(self) -> int:
        """The most camera rays of the next block."""
        return self._size

    def phases(self) -> Iterator[Iterator[Block | ListedBlock]]:
        """Yield the blocks; where some follow from the results of others, after those."""
        yield iter(self)

    def ends_sweep(self, block: Block | ListedBlock) -> bool:
        """Return True where at least one sweep is done with this block."""
        assert isinstance(block, Block)
        return block.stop == self.pixels

    def count_done(self, block: Block | ListedBlock) -> float:
        """Return the number of sweeps that are done with this block."""
        assert isinstance(block, Block)
        return block.sample + block.samples * block.stop / self.pixels
