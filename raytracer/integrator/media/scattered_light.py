"""Light that media scatter: from every source to points in space, and on by the phase function.

Points in space have no normal: what samples around one for surfaces samples evenly here. Sources that scattered rays
can also meet are sampled in both ways, weighed by the power heuristic, as at surfaces. Media scatter the light of what
their scattered rays see.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import any_column, sum_columns
from raytracer.arrays.types import Colors, Floats, Indices, Integers, Numbers, Vectors
from raytracer.bsdfs.bounce_kinds import SCATTERED, count_bounces
from raytracer.bsdfs.closures import Shading
from raytracer.casting.rays import Rays, select_rows
from raytracer.integrator.bounces import CERTAIN_BOUNCES, find_ended, survival_probability
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.light_sources import (
    ALONE,
    WORLD,
    KeyedSamples,
    LightSource,
    SampledLight,
    SampledWorld,
    ShadingPoints,
)
from raytracer.integrator.parts import Split
from raytracer.integrator.path_passes import PathPasses
from raytracer.integrator.paths import Paths
from raytracer.integrator.picked_lights import PickedLight
from raytracer.integrator.scattering import count_all
from raytracer.integrator.shadow_rays import ShadowRays
from raytracer.lights.environment import density_everywhere, evaluate_environment
from raytracer.lights.light_shapes import LightSamples
from raytracer.media.mixtures import Lobes, evaluate_lobes, sample_lobes
from raytracer.media.stack import Immersed, MediaStack
from raytracer.sampling.dimensions import AFTER_MAP, AROUND, PHASE_DIRECTION, PHASE_LOBE, PHASE_ROULETTE
from raytracer.sampling.direction_map import sample_map
from raytracer.sampling.sampler import Sampler
from raytracer.sampling.streams import Noise, start_noise
from raytracer.sampling.warps import power_heuristic
from raytracer.scene.fields import ALL_SETS, SEEN_BY
from raytracer.scene.lights import SunLight
from raytracer.shading.light_path import FARTHEST, Depths, describe_sampling
from raytracer.surfaces.surface import Surface, imagine_surface


@dataclass(frozen=True, eq=False, slots=True)
class MediumPoints:
    """n points in media that light is scattered at.

    paths : that come there, unscattered as yet
    position, before : (n, 3) float64, metres, and unit, the way that the paths come
    lobes : how light is scattered
    throughput : (n, 3) float64, what light that is scattered to the path counts
    instance : (n,) int32, whose medium it is; -1 for the world's
    stack : what they are inside of
    noise : (n,) streams of random numbers
    sampler : of the paths, from the wave's dimensions on; without points of lights that pixels share
    """

    paths: Paths
    position: Vectors
    before: Vectors
    lobes: Lobes
    throughput: Colors
    instance: Integers
    stack: MediaStack
    noise: Noise
    sampler: Sampler

    def __len__(self) -> int:
        return len(self.position)

    def select(self, rows: Any) -> MediumPoints:
        """Return some of the points: index or boolean array."""
        return select_rows(self, rows)


def follows_media(integrator: Integrator) -> bool:
    """True where scattered paths go on: else all light comes by samples of the sources."""
    return integrator.settings.integrator == "path" or integrator.looks_around


def list_sources(integrator: Integrator) -> Iterator[tuple[int, LightSource]]:
    """Yield the sources but the world, by number."""
    for number, source in enumerate(integrator.sources):
        if not isinstance(source, SampledWorld):
            yield number, source


def find_place(source: LightSource) -> Vectors | None:
    """Return the middle (3,) of a light that is near some points and far from others; None for other sources."""
    if not isinstance(source, SampledLight) or isinstance(source.light, SunLight):
        return None
    place: Vectors = source.light.position
    return place


def light_points(
    integrator: Integrator,
    passes: PathPasses,
    points: MediumPoints,
    number: int,
    source: LightSource,
    share: Numbers | float,
    lit: ShadingPoints,
) -> ShadowRays:
    """Return shadow rays from points to samples of one source.

    share : (n,) of its light that these points stand for, where others are chosen for it as well
    lit : the points as sources see them
    """
    found = source.sample(replace(lit, sampler=lit.sampler.skip(source.dimension)))
    light = found.light
    if source.share != 1.0:
        light = replace(light, density=source.share * light.density)
    met = follows_media(integrator) and is_met(integrator, source)
    arriving = scatter_samples(points, light, met) * np.reshape(share, (-1, 1))
    seen_by = source.seen_by if found.seen_by is None else found.seen_by
    arriving[np.broadcast_to(np.asarray(seen_by) & SEEN_BY["volume"] == 0, len(arriving))] = 0.0
    if source.max_bounces is not None:
        arriving[sum_columns(points.paths.bounces) > source.max_bounces] = 0.0
    group = source.light_group if found.light_group is None else found.light_group
    sent = replace(found, light=light)
    return aim_from_medium(integrator, passes, points, sent, arriving, number, source, group)


def is_met(integrator: Integrator, source: LightSource) -> bool:
    """True where a scattered ray finds a source's light where it meets it."""
    if isinstance(source, SampledLight):
        return source.light in integrator.visible_lights
    return source.group in integrator.visible_groups if isinstance(source, PickedLight) else True


def describe_points(integrator: Integrator, points: MediumPoints, dimension: int) -> ShadingPoints:
    """Return points in media as sources of light see them: without a normal.

    dimension : of the numbers that sources count theirs from
    """
    count = len(points)
    nothing = np.zeros((count, 3))
    surface: Surface = imagine_surface(points.position, nothing, -points.before, True, np.zeros((count, 2)))
    surface = replace(surface, instance=points.instance)
    shading = Shading(nothing, nothing, -points.before, nothing, nothing, nothing, ())
    depths = find_depths(integrator, points.paths)
    bounces = count_all(integrator, points.paths)
    return ShadingPoints(surface, shading, depths, points.sampler.skip(dimension), None, bounces)


def find_depths(integrator: Integrator, paths: Paths) -> Depths:
    """Return how far paths have come, for programs that ask."""
    return Depths(paths.passages, paths.bounces if integrator.tells_paths else None)


def scatter_samples(points: MediumPoints, light: LightSamples, is_met: bool) -> Colors:
    """Return what points scatter to their paths of samples of a light, (n, 3), in the share that rays leave."""
    value, density = evaluate_lobes(points.lobes, points.before, light.direction)
    share = power_heuristic(light.density, density) if is_met else np.where(light.density > 0, 1.0, 0.0)
    return points.throughput * value * light.weight * share[:, np.newaxis]


def aim_from_medium(
    integrator: Integrator,
    passes: PathPasses,
    points: MediumPoints,
    found: KeyedSamples,
    arriving: Colors,
    number: int,
    source: LightSource | None,
    group: Integers | int,
) -> ShadowRays:
    """Return the shadow rays of samples whose light would arrive, (n, 3); source : None for the world."""
    lit = np.flatnonzero((found.light.density > 0) & any_column(arriving != 0))
    light, some = found.light, points.select(lit)
    rays = None
    if source is None or source.cast_shadow:
        count = len(lit)
        rays = Rays(some.position, light.direction[lit], np.zeros(count), light.distance[lit])
    split = None
    if passes.parts is not None:
        direct = some.paths.direct
        # What is scattered here first is neither diffuse nor glossy.
        parts = passes.parts.select(some.paths.row).scale(np.where(direct[:, np.newaxis], 0.0, arriving[lit]))
        split = Split(parts, direct)
    if not isinstance(group, int):
        group = group[lit]
    return ShadowRays(
        some.paths.row,
        arriving[lit],
        found.key[lit],
        find_depths(integrator, some.paths),
        rays,
        number,
        unstopped=source is None and integrator.background is not None and integrator.background.is_even,
        cast_as=SEEN_BY["shadow"],
        chance=1.0 if source is None else source.chance,
        split=split,
        light_group=group,
        immersed=Immersed(some.stack, start_noise_of(some.noise, number)),
        blockers=find_blockers(found, source, lit),
        from_medium=True,
    )


def find_blockers(found: KeyedSamples, source: LightSource | None, lit: Indices) -> NDArray[np.int64] | int:
    """Return the sets of objects that shadow the samples of some points, as bits, one for all or (k,)."""
    if found.blockers is not None:
        return found.blockers[lit]
    return ALL_SETS if source is None else source.blockers


def start_noise_of(noise: Noise, number: int) -> Noise:
    """Return streams (n,) of random numbers for a source's shadow rays."""
    words = np.stack([noise >> np.uint64(32), noise & np.uint64(0xFFFFFFFF)], axis=1)
    return start_noise(words * 2.0**-32, number)


def light_by_world(integrator: Integrator, passes: PathPasses, points: MediumPoints, medium: int) -> list[ShadowRays]:
    """Return shadow rays from points to samples of the world: evenly around, and after its map.

    medium : the first dimension of ways through media
    """
    background = integrator.background
    if background is None or not background.seen_by & SEEN_BY["volume"]:
        return []
    ways = [] if background.by_map_alone else [AROUND]
    ways += [] if background.grid is None else [AFTER_MAP]
    rays, sampler = [], points.sampler.skip(medium)
    depths = find_depths(integrator, points.paths)
    for way in ways:
        pair = sampler.uniform_pair(way)
        if way == AROUND:
            direction = sample_around(pair)
        else:
            assert background.grid is not None
            direction = sample_map(background.grid, pair)
        density = density_everywhere(background, direction)
        path = None if background.program is None else describe_sampling(np.full(len(points), FARTHEST), depths)
        radiance = np.broadcast_to(evaluate_environment(background, direction, path), direction.shape)
        weight = np.divide(
            radiance, density[:, np.newaxis], out=np.zeros(direction.shape), where=density[:, np.newaxis] > 0
        )
        density = integrator.share_density(WORLD, density)
        light = LightSamples(direction, np.full(len(points), np.inf), weight, density)
        arriving = scatter_samples(points, light, follows_media(integrator))
        if background.max_bounces is not None:
            arriving[sum_columns(points.paths.bounces) > background.max_bounces] = 0.0
        found = KeyedSamples(light, np.full(len(points), ALONE, np.int32))
        number = len(integrator.sources) + way
        rays.append(aim_from_medium(integrator, passes, points, found, arriving, number, None, integrator.world_group))
    return rays


def sample_around(pair: Floats) -> Vectors:
    """Return directions (n, 3), even over the sphere, for uniform pairs (n, 2)."""
    height, angle = 1.0 - 2.0 * pair[:, 0], 2.0 * np.pi * pair[:, 1]
    sine = np.sqrt(np.maximum(1.0 - height * height, 0.0))
    return np.stack([sine * np.cos(angle), sine * np.sin(angle), height], axis=1)


def go_on_scattered(integrator: Integrator, passes: PathPasses, points: MediumPoints, medium: int) -> Paths:
    """Return the paths that go on from points, by the phase function.

    medium : the first dimension of ways through media
    """
    sampler = points.sampler.skip(medium)
    sample = sample_lobes(
        points.lobes, points.before, sampler.uniform(PHASE_LOBE), sampler.uniform_pair(PHASE_DIRECTION)
    )
    throughput = points.throughput * sample.value
    kind = np.full(len(points), SCATTERED, dtype=np.uint8)
    bounces = count_bounces(points.paths.bounces, kind)
    throughput *= _play_roulette(throughput, sum_columns(bounces), sampler)[:, np.newaxis]
    if not integrator.emission_ahead:
        throughput[find_ended(bounces, integrator.settings)] = 0.0
    alive = np.flatnonzero(any_column(throughput != 0) & (sample.density > 0))
    if passes.in_medium is not None:
        passes.in_medium[points.paths.row[alive[points.paths.direct[alive]]]] = True
    some, count = points.select(alive), len(alive)
    rays = Rays(some.position, sample.direction[alive], np.zeros(count), np.full(count, np.inf))
    return replace(
        some.paths,
        rays=rays,
        throughput=throughput[alive],
        kind=kind[alive],
        bounces=bounces[alive],
        scatter_origin=some.position,
        scatter_normal=np.zeros((count, 3)),
        density=sample.density[alive],
        rarest=np.minimum(some.paths.rarest, sample.density[alive]),
        scatterer=some.instance,
        travelled=np.zeros(count),
        media=some.stack,
    )


def _play_roulette(throughput: Colors, bounces: Any, sampler: Sampler) -> Numbers:
    """Return factors (n,) of paths' throughput, 0 for those that end (as `scattering.play_roulette`)."""
    survival = np.where(bounces > CERTAIN_BOUNCES, survival_probability(throughput), 1.0)
    survives = sampler.uniform(PHASE_ROULETTE) < survival
    return np.divide(1.0, survival, out=np.zeros_like(survival), where=survives & (survival > 0))
