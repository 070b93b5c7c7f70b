"""Russian roulette that is played late: its losers still see what shines where they come to, and end there.

A mirror, or a narrow lobe, shows small bright light that samples of lights leave to it: rarely met, it holds most of
the noise of caustics. What such a bounce meets next, A, counts as it is; only what comes from beyond, B, is left to
chance, the survival s of the probability p. Of the two ways to estimate A + B,

    E (A + B s / p)^2 = A^2 + 2 A B + B^2 / p  <=  (A + B)^2 / p = E ((A + B) s / p)^2,

so the noise is never larger, and smaller the more of the light is A. The losers are cast once more, which takes little
of the time of a bounce. Of wide lobes samples of lights bring most of A: their losers end before they are cast.

References
----------
Blender, intern/cycles/kernel/integrator/intersect_closest.h and shade_surface.h: all paths are ended after the emission
of the surface that they have come to.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from raytracer.arrays.rows import any_column, scale_vectors
from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.bsdfs.bounce_kinds import STRAIGHT
from raytracer.bsdfs.bsdf_samples import BsdfSample
from raytracer.casting.rays import Hits
from raytracer.integrator.features import NARROW_DENSITY
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.paths import Paths, Wave
from raytracer.surfaces.surface import find_material


def find_late(sample: BsdfSample, rows: Indices) -> Booleans:
    """Return (k,) True where paths, at `rows` (k,) of n, leave a narrow lobe or a perfect one."""
    late: Booleans = (sample.density[rows] > NARROW_DENSITY) & (sample.kind[rows] != STRAIGHT)
    return late


def put_off(sample: BsdfSample, rows: Indices, factor: Floats) -> Floats | None:
    """Return what the light of n paths from beyond their next surface counts more, or None where no roulette is late.

    rows, factor : (k,), which paths chance has to do with, and by what their light counts more; 1 afterwards of those
        that wait
    """
    late = np.flatnonzero(find_late(sample, rows))
    if not len(late):
        return None
    beyond = np.ones(len(sample.density))
    beyond[rows[late]] = factor[late]
    factor[late] = 1.0
    return beyond


def find_shaded(integrator: Integrator, paths: Paths, hits: Hits) -> Indices:
    """Return which paths have met a surface that they go beyond, or that may shine."""
    met: Indices = np.flatnonzero(hits.hit)
    if paths.beyond is None:
        return met
    kept = paths.beyond[met] > 0
    if integrator.emitters is not None and not kept.all():
        rows = np.flatnonzero(~kept)
        material = find_material(integrator.tables, hits.select(met[rows]))
        kept[rows] = any_column(integrator.materials.radiance[material] != 0)  # NaN where a program computes it
    return met[kept]


def go_beyond(wave: Wave) -> Wave:
    """Return the paths of a wave that chance lets go beyond the surface that they have met, with what they count."""
    if wave.paths.beyond is None:
        return wave
    rows = np.flatnonzero(wave.paths.beyond)
    wave = wave.select(rows) if len(rows) < len(wave) else wave
    assert wave.paths.beyond is not None
    throughput = scale_vectors(wave.paths.throughput, wave.paths.beyond)
    return replace(wave, paths=replace(wave.paths, throughput=throughput, beyond=None))
