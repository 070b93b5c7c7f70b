"""Light in media that vary along a ray: collisions with a density that is bounded, most of which are with nothing.

Rays collide at a rate m, the bound of where they are (`majorants`). At a collision with extinction x, of it scattering
s, and emission e, light of a weight w is scattered with a probability p, or goes on; then it weighs

    w s / (m p)   or   w (m - x) / (m (1 - p)),   and in any case it has met  w e / m.

That holds for any p, and for any m > 0, even where x is larger: then weights change their sign, and there is more
noise. p is the share that scattering has of both, in the size of their light. What gets through a stretch is the
product of (m - x) / m (ratio tracking).

References
----------
E. Woodcock et al., 1965: null collisions. M. Galtier et al., "Integral formulation of null-collision Monte Carlo
    algorithms", 2013: weights for any bound.
P. Kutz et al., "Spectral and Decomposition Tracking", SIGGRAPH 2017: channels.
J. Novak et al., "Residual Ratio Tracking", SIGGRAPH Asia 2014: ratio tracking.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from raytracer.arrays.rows import largest_column, mean_column
from raytracer.arrays.types import Booleans, Colors, Indices, Integers, Numbers, Vectors
from raytracer.media.majorants import Majorants, find_local
from raytracer.media.mixtures import Mixture
from raytracer.sampling.streams import Noise, draw

# The sums of media (n, d) at points (n, 3).
SumMedia = Callable[[Integers, Vectors], Mixture]
# A ray takes so many steps at most, from cell to cell or to a collision: an error of rounding must not hold it.
MOST_STEPS = 1 << 14
# What weighs less than this goes on by chance.
LIGHT_WEIGHT = 0.05
# Numbers of a step: how far, what happens, whether it goes on.
NUMBERS_OF_STEP = 3


@dataclass(frozen=True, eq=False, slots=True)
class Stretches:
    """n stretches of rays, and what they lead through.

    inside : (n, d) int32, numbers of media
    origin, direction : (n, 3) float64, metres and unit; start, end : (n,) metres along the rays
    noise : (n,) streams of random numbers
    """

    inside: Integers
    origin: Vectors
    direction: Vectors
    start: Numbers
    end: Numbers
    noise: Noise

    def __len__(self) -> int:
        return len(self.start)

    def select(self, rows: Indices) -> Stretches:
        """Return some of the stretches."""
        return Stretches(*(getattr(self, name)[rows] for name in Stretches.__slots__))

    def find_points(self, distance: Numbers) -> Vectors:
        """Return the points (n, 3) at distances (n,) along the rays."""
        return self.origin + distance[:, np.newaxis] * self.direction


@dataclass(frozen=True, eq=False, slots=True)
class Tracked:
    """How light gets along n stretches.

    distance : (n,) float64, where it is scattered, or the end
    scattered : (n,) bool
    weight : (n, 3) float64, what it counts from there
    emission : (n, 3) float64, what it has met, W / (m^2 sr)
    """

    distance: Numbers
    scattered: Booleans
    weight: Colors
    emission: Colors


def track(
    majorants: Majorants, sum_media: SumMedia, stretches: Stretches, throughput: Colors, scatters: Booleans
) -> Tracked:
    """Follow light along stretches, to where it is scattered or to the end.

    throughput : (n, 3) what light counts at the start, by which channels are weighed
    scatters : (n,) bool, False for what gets through or is lost
    """
    count = len(stretches)
    result = Tracked(stretches.start.copy(), np.zeros(count, np.bool_), np.ones((count, 3)), np.zeros((count, 3)))
    going = np.flatnonzero(stretches.end > stretches.start)
    for number in range(0, NUMBERS_OF_STEP * MOST_STEPS, NUMBERS_OF_STEP):
        if not len(going):
            break
        part = stretches.select(going)
        rate, collides, result.distance[going] = _step(majorants, part, result.distance[going], number)
        rows = going[collides]
        if len(rows):
            mixture = sum_media(part.inside[collides], part.select(collides).find_points(result.distance[rows]))
            _collide(
                result, rows, rate[collides], mixture, throughput[rows], scatters[rows], part.noise[collides], number
            )
        goes_on = (result.distance[going] < part.end) & ~result.scattered[going] & result.weight[going].any(axis=1)
        going = going[goes_on]
    return result


def _step(majorants: Majorants, part: Stretches, at: Numbers, number: int) -> tuple[Numbers, Indices, Numbers]:
    """Return the bounds (k,), which of the rays collide, and where each goes to: a collision, or its next cell."""
    rate, end = find_local(majorants, part.inside, part.origin, part.direction, at)
    end = np.minimum(np.maximum(end, np.nextafter(at, np.inf)), part.end)
    free = -np.log1p(-draw(part.noise, number))
    target = at + np.divide(free, rate, out=np.full_like(free, np.inf), where=rate > 0)
    return rate, np.flatnonzero(target < end), np.minimum(target, end)


def _collide(
    result: Tracked,
    rows: Indices,
    rate: Numbers,
    mixture: Mixture,
    throughput: Colors,
    scatters: Booleans,
    noise: Noise,
    number: int,
) -> None:
    """Let some of the rays collide."""
    weight, rate = result.weight[rows], rate[:, np.newaxis]
    result.emission[rows] += weight * mixture.emission / rate
    scattered, passed = weight * mixture.scattering / rate, weight * (rate - mixture.extinction) / rate
    chosen, other = (mean_column(np.abs(throughput * part)) for part in (scattered, passed))
    chosen = np.where(scatters, chosen, 0.0)
    probability = np.divide(chosen, chosen + other, out=np.zeros_like(chosen), where=chosen + other > 0)
    is_scattered = draw(noise, number + 1) < probability
    share = np.where(is_scattered, probability, 1.0 - probability)[:, np.newaxis]
    new = np.where(is_scattered[:, np.newaxis], scattered, passed)
    new = np.divide(new, share, out=np.zeros_like(new), where=share > 0)
    result.scattered[rows] = is_scattered
    result.weight[rows] = np.where(is_scattered[:, np.newaxis], new, _play_roulette(new, draw(noise, number + 2)))


def _play_roulette(weight: Colors, chance: Numbers) -> Colors:
    """Return weights (n, 3) of which those that are light have become 0, or heavier."""
    largest = largest_column(np.abs(weight))
    survival = np.minimum(largest / LIGHT_WEIGHT, 1.0)
    factor = np.divide(1.0, survival, out=np.zeros_like(survival), where=chance < survival)
    return weight * factor[:, np.newaxis]
