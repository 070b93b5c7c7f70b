"""Which numbered dimension comes next: a pixel's own samples, and those that sets of pixels share."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.sampling.dimensions import SHARED_DIMENSION, find_wave_pair
from raytracer.sampling.sobol import SobolSamples, join_numbers, split_numbers


@dataclass(frozen=True, eq=False, slots=True)
class SharedSamples:
    """One sample of each of k sets of pixels, which n pixels share.

    key : (n,) unsigned, the set's sample that each pixel takes, 0 <= key < k
    of_sets : k SobolSamples, numbered by set
    """

    key: NDArray[np.unsignedinteger[Any]]
    of_sets: SobolSamples

    def select(self, index: Any) -> SharedSamples:
        """Return what some of the pixels share: index or boolean array."""
        return SharedSamples(self.key[index], self.of_sets)

    def uniform(self, dimension: int) -> Floats:
        """Return (k,) float64 in [0, 1), independent of every pixel's own."""
        return self.of_sets.uniform(dimension + SHARED_DIMENSION)

    def uniform_pair(self, dimension: int) -> Floats:
        """Return (k, 2) float64 in [0, 1) x [0, 1), good together with the film's, as the camera's rays alone share."""
        return self.of_sets.uniform_pair(dimension + SHARED_DIMENSION, find_wave_pair(0))


@dataclass(frozen=True, eq=False, slots=True)
class Sampler:
    """Where n paths take their numbers from.

    own : n SobolSamples
    shared : what they share with others; None for nothing
    dimension : the first of the numbered dimensions that are theirs to use; the methods count from there
    wave : number of the paths' wave, from 0, for `joined_pair`
    """

    own: SobolSamples
    shared: SharedSamples | None
    dimension: int
    wave: int = 0

    def select(self, index: Any) -> Sampler:
        """Return the sampler of some of the paths: index or boolean array."""
        return replace(self, own=self.own.select(index), shared=self.shared and self.shared.select(index))

    def skip(self, dimensions: int) -> Sampler:
        """Return the sampler that begins so many dimensions later."""
        return replace(self, dimension=self.dimension + dimensions)

    def uniform(self, dimension: int = 0) -> Floats:
        """Return (n,) float64 in [0, 1), each path its own."""
        return self.own.uniform(self.dimension + dimension)

    def uniform_pair(self, dimension: int = 0) -> Floats:
        """Return (n, 2) float64 in [0, 1) x [0, 1), each path its own."""
        return self.own.uniform_pair(self.dimension + dimension)

    def joined_pair(self, dimension: int = 0) -> Floats:
        """Return (n, 2) float64 in [0, 1) x [0, 1), good together with those of the film and of other waves.

        Those of one wave are not good together: they are for uses whose light adds up, such as samples of several
        lights and the way on. What multiplies takes `uniform_pair`, such as a choice among lights.
        """
        return self.own.uniform_pair(self.dimension + dimension, find_wave_pair(self.wave))


def number_branches(sampler: Sampler, count: int) -> Iterator[Sampler]:
    """Yield the samplers of `count` ways on that each path tries at once.

    Each sample of a pixel has the next `count` points of one sequence, so that all samples fill it together.
    """
    own = sampler.own
    first = np.asarray(own.sample, dtype=np.uint32) * np.uint32(count)
    for number in range(count):
        sample = np.broadcast_to(first + np.uint32(number), len(own))
        yield replace(sampler, own=replace(own, sample=sample))


def share_samples(samples: SobolSamples) -> SharedSamples | None:
    """Return what the pixels of each set share; None where they share nothing."""
    if samples.group is None or not len(samples):
        return None
    number = join_numbers(samples.sample, samples.replication)
    number = np.broadcast_to(number, samples.pixel.shape)
    first, sets = number.min(), np.uint32(samples.group.max()) + 1
    key = (number - first) * sets + samples.group
    count = int(key.max()) + 1
    number, group = np.divmod(np.arange(count, dtype=np.uint32), sets)
    sample, replication = split_numbers(number + first)
    of_sets = SobolSamples(group, sample, samples.seed, replication=replication)
    return SharedSamples(key.astype(np.min_scalar_type(count)), of_sets)
