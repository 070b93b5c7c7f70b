"""Light that arrives at surface points straight from its sources, with shadow rays.

Every source of a scene becomes one function, a LightStage, that samples a direction from each point; what a scene lacks
is not among them. A source that reflected rays can also meet is sampled in both ways, weighed by the power heuristic.
Shadow rays that share the point they end at, or their direction, are cast in calls of their own.
Imports `emitters`, `environment`, `lights`, `shared_lights`, `materials`, `scatter`, `surface`, `sampling`,
`visibility`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from raytracer.closures import Shading
from raytracer.emitters import (
    Emitters,
    aim_at_triangles,
    pick_emitters,
    place_on_triangles,
    sample_picked,
    vary_radiance,
)
from raytracer.environment import Environment, Way, environment_density, find_environment, list_ways
from raytracer.light_shapes import LightSamples
from raytracer.lights import has_extent, sample_light
from raytracer.linking import LightLinks
from raytracer.materials import MaterialTable, find_transparency
from raytracer.rays import Booleans, Floats, Integers, Rays, Surface, join_rays
from raytracer.records import ALL_SETS, SEEN_BY_ALL
from raytracer.rows import any_column, take_rows
from raytracer.sampling import Sampler
from raytracer.scatter import reflect_light
from raytracer.scene import Light
from raytracer.shared_lights import is_near, is_shareable, sample_shared, share_points
from raytracer.surface import SurfaceTables, make_surface, spawn_origin
from raytracer.taming import GEOMETRY, LAMP, OTHER, WORLD, find_chances
from raytracer.visibility import Cast, RayCaster, classify_shadows

# The key of shadow rays that share nothing.
ALONE = -1

Indices = NDArray[np.intp]
Keys = NDArray[np.int32]
Counts = NDArray[np.int32]
# What shadow rays, after so many straight passages of their paths, let through: (n, 1) or (n, 3); where the third is
# True, transparent surfaces let light through even if their material says that they stop it.
Visibility = Callable[[Rays, Counts, Booleans], Floats]


@dataclass(frozen=True, eq=False, slots=True)
class LitPoints:
    """n points that wait for light.

    passages : (n,) int32, straight passages of the paths that led there
    """

    surface: Surface
    shading: Shading
    passages: Counts
    sampler: Sampler


@dataclass(frozen=True, eq=False, slots=True)
class Aim:
    """Where n points look for a light: a sample each, and the key (n,) of the point or direction that they share with
    all others of the same key; ALONE where with none."""

    light: LightSamples
    key: Keys


LightStage = Callable[[LitPoints], Aim]


@dataclass(frozen=True, eq=False)
class LightSource:
    """A source of light: the stage that samples it, how many numbered dimensions that takes, whether it throws shadows,
    the classes of rays that see it, which are the ways in which its light is reflected, whether its light passes
    transparent surfaces that stop that of others, how many numbered dimensions before its own nobody takes, its kind
    and chance among what Cycles would choose from (`taming`), and which (n,) of n instances and groups of spheres it
    lights; None for all, or where `sample` has told them apart."""

    sample: LightStage
    dimensions: int
    cast_shadow: bool = True
    seen_by: int = SEEN_BY_ALL
    unstopped: bool = False
    skipped: int = 0
    kind: int = LAMP
    chance: float = 1.0
    find_lit: Callable[[Integers], Booleans] | None = None


def leave_out(sources: Sequence[LightSource], present: Sequence[bool]) -> tuple[LightSource, ...]:
    """Return the sources that are present; each takes the same random numbers as if all were."""
    kept, skipped = [], 0
    for source, stays in zip(sources, present, strict=True):
        if stays:
            kept.append(replace(source, skipped=source.skipped + skipped))
        skipped = 0 if stays else skipped + source.dimensions
    return tuple(kept)


def set_chances(sources: Sequence[LightSource]) -> tuple[LightSource, ...]:
    """Return all the sources that there are with the chances that Cycles would choose them with."""
    kinds = [source.kind for source in sources]
    chances = find_chances(kinds.count(LAMP) + (WORLD in kinds), GEOMETRY in kinds)
    return tuple(replace(source, chance=chances.get(source.kind, 1.0)) for source in sources)


def lamp_source(light: Light, weigh: bool, links: LightLinks | None = None) -> LightSource:
    """A lamp: two pairs of numbers at most.

    weigh : False where no reflected ray can meet the lamp
    """
    # Without extent all shadow rays of a lamp end at one point, or run in one direction.
    key_of_own = ALONE if has_extent(light) else 0
    shareable = is_shareable(light)

    def sample(points: LitPoints) -> Aim:
        shared = points.sampler.shared
        if shareable and shared is not None:
            targets = share_points(light, shared, points.sampler.dimension).take(shared.key, axis=0)
            aim = Aim(sample_shared(light, points.surface.position, targets, weigh), shared.key.astype(np.int32))
            _replace_near(light, points, aim)
            return aim
        pair = points.sampler.uniform_pair()
        return Aim(sample_light(light, points.surface.position, pair), _fill_keys(points, key_of_own))

    find_lit = partial(links.find_lit, light.receivers) if links is not None and light.receivers != ALL_SETS else None
    return LightSource(sample, 2, light.cast_shadow, light.seen_by, find_lit=find_lit)


def _replace_near(light: Light, points: LitPoints, aim: Aim) -> None:
    """Give points near a lamp a sample of their own."""
    rows = np.flatnonzero(is_near(light, points.surface.position))
    if not len(rows):
        return
    position = points.surface.position[rows]
    own = sample_light(light, position, points.sampler.select(rows).uniform_pair())
    for name in ("direction", "distance", "weight", "density"):
        getattr(aim.light, name)[rows] = getattr(own, name)
    if aim.light.target is not None and aim.light.reach is not None:
        aim.light.target[rows] = position + own.direction
        aim.light.reach[rows] = own.distance
    aim.key[rows] = ALONE


def _fill_keys(points: LitPoints, key: int) -> Keys:
    return np.full(len(points.surface), key, dtype=np.int32)


def emitter_source(emitters: Emitters, links: LightLinks | None = None) -> LightSource:
    """All emissive geometry: a number to choose by, and a pair for the place."""
    shareable = not emitters.has_spheres

    def sample(points: LitPoints) -> Aim:
        dimension, shared = points.sampler.dimension, points.sampler.shared
        if shareable and shared is not None:
            picked, pair = pick_emitters(emitters, shared.uniform(dimension)), shared.uniform_pair(dimension + 1)
            places = place_on_triangles(emitters, picked, pair).select(shared.key)
            light = aim_at_triangles(places, points.surface)
            picked, pair, key = picked[shared.key], pair[shared.key], shared.key.astype(np.int32)
            vary_radiance(emitters, picked, pair, points.surface, light)
        else:
            picked, pair = pick_emitters(emitters, points.sampler.uniform(0)), points.sampler.uniform_pair(1)
            light, key = sample_picked(emitters, points.surface, picked, pair), _fill_keys(points, ALONE)
        if links is not None:
            lit = links.find_lit(links.receivers[emitters.instance[picked]], points.surface.instance)
            light.weight[~lit] = 0.0
        return Aim(light, key)

    return LightSource(sample, 2, kind=GEOMETRY)


def world_sources(environment: Environment) -> list[LightSource]:
    """The world: directions around the shading normal, and to where it is bright.

    Cycles looks for the light of an even world with paths alone, which go on behind all that is transparent.
    """

    def sample(way: Way, points: LitPoints) -> Aim:
        normal = points.shading.normal
        direction = way(normal, points.sampler.uniform_pair())
        density = environment_density(environment, normal, direction)
        share = np.where(density > 0, 1.0 / np.where(density > 0, density, 1.0), 0.0)
        weight = share[:, np.newaxis] * find_environment(environment, direction)
        light = LightSamples(direction, np.full(len(direction), np.inf), weight, density)
        return Aim(light, _fill_keys(points, ALONE))

    even = environment.program is None
    kind = OTHER if even else WORLD
    return [LightSource(partial(sample, way), 1, unstopped=even, kind=kind) for way in list_ways(environment)]


# Shadow rays ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, slots=True)
class ShadowRays:
    """k shadow rays of one source.

    row : (k,) int64, of the batch, that they light
    light : (k, 3) float64, what arrives if nothing is in the way
    key : (k,) int32, as in Aim
    passages : (k,) int32, as in LitPoints
    rays : None where the source throws no shadows
    unstopped, chance : as in LightSource
    """

    row: Indices
    light: Floats
    key: Keys
    passages: Counts
    rays: Rays | None
    unstopped: bool = False
    chance: float = 1.0


def aim_at_lights(
    sources: tuple[LightSource, ...], points: LitPoints, probabilities: Floats, throughput: Floats, row: Indices
) -> list[ShadowRays]:
    """Return shadow rays from n points to one sample of every source, with the light they would bring.

    Parameters
    ----------
    probabilities : (n, options) float64, of `scatter.option_probabilities`
    throughput : (n, 3) float64, what light from these points counts; 0 leaves a point out
    row : (n,) int64, the points' rows of the batch
    """
    aimed = []
    for source in sources:
        points = replace(points, sampler=points.sampler.skip(source.skipped))
        aim = source.sample(points)
        points = replace(points, sampler=points.sampler.skip(source.dimensions))
        light = reflect_light(points.shading, probabilities, aim.light, source.seen_by) * throughput
        if source.find_lit is not None:
            light[~source.find_lit(points.surface.instance)] = 0.0
        lit = np.flatnonzero((aim.light.density > 0) & any_column(light > 0))
        rays = _aim(points.surface, aim.light, lit) if source.cast_shadow else None
        light = take_rows(light, lit)
        passages, chance = points.passages[lit], source.chance
        aimed.append(ShadowRays(row[lit], light, aim.key[lit], passages, rays, source.unstopped, chance))
    return aimed


def _aim(surface: Surface, light: LightSamples, rows: Indices) -> Rays:
    """Return shadow rays from some of the points: to the light's target, if it has one, so that rays which share it end
    at the same point to the last place."""
    direction, reach = light.direction.take(rows, axis=0), light.distance.take(rows)
    origins = spawn_origin(surface.select(rows), direction)
    if light.target is not None and light.reach is not None:
        direction, reach = light.target.take(rows, axis=0) - origins, light.reach.take(rows)
    return Rays(origins, direction, np.zeros(len(rows)), reach)


def cast_shadows(visibility: Visibility, aimed: Sequence[ShadowRays]) -> list[Floats]:
    """Return what share of its light each record's rays let through, (k, 1) or (k, 3); 1 where there are no shadows.

    Rays of one key of one record are cast in a call of their own, all others together.
    """
    casting = [record for record in aimed if record.rays is not None and len(record.row)]
    rays = join_rays([record.rays for record in casting if record.rays is not None])
    key = np.concatenate([np.zeros(0, np.int32), *_number_keys(casting)])
    passages = np.concatenate([np.zeros(0, np.int32), *(record.passages for record in casting)])
    unstopped = np.concatenate(
        [np.zeros(0, np.bool_), *(np.full(len(record.row), record.unstopped) for record in casting)]
    )
    seen = None
    for rows in _split_by_key(key):
        part = visibility(rays.select(rows), passages[rows], unstopped[rows])
        seen = np.empty((len(rays), part.shape[1])) if seen is None else seen
        seen[rows] = part
    shares, start = [], 0
    for record in aimed:
        stop = start + (len(record.row) if record.rays is not None else 0)
        shares.append(np.ones((len(record.row), 1)) if seen is None or record.rays is None else seen[start:stop])
        start = stop
    return shares


def _number_keys(records: Sequence[ShadowRays]) -> Iterator[Keys]:
    """Yield each record's keys, no key of one like a key of another."""
    first = 0
    for record in records:
        yield np.where(record.key == ALONE, ALONE, record.key + first).astype(np.int32)
        first += int(record.key.max()) + 1


def _split_by_key(key: Keys) -> Iterator[Indices | slice]:
    """Yield the rows of each key."""
    if not len(key):
        return
    if (key == key[0]).all():
        yield slice(None)
        return
    order = np.argsort(key, kind="stable")
    ends = np.flatnonzero(np.diff(key[order])) + 1
    yield from np.split(order, ends)


def opaque_visibility(caster: RayCaster, cast: Cast | None = None) -> Visibility:
    """Shadow rays where every surface stops the light: (n, 1), 1 or 0.

    cast : needed where some objects throw no shadows
    """

    def see(rays: Rays, passages: Counts, unstopped: Booleans) -> Floats:
        if cast is not None:
            blocked = cast(rays, classify_shadows(rays)).hit
        else:
            blocked = caster.any_hit(rays.origins, rays.directions, rays.t_min, rays.t_max)
        return np.where(blocked, 0.0, 1.0)[:, np.newaxis]

    return see


def transparent_visibility(cast: Cast, tables: SurfaceTables, materials: MaterialTable, most: int) -> Visibility:
    """Shadow rays that pass through transparent surfaces: (n, 3), the share of light that is left.

    most : straight passages that a path may make together with its shadow ray
    """
    return partial(_see_through, cast, tables, materials, most)


def _see_through(
    cast: Cast,
    tables: SurfaceTables,
    materials: MaterialTable,
    most: int,
    rays: Rays,
    passages: Counts,
    unstopped: Booleans,
) -> Floats:
    left = np.ones((len(rays), 3))
    rows = np.arange(len(rays))
    while len(rows):
        hits = cast(rays, classify_shadows(rays))
        met = np.flatnonzero(hits.hit)
        rays, hits, rows = rays.select(met), hits.select(met), rows[met]
        surface = make_surface(tables, rays, hits)
        left[rows] *= find_transparency(materials, surface, unstopped[rows])
        left[rows[passages[rows] >= most]] = 0.0
        passages = passages + 1
        open_ = np.flatnonzero(any_column(left[rows] > 0))
        rays, surface, rows = rays.select(open_), surface.select(open_), rows[open_]
        reach = rays.t_max - hits.distance[open_]
        rays = Rays(spawn_origin(surface, rays.directions), rays.directions, np.zeros(len(rows)), np.maximum(reach, 0))
    return left
