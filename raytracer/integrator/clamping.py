"""Fireflies tamed, at the price of light: Cycles' clamping, and its blurring of what rare paths see (Filter Glossy).

Both are off unless the settings ask for them, and a picture that is to be exact has both off. Cycles aims at one
source, chosen with a chance p, and clamps its light l / p to a limit c; what that leaves on average, p min(l / p, c),
is min(l, p c). Here every source is aimed at, and each is clamped to its share p c of the limit, with the chances that
Cycles has without its light tree.

References
----------
Blender, intern/cycles/kernel/film/light_passes.h: film_clamp_light; kernel/integrator/surface_shader.h: blur_pdf.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from raytracer.arrays.rows import sum_columns
from raytracer.arrays.types import Counts, Floats
from raytracer.bsdfs.closures import Lobes, Shading
from raytracer.bsdfs.distributions import Stretch
from raytracer.bsdfs.hair import HairLobes
from raytracer.integrator.settings import Settings

# The limits are means of the three channels; sums are compared.
CHANNELS = 3


# What a path sees is blurred to this roughness (alpha) at most.
LARGEST_BLUR = 0.5


def find_limits(settings: Settings, counts: Counts, aimed: bool) -> Floats:
    """Return (n,) the largest sum of channels that light may add to n paths that have taken `counts` (n, 3) bounces.

    aimed : True for light that the last point aims at, False for light that the path meets, which is direct light, of
        the point before, after one bounce still
    """
    direct, indirect = (limit * CHANNELS if limit > 0 else np.inf for limit in _list_limits(settings))
    return np.where(sum_columns(counts) <= (0 if aimed else 1), direct, indirect)


def _list_limits(settings: Settings) -> tuple[float, float]:
    return settings.clamp_direct, settings.clamp_indirect


def is_clamped(settings: Settings) -> bool:
    """True where any light has a limit."""
    return any(limit > 0 for limit in _list_limits(settings))


def clamp(light: Floats, limit: Floats) -> Floats:
    """Return light (n, 3), dimmed in all channels alike to a sum of sizes of at most `limit` (n,)."""
    total = np.abs(light[:, 0]) + np.abs(light[:, 1]) + np.abs(light[:, 2])
    bright = total > limit
    if not bright.any():
        return light
    share = np.divide(limit, total, out=np.ones_like(total), where=bright)
    return light * share[:, np.newaxis]


def clamp_met(settings: Settings, counts: Counts, light: Floats) -> Floats:
    """Return light (n, 3) that paths have met, after `counts` (n, 3) bounces, within its limits."""
    return clamp(light, find_limits(settings, counts, aimed=False)) if is_clamped(settings) else light


def blur_lobes(shading: Shading, rarest: Floats, filter_glossy: float) -> Shading:
    """Return shading whose lobes are at least as rough as the paths (n,) to them are rare.

    alpha >= sqrt(1 - p / f) / 2, for a path whose least density of a bounce so far is p and a filter f.
    """
    rare = rarest < filter_glossy
    if not shading.lobes or not rare.any():
        return shading
    least = np.zeros(len(rarest))
    least[rare] = LARGEST_BLUR * np.sqrt(1.0 - rarest[rare] / filter_glossy)
    return dataclasses.replace(shading, lobes=tuple(_blur(lobes, least[lobes.hit]) for lobes in shading.lobes))


def _blur(lobes: Lobes, least: Floats) -> Lobes:
    if isinstance(lobes, HairLobes):
        return lobes.blur(least)
    alpha, stretch = np.where(lobes.passes_straight, lobes.alpha, np.maximum(lobes.alpha, least)), lobes.stretch
    if stretch is not None:
        along, across = np.maximum(stretch.along, least), np.maximum(stretch.across, least)
        stretch = Stretch(stretch.tangent, stretch.bitangent, along, across)
        alpha = np.sqrt(along * across)
    return dataclasses.replace(lobes, alpha=alpha, stretch=stretch)
