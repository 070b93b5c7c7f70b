"""Adaptive sampling: which pixels get more samples, decided so that the picture stays right on average.

A picture whose samples follow what they have seen themselves is too dark: a pixel that has met no bright path yet is
left alone, one that has is sampled till it is average again. So after the pilot, the first sweeps over the picture,

    the samples of one replication follow the pilot of the other alone;
    a pixel is the mean of its replications' means, whatever their numbers of samples.

Then no number of samples, and no weight, depends on a value that it counts: the mean is unbiased by construction.

For the least sum of v / n, where a sample of a pixel has the variance v and the cost c, and the sum of n c is given, n
is in proportion to sqrt(v / c) (Neyman). Neighbors share what they know of v and c: noise comes in patches and along
edges. A pilot of P samples knows v little better than to 1 / sqrt(P), and rare bright paths not at all. So its share
s = 1 - 2 / sqrt(P) alone of the samples follows it, at most, and the rest is even: what was wrongly thought quiet is
not forgotten.

Where noise comes from rare bright paths, the pixels that have met one say nothing of those that will. Whether a pilot
can tell is told by itself: of its two parts, the first and the last samples, each says what it would give to a pixel,
w, and the other what noise v the pixel has. The sum of v / (1 - s + s w) over pixels and both parts is without bias,
over pilots, what the noise will be; the share s is the one of a few for which that is least, and 0, all even, where not
even LEAST_GAIN is promised.

Parts of time, not of the picture: what neighbors alone can say of a pixel is nothing where noise is a pixel wide, as of
edges in mirrors, although the pixel's own samples know it well. Where one replication is told to follow its pilot and
the other to stay even, the half that stays even holds the gain below 2, whatever the other gains.

References
----------
J. Neyman, "On the Two Different Aspects of the Representative Method", 1934: stratified sampling at least variance.
M. Stone, "Cross-Validatory Choice and Assessment of Statistical Predictions", 1974: a part foretells the other.
D. Kirk, J. Arvo, "Unbiased Sampling Techniques for Image Synthesis", SIGGRAPH 1991: the bias, and pilots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from raytracer.arrays.types import Floats, Numbers
from raytracer.film.error import share_with_neighbors

# The share of all samples that the pilot takes, and the fewest and most of a pixel.
PILOT_SHARE = 0.25
SHORTEST_PILOT = 16
LONGEST_PILOT = 64
# The camera rays of a picture up to which samples stay even: so few are one block, which a pilot makes two of. A block
# takes some 60 to 100 ms whatever its rays, of deep waves with few paths: 36x24 pixels with 64 samples took 1.17 to
# 1.3 times as long, 72x48 with 64 samples 1.05 to 1.2.
ONE_BLOCK = 1 << 18
# Times the average number of samples, beyond which a pixel gets no more.
LARGEST_DENSITY = 1000.0
# Parts of the largest share that are tried, and how many times less variance the best must promise: a sample of a list
# takes 1.0 to 1.05 times as long as one of a whole sweep, 1.15 times where pixels of those share points of lights, and
# uneven numbers of samples lose some of what makes Sobol's even ones good (a tenth where mirrors face each other).
# With 1.125, mirrors that face each other gain 1.23 in efficiency instead of 1.18, and the Cornell box 1.03 of 1.02.
PARTS_OF_SHARE = np.array([0.25, 0.5, 0.75, 1.0])
LEAST_GAIN = 1.25


@dataclass(frozen=True)
class Scatter:
    """What one replication's pilot knows of n pixels.

    variance : (n,) of one sample; cost : (n,) mean number of casts along its path
    """

    variance: Numbers
    cost: Numbers


def choose_pilot(samples: int, pixels: int) -> int:
    """Return the sweeps of the pilot for so many samples of each pixel; 0 where they are too few to be worth it.

    pixels : of the whole picture, so that its tiles have the same pilot

    Examples
    --------
    >>> [choose_pilot(samples, 1920 * 1080) for samples in (31, 32, 100, 4096)], choose_pilot(100, 48 * 32)
    ([0, 16, 24, 64], 0)
    """
    if samples < 2 * SHORTEST_PILOT or samples * pixels <= ONE_BLOCK:
        return 0
    return int(min(max(PILOT_SHARE * samples, SHORTEST_PILOT), LONGEST_PILOT)) // 2 * 2


def measure_scatter(sums: Floats, count: int) -> Scatter:
    """Return the Scatter of sums (n, 3) over `count` samples: of their values, their squares, and their lengths.

    A path costs a cast at least, also where the lens of a panorama lets none through.
    """
    value, square, length = sums.T
    with np.errstate(invalid="ignore", over="ignore"):  # of what is infinite nothing is known
        variance = np.maximum(square - value * value / count, 0.0) / (count - 1)
    return Scatter(variance, np.maximum(length / count, 1.0))


def allocate(scatter: Scatter, parts: Sequence[Scatter], shape: tuple[int, int], pilot: int) -> Numbers:
    """Return (n,) how many samples pixels of the other replication get, over the average, at the cost of even ones.

    1 - s + s w, where w is as sqrt(v / c) and its cost, the sum of w c, is the sum of c.

    Parameters
    ----------
    scatter : of one replication
    parts : the same by its first samples alone, and by its last
    shape : (h, w) of the picture
    pilot : its sweeps, of both replications
    """
    variance = np.concatenate([part.variance for part in parts])
    foretold = np.concatenate([weigh_cost(part, shape) for part in parts[::-1]])
    share = choose_share(variance, foretold, 1.0 - 2.0 / np.sqrt(pilot))
    if not share:
        return np.ones(len(scatter.variance))
    return np.minimum(1.0 - share + share * weigh_cost(scatter, shape), LARGEST_DENSITY)


def weigh_cost(scatter: Scatter, shape: tuple[int, int]) -> Numbers:
    """Return (n,) sqrt(v / c), of what neighbors share of v and c, scaled to the cost of even samples; nan where
    nothing is known."""
    with np.errstate(invalid="ignore", over="ignore"):
        variance, cost = (share_with_neighbors(values.reshape(shape)) for values in (scatter.variance, scatter.cost))
        wanted = np.sqrt(variance / cost).ravel()
        total = float((wanted * scatter.cost).sum())  # no product: BLAS rounds it in its processor's way
    return wanted * (scatter.cost.sum() / total) if 0.0 < total < np.inf else np.full(len(wanted), np.nan)


def choose_share(variance: Numbers, foretold: Numbers, largest: float) -> float:
    """Return the share s, up to the largest, for which the sum of v / (1 - s + s w) is least; 0 where little is gained.

    variance, foretold : (n,) v of each pixel, and w of samples that v knows nothing of

    Examples
    --------
    >>> choose_share(np.array([1.0, 25.0]), np.array([0.4, 1.6]), 0.5)  # the others tell
    0.5
    >>> choose_share(np.array([1.0, 25.0]), np.array([1.6, 0.4]), 0.5)  # they do not
    0.0
    """
    if not (np.isfinite(variance.sum()) and np.isfinite(foretold).all()):
        return 0.0
    shares = largest * PARTS_OF_SHARE
    gains = [foretell_gain(variance, foretold, share) for share in shares]
    best = int(np.argmax(gains))
    return float(shares[best]) if gains[best] > LEAST_GAIN else 0.0


def foretell_gain(variance: Numbers, foretold: Numbers, share: float) -> float:
    """Return how many times less the sum of v / (1 - s + s w) is than that of v; 1 where there is none."""
    even = float(variance.sum())
    return even / float((variance / (1.0 - share + share * foretold)).sum()) if even else 1.0
