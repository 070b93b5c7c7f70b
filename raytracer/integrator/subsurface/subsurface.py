"""Light that goes below surfaces: which paths do, and what they see where they come out.

A path chooses between the lobes of a surface and what is below it. Below it walks to where light has come in
(`random_walk`): there the surface is white and matte, whatever its material says; sources of light are sampled, and the
path goes on, all as part of the same wave. The walk is no bounce, the reflection at its end is a diffuse one.

References
----------
Cycles, kernel/integrator/shade_surface.h and subsurface.h: what counts as a bounce, and the surface at the way out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import mean_column, sum_columns, take_rows
from raytracer.arrays.types import Booleans, Floats, Numbers, Vectors
from raytracer.arrays.vectors import normalize
from raytracer.bsdfs.bsdf import lobe_shares
from raytracer.bsdfs.closures import Shading
from raytracer.bsdfs.subsurface import Subsurface, enter, find_medium, join_parts
from raytracer.casting.rays import Hits
from raytracer.integrator.bounces import find_closed, find_finished
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.path_passes import PathPasses
from raytracer.integrator.paths import Paths, Wave, join_paths
from raytracer.integrator.ray_descriptions import describe_path
from raytracer.integrator.scattering import (
    Shaded,
    close_portals,
    scatter,
    scatter_by,
    weigh_lobes,
)
from raytracer.integrator.subsurface.random_walk import Exits, walk
from raytracer.lecture import dot
from raytracer.sampling.sampler import Sampler
from raytracer.shading.materials import make_shading
from raytracer.surfaces.departing import spawn_origin
from raytracer.surfaces.surface import Surface, make_surface


def scatter_below(integrator: Integrator, passes: PathPasses, wave: Wave, sampler: Sampler) -> Shaded:
    """Do what `scatter` does for surfaces that light goes below."""
    if not wave.shading.subsurface:
        return scatter(integrator, passes, wave, sampler)
    paths, dimensions = wave.paths, integrator.dimensions
    ended = find_finished(integrator, paths) | find_closed(integrator, paths)
    wave = close_portals(wave, ended)
    probabilities = weigh_lobes(integrator, wave, ended)
    below = weigh_parts(integrator, wave, probabilities, ended)
    share = sum_columns(below)
    choice = sampler.uniform(dimensions.lobe)
    entering = choose_part(wave.shading.subsurface, below, choice)
    probabilities *= (1.0 - share)[:, np.newaxis]
    # What is left of the number chooses the lobe.
    rest = np.divide(choice - share, 1.0 - share, out=np.zeros_like(choice), where=choice > share)
    above = scatter_by(integrator, passes, wave, sampler, ended, probabilities, rest, elsewhere=choice < share)
    if not len(entering.part):
        return above
    exits, rows = walk_below(integrator, wave, entering, sampler.skip(dimensions.walk or 0))
    come_out = make_exit_wave(integrator, wave, exits, rows, sampler)
    # Points of lights are shared by what the camera sees, not by what is below.
    own = replace(sampler.select(rows[exits.hits.hit]), shared=None).skip(dimensions.exit)
    outside = scatter(integrator, passes, come_out, own)
    return Shaded(above.shadow_rays + outside.shadow_rays, join_paths([above.paths, outside.paths]))


def weigh_parts(integrator: Integrator, wave: Wave, probabilities: Floats, ended: Booleans) -> Floats:
    """Return the probabilities (n, parts) with which paths go below the surface, by its parts: in proportion to the
    light that these send on, and the lobes that may be chosen instead."""
    parts = wave.shading.subsurface
    shares = np.zeros((len(wave), len(parts)))
    for column, part in enumerate(parts):
        shares[part.hit, column] = mean_column(part.weight)
    lobes = np.where(probabilities > 0, lobe_shares(wave.shading, integrator.interreflects), 0.0)
    shares[ended] = 0.0
    total = (sum_columns(shares) + sum_columns(lobes))[:, np.newaxis]
    return np.divide(shares, total, out=np.zeros_like(shares), where=total > 0)


@dataclass(frozen=True, eq=False, slots=True)
class Entering:
    """What m paths go below by, and the probability (m,) with which they do."""

    part: Subsurface
    probability: Numbers


def choose_part(parts: tuple[Subsurface, ...], probabilities: Floats, choice: Floats) -> Entering:
    """Return what paths go below by that do: those whose number (n,) is below the sum of the probabilities."""
    upper = np.cumsum(probabilities, axis=1)
    chosen, taken = [], []
    for column, part in enumerate(parts):
        number, high = choice[part.hit], upper[part.hit, column]
        probability = probabilities[part.hit, column]
        rows = np.flatnonzero((number >= high - probability) & (number < high))
        chosen.append(part.select(rows))
        taken.append(probability[rows])
    return Entering(join_parts(chosen), np.concatenate(taken))


def walk_below(
    integrator: Integrator, wave: Wave, entering: Entering, sampler: Sampler
) -> tuple[Exits, NDArray[np.int64]]:
    """Return how the walks of those that enter end, and whose these are in the wave; sampler : of the wave's paths."""
    assert integrator.cast_inside is not None
    part, rows = entering.part, entering.part.hit
    surface, own = wave.surface.select(rows), sampler.select(rows)
    outgoing, normal = take_rows(wave.shading.outgoing, rows), take_rows(wave.shading.geometric_normal, rows)
    direction, enters = enter(part, outgoing, normal, own.uniform_pair())
    medium, factor = find_medium(part)
    throughput = take_rows(wave.paths.throughput, rows) * factor / entering.probability[:, np.newaxis]
    throughput[~enters] = 0.0
    origin = spawn_origin(surface, direction)
    exits = walk(
        integrator.cast_inside, medium, origin, direction, part.normal, surface.instance, throughput, own.skip(1)
    )
    return exits, rows


def make_exit_wave(integrator: Integrator, wave: Wave, exits: Exits, rows: NDArray[np.int64], sampler: Sampler) -> Wave:
    """Return the wave of the paths that come out: where they do, the surface is white and matte.

    rows : (m,) int64, of the walks in the wave that has entered
    sampler : of that wave's paths
    """
    out = np.flatnonzero(exits.hits.hit)
    rays, hits = exits.rays.select(out), exits.hits.select(out)
    paths = replace(wave.paths.select(rows[out]), rays=rays, throughput=exits.throughput[out])
    surface = face_outside(make_surface(integrator.tables, rays, hits))
    normal = find_exit_normal(integrator, paths, hits, surface, sampler)
    sign = np.where(surface.front, 1.0, -1.0)[:, np.newaxis]
    shading = Shading(
        normal=normal,
        geometric_normal=sign * surface.geometric_normal,
        outgoing=surface.outgoing,
        radiance=np.zeros_like(normal),
        transparency=np.zeros_like(normal),
        diffuse=np.ones_like(normal),
        lobes=(),
    )
    if integrator.terminator is not None and integrator.terminator.frequency is not None:
        shading = replace(shading, frequency=integrator.terminator.frequency[surface.instance])
    return Wave(paths, hits, surface, shading)


def face_outside(surface: Surface) -> Surface:
    """Return surfaces that rays have met from inside as if the rays had come from outside."""
    outgoing = -surface.outgoing
    return replace(
        surface,
        outgoing=outgoing,
        front=dot(surface.geometric_normal, outgoing) >= 0,
        approach=None if surface.approach is None else outgoing,
    )


def find_exit_normal(integrator: Integrator, paths: Paths, hits: Hits, surface: Surface, sampler: Sampler) -> Vectors:
    """Return the normals (k, 3), unit, of surfaces that light leaves by: where textures bend them, those of what is
    below, averaged by weight."""
    normal = np.where(surface.front, 1.0, -1.0)[:, np.newaxis] * surface.shading_normal
    if integrator.materials.computed is None or not len(paths):
        return normal
    shading = make_shading(integrator.materials, surface, describe_path(integrator, paths, hits, surface, sampler))
    total = np.zeros_like(normal)
    for part in shading.subsurface:
        total[part.hit] += mean_column(part.weight)[:, np.newaxis] * part.normal
    return np.where(total.any(axis=1)[:, np.newaxis], normalize(total), shading.normal)
