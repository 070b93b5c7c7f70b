"""How far two pictures are apart: errors for numbers, a statistical test for noise.

A picture is an (h, w, c) array. Two renders of the same scene differ by noise even where both are right, so images are
compared as *batches*, (k, h, w, c): k independent renders of each side, whose spread says how much noise to expect.
FLIP, the perceived difference, is in `flip.py`.

References
----------
Rousselle, Knaus, Zwicker, "Adaptive Sampling and Reconstruction using Greedy Error Minimization", 2011 (relative MSE).
Subr and Arvo, "Statistical Hypothesis Testing for Assessing Monte Carlo Estimators: Applications to Image Synthesis",
2007, and the render tests of Mitsuba 3 (a test per pixel, Sidak's correction, 99.75% of pixels have to pass).
Abramowitz and Stegun, "Handbook of Mathematical Functions", 26.7.3-4 (Student's t in closed form).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans

Floats = NDArray[np.floating]


# Keeps the relative error finite where the reference is black (Rousselle et al. 2011, section 4).
RELATIVE_MSE_OFFSET = 0.01


TILE = 16


# Probability that the test rejects a picture whose expected values are equal.
SIGNIFICANCE = 0.01


# Pixels around a pixel whose variance speaks for it too, see `pool_variance`.
POOL = 5


# Cycles shades in float32; a path's value has been rounded about so many times.
FLOAT32_OPERATIONS = 32


FLOAT32_UNIT = 2.0**-24


def float32_slack(operations: int) -> float:
    """Return the relative error of so many float32 operations, gamma(n) = n u / (1 - n u): below it nothing is said."""
    return operations * FLOAT32_UNIT / (1 - operations * FLOAT32_UNIT)


def root_mean_square_error(image: Floats, reference: Floats) -> float:
    """Return sqrt(mean((image - reference)^2)) over all pixels and channels."""
    return float(np.sqrt(np.mean(np.square(np.asarray(image, np.float64) - reference))))


def relative_mean_square_error(image: Floats, reference: Floats) -> float:
    """Return mean((image - reference)^2 / (reference^2 + 0.01)) over all pixels and channels."""
    squared = np.square(np.asarray(image, np.float64) - reference)
    return float(np.mean(squared / (np.square(reference) + RELATIVE_MSE_OFFSET)))


def average_tiles(image: Floats, size: int = TILE) -> Floats:
    """Return the mean of each tile of `size` x `size` pixels (smaller at the right and lower border), (th, tw, c)."""
    height, width = image.shape[:2]
    rows, columns = np.arange(0, height, size), np.arange(0, width, size)
    sums = np.add.reduceat(np.add.reduceat(np.asarray(image, np.float64), rows, axis=0), columns, axis=1)
    heights, widths = np.diff(np.append(rows, height)), np.diff(np.append(columns, width))
    return sums / (heights[:, None, None] * widths[None, :, None])


def largest_tile_difference(image: Floats, reference: Floats, size: int = TILE) -> float:
    """Return the largest |difference| between the means of corresponding tiles; noise averages out, bias does not."""
    return float(np.abs(average_tiles(image, size) - average_tiles(reference, size)).max())


class TileDifference(NamedTuple):
    """The largest difference of a tile's mean, in any channel, and how much of such a difference noise explains.

    error : of all tiles' the largest
    noise : standard error of that difference
    bias : the largest share of a tile's level by which its difference exceeds what noise explains: so many standard
        errors as noise alone exceeds anywhere in the picture with a probability of SIGNIFICANCE
    """

    error: float
    noise: float
    bias: float


def average_blocks(batches: Floats, size: int = TILE) -> Floats:
    """Return the tiles of every batch of (k, h, w, c), (k, th, tw, c) float64."""
    return np.stack([average_tiles(batch, size) for batch in batches])


def measure_level(picture: Floats) -> Floats:
    """Return the mean magnitude of the channels (h, w, 1) of (h, w, c): light may be negative, a level is not."""
    level: Floats = np.abs(np.asarray(picture, np.float64)).mean(axis=-1, keepdims=True)
    return level


def measure_tiles(ours: Floats, theirs: Floats, size: int = TILE) -> TileDifference:
    """Return how the tiles of two sets of batches (k, h, w, c) differ; a tile's level is the mean of its channels."""
    ours, theirs = (average_blocks(side, size) for side in (ours, theirs))
    apart = measure_means(ours, theirs)
    explained = student_quantiles(correct_significance(apart.error.size), apart.degrees) * apart.error
    beyond = np.maximum(apart.difference - explained, 0.0)
    level = np.broadcast_to(measure_level(theirs.mean(axis=0)), beyond.shape)
    share = np.divide(beyond, level, out=np.where(beyond > 0, np.inf, 0.0), where=level > 0)
    largest = np.unravel_index(apart.difference.argmax(), apart.difference.shape)
    return TileDifference(float(apart.difference[largest]), float(apart.error[largest]), float(share.max()))


def student_tail(statistic: Floats, degrees: NDArray[np.integer]) -> Floats:
    """Return P(|T| >= |statistic|) for Student's t with whole `degrees` of freedom of 1 or more.

    With theta = atan(t / sqrt(n)) the probability inside is, for even n,
    sin(theta) (1 + 1/2 cos^2 + (1 3)/(2 4) cos^4 + ... up to cos^(n-2)), and for odd n
    2/pi (theta + sin(theta) (cos + 2/3 cos^3 + (2 4)/(3 5) cos^5 + ... up to cos^(n-2))).
    """
    statistic, degrees = np.broadcast_arrays(np.abs(np.asarray(statistic, np.float64)), degrees)
    tail = np.empty(statistic.shape)
    for count in np.unique(degrees):
        chosen = degrees == count
        angle = np.arctan(statistic[chosen] / np.sqrt(count))
        odd = int(count) % 2
        term = np.cos(angle) if odd else np.ones_like(angle)
        total = np.zeros_like(angle)
        for power in range(odd, int(count) - 1, 2):
            total += term
            term = term * np.cos(angle) ** 2 * (power + 1) / (power + 2)
        inside = np.sin(angle) * total
        tail[chosen] = 1 - (2 / np.pi * (angle + inside) if odd else inside)
    return np.clip(tail, 0.0, 1.0)


def student_quantile(probability: float, degrees: int) -> float:
    """Return t with P(|T| >= t) = probability for Student's t, by halving."""
    low, high = 0.0, 1.0
    while student_tail(np.array(high), np.array(degrees)) > probability:
        high *= 2.0
    while (middle := (low + high) / 2.0) not in (low, high):
        above = student_tail(np.array(middle), np.array(degrees)) > probability
        low, high = (middle, high) if above else (low, middle)
    return high


def student_quantiles(probability: float, degrees: NDArray[np.integer]) -> Floats:
    """Return t with P(|T| >= t) = probability for each of an array of whole `degrees`."""
    values, places = np.unique(degrees, return_inverse=True)
    quantiles = np.array([student_quantile(probability, int(count)) for count in values])
    return quantiles[places].reshape(np.shape(degrees))


class MeanDifference(NamedTuple):
    """How far the means of two sets of batches are apart, (h, w, c) each.

    difference : |mean_a - mean_b|
    error : its standard error, sqrt(s_a^2 / k_a + s_b^2 / k_b)
    degrees : whole, of freedom that the error is estimated with
    """

    difference: Floats
    error: Floats
    degrees: NDArray[np.int64]


def measure_means(ours: Floats, theirs: Floats, pool: int = 1) -> MeanDifference:
    """Return how the means of two sets of batches (k, h, w, c) differ, with Welch's degrees of freedom.

    (v_a + v_b)^2 / (v_a^2 / (k_a - 1) + v_b^2 / (k_b - 1)), v = s^2 / k, rounded down: towards passing. The engines'
    noise differs, and what one of them alone estimates is as uncertain as its own few batches are.

    Parameters
    ----------
    ours, theirs : (k, h, w, c) float, k >= 2 independent estimates each
    pool : side in pixels of the square whose mean variance is taken where it is larger than the pixel's own
    """
    if len(ours) < 2 or len(theirs) < 2:
        raise ValueError(f"measure_means: expected at least 2 batches per side, got {len(ours)} and {len(theirs)}")
    ours, theirs = np.asarray(ours, np.float64), np.asarray(theirs, np.float64)
    spread_ours, spread_theirs = (pool_variance(side.var(axis=0, ddof=1), pool) / len(side) for side in (ours, theirs))
    spread = spread_ours + spread_theirs
    share = np.divide(spread_ours, spread, out=np.full_like(spread, 0.5), where=spread > 0)
    degrees = 1 / (share**2 / (len(ours) - 1) + (1 - share) ** 2 / (len(theirs) - 1))
    difference = np.abs(ours.mean(axis=0) - theirs.mean(axis=0))
    return MeanDifference(difference, np.sqrt(spread), np.maximum(degrees, 1).astype(np.int64))


def compare_means(ours: Floats, theirs: Floats, slack: Floats | float = 0.0, pool: int = 1) -> Floats:
    """Return the p-value, per pixel and channel, of two sets of batches having expected values within `slack`.

    Welch's test: t = max(|mean_a - mean_b| - slack, 0) / error. With many batches it is the z-test of Mitsuba 3; with
    few, the estimated variance is itself uncertain; this allows for it.

    Parameters
    ----------
    ours, theirs, pool : as in `measure_means`
    slack : (h, w, c) or scalar, difference of the means that does not count

    Returns
    -------
    (h, w, c) float64; 1 where the means agree within slack, 0 where they differ and nothing near varies
    """
    apart = measure_means(ours, theirs, pool)
    excess = np.maximum(apart.difference - slack, 0.0)
    varies = apart.error > 0
    statistic = np.divide(excess, apart.error, out=np.zeros_like(excess), where=varies)
    return np.where(varies, student_tail(statistic, apart.degrees), (excess == 0).astype(np.float64))


def pool_variance(variance: Floats, side: int) -> Floats:
    """Return the larger of each pixel's variance and its mean over `side` x `side` pixels around, (h, w, c).

    Stratified samples miss a rare event, a sliver of light in a pixel or one more choice of a dim light, in all batches
    or in none, and the spread says 0. The neighbours meet the same event at other times.
    """
    reach = side // 2
    height, width = variance.shape[:2]
    padded = np.pad(variance, ((reach, reach), (reach, reach), (0, 0)), mode="symmetric")
    rows = np.sum([padded[row : row + height] for row in range(side)], axis=0)
    total = np.sum([rows[:, column : column + width] for column in range(side)], axis=0)
    return np.maximum(variance, total / side**2)


def correct_significance(tests: int, significance: float = SIGNIFICANCE) -> float:
    """Return Sidak's level for one of `tests` tests: 1 - (1 - significance)^(1 / tests)."""
    return float(-np.expm1(np.log1p(-significance) / tests))


def find_failing(
    ours: Floats, theirs: Floats, summed: int = 0, pool: int = 1, allowed: Floats | float = 0.0
) -> Booleans:
    """Return (h, w): pixels (or tiles) of which a channel differs by more than noise and float32 rounding explain.

    Parameters
    ----------
    ours, theirs : (k, h, w, c) float, k independent renders each
    summed : samples that were added up in float32 in each pixel
    pool : as in `compare_means`
    allowed : (h, w, c) or scalar, difference that does not count, besides that of rounding
    """
    p_value = compare_means(ours, theirs, measure_slack(ours, theirs, summed) + allowed, pool)
    return (p_value < correct_significance(p_value.size)).any(axis=-1)


def measure_slack(ours: Floats, theirs: Floats, summed: int = 0) -> Floats:
    """Return (h, w, c): the difference that float32 rounding explains, of values of two sets of batches (k, h, w, c)
    in which `summed` samples were added up."""
    scale = np.maximum(np.abs(ours).max(axis=0), np.abs(theirs).max(axis=0))
    slack: Floats = float32_slack(FLOAT32_OPERATIONS + summed) * np.asarray(scale, np.float64)
    return slack


def share_failing_pixels(ours: Floats, theirs: Floats, summed: int = 0) -> float:
    """Return the share of pixels that fail the test; Mitsuba 3's bar is 0.0025."""
    return float(find_failing(ours, theirs, summed, POOL).mean())


def share_failing_tiles(ours: Floats, theirs: Floats, summed: int = 0, size: int = TILE) -> float:
    """Return the share of tiles that fail: hundreds of pixels averaged, a bias far below the noise of one shows."""
    tiles = [average_blocks(side, size) for side in (ours, theirs)]
    return float(find_failing(tiles[0], tiles[1], summed).mean())
