"""Do two engines agree, differ, or is there too much noise to tell? Pixels, tiles and the whole picture are judged.

Of every tile, of 16 x 16 pixels, and of the whole picture, the means of both engines are compared channel by channel
with Welch's test. A tile's level is that of the brighter engine. H0: the expected values differ by no more than
`tolerated` = `TOLERATED` `to` of the level; it is rejected where

    |d| > tolerated + q e,    e: standard error of d, q: quantile of Student's t,

so that the bias that is reported, |d| - q e, is a lower bound of the true one. All these tests are one family: of n
tests each has Sidak's level 1 - (1 - 0.01)^(1/n), which keeps the probability of a false alarm anywhere below 1%,
however tiles depend on each other, for normal means (Sidak 1967): those of hundreds of pixels nearly are. A
difference of tolerated + s e, s of `power.find_shift`, would have been found in this comparison, with the e that it has
seen, with a probability of `POWER` or more: that is the smallest difference found, and where it is larger than `to`,
agreement says nothing: the verdict is *undecided*.

Pixels are tested alike, with the variance of their neighbours (`metrics.find_failing`); noise of single pixels is far
from normal, so a share of them, Mitsuba 3's 0.25%, may fail. Passes of the surface, seen through the centres of pixels,
have no noise to speak of.

References
----------
Z. Sidak, "Rectangular Confidence Regions for the Means of Multivariate Normal Distributions", JASA 62, 1967.
C. Stein, "A Two-Sample Test for a Linear Hypothesis Whose Power is Independent of the Variance", 1945: the size of a
sample may follow from the variance that was seen, for normal means do not depend on it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..verdicts import AGREES, DIFFERS, UNDECIDED
from . import metrics
from .metrics import Floats
from .power import find_shifts

# The difference, as a share of the level, that a comparison is to find where nothing else is asked for.
TO = 0.01
# Of that, so much is not counted as a difference. Both engines approximate: what a glossy layer leaves to the diffuse
# one under it comes from tables that are right to 1e-3, and a path meets some such layers.
TOLERATED = 0.25
# The smallest difference found is that of so many pixels or tiles; fireflies sit in the others.
COVERED = 0.95
# A tile is taken to be at least so bright, as a share of the picture: darker ones are black beside it on a screen of
# 8 bits, whose first step above black is 1 / (255 * 12.92) of white.
DARKEST = 1.0 / (255.0 * 12.92)
# So many pixels may fail their test (Mitsuba 3), and so many pixels of a pass may differ: limbs of spheres.
PIXELS_BAR, PASSES_BAR = 0.0025, 0.001


class Scale(NamedTuple):
    """The test of all tiles of one size, with the largest of their differences.

    error, noise : the largest difference of a mean and its standard error
    bias : lower bound of the largest true difference, share of the tile's level; 0 where noise explains all
    detectable : the smallest difference found, share of the level of the tile or of the picture, the larger of both;
        in so many of the tiles as `COVERED`
    row, column : the tile of `bias`
    """

    error: float
    noise: float
    bias: float
    detectable: float
    row: int
    column: int


class Judgement(NamedTuple):
    """What was found of two pictures at three scales.

    to : the difference that was to be found; pixel_share : of pixels that failed; pixel_detectable : as in Scale
    strange : share of pixels that are infinite or no number; they are left out of the rest
    """

    to: float
    strange: float
    pixel_share: float
    pixel_detectable: float
    tile: Scale
    picture: Scale


def judge_pictures(
    ours: Floats, theirs: Floats, to: float = TO, summed: int = 0, significance: float = metrics.SIGNIFICANCE
) -> Judgement:
    """Judge two sets of batches (k, h, w, c) of a picture.

    Parameters
    ----------
    to : the difference that shall be found, share of the level
    summed : samples that were added up in float32 in each pixel of a batch
    significance : probability that equal pictures are said to differ
    """
    height, width, channels = ours.shape[1:]
    finite = np.isfinite(ours).all(axis=(0, -1)) & np.isfinite(theirs).all(axis=(0, -1))
    ours, theirs = (np.where(finite[..., np.newaxis], side, np.zeros_like(side)) for side in (ours, theirs))
    tiles = -(-height // metrics.TILE) * -(-width // metrics.TILE)
    level = metrics.correct_significance((tiles + 1) * channels, significance)
    tile, picture = (
        judge_tiles(ours, theirs, size, level, TOLERATED * to, summed) for size in (metrics.TILE, max(height, width))
    )
    strange = 1.0 - float(finite.mean())
    return Judgement(to, strange, *judge_pixels(ours, theirs, TOLERATED * to, summed), tile, picture)


class Tested(NamedTuple):
    """The tests of all tiles, (th, tw, c) each: the means' difference, and as shares of a level what Scale has."""

    apart: metrics.MeanDifference
    bias: Floats
    detectable: Floats


def judge_tiles(ours: Floats, theirs: Floats, size: int, level: float, tolerated: float, summed: int) -> Scale:
    """Test the tiles of one size, each channel with a probability of error `level`; return the worst."""
    apart, bias, detectable = find_bias(ours, theirs, size, level, tolerated, summed)
    worst = np.unravel_index(bias.argmax(), bias.shape)
    largest = np.unravel_index(apart.difference.argmax(), apart.difference.shape)
    return Scale(
        float(apart.difference[largest]), float(apart.error[largest]),
        float(bias[worst]), cover(detectable.max(axis=-1)), int(worst[0]), int(worst[1]),
    )  # fmt: skip


def find_bias(ours: Floats, theirs: Floats, size: int, level: float, tolerated: float = 0.0, summed: int = 0) -> Tested:
    """Test the means of all tiles of batches (k, h, w, c), each channel by itself.

    H0, |D| <= tolerated, is rejected where bias = |d| - slack - q e > tolerated, each a share of the tile's level;
    `slack` is what float32 rounding explains. A difference of tolerated + slack + s e is found with POWER.
    """
    ours, theirs = (metrics.average_blocks(side, size) for side in (ours, theirs))
    apart = metrics.measure_means(ours, theirs)
    own = measure_brighter(ours, theirs)
    whole = float(own.mean())
    own = np.maximum(own, DARKEST * whole)
    slack = metrics.measure_slack(ours, theirs, summed)
    explained = slack + metrics.student_quantiles(level, apart.degrees) * apart.error
    found = slack + find_shifts(level, apart.degrees) * apart.error + tolerated * own
    bias = divide_by_level(np.maximum(apart.difference - explained, 0.0), own)
    return Tested(apart, bias, divide_by_level(found, np.maximum(own, whole)))


def measure_brighter(ours: Floats, theirs: Floats) -> Floats:
    """Return the level (h, w, 1) of the brighter of two sets of batches (k, h, w, c)."""
    levels = [metrics.measure_level(side.mean(axis=0, dtype=np.float64)) for side in (ours, theirs)]
    return np.maximum(*levels)


def divide_by_level(value: Floats, level: Floats) -> Floats:
    """Return value / level, and 0 where both are black throughout."""
    level = np.broadcast_to(level, value.shape)
    return np.divide(value, level, out=np.zeros_like(value), where=level > 0)


def cover(detectable: Floats) -> float:
    """Return the value that COVERED of an array do not exceed."""
    return float(np.quantile(detectable, COVERED, method="higher"))


def judge_pixels(ours: Floats, theirs: Floats, tolerated: float, summed: int) -> tuple[float, float]:
    """Return the share of pixels that differ, and the smallest difference that the test of one finds, as in Scale."""
    own = measure_brighter(ours, theirs)
    whole = float(own.mean())
    allowed = tolerated * np.maximum(own, DARKEST * whole)
    failing = metrics.find_failing(ours, theirs, summed, metrics.POOL, allowed)
    apart = metrics.measure_means(ours, theirs, metrics.POOL)
    shifts = find_shifts(metrics.correct_significance(apart.error.size), apart.degrees)
    found = metrics.measure_slack(ours, theirs, summed) + shifts * apart.error + allowed
    return float(failing.mean()), cover(divide_by_level(found, np.maximum(own, whole)).max(axis=-1))


def find_differences(judgement: Judgement, passes: Mapping[str, float]) -> list[str]:
    """Return what differs, in words; passes : name to the share of differing pixels.

    A tile is said by the pixel of its upper left corner, counted from that of the picture.
    """
    tolerated = TOLERATED * judgement.to
    found = []
    if judgement.strange:
        found.append(f"{show_share(judgement.strange)} of the pixels are infinite or no number")
    if judgement.picture.bias > tolerated:
        found.append(f"the whole picture is off by {show_share(judgement.picture.bias)} or more")
    if judgement.tile.bias > tolerated:
        left, top = judgement.tile.column * metrics.TILE, judgement.tile.row * metrics.TILE
        found.append(
            f"the tile at ({left}, {top}) from the upper left is off by {show_share(judgement.tile.bias)} or more"
        )
    if judgement.pixel_share > PIXELS_BAR:
        found.append(f"{show_share(judgement.pixel_share)} of the pixels differ by more than noise")
    return found + [
        f"{name} differs in {show_share(share)} of the pixels" for name, share in passes.items() if share > PASSES_BAR
    ]


def decide(judgement: Judgement, passes: Mapping[str, float], samples: int) -> tuple[str, str]:
    """Return the verdict and the reason for it in words.

    Parameters
    ----------
    passes : name to the share of differing pixels
    samples : per pixel, that were taken
    """
    differences = find_differences(judgement, passes)
    if differences:
        return DIFFERS, "; ".join(differences)
    smallest = (
        f"{show_share(judgement.tile.detectable)} in a tile and {show_share(judgement.picture.detectable)} in all"
    )
    if is_powerful(judgement):
        return AGREES, f"a difference of {smallest} would have been found"
    needed = show_count(samples * measure_shortage(judgement))
    hidden = f"noise would hide differences up to {smallest}"
    return UNDECIDED, f"{hidden}; about {needed} samples would find {show_share(judgement.to)}"


def is_powerful(judgement: Judgement) -> bool:
    """Return whether the difference asked for would have been found, in tiles and in the whole picture."""
    return max(judgement.tile.detectable, judgement.picture.detectable) <= judgement.to


def measure_shortage(judgement: Judgement) -> float:
    """Return how many times the samples would find the difference asked for: the noise of n batches falls as n^-1/2."""
    tolerated = TOLERATED * judgement.to
    largest = max(judgement.tile.detectable, judgement.picture.detectable)
    return ((largest - tolerated) / (judgement.to - tolerated)) ** 2


def show_share(share: float) -> str:
    """Return a share as percent, two digits."""
    return f"{100 * share:.2g}%" if share < 1 else f"{100 * share:.0f}%"


def show_count(number: float) -> str:
    """Return a number rounded up to two digits, without exponent."""
    step = 10 ** max(len(str(math.ceil(number))) - 2, 0)
    return str(math.ceil(number / step) * step)
