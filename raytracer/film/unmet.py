"""Light that a picture's samples might have met, and have not: what it can lack.

Samples aim at light, but what a mirror, clear glass or a narrow lobe reflects of it they meet by chance alone, and
where it is small, rarely. Before one has, nothing that the picture shows tells of it. But of samples that come within
NEAR radii of a light (`integrator.near_misses`), one in NEAR^2 meets it, where they lie even around it. So

    of k near misses, k / NEAR^2 were to be expected to meet it, and (sqrt(k) + 1)^2 / NEAR^2 at most, with 95%;
    where that is more than UNMET, and none has met it, it is out of their reach: hidden, or behind. (e^-3 is the chance
    to meet none of 3, the rule of three.)

A pixel of n samples that lacks m meetings with a light of which a sample sees c lacks m c / n.

References
----------
J. A. Hanley, A. Lippman-Hand, "If Nothing Goes Wrong, Is Everything All Right?", 1983: the rule of three.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Floats

# Radii of a light from its middle, within which a path has come near.
NEAR = 10.0
# So many samples may have been expected to meet what none has met, at 95%: -ln 0.05.
UNMET = 3.0
# Near misses are counted by what they would have seen, in steps of a root of 2 from 2^-LOWEST on.
LOWEST, STEPS = 32, 2 * 64
# A light is met where a sample stands out of its pixel by this share of what near misses would have seen, 6 steps: they
# come by way of other surfaces.
MET_STEPS = 6


def count_near_misses(seen: Floats) -> tuple[int, ...]:
    """Return how many samples (n, 1) would have seen how much, of STEPS steps; 0 is none."""
    mantissa, exponent = np.frexp(seen[seen > 0])
    step = 2 * (exponent + LOWEST) + (mantissa >= np.sqrt(0.5))
    return tuple(np.bincount(np.clip(step, 0, STEPS - 1), minlength=STEPS).tolist())


def add_near_misses(first: tuple[int, ...], second: tuple[int, ...]) -> tuple[int, ...]:
    """Return the sums of two counts; () is none."""
    return tuple(a + b for a, b in zip(first, second, strict=True)) if first and second else first or second


def find_unmet(near_misses: tuple[int, ...], largest: float) -> float:
    """Return what all samples together would have seen at most of the brightest light that none has met; 0 without one.

    largest : by how much a sample stands out of its pixel, the most of all

    Examples
    --------
    >>> counts = count_near_misses(np.array([[9.0], [10.0], [0.0]]))
    >>> round(find_unmet(counts, largest=1.0), 2), find_unmet(counts, largest=5.0)
    (0.66, 0.0)
    """
    steps = np.flatnonzero(near_misses)
    if not len(steps):
        return 0.0
    top = int(steps[-1])
    edge = 2.0 ** ((top - 1) / 2 - LOWEST)
    count = sum(near_misses[max(top - MET_STEPS + 1, 0) : top + 1])
    expected = (np.sqrt(count) + 1.0) ** 2 / NEAR**2
    is_met = largest >= edge * 2.0 ** (-MET_STEPS / 2)
    return 0.0 if expected > UNMET or is_met else float(expected) * edge
