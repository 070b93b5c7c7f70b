"""The scattering of light at surfaces: what they send on of the light around them, and where their paths go on.

Sources of light are sampled, then the BSDF; what is not worth following ends.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from raytracer.arrays.rows import any_column, put_rows, sum_columns, take_rows
from raytracer.arrays.types import Booleans, Counts, Floats, Numbers
from raytracer.bsdfs.bounce_kinds import DIFFUSE, STRAIGHT, count_bounces
from raytracer.bsdfs.bsdf import lobe_probabilities
from raytracer.bsdfs.bsdf_samples import BsdfSample, sample_bsdf
from raytracer.integrator.bounces import (
    CERTAIN_BOUNCES,
    find_closed,
    find_ended,
    find_finished,
    survival_probability,
)
from raytracer.integrator.caustics import WaveCaustics, note_receivers
from raytracer.integrator.direct_light import light_receptive
from raytracer.integrator.integrator import Integrator, find_lift
from raytracer.integrator.late_roulette import put_off
from raytracer.integrator.light_sources import ShadingPoints
from raytracer.integrator.media.shadow_media import immerse_shadows
from raytracer.integrator.passes.light_passes import note_scattering, split_paths
from raytracer.integrator.path_passes import PathPasses
from raytracer.integrator.paths import Paths, Wave, advance
from raytracer.integrator.shadow_linking import add_linked_light
from raytracer.integrator.shadow_rays import ShadowRays
from raytracer.sampling.sampler import Sampler
from raytracer.shading.light_path import Depths


@dataclass(frozen=True, eq=False, slots=True)
class Shaded:
    """What a part of a wave leaves to do: shadow rays to cast, and paths that go on."""

    shadow_rays: list[ShadowRays]
    paths: Paths


def scatter(integrator: Integrator, passes: PathPasses, wave: Wave, sampler: Sampler) -> Shaded:
    """Scatter light at the surfaces of a wave, and its paths; sampler : of the wave's paths."""
    ended = find_finished(integrator, wave.paths) | find_closed(integrator, wave.paths)
    wave = close_portals(wave, ended)
    probabilities = weigh_lobes(integrator, wave, ended)
    choice = sampler.uniform(integrator.dimensions.lobe) if integrator.goes_on else None
    return scatter_by(integrator, passes, wave, sampler, ended, probabilities, choice)


def close_portals(wave: Wave, ended: Booleans) -> Wave:
    """Return the wave without the portals of paths that only see emission: as in Cycles these pass straight only."""
    return replace(wave, shading=wave.shading.close_portals(ended)) if wave.shading.portals else wave


def scatter_by(
    integrator: Integrator,
    passes: PathPasses,
    wave: Wave,
    sampler: Sampler,
    ended: Booleans,
    probabilities: Floats,
    choice: Numbers | None,
    elsewhere: Booleans | None = None,
) -> Shaded:
    """Scatter light at the surfaces of a wave, and its paths by lobes of such probabilities.

    ended : (n,) bool, True for paths that only see emission here
    probabilities : (n, lobes) float64; rows come to less than 1 where paths take other ways as well
    choice : (n,) uniform numbers that choose the lobe; None where no path goes on
    elsewhere : (n,) bool, True for paths that have taken another way; None where none have
    """
    paths = wave.paths

    # Light sampling: what does each source send, if nothing is in the way?
    points = ShadingPoints(
        wave.surface,
        wave.shading,
        Depths(paths.passages, paths.bounces if integrator.tells_paths else None),
        sampler,
        find_lift(integrator),
        count_all(integrator, paths),
    )
    throughput = np.where(ended[:, np.newaxis], 0.0, paths.throughput) if ended.any() else paths.throughput
    split = split_paths(passes, paths)
    caustics = None if integrator.caustics is None else WaveCaustics(integrator.caustics, paths, throughput)
    shadow_rays = light_receptive(integrator.sources, points, probabilities, throughput, paths.row, split, caustics)
    if integrator.dimensions.medium is not None:
        shadow_rays = immerse_shadows(shadow_rays, wave, sampler, integrator.dimensions.medium)

    # BSDF sampling: where does the path go on?
    if choice is None:
        return Shaded(shadow_rays, paths.select(slice(0, 0)))
    pair = sampler.joined_pair(integrator.dimensions.direction)
    sample = sample_bsdf(wave.shading, probabilities, choice, pair)
    if elsewhere is not None:
        sample.weight[elsewhere] = 0.0
    note_scattering(passes, paths, wave.shading, probabilities, sample)

    # Stopping: is it worth going on?
    if passes.guides is None:
        end_in_the_dark(integrator, paths, sample)
    beyond = play_roulette(integrator, paths, sample, sampler)
    going_on = advance(wave, sample, beyond)
    if integrator.caustics is not None:
        going_on = note_receivers(integrator.caustics, going_on, ~sample.goes_straight[sample.alive])
    if integrator.shadow_links is not None:
        turned = ~sample.goes_straight
        if sample.portals is not None:  # what is seen straight is met as without links
            turned[sample.portals.hit] = ~paths.direct[sample.portals.hit]
        add_linked_light(integrator, passes, going_on.select(turned[sample.alive]))
    return Shaded(shadow_rays, going_on)


def count_all(integrator: Integrator, paths: Paths) -> Counts | None:
    """Return the bounces (k,) of all kinds of paths, or None where no light asks."""
    return sum_columns(paths.bounces) if integrator.counts_bounces else None


def weigh_lobes(integrator: Integrator, wave: Wave, ended: Booleans) -> Floats:
    """Return the probabilities of the lobes that paths may go on by.

    A path that has used up its bounces still sees emission where it ends: light sampling has counted on that. Where
    diffuse reflection is the only bounce, and would be the last, light sampling is left all of it; not so where
    geometry is emissive, for close by, in corners, no other way of sampling keeps the noise finite, nor where light
    comes through from behind, where nobody looks for the world, nor where paths look around.
    """
    paths, shading = wave.paths, wave.shading
    probabilities = lobe_probabilities(shading, integrator.interreflects, integrator.reflects_no_light)
    if ended.any():
        open_ = ended & ~find_closed(integrator, paths)
        probabilities[ended, 0] = (open_ & any_column(shading.transparency > 0))[ended]
        probabilities[ended, 1:] = 0.0
    if integrator.interreflects and integrator.emitters is None and not integrator.looks_around:
        first = 1 + len(shading.lobes)
        last = find_ended(count_bounces(paths.bounces, DIFFUSE), integrator.settings)
        last &= ~probabilities[:, 1:first].any(axis=1)
        for part in shading.tilted:
            if part.transmits:
                last[part.hit] = False
        probabilities[last, 0] = probabilities[last, 0] > 0
        probabilities[last, first:] = 0.0
    return probabilities


def end_in_the_dark(integrator: Integrator, paths: Paths, sample: BsdfSample) -> None:
    """End paths that could see nothing but emission, where there is none ahead."""
    if not integrator.emission_ahead:
        counts = count_bounces(paths.bounces, sample.kind)
        sample.weight[find_ended(counts, integrator.settings)] = 0.0


def play_roulette(integrator: Integrator, paths: Paths, sample: BsdfSample, sampler: Sampler) -> Numbers | None:
    """End some of the paths that carry little light (Russian roulette), for which the others count more; return what
    of that has to wait till they have met another surface, (n,) as of Paths.

    What red reflects and green does not is black: a path of no light at all never survives, nor is divided by.
    """
    if integrator.dimensions.roulette is None:
        return None
    bounces = sum_columns(paths.bounces) + (sample.kind != STRAIGHT)
    rows = np.flatnonzero(sample.alive & (bounces > CERTAIN_BOUNCES))
    probability = survival_probability(take_rows(paths.throughput, rows) * take_rows(sample.weight, rows))
    survives = sampler.select(rows).uniform(integrator.dimensions.roulette) < probability
    factor = np.divide(1.0, probability, out=np.zeros_like(probability), where=survives)
    beyond = put_off(sample, rows, factor) if integrator.late_roulette else None
    put_rows(sample.weight, rows, factor[:, np.newaxis] * take_rows(sample.weight, rows))
    return beyond
