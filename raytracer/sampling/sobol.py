"""Sample points: a scrambled Sobol sequence per pixel.

Each pair of dimensions is the first two dimensions of Sobol's sequence, a (0,2)-sequence in base 2: any aligned run of
2^k samples has one point in each of the 2^k boxes of every shape 2^-a x 2^-(k-a). Pairs are decorrelated ("padded") by
a nested uniform shuffle of the sample index, but for a few that are good together (`joined_pairs`), and every
coordinate gets its own Owen scrambling, both as hashes, so that a value depends on (pixel, sample, seed, dimension) and
on nothing else: not on blocks, workers or other dimensions.

A pixel's samples are REPLICATIONS such sequences, scrambled independently of each other and taken in turn. The points
of one sequence depend on each other, which is what makes them good, so nothing about the error can be told from how
they scatter; the means of the sequences do not, and how those differ tells it ("randomized quasi-Monte Carlo").

References
----------
I. M. Sobol, "On the distribution of points in a cube and the approximate evaluation of integrals", 1967.
A. B. Owen, "Randomly permuted (t,m,s)-nets and (t,s)-sequences", 1995.
P. L'Ecuyer, C. Lemieux, "Recent Advances in Randomized Quasi-Monte Carlo Methods", 2002: replications.
B. Burley, "Practical Hash-based Owen Scrambling", Journal of Computer Graphics Techniques 9(4), 2020.
N. Vegdahl, "Building a Better LK Hash", 2021: the constants of `_scramble_reversed`.
C. Wellons, "Prospecting for Hash Functions", 2018: the constants of `_hash_pixels` and `_hash`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats, Words
from raytracer.sampling.joined_pairs import MIXING, look_up, make_tables

UNIT_PER_WORD = 2.0**-32  # all 32 bits fit a float64, so the result stays below 1

# The fewest from which an error can be told. More would cost: n samples of R sequences have the error of n / R samples
# of one, over sqrt(R), and that of one falls faster than 1 / sqrt(n).
REPLICATIONS = 2
# Makes other keys of the same pixel; odd, so that every replication has its own (the golden ratio's bits).
REPLICATION_STEP = 0x9E3779B9


# One shift and mask per level of the butterflies below: bits whose position lacks that power of two.
_LEVELS = ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF), (16, 0x0000FFFF))


@dataclass(frozen=True, eq=False, slots=True)
class SobolSamples:
    """One sample of each of n pixels.

    pixel : (n,) uint32, index of the pixel in the full picture, y * width + x
    sample : number of the sample in its sequence, int or (n,) uint32, 0 <= sample < 2^32
    seed : int, another seed is another, independent picture of the same noise
    group : (n,) uint8, the pixel's set, which shares points of lights; None where every pixel takes its own
    replication : number of the sequence, int or (n,) uint32; another one is another, independent sequence

    A dimension numbers a pair of coordinates; `uniform` takes the first of the pair, so give each use its own number.
    """

    pixel: Words
    sample: int | Words
    seed: int
    group: NDArray[np.uint8] | None = None
    replication: int | Words = 0

    def __len__(self) -> int:
        return len(self.pixel)

    def select(self, index: Any) -> SobolSamples:
        """Return the samples of some of the pixels: index or boolean array."""
        sample = self.sample[index] if isinstance(self.sample, np.ndarray) else self.sample
        replication = self.replication[index] if isinstance(self.replication, np.ndarray) else self.replication
        group = None if self.group is None else self.group[index]
        return SobolSamples(self.pixel[index], sample, self.seed, group, replication)

    def uniform(self, dimension: int) -> Floats:
        """Return (n,) float64 in [0, 1)."""
        key, index = self._shuffle_index(dimension)
        return _to_unit(_first_coordinate(index, key))

    def uniform_pair(self, dimension: int, joined: int | None = None) -> Floats:
        """Return (n, 2) float64 in [0, 1) x [0, 1).

        joined : which of the pairs that are good together this is; None shuffles it
        """
        pair = np.empty((2, len(self)))
        if joined is None:
            key, index = self._shuffle_index(dimension)
            words = _first_coordinate(index.copy(), key), _second_coordinate(index, key)
        else:
            key = _hash_pixels(self.pixel, dimension, self.seed, self.replication)
            first, second = (self._look_up(tables) for tables in _JOINED[joined])
            words = _first_coordinate(first, key), _scramble_second(second, key)
        for values, word in zip(pair, words, strict=True):
            np.multiply(word, UNIT_PER_WORD, out=values)
        return pair.T

    def _look_up(self, tables: NDArray[np.uint32]) -> Words:
        """Return a new array (n,) of what the samples' numbers come to by the tables of `joined_pairs`."""
        words = look_up(tables, np.asarray(self.sample, np.uint32))
        return words if np.ndim(words) else np.full(self.pixel.shape, words)

    def _shuffle_index(self, dimension: int) -> tuple[Words, Words]:
        """Return each pixel's key (n,) and its shuffled sample index (n,), a nested uniform shuffle of `sample`."""
        key = _hash_pixels(self.pixel, dimension, self.seed, self.replication)
        index = np.broadcast_to(_reverse_samples(np.asarray(self.sample, np.uint32)), self.pixel.shape)
        return key, _reverse_bits(_scramble_reversed(index.copy(), key))


def _first_coordinate(index: Words, key: Words) -> Words:
    """Owen-scramble Sobol's first dimension. Destroys `index`.

    That dimension is the index with its bits reversed, so it enters the scrambling unreversed.
    """
    return _reverse_bits(_scramble_reversed(index, _hash(key, 0x9E3779B9)))


def _second_coordinate(index: Words, key: Words) -> Words:
    """Owen-scramble Sobol's second dimension. Destroys `index`.

    Its generator matrix is Pascal's triangle modulo 2. Bit j of the reversed coordinate is the sum modulo 2 of
    C(k, j) i_k over the bits i_k of the index, and C(k, j) is odd where the bits of j are a subset of those of k
    (Lucas): a sum over supersets, done for all bits at once, one power of two at a time.
    """
    return _scramble_second(_sum_supersets(index), key)


def _sum_supersets(index: Words) -> Words:
    """Return Sobol's second dimension, its bits reversed, in place."""
    shifted = np.empty_like(index)
    for shift, mask in _LEVELS:
        np.right_shift(index, np.uint32(shift), out=shifted)
        np.bitwise_and(shifted, np.uint32(mask), out=shifted)
        np.bitwise_xor(index, shifted, out=index)
    return index


def _scramble_second(word: Words, key: Words) -> Words:
    """Owen-scramble Sobol's second dimension, whose bits come reversed. Destroys `word`."""
    return _reverse_bits(_scramble_reversed(word, _hash(key, 0x7F4A7C15)))


def _scramble_reversed(bits: Words, key: Words) -> Words:
    """Owen-scramble bit-reversed numbers in place: every step carries from lower to higher bits only."""
    product = np.empty_like(bits)

    def xor_with_product(factor: int) -> None:
        np.multiply(bits, np.uint32(factor), out=product)
        np.bitwise_xor(bits, product, out=bits)

    xor_with_product(0x3D20ADEA)
    np.add(bits, key, out=bits)
    np.right_shift(key, np.uint32(16), out=product)
    np.bitwise_or(product, np.uint32(1), out=product)
    np.multiply(bits, product, out=bits)
    xor_with_product(0x05526C56)
    xor_with_product(0x53A22864)
    return bits


def _reverse_bits(words: Words) -> Words:
    """Reverse the order of the 32 bits of each word, in place."""
    high = np.empty_like(words)
    for shift, mask in _LEVELS[:3]:
        np.right_shift(words, np.uint32(shift), out=high)
        np.bitwise_and(high, np.uint32(mask), out=high)
        np.bitwise_and(words, np.uint32(mask), out=words)
        np.left_shift(words, np.uint32(shift), out=words)
        np.bitwise_or(words, high, out=words)
    return words.byteswap(inplace=True)


# Of the first samples; a gather takes a fourth of the time of `_reverse_bits`.
_REVERSED = _reverse_bits(np.arange(1 << 12, dtype=np.uint32))


# Of each pair that is good together with the others, the tables of both coordinates, their bits reversed.
_JOINED = tuple(
    (tables, _sum_supersets(tables.copy()))
    for tables in map(make_tables, (tuple(1 << bit for bit in range(32)), *MIXING))
)


def _reverse_samples(sample: Words) -> Words:
    """Return the numbers () or (n,) of samples with their bits reversed."""
    if sample.size and sample.max() < len(_REVERSED):
        return _REVERSED.take(sample)
    return _reverse_bits(sample.copy())


def split_numbers(number: Words) -> tuple[Words, Words]:
    """Return which sample of which replication the samples of some numbers (n,) are: replications take turns."""
    return np.divmod(number, np.uint32(REPLICATIONS))


def join_numbers(sample: int | Words, replication: int | Words) -> Words:
    """Return the number () or (n,) of a sample of a replication: the inverse of `split_numbers`."""
    return np.asarray(sample, np.uint32) * np.uint32(REPLICATIONS) + np.asarray(replication, np.uint32)


def _hash_pixels(pixel: Words, dimension: int, seed: int, replication: int | Words) -> Words:
    """Return one well-mixed key per pixel. Two numbers enter, so that no two streams are shifts of each other."""
    first, second = _stream_numbers(dimension, seed)
    key = np.bitwise_xor(pixel, np.uint32(first))
    shifted = np.right_shift(key, np.uint32(16))
    np.bitwise_xor(key, shifted, out=key)
    np.multiply(key, np.uint32(0x7FEB352D), out=key)
    np.add(key, np.uint32(second), out=key)
    np.add(key, np.multiply(replication, np.uint32(REPLICATION_STEP), dtype=np.uint32), out=key)
    np.right_shift(key, np.uint32(15), out=shifted)
    np.bitwise_xor(key, shifted, out=key)
    np.multiply(key, np.uint32(0x846CA68B), out=key)
    np.right_shift(key, np.uint32(16), out=shifted)
    return np.bitwise_xor(key, shifted, out=key)


def _hash(key: Words, number: int) -> Words:
    """Return a key derived from `key`, another for every number."""
    mixed = np.bitwise_xor(key, np.uint32(number))
    np.multiply(mixed, np.uint32(0x7FEB352D), out=mixed)
    np.bitwise_xor(mixed, np.right_shift(mixed, np.uint32(15)), out=mixed)
    np.multiply(mixed, np.uint32(0x846CA68B), out=mixed)
    return np.bitwise_xor(mixed, np.right_shift(mixed, np.uint32(16)), out=mixed)


@lru_cache(maxsize=1024)
def _stream_numbers(dimension: int, seed: int) -> tuple[int, int]:
    """Mix (dimension, seed) into two 32-bit numbers (the finaliser of SplitMix64, Steele, Lea and Flood 2014)."""
    mask = 2**64 - 1
    word = ((seed << 32) + dimension + 1) * 0x9E3779B97F4A7C15 & mask
    word = (word ^ (word >> 30)) * 0xBF58476D1CE4E5B9 & mask
    word = (word ^ (word >> 27)) * 0x94D049BB133111EB & mask
    word ^= word >> 31
    return word & 0xFFFFFFFF, word >> 32


def _to_unit(words: Words) -> Floats:
    return np.multiply(words, UNIT_PER_WORD, dtype=np.float64)
