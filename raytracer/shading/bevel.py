"""Normals that are rounded off towards what is around: the Bevel node.

Around a point P the normals N(x) of its own object's surface are averaged over what a ball of radius R holds of it,

    sum = int p(|x - P|) N(x) dA(x),    p(r) = 10 (R - r)^3 / (pi R^5), which is 1 over a flat disk,

by probes: straight lines through the ball, parallel to one of three axes, of which the geometric normal is the first.
How far a line passes from P has p for its density; each point where it meets the surface counts p(|x - P|) over that,
in the share that multiple importance sampling leaves to the line's axis. The power heuristic is taken over the chances
of the axes times their cosines alone, so that the shares of all three add up to 1.

References
----------
Blender, intern/cycles/kernel/svm/bevel.h: falloff, chances of the axes, where nothing is rounded off.
A. King et al., "BSSRDF Importance Sampling", SIGGRAPH 2013 Talks.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from raytracer.arrays.rows import any_column, make_zeros, sum_columns
from raytracer.arrays.types import Floats, Indices
from raytracer.arrays.vectors import make_slanted_frame, normalize
from raytracer.casting.geometry import Kind
from raytracer.casting.rays import Rays
from raytracer.lecture import dot, length
from raytracer.sampling.sampler import number_branches
from raytracer.shading.probes import Probe
from raytracer.surfaces.surface import Surface, make_surface
from raytracer.surfaces.surface_tables import SurfaceTables

# How often a probe is parallel to each of the axes.
CHANCES = np.array([0.5, 0.25, 0.25])
# Paths that a wider bounce has led to, of a density below this, see no bevel.
RAREST = 8.0
# The inverse of the falloff's integral is found to half the distance of two samples.
DISK_TOLERANCE = 2.0**-33
# Newton's steps that takes at most: towards the fourfold root at 1 each leaves 3/4 of the distance, down to 2^-32.
DISK_STEPS = 24


def round_off(probe: Probe, tables: SurfaceTables, normal: Floats, radius: Floats, count: int) -> Floats:
    """Return the means (n, 3) of the normals around points, by `count` probes each; unit, on the side of `normal`.

    normal : (n, 3) the points' own, kept where nothing is rounded off: without a radius, on curves and spheres, and
        behind blurry bounces
    radius : (n,) metres
    """
    is_triangle = tables.geometry.belongs_to_kind(probe.surface.instance, Kind.TRIANGLE)
    rows = np.flatnonzero((radius > 0) & is_triangle & (probe.rarest >= RAREST))
    total = sum_normals(probe.select(rows), tables, radius[rows], count)
    side = np.where(probe.surface.front[rows], 1.0, -1.0)[:, np.newaxis]
    found = any_column(total != 0)
    rounded = normal.copy("K")
    rounded[rows[found]] = (side * normalize(total))[found]
    return rounded


def sum_normals(probe: Probe, tables: SurfaceTables, radius: Floats, count: int) -> Floats:
    """Return `count` times the integral (n, 3) of the normals around points, as wound."""
    total = make_zeros(len(radius))
    for branch in number_branches(probe.sampler.skip(probe.bevel), count if len(radius) else 0):
        _add_normals(probe, tables, radius, branch.uniform_pair(), total)
    return total


def _add_normals(probe: Probe, tables: SurfaceTables, reach: Floats, pair: Floats, total: Floats) -> None:
    """Add to `total` (n, 3) what one probe of each point meets, which a pair (n, 2) of numbers chooses."""
    axes = _find_axes(probe.surface)
    chosen, turn = _choose_axes(pair[:, 0])
    away = sample_falloff(pair[:, 1]) * reach
    rays, rows = _aim(probe.surface, axes, chosen, 2.0 * np.pi * turn, away, reach), np.arange(len(away))
    density = evaluate_falloff(away, reach)
    while len(rows):
        hits = probe.caster.inside(rays, probe.surface.instance[rows])
        met = np.flatnonzero(hits.hit & (density[rows] > 0))
        rays, hits, rows = rays.select(met), hits.select(met), rows[met]
        around = make_surface(tables, rays, hits)
        distance = length(around.position - probe.surface.position[rows])
        share = evaluate_falloff(distance, reach[rows]) / density[rows]
        share *= _weigh_axes(axes[rows], chosen[rows], around.geometric_normal)
        total[rows] += share[:, np.newaxis] * around.shading_normal
        rays = replace(rays, after=hits)


def _find_axes(surface: Surface) -> Floats:
    """Return the three axes (n, 3, 3) of the probes of each point: its geometric normal, and two at right angles."""
    return np.stack([surface.geometric_normal, *make_slanted_frame(surface.geometric_normal)], axis=1)


def _choose_axes(number: Floats) -> tuple[Indices, Floats]:
    """Return which axis (n,) of three a number in [0, 1) chooses, and where it lies in that axis' share, 0 to 1."""
    chosen = np.searchsorted(np.cumsum(CHANCES)[:-1], number, side="right")
    return chosen, (number - (np.cumsum(CHANCES) - CHANCES)[chosen]) / CHANCES[chosen]


def _aim(surface: Surface, axes: Floats, chosen: Indices, angle: Floats, away: Floats, reach: Floats) -> Rays:
    """Return the probes through balls of radii `reach` (n,) that pass their centers at distances `away` (n,)."""
    order = np.arange(len(chosen))
    along, first, second = (axes[order, (chosen + step) % 3] for step in range(3))
    half = np.sqrt(np.maximum(reach**2 - away**2, 0.0))
    offsets = ((half, along), (away * np.cos(angle), first), (away * np.sin(angle), second))
    start = surface.position + sum(size[:, np.newaxis] * axis for size, axis in offsets)
    return Rays(start, -along, np.zeros(len(half)), 2.0 * half)


def _weigh_axes(axes: Floats, chosen: Indices, normal: Floats) -> Floats:
    """Return p / (p_1^2 + p_2^2 + p_3^2) (n,) of the chosen axis, p = chance |axis . normal|: the power heuristic,
    p^2 over the sum, divided by the density of surface with this normal, p.

    normal : (n, 3) unit, geometric, where the probes meet the surface
    """
    density = CHANCES * np.abs(dot(axes, normal[:, np.newaxis]))
    return density[np.arange(len(chosen)), chosen] / sum_columns(density**2)


def evaluate_falloff(distance: Floats, reach: Floats) -> Floats:
    """Return 10 (R - r)^3 / (pi R^5) (n,), for each square metre, of distances r from the middle; 0 beyond R."""
    return 10.0 / np.pi * np.maximum(1.0 - distance / reach, 0.0) ** 3 / reach**2


def sample_falloff(number: Floats) -> Floats:
    """Return the distances (n,) over R below which shares (n,) of the falloff's integral over a disk lie.

    The integral to x is F(x) = 1 - (1 - x)^4 (1 + 4 x), which bends at 1/4: from there Newton's method draws near to
    every root from one side, until it is found: how often depends on no other number, so that no bits do.
    """
    x = np.full(len(number), 0.25)
    for _ in range(DISK_STEPS):
        rest = 1.0 - x
        missing = number - (1.0 - rest**4 * (1.0 + 4.0 * x))
        slope = 20.0 * x * rest**3
        goes_on = (np.abs(missing) > DISK_TOLERANCE) & (slope > 0)
        if not goes_on.any():
            break
        x += np.divide(missing, slope, out=np.zeros_like(x), where=goes_on)
    return x
