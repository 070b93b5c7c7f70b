"""What paths add to the passes: the world and the lights that they see, emission, and what the first surface is.

Passes mean what they mean in Cycles (intern/cycles/kernel/film/data_passes.h).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from raytracer.arrays.rows import any_column, mean_column, sum_columns, take_rows
from raytracer.arrays.types import Booleans, Floats, Indices, Integers, Vectors
from raytracer.bsdfs.bounce_kinds import SCATTERED, describe_kinds
from raytracer.bsdfs.lobe_colors import sum_lobe_colors
from raytracer.casting.rays import Hits
from raytracer.film.mattes import add_coverage
from raytracer.film.passes import matte_table
from raytracer.integrator.bounces import meet_lights
from raytracer.integrator.clamping import clamp_met
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.light_sources import GEOMETRY, LIGHT, WORLD
from raytracer.integrator.passes.denoising import add_met_guides
from raytracer.integrator.passes.light_passes import add_met
from raytracer.integrator.paths import PathPasses, Paths, Wave
from raytracer.integrator.picked_geometry import find_emitter_factors
from raytracer.integrator.picked_lights import LightGroup, split_by_light
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
from raytracer.sampling.sampler import Sampler
from raytracer.sampling.warps import power_heuristic
from raytracer.scene.fields import ALL_SETS, SEEN_BY_ALL
from raytracer.scene.light_groups import NO_GROUP
from raytracer.scene.lights import Light
from raytracer.shading.light_path import FARTHEST, LightPath, put_further
from raytracer.shading.probes import Probe
from raytracer.surfaces.screen_motion import find_vectors
from raytracer.surfaces.surface import Surface

# Cycles' default: Normal, UV, Depth and so on belong to the first surface at least this opaque.
OPAQUE_ENOUGH = 0.5


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
    passed &= seen.distance <= hits.distance[rows] * length(paths.rays.directions)
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


def cut_holes(integrator: Integrator, passes: PathPasses, paths: Paths, hits: Hits) -> tuple[Paths, Hits]:
    """End paths that go straight into a holdout object: black, and no part of the picture."""
    if integrator.holdout is None:
        return paths, hits
    cut = paths.direct & integrator.holdout[hits.instance]
    passes.background[paths.row[cut]] += mean_column(paths.throughput[cut])
    return paths.select(~cut), hits.select(~cut)


def punch_holes(passes: PathPasses, wave: Wave) -> Booleans | None:
    """Take the holdout closures of surfaces that are seen straight out of the picture, whatever its background; return
    where nothing else is left (n,), or None where no material has any."""
    paths, holdout = wave.paths, wave.shading.holdout
    if holdout is None:
        return None
    rows = np.flatnonzero(paths.direct)
    passes.background[paths.row[rows]] += mean_column(paths.throughput[rows]) * holdout[rows]
    return holdout >= 1.0


def describe_surface(integrator: Integrator, passes: PathPasses, wave: Wave) -> None:
    """Fill the passes that describe the first opaque surface straight ahead of the camera; what is a hole is none."""
    paths, surface, shading = wave.paths, wave.surface, wave.shading
    holes = punch_holes(passes, wave)
    if paths.media is not None:  # the mere border of a medium is nothing to see
        is_border = paths.media.index.is_border[surface.material]
        holes = is_border if holes is None else holes | is_border
    direct = np.flatnonzero(paths.direct if holes is None else paths.direct & ~holes)
    if not len(direct):
        return
    if "Diffuse Color" in passes.values:
        passes.add("Diffuse Color", paths.row[direct], (paths.throughput * shading.sum_diffuse())[direct])
    if "Glossy Color" in passes.values or "Transmission Color" in passes.values:
        for name, color in zip(("Glossy Color", "Transmission Color"), sum_lobe_colors(shading), strict=True):
            passes.add(name, paths.row[direct], (paths.throughput * color)[direct])
    for kind, identity in integrator.mattes.items():
        seen = surface.material if kind == "Material" else surface.instance
        share = mean_column(paths.throughput[direct]) * (1.0 - mean_column(shading.passage[direct]))
        add_coverage(passes.values[matte_table(kind)], paths.row[direct], identity[seen[direct]], share)
    if "Mist" in passes.values:
        add_mist(integrator, passes, wave, direct)
    rows = direct[~passes.found[paths.row[direct]]]
    if not len(rows):
        return
    row = paths.row[rows]
    if "Depth" in passes.values:
        passes.set("Depth", row, find_depths(integrator, passes, wave, rows))
    if "Position" in passes.values:
        passes.set("Position", row, take_rows(surface.position, rows))
    passes.set("Object Index", row, integrator.pass_index[surface.instance[rows]])
    passes.set("Material Index", row, integrator.materials.pass_index[surface.material[rows]])
    if integrator.screen_motion is not None:
        which = surface.instance[rows], surface.primitive[rows], wave.hits.barycentric[rows]
        passes.set("Vector", row, find_vectors(integrator.screen_motion, surface.position[rows], *which))
    opaque = mean_column(take_rows(shading.passage, rows)) <= 1.0 - OPAQUE_ENOUGH
    rows, row = rows[opaque], row[opaque]
    if "Normal" in passes.values:
        passes.set("Normal", row, shading.average_normal()[rows])
    if surface.uv is not None:
        mapped = ~np.isnan(surface.uv[rows, 0])
        uv = surface.uv[rows[mapped]]
        passes.set("UV", row[mapped], np.pad(uv, ((0, 0), (0, 1)), constant_values=1.0))
    passes.found[row] = True


def find_depths(integrator: Integrator, passes: PathPasses, wave: Wave, rows: Indices) -> Floats:
    """Return how far before the camera (k,) the surfaces at `rows` of a wave are that it sees."""
    paths = wave.paths
    stretch = wave.hits.distance[rows] * length(paths.rays.directions[rows])
    depth = stretch / passes.depth_unit[paths.row[rows]]
    if paths.portals is not None and integrator.measure_depth is not None:
        moved = np.flatnonzero(paths.portals[rows])
        depth[moved] = integrator.measure_depth(wave.surface.position[rows[moved]])
    return depth


def add_mist(integrator: Integrator, passes: PathPasses, wave: Wave, rows: Indices) -> None:
    """Mist thickens by a power of the distance from the camera, from where it starts to where nothing else is seen."""
    start, depth, power = integrator.settings.mist
    distance = length(wave.surface.position[rows] - integrator.eye) if integrator.eye is not None else None
    if distance is None:  # there is no eye that all rays of an orthographic camera come from
        distance = np.abs(find_depths(integrator, passes, wave, rows))
    share = np.clip((distance - start) / depth if depth > 0 else np.sign(distance - start), 0.0, 1.0) ** power
    opaque = mean_column(wave.paths.throughput[rows] * (1.0 - wave.shading.passage[rows]))
    passes.add("Mist", wave.paths.row[rows], (-(1.0 - share) * opaque)[:, np.newaxis])


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


def describe_path(
    integrator: Integrator, paths: Paths, hits: Hits, surface: Surface, sampler: Sampler
) -> LightPath | None:
    """Return what programs of materials can ask of the rays; None where there are no programs.

    sampler : of the batch's rays
    """
    if integrator.materials.computed is None:
        return None
    path = describe_rays(paths, hits.distance)
    if integrator.program_caster is None or integrator.dimensions.programs is None:
        return path
    own = sampler.select(paths.row).skip(integrator.dimensions.programs)
    return replace(path, probe=Probe(surface, integrator.program_caster, own, 1, paths.rarest))


def describe_rays(paths: Paths, distance: Floats | float) -> LightPath:
    """Return what programs can ask of rays that go for a distance (n,), in units of their directions' lengths."""
    unit = length(paths.rays.directions)
    travelled = distance * unit
    return LightPath(
        {
            **describe_kinds(paths.kind, paths.bounces),
            # From the last bounce, or the camera's near clip, also where the ray has passed surfaces straight.
            "length": travelled - paths.rays.t_min * unit,
            "travelled": travelled,
            "transparent_depth": paths.passages.astype(np.float64),
            **({} if paths.portals is None else {"portal_depth": paths.portals.astype(np.float64)}),
        }
    )


def divide_shadow(arriving: Floats, unshadowed: Floats) -> Floats:
    """The Shadow pass: the share of the direct light that reaches the first surface; where none could, nothing does."""
    return np.divide(arriving, unshadowed, out=np.zeros_like(arriving), where=unshadowed > 0)


def finish_alpha(integrator: Integrator, passes: PathPasses) -> None:
    """Alpha is what did not reach a background left out of the picture."""
    if "Combined" in passes.values:
        passes.values["Combined"][:, 3] = 1.0 - passes.background
