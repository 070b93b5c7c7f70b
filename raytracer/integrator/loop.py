"""What rays see: the lecture's "Ray Tracing Fundamentals", recursive ray tracing written as a loop.

Find the closest hit, add what the ray met on its way, shade the hit: describe it, add its emission, sample every light,
sample the BSDF to go on; then cast the shadow rays. `integrator.prepare` composes once, from the scene's content, which
stages run; `trace` runs them on a batch of rays, wave by wave.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from raytracer.arrays.rows import any_column
from raytracer.arrays.types import Floats
from raytracer.bsdfs.bounce_kinds import STRAIGHT
from raytracer.bsdfs.bsdf_samples import BsdfSample, enter_portals
from raytracer.casting.rays import Hits, Rays
from raytracer.film.passes import LENGTH, NEAR_MISS
from raytracer.integrator.bounces import classify_rays, find_closed
from raytracer.integrator.clamping import blur_lobes, clamp, find_limits
from raytracer.integrator.clear_surfaces import forget_clear_surfaces
from raytracer.integrator.contributions import add_background, add_emission, add_visible_lights
from raytracer.integrator.first_surface import cut_holes, describe_surface, divide_shadow, finish_alpha
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.late_roulette import find_shaded, go_beyond
from raytracer.integrator.media.scene_media import immerse_paths, leave_media
from raytracer.integrator.media.travel import cross_media
from raytracer.integrator.near_misses import note_near_misses
from raytracer.integrator.passes.aovs import add_sky_aovs, add_surface_aovs
from raytracer.integrator.passes.denoising import add_guides
from raytracer.integrator.passes.light_passes import add_aimed
from raytracer.integrator.passes.open_share import add_open_share
from raytracer.integrator.passes.shadow_catcher import find_split, finish_caught, note_split, start_catching
from raytracer.integrator.path_passes import PathPasses, start_passes
from raytracer.integrator.paths import Paths, Wave, advance, join_paths, start_paths
from raytracer.integrator.ray_descriptions import describe_path
from raytracer.integrator.scattering import Shaded, scatter
from raytracer.integrator.shadow_rays import ShadowRays, cast_shadows
from raytracer.integrator.subsurface.subsurface import scatter_below
from raytracer.integrator.waiting_paths import WaitingPaths
from raytracer.sampling.sampler import Sampler, share_samples
from raytracer.sampling.sobol import SobolSamples
from raytracer.shading.materials import make_shading
from raytracer.surfaces.surface import make_surface

# Paths shaded together; casts take whole waves. With half as many a picture takes 3 to 4% longer, with a quarter 10.
PART_SIZE = 1 << 16
# Most shadow rays that are kept to be cast together; bounds the memory that many sources of light take.
SHADOW_BATCH = 1 << 20
# Most camera rays that set out together, which bounds the memory of a wave, and the fewest paths that go on together
# while there are more to set out: a wave takes some 10 ms however few its paths are.
SET_OUT = 1 << 17
FULL_WAVE = 1 << 16

# Paths that set out together, and what they have met, where that is known.
Start = tuple[Paths, Hits | None]
# What a ray meets on its way to its hit, in this order: stages that add to the passes and change no path. Where there
# are media, these come first, and dim the lights themselves.
Stage = Callable[[Integrator, PathPasses, Paths, Hits], None]
AROUND: tuple[Stage, ...] = (add_sky_aovs, note_near_misses, forget_clear_surfaces)
ALONG_RAYS: tuple[Stage, ...] = (add_background, add_visible_lights, *AROUND)
BEHIND_MEDIA: tuple[Stage, ...] = (add_background, *AROUND)


def trace(integrator: Integrator, rays: Rays, samples: SobolSamples, hits: Hits | None = None) -> dict[str, Floats]:
    """Return what n rays see: (n, channels) float64 for each of the settings' passes.

    Parameters
    ----------
    integrator : of `prepare`
    rays : n camera rays, of any length of direction; t is the depth
    samples : n SobolSamples
    hits : what the rays hit, none of them a miss, where that is given; None casts them
    """
    passes = start_passes(integrator.settings, rays)
    start_catching(integrator, passes, rays)
    if integrator.glints:
        passes.near = np.zeros(len(rays))
    if integrator.media is not None and passes.parts is not None:
        passes.in_medium = np.zeros(len(rays), dtype=np.bool_)
    follow(integrator, passes, set_out(integrator, rays, hits), Sampler(samples, share_samples(samples), 0))
    finish_alpha(integrator, passes)
    finish_caught(passes)
    if passes.lengths is not None:
        passes.values[LENGTH] = passes.lengths[:, np.newaxis]
    if passes.near is not None:
        passes.values[NEAR_MISS] = passes.near[:, np.newaxis]
    if passes.unshadowed is not None:
        passes.values["Shadow"] = divide_shadow(passes.values["Shadow"], passes.unshadowed)
    return passes.values


def set_out(integrator: Integrator, rays: Rays, hits: Hits | None) -> Iterator[Start]:
    """Yield the paths that begin with camera rays, in even parts of at most SET_OUT."""
    size = -(-len(rays) // max(1, -(-len(rays) // SET_OUT)))
    for start in range(0, len(rays), max(1, size)):
        part = slice(start, start + size)
        paths = start_paths(rays.select(part), start)
        if integrator.media is not None:
            paths = immerse_paths(integrator.media, paths, is_baked=hits is not None)
        yield paths, None if hits is None else hits.select(part)


def follow(integrator: Integrator, passes: PathPasses, starts: Iterable[Start], sampler: Sampler) -> None:
    """Follow paths wave by wave until all have ended.

    Those of a small wave wait for what of the later starts comes as far. What a path sees does not depend on company.
    """
    waves = [WaitingPaths(sampler)]

    def go_on(number: int, paths: Paths, hits: Hits | None = None) -> None:
        paths, following = trace_wave(integrator, passes, paths, hits, waves[number].sampler)
        if number + 1 == len(waves):
            waves.append(WaitingPaths(following))
        waves[number + 1].add(paths)

    for start in starts:
        go_on(0, *start)
        for number, wave in enumerate(waves):  # paths that go on may begin another one
            if len(wave) >= FULL_WAVE:
                go_on(number, wave.take())
    for number, wave in enumerate(waves):
        if len(wave):
            go_on(number, wave.take())


def trace_wave(
    integrator: Integrator, passes: PathPasses, paths: Paths, hits: Hits | None, sampler: Sampler
) -> tuple[Paths, Sampler]:
    """Cast the rays of a wave, where what they `hits` is not known, add what they met on their way, and shade the hits;
    return the paths that go on, and the sampler of their wave."""
    if hits is not None:
        return shade_wave(integrator, passes, paths, hits, sampler)
    if passes.lengths is not None:
        passes.lengths[paths.row] += 1.0
    hits = integrator.cast(paths.rays, classify_rays(paths.kind))
    stages, scattered = ALONG_RAYS, []
    if integrator.media is not None and integrator.needs_light:
        crossed = cross_media(integrator, passes, paths, hits, sampler)
        add_direct_light(integrator, passes, crossed.shadow_rays, first=False)
        paths, hits, scattered, stages = crossed.paths, crossed.hits, crossed.scattered, BEHIND_MEDIA
    for stage in stages:
        stage(integrator, passes, paths, hits)
    met = find_shaded(integrator, paths, hits)
    if len(met) < len(paths):
        paths, hits = paths.select(met), hits.select(met)
    paths, hits = cut_holes(integrator, passes, paths, hits)
    follow_split(integrator, passes, paths, hits, sampler)
    paths, sampler = shade_wave(integrator, passes, paths, hits, sampler)
    return join_paths([paths, *scattered]) if scattered else paths, sampler


def follow_split(integrator: Integrator, passes: PathPasses, paths: Paths, hits: Hits, sampler: Sampler) -> None:
    """Paths that meet their first shadow catcher also go on, to their end, where there is nothing but catchers."""
    split = find_split(integrator, passes, paths, hits)
    if passes.caught is None or integrator.catchers_only is None or not len(split):
        return
    paths, hits = paths.select(split), hits.select(split)
    note_split(integrator, passes, paths)
    catchers_only, seen = integrator.catchers_only, passes.caught.catchers_only
    if paths.media is not None:
        assert integrator.is_catcher is not None
        paths = leave_media(catchers_only.media, paths, integrator.is_catcher)
    follow(catchers_only, seen, [(paths, hits)], sampler)


def shade_wave(
    integrator: Integrator, passes: PathPasses, paths: Paths, hits: Hits, sampler: Sampler
) -> tuple[Paths, Sampler]:
    """Shade all hits, in parts, cast their shadow rays together; return the paths that go on,
    and the sampler of their wave."""
    if passes.limit is not None:
        passes.limit[paths.row] = find_limits(integrator.settings, paths.bounces, aimed=True)
    going_on: list[Paths] = []
    waiting: list[ShadowRays] = []
    part_size = min(PART_SIZE, max(1, SHADOW_BATCH // max(1, len(integrator.sources))))
    for start in range(0, len(paths), part_size):
        part = slice(start, start + part_size)
        shaded = shade(integrator, passes, paths.select(part), hits.select(part), sampler)
        going_on.append(shaded.paths)
        if count_rays(waiting) + count_rays(shaded.shadow_rays) > SHADOW_BATCH:
            add_direct_light(integrator, passes, waiting, first=sampler.dimension == 0)
            waiting = []
        waiting += shaded.shadow_rays
    if waiting:
        add_direct_light(integrator, passes, waiting, first=sampler.dimension == 0)
    # Only what the camera sees straight shares points of lights.
    sampler = replace(sampler.skip(integrator.dimensions.count), shared=None, wave=sampler.wave + 1)
    return join_paths(going_on), sampler


def count_rays(shadow_rays: list[ShadowRays]) -> int:
    """Return how many shadow rays there are of all sources."""
    return sum(len(rays.row) for rays in shadow_rays)


def shade(integrator: Integrator, passes: PathPasses, paths: Paths, hits: Hits, sampler: Sampler) -> Shaded:
    """Shade hits: the bounce, from the surface that is met to the ray that leaves it."""
    # Surface: where is it, and which closures are there?
    surface = make_surface(integrator.tables, paths.rays, hits)
    shading = make_shading(integrator.materials, surface, describe_path(integrator, paths, hits, surface, sampler))
    if integrator.terminator is not None and integrator.terminator.frequency is not None:
        shading = replace(shading, frequency=integrator.terminator.frequency[surface.instance])
    wave = Wave(paths, hits, surface, shading)
    add_surface_aovs(integrator, passes, paths, hits, surface, sampler)
    describe_surface(integrator, passes, wave)

    # Emission: what of it does light sampling leave to this ray?
    add_emission(integrator, passes, wave)
    wave = go_beyond(wave)
    shading = blur_lobes(wave.shading, wave.paths.rarest, integrator.settings.filter_glossy)
    wave = replace(wave, shading=shading)
    if not integrator.needs_light:
        return Shaded([], pass_straight(integrator, passes, wave, sampler))

    sampler = sampler.select(wave.paths.row)
    add_guides(integrator, passes, wave)
    add_open_share(integrator, passes, wave, sampler)

    # Scattering: what light does the surface send on, and where does the path go on?
    stage = scatter if integrator.cast_inside is None else scatter_below
    return stage(integrator, passes, wave, sampler)


def add_direct_light(integrator: Integrator, passes: PathPasses, shadow_rays: list[ShadowRays], first: bool) -> None:
    """Cast shadow rays and add the light that they let through, of the camera's own rays (`first`) also to Shadow."""
    for rays, share in zip(shadow_rays, cast_shadows(integrator.visibility, shadow_rays), strict=True):
        arriving = rays.light * share
        if passes.limit is not None:
            arriving = clamp(arriving, rays.chance * passes.limit[rays.row])
        passes.add("Combined", rays.row, arriving)
        if rays.split is not None or passes.light_groups:
            add_aimed(passes, rays, arriving)
        if first and passes.unshadowed is not None:
            passes.add("Shadow", rays.row, arriving)
            passes.unshadowed[rays.row] += rays.light


def pass_straight(integrator: Integrator, passes: PathPasses, wave: Wave, sampler: Sampler) -> Paths:
    """Without light, only rays that have not found their opaque surface go on, straight or through portals."""
    open_ = ~passes.found[wave.paths.row] & ~find_closed(integrator, wave.paths)
    sample = BsdfSample(
        direction=-wave.shading.outgoing,
        weight=wave.shading.transparency * open_[:, np.newaxis],
        density=np.full(len(wave), np.inf),
        kind=np.full(len(wave), STRAIGHT, dtype=np.uint8),
    )
    if wave.shading.portals:
        rows = np.flatnonzero(open_ & any_column(wave.shading.passage > 0))
        choice = sampler.select(wave.paths.row[rows]).uniform(integrator.dimensions.lobe)
        sample = enter_portals(sample, wave.shading, rows, np.ones(len(rows)), choice)
    return advance(wave, sample)
