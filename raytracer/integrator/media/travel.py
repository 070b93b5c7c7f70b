"""Media on the way of rays: what of their light gets through, what shines, and what is scattered to where they go on.

Before what they hit, rays go through the media that their paths are inside of (`media.stack`). There

    media that are the same everywhere are integrated in closed form, and distances of scattering sampled by density
    media that vary are followed from collision to collision (`media.tracking`)

and where a path is scattered it is lit by every source, and goes on by the phase function: with integrator 'direct' it
ends there, which is single scattering, or sees what shines where media do. To lights that have a place more points are
chosen, by the angle they see the ray at: weights 1 / (p + q) of both densities p, q of a distance add up to one at
each place (balance heuristic); where media vary the density of scattering is not known, and 1 over the length of the
stretch stands in, for any weights that add up to one will do.

Paths that have used up their bounces only see what shines: light that reaches them that way gets through or is lost.

References
----------
Blender, intern/cycles/kernel/integrator/shade_volume.h: what is scattered, what passes count.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from raytracer.arrays.rows import any_column
from raytracer.arrays.types import Booleans, Colors, Indices, Integers, Numbers
from raytracer.casting.rays import Hits
from raytracer.integrator.clamping import clamp_met, find_limits
from raytracer.integrator.contributions import add_visible_lights
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.media.scattered_light import (
    MediumPoints,
    describe_points,
    find_place,
    follows_media,
    go_on_scattered,
    light_by_world,
    light_points,
    list_sources,
)
from raytracer.integrator.media.scene_media import SceneMedia, sum_even
from raytracer.integrator.media.shadow_media import find_passing
from raytracer.integrator.media.ways import (
    CHOSEN,
    Ways,
    dim_light,
    draw_stream,
    find_dimension,
    find_first,
    find_media,
    find_ways,
)
from raytracer.integrator.passes.denoising import add_medium_guides
from raytracer.integrator.passes.light_passes import add_met
from raytracer.integrator.path_passes import PathPasses
from raytracer.integrator.paths import Paths
from raytracer.integrator.shadow_linking import add_linked_light
from raytracer.integrator.shadow_rays import ShadowRays
from raytracer.media.distances import (
    find_angle_density,
    find_density,
    find_transmittance,
    measure_angles,
    sample_angles,
    sample_distances,
    sum_emission,
    weigh_channels,
)
from raytracer.media.mixtures import Mixture
from raytracer.media.tracking import Stretches, track
from raytracer.sampling.dimensions import DISTANCE, MEDIUM_COUNT
from raytracer.sampling.sampler import Sampler
from raytracer.scene.light_groups import NO_GROUP


@dataclass(frozen=True, eq=False, slots=True)
class Crossed:
    """What media leave to do on the way: paths that get through, with what they hit, those that go on from where they
    are scattered, and shadow rays to cast."""

    paths: Paths
    hits: Hits
    scattered: list[Paths]
    shadow_rays: list[ShadowRays]


@dataclass(frozen=True, eq=False, slots=True)
class Stage:
    """What becomes of k ways.

    weight : (k, 3) float64, what light counts behind, or where it is scattered
    is_scattered : (k,) bool
    points : where they are; albedo : (n, 3) float64, the share of what is extinguished there that is scattered
    shares : by number of a source, how much of its light points stand for (n,), where others are chosen for it as well
    shadow_rays : of those others
    """

    weight: Colors
    is_scattered: Booleans
    points: MediumPoints
    albedo: Colors
    shares: dict[int, Numbers]
    shadow_rays: list[ShadowRays]


def cross_media(integrator: Integrator, passes: PathPasses, paths: Paths, hits: Hits, sampler: Sampler) -> Crossed:
    """Take paths through the media on their way; sampler : of the batch's rays."""
    media = find_media(integrator)
    ways = find_ways(integrator, media, paths, hits, sampler)
    add_visible_lights(integrator, passes, paths, hits, partial(dim_light, media, ways))
    if passes.limit is not None:
        passes.limit[paths.row] = find_limits(integrator.settings, paths.bounces, aimed=True)
    varying = media.find_varying(ways.inside)
    even = ~varying & (ways.inside <= media.table.world).any(axis=1)
    gets_through, throughput = np.ones(len(paths), np.bool_), paths.throughput.copy()
    scattered, shadow_rays = [], []
    for rows, cross in ((np.flatnonzero(even), cross_even), (np.flatnonzero(varying), cross_varying)):
        if not len(rows):
            continue
        stage = cross(integrator, passes, media, ways.select(rows))
        throughput[rows] *= stage.weight
        gets_through[rows] = ~stage.is_scattered
        shadow_rays += stage.shadow_rays + light_all(integrator, passes, stage)
        add_medium_guides(passes, stage.points.paths, stage.albedo)
        if follows_media(integrator) and len(stage.points):
            going_on = go_on_scattered(integrator, passes, stage.points, find_dimension(integrator))
            scattered.append(going_on)
            if integrator.shadow_links is not None:
                add_linked_light(integrator, passes, going_on)
    alive = np.flatnonzero(gets_through & any_column(throughput != 0))
    passed = replace(paths.select(alive), throughput=throughput[alive])
    return Crossed(passed, hits.select(alive), scattered, shadow_rays)


def add_shine(integrator: Integrator, passes: PathPasses, ways: Ways, light: Colors) -> None:
    """Add what media shine with along ways, (k, 3), as their starts see it."""
    shining = np.flatnonzero(any_column(light != 0))
    if not len(shining):
        return
    paths, group = ways.paths.select(shining), find_shining_groups(integrator, ways, shining)
    light = clamp_met(integrator.settings, paths.bounces, paths.throughput * light[shining])
    add_met(passes, paths, light, "Emission", group)


def find_shining_groups(integrator: Integrator, ways: Ways, rows: Indices) -> Integers | int:
    """Return the groups of lights (k,) that what shines along some of the ways belongs to: those of the object that was
    come into first, or of the world."""
    grouped = integrator.grouped
    if grouped is None:
        return NO_GROUP
    instance = find_media(integrator).table.instance[find_first(find_media(integrator), ways.inside[rows])]
    return np.where(instance < 0, grouped.of_world, grouped.of_objects[instance])


def cross_even(integrator: Integrator, passes: PathPasses, media: SceneMedia, ways: Ways) -> Stage:
    """Take paths through media that are the same all along their ways."""
    mixture = sum_even(media, ways.inside)
    add_shine(integrator, passes, ways, sum_emission(mixture.extinction, mixture.emission, ways.length))
    weight, is_scattered = find_transmittance(mixture.extinction, ways.length), np.zeros(len(ways), np.bool_)
    rows = np.flatnonzero(ways.scatters & any_column(mixture.scattering > 0))
    some, mixture = ways.select(rows), mixture.select(rows)
    channels = weigh_channels(mixture.extinction, mixture.scattering, some.paths.throughput)
    pair = some.sampler.uniform_pair(find_dimension(integrator) + DISTANCE)
    sample = sample_distances(mixture.extinction, mixture.scattering, channels, some.length, pair)
    weight[rows], is_scattered[rows] = sample.weight, sample.scattered
    known = partial(find_density, mixture.extinction, channels)

    def measure(distance: Numbers, number: int) -> tuple[Colors, Mixture]:
        left = find_transmittance(mixture.extinction, distance)
        return left * mixture.scattering, mixture

    there = np.flatnonzero(sample.scattered)
    throughput = some.paths.throughput[there] * sample.weight[there]
    met = mixture.select(there)
    points = make_points(media, some.select(there), sample.distance[there], met, throughput)
    shares, shadow_rays = choose_points(integrator, passes, media, some, known, measure, sample.distance, there)
    return Stage(weight, is_scattered, points, find_albedo(met), shares, shadow_rays)


def cross_varying(integrator: Integrator, passes: PathPasses, media: SceneMedia, ways: Ways) -> Stage:
    """Take paths through media of which any varies along their ways."""
    ways = replace(ways, end=np.maximum(media.find_reach(ways.inside, ways.origin, ways.end), ways.start))
    stretches = Stretches(ways.inside, ways.origin, ways.direction, ways.start, ways.end, ways.noise)
    tracked = track(media.majorants, media.sum_media, stretches, ways.paths.throughput, ways.scatters)
    add_shine(integrator, passes, ways, tracked.emission)
    distance = tracked.distance - ways.start
    rows, there = np.flatnonzero(ways.scatters & (ways.length > 0)), np.flatnonzero(tracked.scattered)
    mixture = media.sum_media(ways.inside[there], ways.find_points(distance)[there])
    throughput = ways.paths.throughput[there] * tracked.weight[there]
    points = make_points(media, ways.select(there), distance[there], mixture, throughput)
    some = ways.select(rows)

    def measure(distance: Numbers, number: int) -> tuple[Colors, Mixture]:
        mixture = media.sum_media(some.inside, some.find_points(distance))
        noise = draw_stream(some.noise, CHOSEN + number)
        which = some.inside, some.origin, some.direction, some.start, some.start + distance
        return find_passing(media, *which, noise) * mixture.scattering, mixture

    place = np.searchsorted(rows, there)
    known = partial(spread_evenly, some.length)
    shares, shadow_rays = choose_points(integrator, passes, media, some, known, measure, distance[rows], place)
    return Stage(tracked.weight, tracked.scattered, points, find_albedo(mixture), shares, shadow_rays)


def find_albedo(mixture: Mixture) -> Colors:
    """Return the share (k, 3) of extinguished light that is scattered."""
    extinction = mixture.extinction
    return np.divide(mixture.scattering, extinction, out=np.zeros_like(extinction), where=extinction > 0)


def spread_evenly(reach: Numbers, distance: Numbers) -> Numbers:
    """Return the density (n,) of distances that stands in for one that is not known."""
    return 1.0 / reach


# The density (k,) of distances (k,) by scattering, known or not; what light of distances (k,) a ray sees scattered per
# metre, for a source of a number, and the media there.
Known = Callable[[Numbers], Numbers]
Measure = Callable[[Numbers, int], tuple[Colors, Mixture]]


def choose_points(
    integrator: Integrator,
    passes: PathPasses,
    media: SceneMedia,
    ways: Ways,
    known: Known,
    measure: Measure,
    distance: Numbers,
    there: Indices,
) -> tuple[dict[int, Numbers], list[ShadowRays]]:
    """Choose a point on each way for each light that has a place; return which share of the light the points leave to
    those where the ways are scattered, `there` at `distance` (k,), and the shadow rays of their own."""
    shares, shadow_rays = {}, []
    for number, source in list_sources(integrator):
        place = find_place(source)
        if place is None or not len(ways):
            continue
        start = ways.find_points(np.zeros(len(ways)))
        angles = measure_angles(start, ways.direction, ways.length, place)
        uniform = ways.sampler.uniform(find_dimension(integrator) + MEDIUM_COUNT + number)
        chosen = np.minimum(sample_angles(angles, uniform), ways.length)
        density = known(chosen) + find_angle_density(angles, chosen)
        scattered, mixture = measure(chosen, number)
        usable = (density > 0)[:, np.newaxis]
        throughput = ways.paths.throughput * scattered
        throughput = np.divide(throughput, density[:, np.newaxis], out=np.zeros_like(throughput), where=usable)
        points = make_points(media, ways, chosen, mixture, throughput)
        lit = describe_points(integrator, points, integrator.dimensions.lit)
        shadow_rays.append(light_points(integrator, passes, points, number, source, 1.0, lit))
        own, other = known(distance)[there], find_angle_density(angles, distance)[there]
        shares[number] = np.divide(own, own + other, out=np.ones_like(own), where=own + other > 0)
    return shares, shadow_rays


def make_points(media: SceneMedia, ways: Ways, distance: Numbers, mixture: Mixture, throughput: Colors) -> MediumPoints:
    """Return the points at distances (k,) from the starts of ways."""
    assert ways.paths.media is not None
    return MediumPoints(
        ways.paths,
        ways.find_points(distance),
        ways.direction,
        mixture.lobes,
        throughput,
        media.table.instance[find_first(media, ways.inside)],
        ways.paths.media,
        ways.noise,
        ways.sampler,
    )


def light_all(integrator: Integrator, passes: PathPasses, stage: Stage) -> list[ShadowRays]:
    """Return shadow rays from where paths are scattered to all sources."""
    points, shares = stage.points, stage.shares
    if not len(points):
        return []
    lit = describe_points(integrator, points, 0)
    rays = [
        light_points(integrator, passes, points, number, source, shares.get(number, 1.0), lit)
        for number, source in list_sources(integrator)
    ]
    return rays + light_by_world(integrator, passes, points, find_dimension(integrator))
