"""Shadow rays through media: what share of a light's radiance gets through all that fills the way to it.

A ray goes from surface to surface as through transparent ones (`shadow_rays`), and between them through the media that
it is inside of: in closed form where these are the same everywhere, by ratio tracking where they vary. Borders of media
that are nothing else do not count as passages.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from raytracer.arrays.rows import any_column
from raytracer.arrays.types import Colors, Floats, Integers, Numbers, Vectors
from raytracer.integrator.media.scene_media import SceneMedia, sum_even
from raytracer.integrator.paths import Wave, cross_surfaces
from raytracer.integrator.shadow_rays import CastShadows, ShadowRays, Shadows, Visibility, describe_shadows
from raytracer.lecture import length
from raytracer.media.distances import find_transmittance
from raytracer.media.stack import Immersed
from raytracer.media.tracking import Stretches, track
from raytracer.sampling.dimensions import NOISE
from raytracer.sampling.sampler import Sampler
from raytracer.sampling.streams import Noise, start_noise
from raytracer.shading.materials import MaterialTable, find_transparency
from raytracer.surfaces.surface import make_surface
from raytracer.surfaces.surface_tables import SurfaceTables

# Each stretch between two surfaces has random numbers of its own.
NEXT_STRETCH = 2**21


def media_visibility(
    cast: CastShadows, tables: SurfaceTables, materials: MaterialTable, most: int, media: SceneMedia
) -> Visibility:
    """Shadow rays that pass through media and transparent surfaces: (n, 3), the share of light that is left."""
    return partial(_see_through_media, cast, tables, materials, most, media)


def _see_through_media(
    cast: CastShadows, tables: SurfaceTables, materials: MaterialTable, most: int, media: SceneMedia, shadows: Shadows
) -> Floats:
    count = len(shadows.rays)
    left, rows, passed, start = np.ones((count, 3)), np.arange(count), np.zeros(count, np.int32), np.zeros(count)
    while len(rows):
        hits = cast(shadows)
        unit = length(shadows.rays.directions)
        end = np.where(hits.hit, hits.distance, shadows.rays.t_max) * unit
        left[rows] *= _pass_media(media, shadows, start, end)
        met = np.flatnonzero(hits.hit & any_column(left[rows] != 0))
        shadows, hits, rows, passed, start = shadows.select(met), hits.select(met), rows[met], passed[met], end[met]
        surface = make_surface(tables, shadows.rays, hits)
        path = None if materials.computed is None else describe_shadows(shadows, start, passed)
        left[rows] *= find_transparency(materials, surface, shadows.unstopped, path)
        is_border = media.table.index.is_border[surface.material]
        left[rows[(shadows.depths.passages + passed >= most) & ~is_border]] = 0.0
        passed = passed + ~is_border
        open_ = np.flatnonzero(any_column(left[rows] != 0))
        if shadows.immersed is not None:
            stack = shadows.immersed.stack
            through = stack.cross(surface.instance, surface.material, surface.front, np.ones(len(rows), np.bool_))
            shadows = replace(shadows, immersed=Immersed(through, shadows.immersed.noise + np.uint64(NEXT_STRETCH)))
        shadows, rows, passed, start = shadows.select(open_), rows[open_], passed[open_], start[open_]
        shadows = replace(shadows, rays=replace(shadows.rays, after=hits.select(open_)))
    return left


def _pass_media(media: SceneMedia, shadows: Shadows, start: Numbers, end: Numbers) -> Colors:
    """Return the share (n, 3) of light that gets through the media on stretches of shadow rays, metres."""
    if shadows.immersed is None:
        return np.ones((len(start), 3))
    rays = shadows.rays
    direction = rays.directions / length(rays.directions)[:, np.newaxis]
    inside = media.list_met(shadows.immersed.stack, shadows.cast_as)
    return find_passing(media, inside, rays.origins, direction, start, end, shadows.immersed.noise)


def find_passing(
    media: SceneMedia, inside: Integers, origin: Vectors, direction: Vectors, start: Numbers, end: Numbers, noise: Noise
) -> Colors:
    """Return the share (n, 3) of light that gets through media (n, d) on stretches of rays, metres; on average, where
    these vary."""
    share = np.ones((len(start), 3))
    varying = media.find_varying(inside)
    rows = np.flatnonzero(~varying & (inside <= media.table.world).any(axis=1))
    if len(rows):
        share[rows] = find_transmittance(sum_even(media, inside[rows]).extinction, (end - start)[rows])
    rows = np.flatnonzero(varying)
    if len(rows):
        reach = media.find_reach(inside[rows], origin[rows], end[rows])
        which = inside[rows], origin[rows], direction[rows], start[rows], reach, noise[rows]
        stretches, scatters = Stretches(*which), np.zeros(len(rows), np.bool_)
        share[rows] = track(media.majorants, media.sum_media, stretches, share[rows], scatters).weight
    return share


def immerse_shadows(shadow_rays: Sequence[ShadowRays], wave: Wave, sampler: Sampler, medium: int) -> list[ShadowRays]:
    """Return shadow rays from the surfaces of a wave with what they start inside of.

    sampler : of the wave's paths; medium : the first dimension of ways through media
    """
    if wave.paths.media is None:
        return list(shadow_rays)
    order = np.argsort(wave.paths.row)
    pair = sampler.uniform_pair(medium + NOISE)
    immersed = []
    for rays in shadow_rays:
        if rays.rays is None:
            immersed.append(rays)
            continue
        place = order[np.searchsorted(wave.paths.row[order], rays.row)]
        stack, surface = wave.paths.media.select(place), wave.surface.select(place)
        straight = np.zeros(len(place), np.bool_)
        stack = cross_surfaces(stack, surface, rays.rays.directions, straight)
        noise = start_noise(pair[place], 1 + rays.source)  # 0 is that of the way to the surface
        immersed.append(replace(rays, immersed=Immersed(stack, noise)))
    return immersed
