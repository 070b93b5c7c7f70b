"""Samples until a difference would be found: how many more batches of how many samples, and what is done with the old.

The noise of a mean of n independent samples falls as n^-1/2, so the noise of a first look says how many are needed
(Stein 1945, see `verdict`); the prediction is as good as a spread of few batches is, so there are several looks. Every
look may be a false alarm: of `LOOKS` looks each has Sidak's part of the probability.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import metrics
from .rendering import Rendering

LOOKS = 6
LOOK_SIGNIFICANCE = metrics.correct_significance(LOOKS)
# The samples grow by so much at once at most.
GROWTH = 8
# Every batch is a render of its own, with its start, so old batches are merged rather than to become more than these.
MOST_BATCHES = 32


class Plan(NamedTuple):
    """What to render next: `batches` of `samples` each; so many old batches become one, which `merged` says."""

    samples: int
    batches: int
    merged: int


def plan_batches(samples: int, batches: int, shortage: float, most: int) -> Plan | None:
    """Return what to add to `batches` of `samples` each, or None at the end of what is allowed.

    Parameters
    ----------
    shortage : times the samples that are there, as many as are needed
    most : samples in all batches together
    """
    wanted = min(samples * batches * min(shortage, GROWTH), most)
    merged = 1
    while wanted > MOST_BATCHES * samples * merged and batches % (2 * merged) == 0:
        merged *= 2
    more = math.ceil(wanted / (samples * merged)) - batches // merged
    return Plan(samples * merged, more, merged) if more > 0 and wanted > samples * batches else None


def join_renderings(before: Rendering, more: Rendering, merged: int) -> Rendering:
    """Return both as one, after the means of every `merged` batches (k, h, w, c) of `before` have taken their place."""
    passes = {name: join_batches(values, more.passes[name], merged) for name, values in before.passes.items()}
    return Rendering(passes, before.seconds + more.seconds)


def join_batches(before: NDArray, more: NDArray, merged: int) -> NDArray:
    """Return the batches of both (k, h, w, c), those before merged."""
    groups = before.reshape(-1, merged, *before.shape[1:])
    return np.concatenate([groups.mean(axis=1, dtype=np.float64).astype(before.dtype), more])
