"""The light loop: what every source sends to shading points, and what they reflect of it, before shadow rays are cast.

`light_sources` samples the sources, `shadow_rays` casts. A source that reflected rays can also meet is sampled in both
ways, weighed by the power heuristic.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from raytracer.arrays.rows import add_rows, any_column, make_zeros, put_rows, shorten_rows, take_rows
from raytracer.arrays.types import Floats, Indices, Masks
from raytracer.arrays.vectors import normalize
from raytracer.bsdfs.bsdf import evaluate_bsdf, evaluate_diffuse, evaluate_lobes, includes_diffuse
from raytracer.bsdfs.closures import Shading
from raytracer.casting.rays import Rays
from raytracer.integrator.caustics import WaveCaustics
from raytracer.integrator.light_sources import ALONE, OTHER, KeyedSamples, LightSource, ShadingPoints
from raytracer.integrator.parts import Parts, Split
from raytracer.integrator.shadow_rays import ShadowRays
from raytracer.lecture import length
from raytracer.lights.light_shapes import LightSamples
from raytracer.sampling.warps import power_heuristic
from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL
from raytracer.surfaces.departing import depart, leave

# To leave points out takes about as long as to sample lights for this share of all.
LEAST_LEFT_OUT = 0.125


def light_receptive(
    sources: tuple[LightSource, ...],
    points: ShadingPoints,
    probabilities: Floats,
    throughput: Floats,
    row: Indices,
    split: Split | None,
    caustics: WaveCaustics | None,
) -> list[ShadowRays]:
    """Do what `sample_lights` does, of what arguments it has, without the points that would send nothing on of what
    it samples: perfect mirrors, clear glass, the ends of paths."""
    rows = np.flatnonzero(any_column(throughput != 0) & points.shading.find_receptive())
    if not len(rows):
        return []
    if len(rows) < (1.0 - LEAST_LEFT_OUT) * len(row):
        points, row, split = points.select(rows), row[rows], None if split is None else split.select(rows)
        probabilities, throughput = take_rows(probabilities, rows), take_rows(throughput, rows)
        caustics = None if caustics is None else caustics.select(rows)
    return sample_lights(sources, points, probabilities, throughput, row, split=split, caustics=caustics)


def sample_lights(
    sources: tuple[LightSource, ...],
    points: ShadingPoints,
    probabilities: Floats,
    throughput: Floats,
    row: Indices,
    all_rays: bool = False,
    split: Split | None = None,
    caustics: WaveCaustics | None = None,
) -> list[ShadowRays]:
    """The light loop: return shadow rays from n points to one sample of every source, with the light they would bring.

    Parameters
    ----------
    probabilities : (n, lobes) float64, of `bsdf.lobe_probabilities`
    throughput : (n, 3) float64, what light from these points counts; 0 leaves a point out
    row : (n,) int64, the points' rows of the batch
    all_rays : True for rays to sources that throw no shadows, too
    split : how the light of the n points is split among the passes of light; None splits nothing
    caustics : bends light of some sources on its way to the points; None where nothing does
    """
    shadow_rays = []
    for number, source in enumerate(sources):
        found = source.sample(replace(points, sampler=points.sampler.skip(source.dimension)))
        bent = None
        if caustics is not None:
            bent = caustics.bend(source, points, found.light)
            found = replace(found, light=caustics.leave_out(source, points, found.light))
        if source.share != 1.0:
            found = replace(found, light=replace(found.light, density=source.share * found.light.density))
        lit = partial(_light_points, number, source, points, probabilities, throughput, row, split)
        shadow_rays.append(lit(found, all_rays))
        if bent is not None:
            alone = np.full(len(points.surface), ALONE, np.int32)
            shadow_rays.append(lit(replace(found, light=bent.light, key=alone), all_rays, bent.aim))
    return shadow_rays


def _light_points(
    number: int,
    source: LightSource,
    points: ShadingPoints,
    probabilities: Floats,
    throughput: Floats,
    row: Indices,
    split: Split | None,
    found: KeyedSamples,
    all_rays: bool,
    aim: Callable[[Indices], Rays] | None = None,
) -> ShadowRays:
    """Return shadow rays to samples of a source; aim : returns those of some of the points; None: they go straight."""
    seen_by = source.seen_by if found.seen_by is None else found.seen_by
    reflect = reflect_seen if source.cast_as == SEEN_BY["shadow"] else reflect_as_rays
    light = reflect(points.shading, probabilities, found.light, seen_by) * throughput
    if source.max_bounces is not None:
        assert points.bounces is not None
        light[points.bounces > source.max_bounces] = 0.0
    lit, rays = np.flatnonzero((found.light.density > 0) & any_column(light != 0)), None
    if aim is not None:
        rays = aim(lit)
    elif source.cast_shadow or all_rays:
        rays = _aim(points, found.light, lit, lifts=source.kind != OTHER)
    depths, key = points.depths.select(lit), found.key[lit]
    light = take_rows(light, lit)
    of_parts = None
    if split is not None:
        reflect_part = partial(reflect, points.shading, probabilities, found.light, seen_by)
        of_parts = _split_light(split.select(lit), light, reflect_part, throughput, lit)
    how = (source.unstopped, source.cast_as)
    rays_of = partial(ShadowRays, row[lit], light, key, depths, rays, number, *how)
    group = source.light_group if found.light_group is None else found.light_group[lit]
    blockers = source.blockers if found.blockers is None else found.blockers[lit]
    return rays_of(chance=source.chance, split=of_parts, light_group=group, blockers=blockers)


def _split_light(
    split: Split, light: Floats, reflect: Callable[[str], Floats], throughput: Floats, rows: Indices
) -> Split:
    """Return light (k, 3) of some of n points in parts: at a path's first scattering those that `reflect` gives, times
    its throughput (n, 3), later in the shares of that."""
    parts = split.parts.scale(light)
    if split.unscattered.any():
        chosen = split.unscattered[:, np.newaxis]
        diffuse, glossy = (take_rows(reflect(name) * throughput, rows) for name in ("diffuse", "glossy"))
        parts = Parts(np.where(chosen, diffuse, parts.diffuse), np.where(chosen, glossy, parts.glossy))
    return Split(parts, split.unscattered)


def _aim(points: ShadingPoints, light: LightSamples, rows: Indices, lifts: bool) -> Rays:
    """Return shadow rays from some of the points: to the light's target, if it has one, so that rays which share it end
    at the same point to the last place.

    lifts : False for rays that take the place of reflected ones, which start on the surface
    """
    places = shorten_rows(rows, len(points.surface))
    leaving = leave(points.surface, places)
    direction, reach, target = take_rows(light.direction, places), light.distance[places], None
    if light.target is not None and light.reach is not None:
        target, reach = take_rows(light.target, places), light.reach[places]
    if points.lift is None or not lifts:
        return depart(leaving, direction, reach, target)
    normal, geometric = (take_rows(v, places) for v in (points.shading.normal, points.shading.geometric_normal))
    lifted = points.lift(points.surface, places, normal, geometric, direction)
    if not len(lifted.rows):
        return depart(leaving, direction, reach, target)
    if target is None:
        # From higher up the same point lies in another direction; not so what is infinitely far away.
        direction, reach = direction.copy("K"), reach.copy()
        near = np.isfinite(reach[lifted.rows])
        way = direction[lifted.rows[near]] * reach[lifted.rows[near], np.newaxis] - lifted.offset[near]
        reach[lifted.rows[near]] = length(way)
        put_rows(direction, lifted.rows[near], normalize(way))
    position = leaving.position.copy("K")
    add_rows(position, lifted.rows, lifted.offset)
    return depart(dataclasses.replace(leaving, position=position), direction, reach, target)


# The classes of rays that no surface reflects.
UNREFLECTED = SEEN_BY["camera"] | SEEN_BY["shadow"] | SEEN_BY["volume"]


def reflect_seen(
    shading: Shading, probabilities: Floats, light: LightSamples, seen_by: Masks | int, part: str | None = None
) -> Floats:
    """Return what `reflect_light` does where `seen_by` may differ from point to point, (n,)."""
    if isinstance(seen_by, int):
        return reflect_light(shading, probabilities, light, seen_by, part)
    value = make_zeros(len(shading))
    for mask in np.unique(seen_by):
        rows = seen_by == mask
        value[rows] = reflect_light(shading, probabilities, light, int(mask), part)[rows]
    return value


def reflect_light(
    shading: Shading,
    probabilities: Floats,
    light: LightSamples,
    seen_by: int = SEEN_BY_ALL,
    part: str | None = None,
) -> Floats:
    """Return (n, 3) what each point of `shading` sends back of its sample of a light, in the share that reflected rays
    leave to light sampling.

    seen_by : bits of SEEN_BY, the ways in which the light is reflected
    part : 'diffuse' or 'glossy' for only what that part of the BSDF sends back
    """
    if (seen_by | UNREFLECTED) != SEEN_BY_ALL:
        shading, probabilities = _leave_out_hidden(shading, probabilities, seen_by)
    if includes_diffuse(shading, probabilities):
        value, density = evaluate_bsdf(shading, probabilities, light.direction, part)
        value *= power_heuristic(light.density, density)[:, np.newaxis]
    else:
        value = make_zeros(len(shading)) if part == "glossy" else evaluate_diffuse(shading, light.direction)
        if shading.lobes:
            specular, density = evaluate_lobes(shading, probabilities, light.direction, part)
            value += specular * power_heuristic(light.density, density)[:, np.newaxis]
    value *= light.weight
    return value


def reflect_as_rays(
    shading: Shading, probabilities: Floats, light: LightSamples, ray_class: Masks | int, part: str | None = None
) -> Floats:
    """Return (n, 3) what points send back of samples of a light that reflected rays of one class bring, in the share
    that those leave to light sampling.

    A reflected ray brings the light of all parts, whichever part it was sampled by: f p_k / p of it comes by those of
    class k, with p_k their part of the density p. Where diffuse reflection is not followed, each part brings its own.
    """
    assert isinstance(ray_class, int)
    if not includes_diffuse(shading, probabilities):
        return reflect_light(shading, probabilities, light, ray_class, part)
    kept, own = _leave_out_hidden(shading, probabilities, ray_class)
    whole, density = evaluate_bsdf(shading, probabilities, light.direction, part)
    value, own_density = evaluate_bsdf(kept, own, light.direction, part)
    followed = np.flatnonzero(probabilities[:, 1 + len(shading.lobes) :].any(axis=1) & (density > 0))
    value[followed] = whole[followed] * (own_density[followed] / density[followed])[:, np.newaxis]
    return value * power_heuristic(light.density, density)[:, np.newaxis] * light.weight


def _leave_out_hidden(shading: Shading, probabilities: Floats, seen_by: int) -> tuple[Shading, Floats]:
    """Return only the parts that belong to the classes of rays in `seen_by`, and how often they are taken.

    A part that both reflects and transmits goes only where neither is left, and diffuse transmission with diffuse
    reflection, as in Cycles.
    """
    probabilities, first = probabilities.copy(), 1 + len(shading.lobes)
    kept = []
    for column, lobes in enumerate(shading.lobes, start=1):
        glossy = lobes.reflects & bool(seen_by & SEEN_BY["glossy"])
        through = lobes.transmits & bool(seen_by & SEEN_BY["transmission"])
        kept.append(lobes.select(np.flatnonzero(glossy | through)))
        probabilities[lobes.hit[~(glossy | through)], column] = 0.0
    diffuse, tilted = shading.diffuse, []
    if not seen_by & SEEN_BY["diffuse"]:
        diffuse = np.zeros_like(diffuse)
        probabilities[:, first : first + 1] = 0.0
    for column, part in enumerate(shading.tilted, start=first + 1):
        if not seen_by & SEEN_BY["diffuse"]:
            part = dataclasses.replace(part, albedo=np.zeros_like(part.albedo))
            probabilities[:, column : column + 1] = 0.0
        tilted.append(part)
    shading = dataclasses.replace(shading, lobes=tuple(kept), diffuse=diffuse, tilted=tuple(tilted))
    return shading, probabilities
