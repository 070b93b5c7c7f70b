"""What rays see: the lecture's "Ray Tracing Fundamentals", recursive ray tracing written as a loop.

Find the closest hit, add what shines there, aim at every source of light, go on through mirrors and glass, and, where
paths are traced, by diffuse reflection; cast the shadow rays. `stages.prepare` composes once, from the scene's content,
which stages run; `trace` runs them on a batch of rays, wave by wave.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from raytracer.arrays.rows import any_column, sum_columns
from raytracer.arrays.types import Booleans, Floats
from raytracer.bsdfs.bounce_kinds import DIFFUSE, STRAIGHT, count_bounces
from raytracer.bsdfs.bsdf import BsdfSample, lobe_probabilities, sample_bsdf
from raytracer.bsdfs.closures import Shading
from raytracer.casting.rays import Hits, Rays
from raytracer.integrator.bounces import CERTAIN_BOUNCES, classify_rays, find_ended, survival_probability
from raytracer.integrator.clamping import blur_lobes, clamp, find_limits
from raytracer.integrator.contributions import (
    add_background,
    add_emission,
    add_visible_lights,
    cut_holes,
    describe_path,
    describe_surface,
    divide_shadow,
    finish_alpha,
)
from raytracer.integrator.direct_light import sample_lights
from raytracer.integrator.integrator import CHOICE, FIRST_SOURCE, WAY, Integrator
from raytracer.integrator.light_sources import ShadingPoints
from raytracer.integrator.paths import Paths, Record, advance, join_paths, start_paths, start_record
from raytracer.integrator.shadow_catcher import find_split, finish_caught, note_split, start_catching
from raytracer.integrator.shadow_rays import ShadowRays, cast_shadows
from raytracer.sampling.sampler import Sampler, share_samples
from raytracer.sampling.sobol import SobolSamples
from raytracer.shading.materials import make_shading
from raytracer.surfaces.surface import Surface, make_surface

# Paths shaded together; casts take whole waves.
PART_SIZE = 1 << 15
# Most shadow rays that are kept to be cast together; bounds the memory that many lights take.
SHADOW_BATCH = 1 << 20


def trace(integrator: Integrator, rays: Rays, samples: SobolSamples) -> dict[str, Floats]:
    """Return what n rays see: (n, channels) float64 for each of the settings' passes.

    Parameters
    ----------
    integrator : of `prepare`
    rays : n camera rays, of any length of direction; t is the depth
    samples : n SobolSamples
    """
    record = start_record(integrator.settings, rays)
    start_catching(integrator, record, rays)
    follow(integrator, record, start_paths(rays), Sampler(samples, share_samples(samples), 0))
    finish_alpha(integrator, record)
    finish_caught(record)
    if record.unshadowed is not None:
        record.passes["Shadow"] = divide_shadow(record.passes["Shadow"], record.unshadowed)
    return record.passes


def follow(integrator: Integrator, record: Record, paths: Paths, sampler: Sampler) -> None:
    """Follow paths wave by wave until all have ended."""
    while len(paths):
        hits = integrator.cast(paths.rays, classify_rays(paths.kind))
        add_background(integrator, record, paths, hits)
        add_visible_lights(integrator, record, paths, hits)
        met = np.flatnonzero(hits.hit)
        paths, hits = cut_holes(integrator, record, paths.select(met), hits.select(met))
        follow_split(integrator, record, paths, hits, sampler)
        paths, sampler = shade_wave(integrator, record, paths, hits, sampler)


def follow_split(integrator: Integrator, record: Record, paths: Paths, hits: Hits, sampler: Sampler) -> None:
    """Paths that meet their first shadow catcher also go on, to their end, where there is nothing but catchers."""
    split = find_split(integrator, record, paths, hits)
    if record.caught is None or integrator.alone is None or not len(split):
        return
    paths, hits = paths.select(split), hits.select(split)
    note_split(integrator, record, paths)
    alone, seen = integrator.alone, record.caught.alone
    follow(alone, seen, *shade_wave(alone, seen, paths, hits, sampler))


@dataclass(frozen=True, eq=False, slots=True)
class Shaded:
    """What a part of a wave leaves to do: shadow rays to cast, and paths that go on."""

    aimed: list[ShadowRays]
    paths: Paths


def shade_wave(
    integrator: Integrator, record: Record, paths: Paths, hits: Hits, sampler: Sampler
) -> tuple[Paths, Sampler]:
    """Shade all hits, in parts that stay in the cache, cast their shadow rays together; return the paths that go on,
    and the sampler of their wave."""
    if record.limit is not None:
        record.limit[paths.row] = find_limits(integrator.settings, paths.bounces, aimed=True)
    going_on, waiting = [], []
    for start in range(0, len(paths), PART_SIZE):
        part = slice(start, start + PART_SIZE)
        shaded = shade(integrator, record, paths.select(part), hits.select(part), sampler)
        going_on.append(shaded.paths)
        waiting += shaded.aimed
        if sum(len(rays.row) for rays in waiting) >= SHADOW_BATCH:
            add_direct_light(integrator, record, waiting, first=sampler.dimension == 0)
            waiting = []
    if waiting:
        add_direct_light(integrator, record, waiting, first=sampler.dimension == 0)
    # Only what the camera sees straight shares points of lights.
    return join_paths(going_on), replace(sampler, shared=None, dimension=sampler.dimension + integrator.dimensions)


def shade(integrator: Integrator, record: Record, paths: Paths, hits: Hits, sampler: Sampler) -> Shaded:
    """See what is where rays hit: describe it, add what shines there, aim at the lights, and go on."""
    surface = make_surface(integrator.tables, paths.rays, hits)
    shading = make_shading(integrator.materials, surface, describe_path(integrator, paths, hits, surface, sampler))
    describe_surface(integrator, record, paths, hits, surface, shading)
    add_emission(integrator, record, paths, surface, shading)
    shading = blur_lobes(shading, paths.rarest, integrator.settings.filter_glossy)
    if not integrator.needs_light:
        return Shaded([], pass_straight(integrator, record, paths, hits, surface, shading))
    sampler = sampler.select(paths.row)
    ended = find_ended(paths.bounces, integrator.settings) | find_closed(integrator, paths)
    probabilities = weigh_lobes(integrator, paths, shading, ended)
    aimed = sample_lights(
        integrator.sources,
        ShadingPoints(surface, shading, paths.passages, sampler.skip(FIRST_SOURCE)),
        probabilities,
        np.where(ended[:, np.newaxis], 0.0, paths.throughput),
        paths.row,
    )
    if not integrator.goes_on:
        return Shaded(aimed, paths.select(slice(0, 0)))
    way = sample_bsdf(shading, probabilities, sampler.uniform(CHOICE), sampler.uniform_pair(WAY))
    way = cut_short(integrator, paths, way, sampler.skip(integrator.dimensions - 1))
    return Shaded(aimed, advance(paths, hits, surface, shading, way))


def find_closed(integrator: Integrator, paths: Paths) -> Booleans:
    """Return (n,) True for paths that have gone straight as often as they may: they see what shines, and end."""
    return paths.passages >= max(integrator.settings.transparent_bounces, 1)


def weigh_lobes(integrator: Integrator, paths: Paths, shading: Shading, ended: Booleans) -> Floats:
    """Return the probabilities of the ways to go on.

    A path that has used up its bounces still sees what shines where it ends: light sampling has counted on that. Where
    diffuse reflection is the only bounce, and would be the last, light sampling is left all of it; not so where
    geometry shines, for close by, in corners, no other way of sampling keeps the noise finite, nor where light comes
    through from behind, where nobody looks for the world.
    """
    probabilities = lobe_probabilities(shading, integrator.interreflects)
    if ended.any():
        open_ = ended & ~find_closed(integrator, paths)
        probabilities[ended, 0] = (open_ & any_column(shading.transparency > 0))[ended]
        probabilities[ended, 1:] = 0.0
    if integrator.interreflects and integrator.emitters is None:
        first = 1 + len(shading.lobes)
        kind = np.full(len(paths), DIFFUSE, dtype=np.uint8)
        last = find_ended(count_bounces(paths.bounces, kind), integrator.settings)
        last &= ~probabilities[:, 1:first].any(axis=1)
        for part in shading.tilted:
            if part.transmits:
                last[part.hit] = False
        probabilities[last, 0] = probabilities[last, 0] > 0
        probabilities[last, first:] = 0.0
    return probabilities


def cut_short(integrator: Integrator, paths: Paths, way: BsdfSample, sampler: Sampler) -> BsdfSample:
    """End paths that could see nothing but what shines, where nothing does, and some of those that carry little light
    (Russian roulette), for which the others count more."""
    counts = count_bounces(paths.bounces, way.kind)
    if not integrator.shines:
        way.weight[find_ended(counts, integrator.settings)] = 0.0
    if not integrator.interreflects:
        return way
    rows = np.flatnonzero(way.alive & (sum_columns(counts) > CERTAIN_BOUNCES))
    probability = survival_probability(paths.throughput[rows] * way.weight[rows])
    survives = sampler.select(rows).uniform() < probability
    way.weight[rows] = np.where(survives, 1.0 / probability, 0.0)[:, np.newaxis] * way.weight[rows]
    return way


def add_direct_light(integrator: Integrator, record: Record, aimed: list[ShadowRays], first: bool) -> None:
    """Cast shadow rays and add the light that they let through, of the camera's own rays (`first`) also to Shadow."""
    for rays, share in zip(aimed, cast_shadows(integrator.visibility, aimed), strict=True):
        arriving = rays.light * share
        if record.limit is not None:
            arriving = clamp(arriving, rays.chance * record.limit[rays.row])
        record.add("Combined", rays.row, arriving)
        if first and record.unshadowed is not None:
            record.add("Shadow", rays.row, arriving)
            record.unshadowed[rays.row] += rays.light


def pass_straight(
    integrator: Integrator, record: Record, paths: Paths, hits: Hits, surface: Surface, shading: Shading
) -> Paths:
    """Without light, only rays that have not found their opaque surface go on, and straight."""
    way = BsdfSample(
        direction=-shading.outgoing,
        weight=shading.transparency * (~record.settled[paths.row] & ~find_closed(integrator, paths))[:, np.newaxis],
        density=np.full(len(paths), np.inf),
        kind=np.full(len(paths), STRAIGHT, dtype=np.uint8),
    )
    return advance(paths, hits, surface, shading, way)
