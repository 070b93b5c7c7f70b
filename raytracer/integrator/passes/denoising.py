"""What denoisers take for guides: depth, normal and albedo of what is seen, also in mirrors and through panes.

A path looks for the first surface of which more than a quarter scatters widely; what it meets before, mirrors and glass
above all, dims the albedo by its own color. The normal is that of all of the surface's parts, weighed by how often they
are sampled, in camera space, z away from the viewer. Light that is met on the way, and that surface's own, counts as
albedo, as it is not for a denoiser to smooth; depth is the length of the way.

References
----------
Blender, intern/cycles/kernel/film/denoising_passes.h and light_passes.h; closure/bsdf.h:
bsdf_get_specular_roughness_squared and bsdf_albedo.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from raytracer.arrays.rows import mean_column, sum_columns, take_rows
from raytracer.arrays.types import Booleans, Floats
from raytracer.bsdfs.closures import Shading
from raytracer.bsdfs.lobe_colors import sum_lobe_colors
from raytracer.bsdfs.portals import close_portals
from raytracer.integrator.bounces import find_finished
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.path_passes import PathPasses
from raytracer.integrator.paths import Paths, Wave
from raytracer.lecture import length

# Cycles' numbers: facets are wide whose alpha is larger, and a surface tells where they are more than this share of it.
WIDE_ALPHA = 0.075
WIDE_SHARE = 0.25


def add_guides(integrator: Integrator, passes: PathPasses, wave: Wave) -> None:
    """Add what surfaces tell: to paths that have used up their bounces, as in Cycles, only what is transparent."""
    if passes.guides is None:
        return
    wave = replace(wave, shading=wave.shading.lay_open())
    paths, ended = wave.paths, find_finished(integrator, wave.paths)
    chosen = np.flatnonzero(passes.guides.searching[paths.row])
    row, share = paths.row[chosen], passes.guides.share[paths.row[chosen]]
    passes.add("Denoising Depth", row, (mean_column(share) * measure_stretch(wave)[chosen])[:, np.newaxis])
    shading = leave_transparency(wave.shading, ended) if ended.any() else wave.shading
    wide, narrow = split_shading(shading)
    weights = tuple(sum_weights(part) for part in (wide, narrow))
    total = weights[0] + weights[1]
    tells = (total == 0) | (weights[0] > WIDE_SHARE * total)
    normal = np.zeros((len(wave), 3))
    np.divide(sum_normals(shading), total[:, np.newaxis], out=normal, where=total[:, np.newaxis] > 0)
    found = tells[chosen]
    passes.add("Denoising Normal", row[found], to_camera(integrator, normal[chosen[found]]))
    passes.add("Denoising Albedo", row[found], share[found] * sum_colors(wide)[chosen[found]])
    passes.guides.searching[row[found]] = False
    passes.guides.share[row[~found]] *= sum_colors(narrow)[chosen[~found]]


def add_met_guides(passes: PathPasses, paths: Paths, light: Floats) -> None:
    """Add light (k, 3) that paths meet on the way to that surface, or on it."""
    if passes.guides is None:
        return
    rows = np.flatnonzero(passes.guides.searching[paths.row])
    row = paths.row[rows]
    passes.add("Denoising Albedo", row, passes.guides.share[row] * light[rows])


def add_medium_guides(passes: PathPasses, paths: Paths, albedo: Floats) -> None:
    """Add what media tell that scatter paths: their albedo (k, 3); as in Cycles they look no further."""
    if passes.guides is None:
        return
    rows = np.flatnonzero(passes.guides.searching[paths.row])
    row = paths.row[rows]
    passes.add("Denoising Albedo", row, passes.guides.share[row] * albedo[rows])
    passes.guides.searching[row] = False


def measure_stretch(wave: Wave) -> Floats:
    """Return metres (k,) from the last surface, or where the camera begins to see."""
    paths = wave.paths
    unit = length(paths.rays.directions)
    return wave.hits.distance * unit - np.where(paths.travelled > 0, paths.travelled, paths.rays.t_min * unit)


def leave_transparency(shading: Shading, rows: Booleans) -> Shading:
    """Return shading of which nothing but transparency is left at `rows` (k,)."""
    tilted = []
    for part in shading.tilted:
        albedo = np.where(rows[part.hit, np.newaxis], 0.0, part.albedo)
        tilted.append(replace(part, albedo=albedo))
    return replace(
        shading,
        diffuse=np.where(rows[:, np.newaxis], 0.0, shading.diffuse),
        lobes=tuple(lobes.select(np.flatnonzero(~rows[lobes.hit])) for lobes in shading.lobes),
        tilted=tuple(tilted),
        portals=close_portals(shading.portals, rows),
    )


def split_shading(shading: Shading) -> tuple[Shading, Shading]:
    """Return the parts that scatter widely, and those that do not: narrow lobes, and what goes straight through."""
    wide = tuple(lobes.select(np.flatnonzero(lobes.alpha > WIDE_ALPHA)) for lobes in shading.lobes)
    narrow = tuple(lobes.select(np.flatnonzero(lobes.alpha <= WIDE_ALPHA)) for lobes in shading.lobes)
    black = np.zeros_like(shading.diffuse)
    return (
        replace(shading, lobes=wide, transparency=black, portals=()),
        replace(shading, lobes=narrow, diffuse=black, tilted=()),
    )


def sum_weights(shading: Shading) -> Floats:
    """Return (k,) how often all parts are sampled, by their mean colors."""
    total = mean_column(shading.passage) + mean_column(shading.sum_diffuse())
    for lobes in shading.lobes:
        total[lobes.hit] += mean_column(lobes.weight) / lobes.energy_scale * lobes.albedo
    return total


def sum_normals(shading: Shading) -> Floats:
    """Return (k, 3) the normals of all parts, weighed likewise."""
    total = (mean_column(shading.passage) + mean_column(shading.diffuse))[:, np.newaxis] * shading.normal
    for part in shading.tilted:
        side = -part.normal if part.transmits else part.normal
        total[part.hit] += mean_column(part.albedo)[:, np.newaxis] * side
    for lobes in shading.lobes:
        weight = mean_column(lobes.weight) / lobes.energy_scale * lobes.albedo
        total[lobes.hit] += weight[:, np.newaxis] * lobes.show_normal(take_rows(shading.outgoing, lobes.hit))
    return total


def sum_colors(shading: Shading) -> Floats:
    """Return (k, 3) the colors of all parts."""
    reflected, transmitted = sum_lobe_colors(shading, all_tabulated=True)
    return shading.passage + shading.sum_diffuse() + reflected + transmitted


def to_camera(integrator: Integrator, vectors: Floats) -> Floats:
    """Return world vectors (k, 3) in Cycles' camera space; as they are where there is no camera."""
    if integrator.camera_axes is None:
        return vectors
    return np.stack([sum_columns(vectors * axis) for axis in integrator.camera_axes], axis=1)
