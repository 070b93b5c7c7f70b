"""Adaptive sampling: which pixels get more samples, decided so that the picture stays right on average.

A picture whose samples follow what they have seen themselves is too dark: a pixel that has met no bright path yet is
left alone, one that has is sampled till it is average again. So after the pilot, the first sweeps over the picture,

    the samples of one replication follow the pilot of the other alone;
    a pixel is the mean of its replications' means, whatever their numbers of samples.

Then no number of samples, and no weight, depends on a value that it counts: the mean is unbiased by construction.

For the least sum of v / n, where a sample of a pixel has the variance v and the cost c, and the sum of n c is given, n
is in proportion to sqrt(v / c) (Neyman). Neighbors share what they know of v and c: noise comes in patches and along
edges. A pilot of P samples knows v little better than to 1 / sqrt(P), and rare bright paths not at all. So its share
1 - 2 / sqrt(P) alone of the samples follows it, and the rest is even: what was wrongly thought quiet is not forgotten.

References
----------
J. Neyman, "On the Two Different Aspects of the Representative Method", 1934: stratified sampling at least variance.
D. Kirk, J. Arvo, "Unbiased Sampling Techniques for Image Synthesis", SIGGRAPH 1991: the bias, and pilots.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from raytracer.arrays.types import Floats, Numbers
from raytracer.film.error import share_with_neighbors

# The share of all samples that the pilot takes, and the fewest and most of a pixel.
PILOT_SHARE = 0.25
SHORTEST_PILOT = 16
LONGEST_PILOT = 64
# Times the average number of samples, beyond which a pixel gets no more.
MOST_SAMPLES = 1000.0


@dataclass(frozen=True)
class Scatter:
    """What one replication's pilot knows of n pixels.

    variance : (n,) of one sample; cost : (n,) mean number of casts along its path
    """

    variance: Numbers
    cost: Numbers


def measure_pilot(samples: int) -> int:
    """Return the sweeps of the pilot for so many samples of a pixel; 0 where they are too few to be worth it."""
    if samples < 2 * SHORTEST_PILOT:
        return 0
    return int(min(max(PILOT_SHARE * samples, SHORTEST_PILOT), LONGEST_PILOT)) // 2 * 2


def describe_pilot(sums: Floats, count: int) -> Scatter:
    """Return the Scatter of sums (n, 3) over `count` samples: of their values, their squares, and their lengths."""
    value, square, length = sums.T
    variance = np.maximum(square - value * value / count, 0.0) / (count - 1)
    return Scatter(variance, length / count)


def allocate(scatter: Scatter, shape: tuple[int, int], pilot: int) -> Numbers:
    """Return (n,) how many samples pixels of the other replication get, over the average, at the cost of even ones.

    Parameters
    ----------
    scatter : of one replication
    shape : (h, w) of the picture
    pilot : its sweeps, of both replications
    """
    variance, cost = (
        share_with_neighbors(values.reshape(shape)).ravel() for values in (scatter.variance, scatter.cost)
    )
    wanted = np.sqrt(variance / cost)
    total = float((wanted * scatter.cost).sum())  # no product: BLAS rounds it in its processor's way
    if not 0.0 < total < np.inf:
        return np.ones(len(wanted))
    share = 1.0 - 2.0 / np.sqrt(pilot)
    return np.minimum(1.0 - share + share * wanted * (scatter.cost.sum() / total), MOST_SAMPLES)
