"""Light split by the first scattering of its path: diffuse, glossy or transmitted, direct or indirect.

A camera's path is scattered first where it meets a surface that it does not pass straight. What a part of that
surface's BSDF, f_k of f, sends on is its part's light: of the light that arrives there by one more ray, direct, of all
that comes later, indirect, in the share f_k / f of the direction that the path took. A film divides the parts by their
colors, so that for each part (direct + indirect) color, and Emission and Environment, add up to Combined.

References
----------
Blender, intern/cycles/kernel/film/light_passes.h and integrator/surface_shader.h, which takes glass for glossy or for
transmission by the side that light comes from.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.rows import sum_columns
from raytracer.arrays.types import Booleans, Floats, Indices, Integers
from raytracer.bsdfs.bounce_kinds import TRANSMITTED
from raytracer.bsdfs.bsdf import evaluate_bsdf
from raytracer.bsdfs.bsdf_samples import BsdfSample
from raytracer.bsdfs.closures import Shading
from raytracer.film.passes import LIGHT_PARTS, VOLUME_DIRECT, VOLUME_INDIRECT, light_pass
from raytracer.integrator.parts import Parts, Split
from raytracer.integrator.passes.denoising import add_met_guides
from raytracer.integrator.path_passes import PathPasses
from raytracer.integrator.paths import Paths
from raytracer.integrator.shadow_rays import ShadowRays


def split_paths(passes: PathPasses, paths: Paths) -> Split | None:
    """Return how the light of paths is split; None where no pass asks."""
    return None if passes.parts is None else Split(passes.parts.select(paths.row), paths.direct)


def note_scattering(
    passes: PathPasses, paths: Paths, shading: Shading, probabilities: Floats, sample: BsdfSample
) -> None:
    """Keep in which shares the parts of a BSDF have sent paths on that are scattered for the first time."""
    if passes.parts is None:
        return
    rows = np.flatnonzero(paths.direct & sample.alive & ~sample.goes_straight)
    passes.parts.diffuse[paths.row[rows]] = 0.0
    glossy = np.where(sample.kind[rows] & TRANSMITTED, 0.0, 1.0)  # of what is perfect, nothing else leads there
    passes.parts.glossy[paths.row[rows]] = glossy[:, np.newaxis]
    if not np.isfinite(sample.density[rows]).any():
        return
    total, diffuse, glossy_part = (
        evaluate_bsdf(shading, probabilities, sample.direction, part)[0] for part in (None, "diffuse", "glossy")
    )
    rows = rows[np.isfinite(sample.density[rows])]
    for share, part in ((passes.parts.diffuse, diffuse), (passes.parts.glossy, glossy_part)):
        value = np.zeros((len(rows), 3))
        share[paths.row[rows]] = np.divide(part[rows], total[rows], out=value, where=total[rows] != 0)


def add_met(passes: PathPasses, paths: Paths, light: Floats, name: str, group: Integers | int) -> None:
    """Add light (k, 3) that paths meet, of one group or of groups (k,): to Combined, and where they see it straight to
    the pass `name`.

    As in Cycles, what comes by shadow catchers belongs to the footage, and is in no other pass.
    """
    passes.add("Combined", paths.row, light)
    passes.add(name, paths.row[paths.direct], light[paths.direct])
    add_met_guides(passes, paths, light)
    if passes.caught is not None:
        rows = np.flatnonzero(~passes.caught.met[paths.row])
        paths, light, group = paths.select(rows), light[rows], group if isinstance(group, int) else group[rows]
    passes.add_grouped(paths.row, light, group)
    add_scattered(passes, paths, light)


def add_scattered(passes: PathPasses, paths: Paths, light: Floats) -> None:
    """Add light (k, 3) that paths meet after they have been scattered."""
    if passes.parts is None:
        return
    rows = np.flatnonzero(~paths.direct)
    shares = passes.parts.select(paths.row[rows])
    is_direct = sum_columns(paths.bounces[rows]) == 1
    in_medium = None if passes.in_medium is None else passes.in_medium[paths.row[rows]]
    add_parts(passes, paths.row[rows], light[rows], shares.scale(light[rows]), is_direct, in_medium)


def add_aimed(passes: PathPasses, rays: ShadowRays, arriving: Floats) -> None:
    """Add light (k, 3) that arrives from a source to the passes that tell how it has come, and where from."""
    row, sent, group, split = rays.row, rays.light, rays.light_group, rays.split
    if passes.caught is not None:
        rows = np.flatnonzero(~passes.caught.met[row])
        row, sent, arriving = row[rows], sent[rows], arriving[rows]
        group = group if isinstance(group, int) else group[rows]
        split = None if split is None else split.select(rows)
    passes.add_grouped(row, arriving, group)
    if split is None:
        return
    passed = np.divide(arriving, sent, out=np.zeros_like(arriving), where=sent != 0)
    in_medium = None
    if passes.in_medium is not None:
        in_medium = np.where(split.unscattered, rays.from_medium, passes.in_medium[row])
    add_parts(passes, row, arriving, split.parts.scale(passed), split.unscattered, in_medium)


def add_parts(
    passes: PathPasses,
    row: Indices,
    light: Floats,
    parts: Parts,
    is_direct: Booleans,
    in_medium: Booleans | None = None,
) -> None:
    """Add light (k, 3) and its parts to the passes of direct, or elsewhere indirect, light.

    in_medium : (k,) True where a medium has scattered the path first, which is a part of its own; None for nowhere
    """
    if in_medium is not None:
        for name, chosen in ((VOLUME_DIRECT, is_direct), (VOLUME_INDIRECT, ~is_direct)):
            passes.add(name, row[chosen & in_medium], light[chosen & in_medium])
        rows = np.flatnonzero(~in_medium)
        row, light, parts, is_direct = row[rows], light[rows], parts.select(rows), is_direct[rows]
    transmitted = light - parts.diffuse - parts.glossy
    for name, values in zip(LIGHT_PARTS, (parts.diffuse, parts.glossy, transmitted), strict=True):
        for way, chosen in (("Direct", is_direct), ("Indirect", ~is_direct)):
            passes.add(light_pass(name, way), row[chosen], values[chosen])
