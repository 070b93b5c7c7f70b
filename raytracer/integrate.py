"""What rays see: the lecture's "Ray Tracing Fundamentals", recursive ray tracing written as a loop.

Find the closest hit, add what shines there, aim at every source of light, go on through mirrors and glass, and, where
paths are traced, by diffuse reflection; cast the shadow rays. `prepare` composes once, from the scene's content, which
stages run; `trace` runs them on a batch of rays, wave by wave. Passes mean what they mean in Cycles
(intern/cycles/kernel/film/data_passes.h). Imports everything below it but the camera.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.accelerate import Caster
from raytracer.bounces import (
    CERTAIN_BOUNCES,
    DIFFUSE,
    STRAIGHT,
    count_bounces,
    describe_kinds,
    find_ended,
    survival_probability,
)
from raytracer.closures import Shading
from raytracer.computed import list_scene_attributes
from raytracer.direct_light import (
    LightSource,
    LitPoints,
    ShadowRays,
    Visibility,
    aim_at_lights,
    cast_shadows,
    emitter_source,
    lamp_source,
    opaque_visibility,
    transparent_visibility,
    world_source,
)
from raytracer.emitters import Emitters, emitter_density, make_emitters
from raytracer.environment import Environment, environment_density, find_environment, make_environment
from raytracer.features import derive_features
from raytracer.lecture import length
from raytracer.lights import evaluate_light, has_extent
from raytracer.materials import MaterialTable, find_radiance, make_material_table, make_shading
from raytracer.paths import Paths, Record, advance, join_paths, start_paths, start_record
from raytracer.rays import Booleans, Floats, Hits, Rays, Surface
from raytracer.records import SEEN_BY, SEEN_BY_ALL
from raytracer.sampling import PixelSamples, SharedSamples, share_samples
from raytracer.scatter import Continuation, option_probabilities, power_heuristic, sample_continuation
from raytracer.scene import Light, Scene
from raytracer.settings import Settings
from raytracer.site_tables import make_site_tables
from raytracer.sites import LightPath
from raytracer.surface import SurfaceTables, make_surface, make_surface_tables
from raytracer.visibility import Cast, classify_rays, make_cast

# Passes that need light; the others are known at the first surface.
LIGHT_PASSES = frozenset(("Combined", "Diffuse Color", "Emission", "Shadow"))
# Cycles' default: Normal, UV, Depth and so on belong to the first surface at least this opaque.
OPAQUE_ENOUGH = 0.5
# Numbered dimensions of a wave: which way to go on, and where within it; the sources of light follow, and last the
# chance to be cut short.
CHOICE, WAY, FIRST_SOURCE = range(3)
# Paths shaded together; casts take whole waves.
PART_SIZE = 1 << 15
# Most shadow rays that are kept to be cast together; bounds the memory that many lamps take.
SHADOW_BATCH = 1 << 20
# How far rays go that hit nothing, as programs of worlds see it: Cycles' largest number.
FARTHEST = float(np.finfo(np.float32).max)
# What programs of materials that ask for the picture's size get where there is none.
DEFAULT_FRAME = (1000, 1000)


@dataclass(frozen=True, eq=False)
class Integrator:
    """The stages that a scene and its settings need.

    sources : one for each source of light that surfaces are lit by
    visible_lamps : lamps that a reflected ray can meet
    emitters : None where nothing shines
    background : the world, or None where it is black
    cast : finds what rays hit of what they see
    visibility : how shadow rays fare
    holdout : (instances + groups,) bool, or None where nothing punches holes
    pass_index : (instances + groups,) int32
    needs_light : False where all passes are known at the first surface
    goes_on : True where rays can go on from a surface
    interreflects : True where diffuse reflection is followed
    shines : True where a ray that goes on can meet something that shines
    dimensions : numbered dimensions of a wave
    """

    cast: Cast
    settings: Settings
    tables: SurfaceTables
    materials: MaterialTable
    sources: tuple[LightSource, ...]
    visible_lamps: tuple[Light, ...]
    emitters: Emitters | None
    background: Environment | None
    visibility: Visibility
    holdout: Booleans | None
    pass_index: NDArray[np.int32]
    needs_light: bool
    goes_on: bool
    interreflects: bool
    shines: bool
    dimensions: int


def prepare(scene: Scene, caster: Caster, settings: Settings, frame: tuple[int, int] = DEFAULT_FRAME) -> Integrator:
    """Compose the stages that `scene` needs for the passes in `settings`; frame : size of the full picture, pixels."""
    features = derive_features(scene)
    needs_light = not LIGHT_PASSES.isdisjoint(settings.passes)
    tables = make_surface_tables(
        scene,
        caster.geometry,
        features.smooth_normals,
        uvs=features.uvs and "UV" in settings.passes,
        barycentric=features.programs,
        roundoff=caster.roundoff,
    )
    sites = make_site_tables(scene, tables, list_scene_attributes(scene), frame) if features.programs else None
    materials = make_material_table(scene, sites)
    emitters = None
    if features.emission and needs_light:
        emitters = make_emitters(tables, materials.radiance, partial(find_radiance, materials))
    background = None
    if features.world and needs_light and scene.world is not None:
        background = make_environment(scene.world, scene.camera, frame)
    lamps = [light for light in scene.lights if light_is_on(light)] if needs_light else []
    interreflects = settings.integrator == "path" and features.diffuse and needs_light
    sources = [lamp_source(light, weigh=features.rough or interreflects) for light in lamps]
    if emitters is not None and not emitters.is_empty:
        sources.append(emitter_source(emitters))
    if background is not None:
        sources.append(world_source(background))
    reflects = features.mirrors or interreflects
    meeting = SEEN_BY_ALL - SEEN_BY["shadow"] if reflects else SEEN_BY["camera"]
    visible_lamps = tuple(light for light in lamps if has_extent(light) and light.seen_by & meeting)
    seen_by = _gather_records(scene, "seen_by", np.int32).astype(np.uint8) if features.ray_visibility else None
    cast = make_cast(caster, seen_by)
    if features.transparency:
        visibility = transparent_visibility(cast, tables, materials, settings.transparent_bounces)
    else:
        visibility = opaque_visibility(caster, None if seen_by is None else cast)
    return Integrator(
        cast=cast,
        settings=settings,
        tables=tables,
        materials=materials,
        sources=tuple(sources),
        visible_lamps=visible_lamps,
        emitters=emitters,
        background=background,
        visibility=visibility,
        holdout=_gather_records(scene, "holdout", np.bool_) if features.holdout else None,
        pass_index=_gather_records(scene, "pass_index", np.int32),
        needs_light=needs_light,
        goes_on=features.mirrors or features.transparency or interreflects,
        interreflects=interreflects,
        shines=bool(visible_lamps) or emitters is not None or background is not None,
        dimensions=FIRST_SOURCE + sum(source.dimensions for source in sources) + interreflects,
    )


def light_is_on(light: Light) -> bool:
    """True where a lamp sends any light."""
    power = light.strength if hasattr(light, "strength") else light.power
    return bool(power.max() > 0)


def _gather_records(scene: Scene, name: str, dtype: type) -> NDArray[Any]:
    """Return a property of all instances, then of all groups of spheres."""
    instances = None if scene.instances is None else getattr(scene.instances, name)
    if instances is None:
        default = SEEN_BY_ALL if name == "seen_by" else 0
        instances = np.full(scene.instance_count, default, dtype)
    return np.concatenate([instances, np.array([getattr(group, name) for group in scene.spheres], dtype=dtype)])


def trace(integrator: Integrator, rays: Rays, samples: PixelSamples) -> dict[str, Floats]:
    """Return what n rays see: (n, channels) float64 for each of the settings' passes.

    Parameters
    ----------
    integrator : of `prepare`
    rays : n camera rays, of any length of direction; t is the depth
    samples : n PixelSamples
    """
    record = start_record(integrator.settings, rays)
    paths = start_paths(rays)
    shared = share_samples(samples)
    dimension = 0
    while len(paths):
        hits = integrator.cast(paths.rays, classify_rays(paths.kind))
        add_background(integrator, record, paths, hits)
        add_lamps(integrator, record, paths, hits)
        met = np.flatnonzero(hits.hit)
        paths, hits = cut_holes(integrator, record, paths.select(met), hits.select(met))
        paths = shade_wave(integrator, record, paths, hits, samples, shared, dimension)
        dimension += integrator.dimensions
        shared = None  # only what the camera sees straight shares points of lights
    finish_alpha(integrator, record)
    if record.unshadowed is not None:
        record.passes["Shadow"] = divide_shadow(record.passes["Shadow"], record.unshadowed)
    return record.passes


@dataclass(frozen=True, eq=False, slots=True)
class Shaded:
    """What a part of a wave leaves to do: shadow rays to cast, and paths that go on."""

    aimed: list[ShadowRays]
    paths: Paths


def describe_path(integrator: Integrator, paths: Paths, hits: Hits) -> LightPath | None:
    """Return what programs of materials can ask of the rays; None where there are no programs."""
    return None if integrator.materials.computed is None else describe_rays(paths, hits.distance)


def describe_rays(paths: Paths, distance: Floats | float) -> LightPath:
    """Return what programs can ask of rays that go for a distance (n,), in units of their directions' lengths."""
    unit = length(paths.rays.directions)
    stretch = distance * unit
    return LightPath(
        {
            **describe_kinds(paths.kind, paths.bounces),
            "length": stretch - paths.rays.t_min * unit,
            "travelled": paths.travelled + stretch,
            "transparent_depth": paths.passages.astype(np.float64),
        }
    )


def shade_wave(
    integrator: Integrator,
    record: Record,
    paths: Paths,
    hits: Hits,
    samples: PixelSamples,
    shared: SharedSamples | None,
    dimension: int,
) -> Paths:
    """Shade all hits, in parts that stay in the cache, cast their shadow rays together; return the paths that go on."""
    going_on, waiting = [], []
    for start in range(0, len(paths), PART_SIZE):
        part = slice(start, start + PART_SIZE)
        shaded = shade(integrator, record, paths.select(part), hits.select(part), samples, shared, dimension)
        going_on.append(shaded.paths)
        waiting += shaded.aimed
        if sum(len(rays.row) for rays in waiting) >= SHADOW_BATCH:
            add_direct_light(integrator, record, waiting, first=dimension == 0)
            waiting = []
    if waiting:
        add_direct_light(integrator, record, waiting, first=dimension == 0)
    return join_paths(going_on)


def shade(
    integrator: Integrator,
    record: Record,
    paths: Paths,
    hits: Hits,
    samples: PixelSamples,
    shared: SharedSamples | None,
    dimension: int,
) -> Shaded:
    """See what is where rays hit: describe it, add what shines there, aim at the lights, and go on."""
    surface = make_surface(integrator.tables, paths.rays, hits)
    shading = make_shading(integrator.materials, surface, describe_path(integrator, paths, hits))
    describe_surface(integrator, record, paths, hits, surface, shading)
    add_emission(integrator, record, paths, surface, shading)
    if not integrator.needs_light:
        return Shaded([], pass_straight(integrator, record, paths, hits, surface, shading))
    chosen = samples.select(paths.row)
    shared = shared and shared.select(paths.row)
    ended = find_ended(paths.bounces, integrator.settings) | find_closed(integrator, paths)
    probabilities = weigh_options(integrator, paths, shading, ended)
    aimed = aim_at_lights(
        integrator.sources,
        LitPoints(surface, shading, paths.passages, chosen, shared, dimension + FIRST_SOURCE),
        probabilities,
        np.where(ended[:, np.newaxis], 0.0, paths.throughput),
        paths.row,
    )
    if not integrator.goes_on:
        return Shaded(aimed, paths.select(slice(0, 0)))
    way = sample_continuation(
        shading, probabilities, chosen.uniform(dimension + CHOICE), chosen.uniform_pair(dimension + WAY)
    )
    way = cut_short(integrator, paths, way, chosen, dimension + integrator.dimensions - 1)
    return Shaded(aimed, advance(paths, hits, surface, shading, way))


def add_background(integrator: Integrator, record: Record, paths: Paths, hits: Hits) -> None:
    """Rays that hit nothing see the world; where it is left out of the picture, what is seen straight is alpha."""
    missed = paths.select(np.flatnonzero(~hits.hit))
    if integrator.settings.transparent:
        record.background[missed.row[missed.direct]] += missed.throughput[missed.direct].mean(axis=1)
        missed = missed.select(~missed.direct)
    if integrator.background is not None and len(missed):
        directions = missed.rays.directions
        sampled = environment_density(integrator.background, missed.scatter_normal, directions)
        share = power_heuristic(missed.density, sampled)[:, np.newaxis]
        path = describe_rays(missed, FARTHEST) if integrator.background.program is not None else None
        radiance = find_environment(integrator.background, directions, path)
        record.add("Combined", missed.row, missed.throughput * share * radiance)


def add_lamps(integrator: Integrator, record: Record, paths: Paths, hits: Hits) -> None:
    """Rays see the lamps that they pass before they hit, if those are for them to see."""
    for lamp in integrator.visible_lamps:
        add_lamp(lamp, record, paths, hits)


def add_lamp(lamp: Light, record: Record, paths: Paths, hits: Hits) -> None:
    """Add what rays see of one lamp; the directions of camera rays may have any length."""
    rows = np.flatnonzero(classify_rays(paths.kind) & lamp.seen_by)
    paths = paths.select(rows)
    unit = length(paths.rays.directions)
    seen = evaluate_light(lamp, paths.scatter_origin, paths.rays.directions / unit[:, np.newaxis])
    reach = paths.travelled + hits.distance[rows] * unit
    passed = (seen.density > 0) & (paths.travelled <= seen.distance) & (seen.distance <= reach)
    share = np.where(passed, power_heuristic(paths.density, seen.density), 0.0)[:, np.newaxis]
    radiance = paths.throughput * share * seen.radiance
    record.add("Combined", paths.row, radiance)
    record.add("Emission", paths.row[paths.direct], radiance[paths.direct])


def cut_holes(integrator: Integrator, record: Record, paths: Paths, hits: Hits) -> tuple[Paths, Hits]:
    """End paths that go straight into a holdout object: black, and no part of the picture."""
    if integrator.holdout is None:
        return paths, hits
    cut = paths.direct & integrator.holdout[hits.instance]
    if integrator.settings.transparent:
        record.background[paths.row[cut]] += paths.throughput[cut].mean(axis=1)
    return paths.select(~cut), hits.select(~cut)


def describe_surface(
    integrator: Integrator, record: Record, paths: Paths, hits: Hits, surface: Surface, shading: Shading
) -> None:
    """Fill the passes that describe the first opaque surface straight ahead of the camera."""
    direct = np.flatnonzero(paths.direct)
    record.add("Diffuse Color", paths.row[direct], (paths.throughput * shading.sum_diffuse())[direct])
    rows = direct[~record.settled[paths.row[direct]]]
    row = paths.row[rows]
    stretch = hits.distance[rows] * length(paths.rays.directions[rows])
    record.set("Depth", row, (paths.travelled[rows] + stretch) / record.depth_unit[row])
    record.set("Position", row, surface.position[rows])
    record.set("Object Index", row, integrator.pass_index[surface.instance[rows]])
    record.set("Material Index", row, integrator.materials.pass_index[surface.material[rows]])
    opaque = shading.transparency[rows].mean(axis=1) <= 1.0 - OPAQUE_ENOUGH
    rows, row = rows[opaque], row[opaque]
    record.set("Normal", row, shading.average_normal()[rows])
    uv = np.zeros((len(surface), 2)) if surface.uv is None else surface.uv
    record.set("UV", row, np.pad(uv[rows], ((0, 0), (0, 1)), constant_values=1.0))
    record.settled[row] = True


def add_emission(integrator: Integrator, record: Record, paths: Paths, surface: Surface, shading: Shading) -> None:
    """Add what shines at the hit, in the share that light sampling leaves to reflected rays."""
    if integrator.emitters is None:
        return
    share = np.ones(len(paths))
    sampled = np.flatnonzero(np.isfinite(paths.density))
    other = emitter_density(
        integrator.emitters,
        paths.scatter_origin[sampled],
        paths.rays.directions[sampled],
        surface.instance[sampled],
        surface.primitive[sampled],
    )
    share[sampled] = power_heuristic(paths.density[sampled], other)
    radiance = paths.throughput * shading.radiance * share[:, np.newaxis]
    record.add("Combined", paths.row, radiance)
    record.add("Emission", paths.row[paths.direct], radiance[paths.direct])


def find_closed(integrator: Integrator, paths: Paths) -> Booleans:
    """Return (n,) True for paths that have gone straight as often as they may: they see what shines, and end."""
    return paths.passages >= max(integrator.settings.transparent_bounces, 1)


def weigh_options(integrator: Integrator, paths: Paths, shading: Shading, ended: Booleans) -> Floats:
    """Return the probabilities of the ways to go on.

    A path that has used up its bounces still sees what shines where it ends: light sampling has counted on that. Where
    diffuse reflection is the only bounce, and would be the last, light sampling is left all of it; not so where
    geometry shines, for close by, in corners, no other way of sampling keeps the noise finite.
    """
    probabilities = option_probabilities(shading, integrator.interreflects)
    if ended.any():
        open_ = ended & ~find_closed(integrator, paths)
        probabilities[ended, 0] = (open_ & (shading.transparency > 0).any(axis=1))[ended]
        probabilities[ended, 1:] = 0.0
    if integrator.interreflects and integrator.emitters is None:
        first = 1 + len(shading.lobes)
        kind = np.full(len(paths), DIFFUSE, dtype=np.uint8)
        last = find_ended(count_bounces(paths.bounces, kind), integrator.settings)
        last &= ~probabilities[:, 1:first].any(axis=1)
        probabilities[last, 0] = probabilities[last, 0] > 0
        probabilities[last, first:] = 0.0
    return probabilities


def cut_short(
    integrator: Integrator, paths: Paths, way: Continuation, samples: PixelSamples, dimension: int
) -> Continuation:
    """End paths that could see nothing but what shines, where nothing does, and some of those that carry little light
    (Russian roulette), for which the others count more."""
    counts = count_bounces(paths.bounces, way.kind)
    if not integrator.shines:
        way.weight[find_ended(counts, integrator.settings)] = 0.0
    if not integrator.interreflects:
        return way
    rows = np.flatnonzero(way.alive & (counts.sum(axis=1) > CERTAIN_BOUNCES))
    probability = survival_probability(paths.throughput[rows] * way.weight[rows])
    survives = samples.select(rows).uniform(dimension) < probability
    way.weight[rows] = np.where(survives, 1.0 / probability, 0.0)[:, np.newaxis] * way.weight[rows]
    return way


def add_direct_light(integrator: Integrator, record: Record, aimed: list[ShadowRays], first: bool) -> None:
    """Cast shadow rays and add the light that they let through, of the camera's own rays (`first`) also to Shadow."""
    for rays, share in zip(aimed, cast_shadows(integrator.visibility, aimed), strict=True):
        arriving = rays.light * share
        record.add("Combined", rays.row, arriving)
        if first and record.unshadowed is not None:
            record.add("Shadow", rays.row, arriving)
            record.unshadowed[rays.row] += rays.light


def divide_shadow(arriving: Floats, unshadowed: Floats) -> Floats:
    """The Shadow pass: the share of the direct light that reaches the first surface; where none could, nothing does."""
    return np.divide(arriving, unshadowed, out=np.zeros_like(arriving), where=unshadowed > 0)


def pass_straight(
    integrator: Integrator, record: Record, paths: Paths, hits: Hits, surface: Surface, shading: Shading
) -> Paths:
    """Without light, only rays that have not found their opaque surface go on, and straight."""
    way = Continuation(
        direction=-shading.outgoing,
        weight=shading.transparency * (~record.settled[paths.row] & ~find_closed(integrator, paths))[:, np.newaxis],
        density=np.full(len(paths), np.inf),
        kind=np.full(len(paths), STRAIGHT, dtype=np.uint8),
    )
    return advance(paths, hits, surface, shading, way)


def finish_alpha(integrator: Integrator, record: Record) -> None:
    """Alpha is what did not reach a background left out of the picture."""
    if "Combined" in record.passes:
        record.passes["Combined"][:, 3] = 1.0 - record.background
