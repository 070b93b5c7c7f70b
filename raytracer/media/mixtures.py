"""Media at points: what they absorb, scatter and emit there, and the phase functions that they mix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import mean_column, sum_columns
from raytracer.arrays.types import Colors, Floats, Numbers, Vectors
from raytracer.casting.rays import select_rows
from raytracer.lecture import dot
from raytracer.media.phases import evaluate_phase, sample_phase, turn_directions


@dataclass(frozen=True, eq=False, slots=True)
class Lobes:
    """The phase functions of n points, m each.

    kind : (n, m) int8; first, second : (n, m) float64, as of `phases.evaluate_phase`
    weight : (n, m, 3) float64, per metre, of the light that each scatters
    """

    kind: NDArray[np.int8]
    first: Floats
    second: Floats
    weight: Floats

    def select(self, rows: Any) -> Lobes:
        """Return those of some of the points: index or boolean array."""
        return select_rows(self, rows)


@dataclass(frozen=True, eq=False, slots=True)
class Mixture:
    """The media at n points.

    extinction, scattering : (n, 3) float64, per metre
    emission : (n, 3) float64, W / (m^3 sr)
    lobes : how they scatter
    """

    extinction: Colors
    scattering: Colors
    emission: Colors
    lobes: Lobes

    def __len__(self) -> int:
        return len(self.extinction)

    def select(self, rows: Any) -> Mixture:
        """Return those at some of the points: index or boolean array."""
        return Mixture(self.extinction[rows], self.scattering[rows], self.emission[rows], self.lobes.select(rows))

    def put(self, rows: Any, other: Mixture) -> None:
        """Overwrite those at some of the points."""
        for name in ("extinction", "scattering", "emission"):
            getattr(self, name)[rows] = getattr(other, name)
        for name in Lobes.__slots__:
            getattr(self.lobes, name)[rows] = getattr(other.lobes, name)


def make_nothing(count: int, columns: int) -> Mixture:
    """Return the mixture of n points where there is nothing, with room for some lobes."""
    size = count, columns
    lobes = Lobes(np.zeros(size, np.int8), np.zeros(size), np.zeros(size), np.zeros((*size, 3)))
    return Mixture(np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3)), lobes)


def add_mixtures(parts: Sequence[Mixture]) -> Mixture:
    """Return the sums of mixtures of n points each, with the lobes of all."""
    if len(parts) == 1:
        return parts[0]
    names = Lobes.__slots__
    lobes = Lobes(*(np.concatenate([getattr(part.lobes, name) for part in parts], axis=1) for name in names))
    total = parts[0]
    for part in parts[1:]:
        extinction, scattering = total.extinction + part.extinction, total.scattering + part.scattering
        total = Mixture(extinction, scattering, total.emission + part.emission, lobes)
    return total


@dataclass(frozen=True, eq=False, slots=True)
class PhaseSample:
    """Where light is scattered to at n points.

    direction : (n, 3) float64, unit
    value : (n, 3) float64, what is scattered there of all that is scattered, by channel, over the density
    density : (n,) float64, per solid angle
    """

    direction: Vectors
    value: Colors
    density: Numbers


def evaluate_lobes(lobes: Lobes, before: Vectors, after: Vectors) -> tuple[Colors, Numbers]:
    """Return the phase functions of n points by channel, (n, 3), and the density (n,) that `sample_lobes` has.

    sum_m w_m p_m / sum_m w_m with the weights w of a channel; the density has those of their mean.

    before, after : (n, 3) float64, unit, the ways that light goes (the ray's, and the scattered one's)
    """
    cosine = np.clip(dot(before, after), -1.0, 1.0)
    phase = np.zeros(lobes.kind.shape)
    for column in range(lobes.kind.shape[1]):
        used = np.flatnonzero(lobes.weight[:, column].any(axis=1))
        which = lobes.kind[used, column], lobes.first[used, column], lobes.second[used, column]
        phase[used, column] = evaluate_phase(*which, cosine[used])
    total = lobes.weight.sum(axis=1)
    value = np.divide(
        (lobes.weight * phase[:, :, np.newaxis]).sum(axis=1), total, out=np.zeros_like(total), where=total > 0
    )
    return value, (_share_lobes(lobes) * phase).sum(axis=1)


def sample_lobes(lobes: Lobes, before: Vectors, choice: Numbers, pair: Floats) -> PhaseSample:
    """Return directions that light is scattered to: by one lobe, chosen in proportion to its weight.

    choice, pair : (n,), (n, 2) uniform numbers
    """
    upper = np.cumsum(_share_lobes(lobes), axis=1)
    column = np.minimum((choice[:, np.newaxis] * upper[:, -1:] >= upper).sum(axis=1), lobes.kind.shape[1] - 1)
    rows = np.arange(len(column))
    which = lobes.kind[rows, column], lobes.first[rows, column], lobes.second[rows, column]
    after = turn_directions(before, sample_phase(*which, pair[:, 0]), pair[:, 1])
    value, density = evaluate_lobes(lobes, before, after)
    share = np.divide(value, density[:, np.newaxis], out=np.zeros_like(value), where=density[:, np.newaxis] > 0)
    return PhaseSample(after, share, density)


def _share_lobes(lobes: Lobes) -> Floats:
    """Return the probabilities (n, m) of lobes; 0 where nothing is scattered."""
    count, columns = lobes.kind.shape
    weight = mean_column(lobes.weight.reshape(count * columns, 3)).reshape(count, columns)
    total = sum_columns(weight)[:, np.newaxis]
    return np.divide(weight, total, out=np.zeros_like(weight), where=total > 0)
