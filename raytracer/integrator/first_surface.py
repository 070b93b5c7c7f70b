"""The first surface that a camera ray meets: the passes that describe it, and the holes that it may be in the picture.

Passes mean what they mean in Cycles (intern/cycles/kernel/film/data_passes.h).
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.rows import mean_column, take_rows
from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.bsdfs.lobe_colors import sum_lobe_colors
from raytracer.casting.rays import Hits
from raytracer.film.mattes import add_coverage
from raytracer.film.passes import matte_table
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.path_passes import PathPasses
from raytracer.integrator.paths import Paths, Wave
from raytracer.lecture import length
from raytracer.lights.instanced_emitters import find_materials
from raytracer.surfaces.screen_motion import find_vectors

# Cycles' default: Normal, UV, Depth and so on belong to the first surface at least this opaque.
OPAQUE_ENOUGH = 0.5


def cut_holes(integrator: Integrator, passes: PathPasses, paths: Paths, hits: Hits) -> tuple[Paths, Hits]:
    """End paths that go straight into a holdout object: black, and no part of the picture. The mere border of a medium
    is no hole, as in Cycles."""
    if integrator.holdout is None:
        return paths, hits
    cut = paths.direct & integrator.holdout[hits.instance]
    if paths.media is not None:
        cut &= ~paths.media.index.is_border[find_materials(integrator.tables, hits.instance, hits.primitive)]
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


def divide_shadow(arriving: Floats, unshadowed: Floats) -> Floats:
    """The Shadow pass: the share of the direct light that reaches the first surface; where none could, nothing does."""
    return np.divide(arriving, unshadowed, out=np.zeros_like(arriving), where=unshadowed > 0)


def finish_alpha(integrator: Integrator, passes: PathPasses) -> None:
    """Alpha is what did not reach a background left out of the picture."""
    if "Combined" in passes.values:
        passes.values["Combined"][:, 3] = 1.0 - passes.background
