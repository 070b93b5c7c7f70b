"""What paths see of what shines, and add to the passes: the world, the lights that they meet, and emissive surfaces.

Each adds the share that light sampling (`direct_light`) leaves to rays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from raytracer.arrays.rows import any_column, mean_column, sum_columns, take_rows
from raytracer.arrays.types import Floats, Indices, Integers, Vectors
from raytracer.bsdfs.bounce_kinds import SCATTERED
from raytracer.casting.rays import Hits
from raytracer.integrator.bounces import meet_lights
from raytracer.integrator.clamping import clamp_met
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.light_sources import GEOMETRY, LIGHT, WORLD
from raytracer.integrator.passes.denoising import add_met_guides
from raytracer.integrator.passes.light_passes import add_met
from raytracer.integrator.path_passes import PathPasses
from raytracer.integrator.paths import Paths, Wave
from raytracer.integrator.picked_geometry import find_emitter_factors
from raytracer.integrator.picked_lights import LightGroup, split_by_light
from raytracer.integrator.ray_descriptions import describe_rays
from raytracer.lecture import length
from raytracer.lights.emitter_table import Emitters
from raytracer.lights.emitters import emitter_density
from raytracer.lights.environment import (
    Environment,
    density_everywhere,
    environment_density,
    evaluate_environment,
)
from raytracer.lights.light_nodes import ComputedLight, find_factor
from raytracer.lights.light_shapes import LightHits
from raytracer.lights.light_tree import find_near_lights
from raytracer.lights.lights import evaluate_light
from raytracer.sampling.direction_map import map_density
from raytracer.sampling.warps import power_heuristic
from raytracer.scene.fields import ALL_SETS, SEEN_BY_ALL
from raytracer.scene.light_groups import NO_GROUP
from raytracer.scene.lights import Light
from raytracer.shading.light_path import FARTHEST, LightPath, put_further
from raytracer.surfaces.surface import Surface


def add_background(integrator: Integrator, passes: PathPasses, paths: Paths, hits: Hits) -> None:
    """Rays that hit nothing see the world; where it is left out of the picture, what is seen straight is alpha.

    Passes of it alone, of its group of lights, and what guides denoisers have it all the same, as in Cycles.
    """
    rows = np.flatnonzero(~hits.hit)
    if not len(rows) or (integrator.background is None and not integrator.settings.transparent):
        return
    missed = paths.select(rows)
    if integrator.settings.transparent:
        passes.background[missed.row[missed.direct]] += mean_column(missed.throughput[missed.direct])
        shows = "Environment" in passes.values or passes.guides is not None or bool(passes.light_groups)
        if integrator.background is not None and shows:
            seen = missed.select(missed.direct)
            light = see_background(integrator, integrator.background, seen)
            passes.add("Environment", seen.row, light)
            passes.add_grouped(seen.row, light, integrator.world_group)
            add_met_guides(passes, seen, light)
        missed = missed.select(~missed.direct)
    if integrator.background is not None and len(missed):
        light = see_background(integrator, integrator.background, missed)
        add_met(passes, missed, light, "Environment", integrator.world_group)
        if passes.backdrop is not None:
            passes.backdrop[missed.row[missed.direct]] += light[missed.direct]


def see_background(integrator: Integrator, background: Environment, paths: Paths) -> Floats:
    """Return what the world adds to paths (k, 3) that see it, in the share that light sampling leaves to them."""
    directions = paths.rays.directions
    sampled = environment_density(background, paths.scatter_normal, directions)
    if paths.media is not None:
        rows = np.flatnonzero(paths.kind == SCATTERED)
        sampled[rows] = density_everywhere(background, directions[rows])
    if background.max_bounces is not None and background.grid is not None:
        # Cycles' share of those that come from where the world is no light: it samples by the map alone.
        unlit = np.flatnonzero(sum_columns(paths.bounces) > background.max_bounces + 1)
        sampled[unlit] = map_density(background.grid, directions[unlit])
    sampled = integrator.share_density(WORLD, sampled)
    share = power_heuristic(paths.density, sampled)[:, np.newaxis]
    path = put_further(describe_rays(paths, FARTHEST)) if background.program is not None else None
    radiance = evaluate_environment(background, directions, path)
    if background.seen_by != SEEN_BY_ALL:
        share *= meet_lights(paths.kind, background.seen_by)[:, np.newaxis]
    return clamp_met(integrator.settings, paths.bounces, paths.throughput * share * radiance)


# What share (k, 3) of light gets to rays, some rows (k,) of a wave, from so many metres (k,) away.
Dim = Callable[[Indices, Floats], Floats]


def add_visible_lights(
    integrator: Integrator, passes: PathPasses, paths: Paths, hits: Hits, dim: Dim | None = None
) -> None:
    """Rays see the lights that they pass before they hit, if those are for them to see.

    dim : what media on the way do to their light; None where there are none
    """
    if integrator.visible_lights:
        directions = find_unit_directions(paths)
        for light in integrator.visible_lights:
            add_visible_light(integrator, light, passes, paths, hits, directions, dim=dim)
    for group in integrator.visible_groups:
        add_visible_group(integrator, group, passes, paths, hits, dim)


def find_unit_directions(paths: Paths) -> Vectors:
    """Return the unit directions (n, 3) of paths: those of camera rays may have any length."""
    return paths.rays.directions / length(paths.rays.directions)[:, np.newaxis]


def add_visible_group(
    integrator: Integrator, group: LightGroup, passes: PathPasses, paths: Paths, hits: Hits, dim: Dim | None = None
) -> None:
    """Add what rays see of many lights; dim : as of `add_visible_lights`."""
    rows = np.flatnonzero(meet_lights(paths.kind, group.example.seen_by))
    paths, hits = paths.select(rows), hits.select(rows)
    ray, number = find_near_lights(group.tree, paths.scatter_origin, paths.rays.directions)
    chance = find_chances(group, paths, ray, number)
    for light, pairs in split_by_light(group, number):
        within = None if dim is None else partial(_dim_some, dim, rows[ray[pairs]])
        met, stops = paths.select(ray[pairs]), hits.select(ray[pairs])
        directions = find_unit_directions(met)
        add_visible_light(integrator, light, passes, met, stops, directions, chance[pairs], within)


def find_chances(group: LightGroup, paths: Paths, ray: Indices, light: Integers) -> Floats:
    """Return the probabilities (k,) with which lights (k,) were aimed at where the rays (k,) of paths come from; 1 for
    those that no light sample could have taken."""
    chance = np.ones(len(ray))
    rows = np.flatnonzero(np.isfinite(paths.density.take(ray)))
    near, row = np.unique(ray.take(rows), return_inverse=True)
    points = group.describe(paths.scatter_origin[near], paths.scatter_normal[near], paths.scatterer[near])
    chance[rows] = group.find_chances(light.take(rows), row, points)
    return chance


def _dim_some(dim: Dim, chosen: Indices, rows: Indices, distance: Floats) -> Floats:
    """Return what `dim` makes of light that comes to some of the `chosen` rays."""
    return dim(chosen[rows], distance)


def add_visible_light(
    integrator: Integrator,
    light: Light,
    passes: PathPasses,
    paths: Paths,
    hits: Hits,
    directions: Vectors,
    chance: Floats | float = 1.0,
    dim: Dim | None = None,
) -> None:
    """Add what rays see of one light.

    directions : (n, 3) unit, of the paths
    chance : with which the light was aimed at where the rays come from, one for all or (n,)
    dim : as of `add_visible_lights`
    """
    seen = evaluate_light(light, paths.scatter_origin, directions)
    rows = np.flatnonzero(seen.density > 0)  # few
    if not len(rows):
        return
    paths, seen = paths.select(rows), seen.select(rows)
    passed = (paths.travelled < seen.distance) | (paths.travelled == 0)
    unit, rays = length(paths.rays.directions), paths.rays
    passed &= seen.distance <= hits.distance[rows] * unit
    clipped = (seen.distance < rays.t_min * unit) | (seen.distance > rays.t_max * unit)
    passed &= ~(paths.direct & np.isfinite(seen.distance) & clipped)  # of cameras; a sun has no place to be clipped at
    passed &= meet_lights(paths.kind, light.seen_by)
    if integrator.links is not None:
        passed &= paths.direct | integrator.links.find_lit(light.receivers, paths.scatterer)
    if integrator.caustics is not None:
        passed &= ~integrator.caustics.leaves(light, paths)
    if light.blockers != ALL_SETS:
        passed &= paths.direct  # `shadow_linking` sees to what others meet
    kept = np.flatnonzero(passed)
    if len(kept):
        rows, paths, seen = rows[kept], paths.select(kept), seen.select(kept)
        chance = chance if isinstance(chance, float) else chance[rows]
        if dim is not None:
            paths = replace(paths, throughput=paths.throughput * dim(rows, seen.distance))
        add_light_met(integrator, light, passes, paths, seen, chance)


def add_light_met(
    integrator: Integrator,
    light: Light,
    passes: PathPasses,
    paths: Paths,
    seen: LightHits,
    chance: Floats | float = 1.0,
) -> None:
    """Add what paths (k,) that meet a light see of it; chance : as of `add_visible_light`."""
    sampled = seen.density * chance
    sampled = integrator.share_density(LIGHT, sampled)
    share = power_heuristic(paths.density, sampled)[:, np.newaxis]
    computed = integrator.light_nodes.get(light)
    radiance = seen.radiance if computed is None else vary_seen(computed, paths, seen)
    radiance = clamp_met(integrator.settings, paths.bounces, paths.throughput * share * radiance)
    add_met(passes, paths, radiance, "Emission", integrator.find_group(light))


def vary_seen(computed: ComputedLight, paths: Paths, seen: LightHits) -> Floats:
    """Return the radiance (n, 3) that paths see of a light, in what its nodes make of it.

    As in Cycles, what kind of ray it is, a light is never told: it would not be where it is sampled either.
    """
    unit = length(paths.rays.directions)
    told = describe_rays(paths, (np.minimum(seen.distance, FARTHEST) - paths.travelled) / unit).values
    known = {name: told[name] for name in ("length", "travelled")}
    path = put_further(LightPath(known | {name: values for name, values in told.items() if name.endswith("depth")}))
    directions = paths.rays.directions / unit[:, np.newaxis]
    return seen.radiance * find_factor(computed, paths.scatter_origin, directions, seen.distance, path)


def add_emission(integrator: Integrator, passes: PathPasses, wave: Wave) -> None:
    """Add the emission of the surface that is hit, in the share that light sampling leaves to reflected rays."""
    if integrator.emitters is None:
        return
    shines = any_column(wave.shading.radiance != 0)
    if integrator.shadow_links is not None:
        linked = integrator.shadow_links.is_linked(wave.surface.instance)
        shines &= wave.paths.direct | ~linked  # `shadow_linking` sees to the others
    rows = np.flatnonzero(shines)  # few, mostly
    if len(rows):
        paths, surface = wave.paths.select(rows), wave.surface.select(rows)
        radiance = take_rows(wave.shading.radiance, rows)
        add_emission_met(integrator, integrator.emitters, passes, paths, surface, radiance)


def add_emission_met(
    integrator: Integrator, emitters: Emitters, passes: PathPasses, paths: Paths, surface: Surface, radiance: Floats
) -> None:
    """Add what paths see of surfaces that they meet, which shine with `radiance` (k, 3)."""
    share = np.ones(len(paths))
    sampled = np.flatnonzero(np.isfinite(paths.density))
    other = emitter_density(
        emitters,
        take_rows(paths.scatter_origin, sampled),
        take_rows(paths.rays.directions, sampled),
        surface.instance[sampled],
        surface.primitive[sampled],
    )
    if integrator.emitter_group is not None:
        other *= find_emitter_factors(
            integrator.emitter_group, integrator.links, paths.select(sampled), surface.instance[sampled]
        )
    share[sampled] = power_heuristic(paths.density[sampled], integrator.share_density(GEOMETRY, other))
    if integrator.links is not None:
        lit = integrator.links.find_lit(integrator.links.receivers[surface.instance], paths.scatterer)
        share[~(paths.direct | lit)] = 0.0
    light = clamp_met(integrator.settings, paths.bounces, paths.throughput * radiance * share[:, np.newaxis])
    group = NO_GROUP if integrator.grouped is None else integrator.grouped.of_objects[surface.instance]
    add_met(passes, paths, light, "Emission", group)
