"""Bounces: of which kinds they are, how many of each a path may take, and which paths are cut short by chance.

A bounce is reflection or transmission, and diffuse, glossy or singular (by a perfect mirror or clear glass); what
passes straight through a transparent surface is none. A path that has used up its bounces still sees what shines at its
end, for light sampling leaves it a share of that.
Imports `rays`, `settings`, `sites`.

References
----------
Blender, intern/cycles/kernel/integrator/path_state.h: which bounces count as what, and when paths end.
J. Arvo, D. Kirk, "Particle Transport and Image Synthesis", SIGGRAPH 1990: Russian roulette.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.rays import Booleans, Floats
from raytracer.rows import sum_columns
from raytracer.settings import Settings

Kinds = NDArray[np.uint8]
Counts = NDArray[np.int32]

# The bits of a kind. A reflection lacks TRANSMITTED, and is DIFFUSE or GLOSSY; what is SINGULAR is GLOSSY as well.
STRAIGHT, DIFFUSE, GLOSSY, SINGULAR, TRANSMITTED = 0, 1, 2, 4, 8
# Counts (n, 3) of bounces: diffuse reflections, glossy reflections, transmissions of any kind.
COUNTED = ("diffuse", "glossy", "transmission")
# The column of each kind.
COLUMN_OF_KIND = np.array([2 if kind & TRANSMITTED else 0 if kind & DIFFUSE else 1 for kind in range(16)])

# So many bounces of a path are not left to chance.
CERTAIN_BOUNCES = 1


def count_bounces(counts: Counts, kind: Kinds) -> Counts:
    """Return the counts (n, 3) of paths after a bounce of each `kind` (n,); straight passages count nowhere."""
    counts = counts.copy()
    rows = np.flatnonzero(kind)
    counts[rows, COLUMN_OF_KIND[kind[rows]]] += 1
    return counts


def find_ended(counts: Counts, settings: Settings) -> Booleans:
    """Return (n,) True for paths that have taken one bounce more than any limit allows: they only see what shines."""
    ended: Booleans = sum_columns(counts) > settings.max_bounces
    for column, name in enumerate(COUNTED):
        ended |= counts[:, column] > getattr(settings, f"{name}_bounces")
    return ended


def survival_probability(throughput: Floats) -> Floats:
    """Return the probability (n,) with which paths of a throughput (n, 3) shall go on.

    The root of the brightest channel, as in Cycles: what a picture shows is nearer to even in the root of light.
    """
    red, green, blue = throughput.T
    return np.minimum(np.sqrt(np.maximum(np.maximum(red, green), blue)), 1.0)


def describe_kinds(kind: Kinds, counts: Counts) -> dict[str, Floats]:
    """Return what the Light Path node tells of rays of each `kind` (n,), as 0 or 1, and depths; all (n,) float64."""
    transmitted = (kind & TRANSMITTED) > 0
    flags = {
        "camera": kind == STRAIGHT,
        "diffuse": (kind & DIFFUSE) > 0,
        "glossy": (kind & GLOSSY) > 0,
        "singular": (kind & SINGULAR) > 0,
        "reflection": (kind != STRAIGHT) & ~transmitted,
        "transmission": transmitted,
        "depth": sum_columns(counts),
        **{f"{name}_depth": counts[:, column] for column, name in enumerate(COUNTED)},
    }
    return {name: values.astype(np.float64) for name, values in flags.items()}
