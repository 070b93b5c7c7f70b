"""Small light that the camera sees straight, and that none of a picture's samples has met: what the picture lacks.

A small emitter out of focus, or in motion, is spread over many pixels, of which a sample meets it rarely; before one
has, nothing that the picture shows tells of it. So some camera rays, the probes, are aimed at emitters, and traced
beside the samples (`rendering.probes`). Probe j sees the light v_j, and has the weight w_j: as many samples of a sweep
are to be expected in its pixel, for each probe of its kind, that see the like. So

    P_i = sum over the probes j of the pixel i of w_j (v_j - m_i)

is an unbiased estimate of p_i L: of how much too dark the pixel's mean m_i is, if its samples have met nothing of light
L, which a sample meets with probability p_i. Probes belong to SWEEPS sweeps, each an independent estimate; so

    sum_i sum_{s != t} P_is P_it / (S (S - 1))

estimates the sum of the squares of what S sweeps' probes show to be missing, without the bias of P_i^2. (In a moving
scene a sweep shows a few moments, and a sum over pairs of its own would take the emitter for one that stands still.)
With the pairs s = t, over S^2, it is too large by the variance of the estimates; and as k probes that count are at most
(sqrt(k) + 1)^2, with 95%, which tells how uncertain the sums are, (1 + 1 / sqrt(k))^4 times that is an upper end.

What probes see counts where it is MET times as bright as what any sample has met. Where a probe's emitter is hidden, it
sees what the samples see. What mirrors or glass show of emitters is not aimed at: that is left to `unmet`.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.rows import mean_column
from raytracer.arrays.types import Floats, Integers

# What is known of a probe: the sweep, its number in it, the column and row in the full picture, the weight, the color.
FIELDS = 8
# The sweeps that have probes: pairs of different ones are 3/4 of all pairs, and moving scenes are seen at 16 times or
# more, four in each sweep.
SWEEPS = 4
# Light that is as bright as what has been met may differ by so much between its samples.
MET = 2.0


def is_table(probes: object) -> bool:
    """True for what a film can hold of probes."""
    return isinstance(probes, tuple) and len(probes) % FIELDS == 0 and all(type(number) is float for number in probes)


def select_sweep(probes: tuple[float, ...], sweep: int) -> tuple[float, ...]:
    """Return the probes of one sweep."""
    if not probes:
        return probes
    table = np.reshape(probes, (-1, FIELDS))
    return tuple(table[table[:, 0] == sweep].ravel().tolist())


def sort_probes(probes: tuple[float, ...]) -> Floats:
    """Return probes (k, FIELDS), whichever block or tile they come from, in one order."""
    table = np.array(probes, dtype=np.float64).reshape(-1, FIELDS)
    return table[np.lexsort(table[:, 3::-1].T)]


def measure_missed(probes: Floats, pixel: Integers, means: Floats, largest: float, samples: int) -> tuple[float, float]:
    """Return the sum, over pixels, of the squares of the light that they lack, the mean of the channels: an estimate
    without bias, and an upper end.

    Parameters
    ----------
    probes : (k, FIELDS), of `sort_probes`
    pixel : (k,) where each is in the film
    means : (k, 3), what the film shows there
    largest : by how much a sample stands out of its pixel, the most of all
    samples : finished sweeps of the film

    Examples
    --------
    >>> probes = np.array([[0, 0, 0, 0, 0.1, 9, 9, 9], [1, 0, 0, 0, 0.1, 9, 9, 9]], dtype=float)
    >>> dark, pixel = np.zeros((2, 3)), np.zeros(2, int)
    >>> [round(square, 2) for square in measure_missed(probes, pixel, dark, largest=1.0, samples=2)]
    [0.81, 6.88]
    >>> measure_missed(probes, pixel, dark, largest=5.0, samples=2)
    (0.0, 0.0)
    """
    sweeps = min(samples, SWEEPS)
    excess = probes[:, 5:] - means
    rows = np.flatnonzero((mean_column(excess) > MET * largest) & (probes[:, 0] < sweeps))
    if sweeps < 2 or not len(rows):
        return 0.0, 0.0
    places, place = np.unique(pixel[rows], return_inverse=True)
    cell = place * sweeps + probes[rows, 0].astype(np.int64)
    pairs, squares = 0.0, 0.0
    for values in (excess[rows] * probes[rows, 4:5] / 3.0**0.5).T:
        lacking = np.bincount(cell, values, len(places) * sweeps).reshape(-1, sweeps)  # (pixels, sweeps)
        total = lacking.sum(axis=1)
        own = float((lacking * lacking).sum())
        squares += own
        pairs += float((total * total).sum()) - own
    if not np.isfinite(pairs + squares):
        return np.inf, np.inf
    pairs = max(pairs, 0.0)
    upper = (pairs + squares) / sweeps**2 * (1.0 + len(rows) ** -0.5) ** 4
    return pairs / (sweeps * (sweeps - 1)), upper
