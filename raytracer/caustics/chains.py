"""Chains of points on casters: where they begin, on the straight way to the light, and what light comes along those
that are found.

A path over the points x_1 .. x_k brings, of what the light sends along its end, the share

    product of (1 - F_i) times J,   J = |d solid angle at the lit point / d area across the way at the light|

to a plane at the lit point that faces it. F is Fresnel's reflectance; radiance is carried as in Cycles, without the
factors of the index of refraction, which are 1 together for light that leaves a glass as it came in. Where the light
moves by dy, the chain's first point moves by T dy, -T the solution of the linear system for the derivatives by y. From
the lit point, at the distance d and the angle a to the first triangle's normal, that is seen as a solid angle of
|det T| cos a / d^2.

References
----------
J. Hanika, M. Droske, L. Fascione, "Manifold Next Event Estimation", Computer Graphics Forum 34(4), 2015.
A. S. Kaplanyan, J. Hanika, C. Dachsbacher, "The Natural-Constraint Representation of the Path Space", 2014.
Blender, intern/cycles/kernel/integrator/mnee.h: kernel_path_mnee_sample, mnee_path_contribution.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from raytracer.arrays.rows import any_column, lay_columns, make_zeros, take_rows
from raytracer.arrays.types import Booleans, Colors, Indices, Numbers, Vectors
from raytracer.arrays.vectors import normalize
from raytracer.bsdfs.closures import Shading
from raytracer.bsdfs.microfacet import Microfacets, evaluate_fresnel
from raytracer.casting.rays import Hits, Rays, make_misses
from raytracer.caustics.blocks import determinant, solve
from raytracer.caustics.casters import Casters
from raytracer.caustics.constraints import Chain, Ends, differentiate, differentiate_by_light, find_bends
from raytracer.caustics.walk import MOST_MET, aim, find_paths, make_chain
from raytracer.lecture import dot, length
from raytracer.surfaces.surface import Surface, find_material, make_surface

# Cycles' MNEE_MAX_CAUSTIC_CASTERS: chains of more points are not looked for.
MOST_POINTS = 6
# A ray towards a point that a ray has found comes to it up to rounding; what is hit within a millionth of the way
# before or behind is the same point, on this triangle or on its neighbor.
SAME_PLACE = 2.0**-20


# What the material does at points of a surface that chains from some rows (n,) of the lit points have come to.
Shade = Callable[[Surface, Indices], Shading]


# J has no upper bound: it is infinite where ways meet, and so is the variance of samples of it. Cycles limits it to 2,
# per square metre or, of distant lights, by solid angle; that would darken all light from closer than 0.7 m. Here light
# may always be this many times as bright as on the straight way, and as bright as in Cycles.
CYCLES_SPREAD = 2.0
MOST_FOCUS = 16.0


@dataclass(frozen=True, eq=False, slots=True)
class Seeds:
    """Where the straight ways of n points to their lights meet casters.

    count : (n,) int64, how often
    hits : MOST_POINTS times n, misses beyond `count`
    """

    count: Indices
    hits: list[Hits]


@dataclass(frozen=True, eq=False, slots=True)
class BentWays:
    """m ways that light takes through casters to some of n points.

    rows : (m,) int64, of the points
    direction : (m, 3) float64, unit, from the lit point
    towards : (m, 3) float64, unit, from the last point of the chain to the light, and its distance (m,)
    share : (m, 3) float64, product of (1 - F)
    spread : (m,) float64, J
    last : Surface of m points, where the chain ends
    """

    rows: Indices
    direction: Vectors
    towards: Vectors
    distance: Numbers
    share: Colors
    spread: Numbers
    last: Surface


def find_seeds(casters: Casters, ends: Ends) -> Seeds:
    """Return where straight ways meet casters, whatever else is in the way."""
    way = np.where(ends.distant[:, np.newaxis] > 0, ends.light, ends.light - ends.position)
    origins = ends.leave(way)
    directions = np.where(ends.distant[:, np.newaxis] > 0, ends.light, ends.light - origins)
    count, rows = np.zeros(len(way), np.intp), np.arange(len(way))
    last_instance, last_distance = np.full(len(way), -1), np.zeros(len(way))
    hits = [make_misses(np.ones(len(way), np.bool_)) for _ in range(MOST_POINTS)]
    rays = Rays(origins, directions, np.zeros(len(way)), np.where(ends.distant > 0, np.inf, 1.0))
    for _ in range(MOST_MET):
        found = replace(casters.cast(rays), tied=None)
        met = np.flatnonzero(found.hit)
        rows, found = rows[met], found.select(met)
        if not len(rows):
            break
        # On an edge both triangles are met, and are one point.
        again = (found.instance == last_instance[rows]) & (found.distance <= (1.0 + SAME_PLACE) * last_distance[rows])
        last_instance[rows], last_distance[rows] = found.instance, found.distance
        on_caster = casters.is_caster[found.instance] & ~again
        for number, part in enumerate(hits):
            new = np.flatnonzero(on_caster & (count[rows] == number))
            part.put(rows[new], found.select(new))
        count[rows] += on_caster
        rays = replace(rays.select(met), after=found)
    return Seeds(count, hits)


def find_ways(casters: Casters, ends: Ends, seeds: Seeds, shade: Shade) -> list[BentWays]:
    """Return the ways that light takes from chains that begin at `seeds`, for each number of points."""
    ways = []
    for number in range(1, MOST_POINTS + 1):
        rows = np.flatnonzero(seeds.count == number)
        if len(rows):
            hits = [part.select(rows) for part in seeds.hits[:number]]
            eta = [casters.eta[find_material(casters.tables, part)] for part in hits]
            chosen, hits = find_paths(casters.cast, casters.tables, ends.select(rows), hits, eta)
            eta = [part[chosen] for part in eta]
            ways.append(_follow(casters, ends.select(rows[chosen]), hits, eta, rows[chosen], shade))
    return ways


def _follow(
    casters: Casters, ends: Ends, hits: Sequence[Hits], eta: Sequence[Numbers], rows: Indices, shade: Shade
) -> BentWays:
    """Return the ways along chains that light takes, without those that something else is in the way of."""
    chain = make_chain(casters.tables, hits, eta)
    spread, solvable = find_spread(chain, ends)
    spread = np.minimum(spread, find_most(ends))
    share, open_ = lay_columns(np.ones((len(rows), 3))), solvable
    for number, (vertex, found) in enumerate(zip(chain, hits, strict=True)):
        rays = aim(ends if number == 0 else chain[number - 1], vertex.position, 1.0 + SAME_PLACE)
        open_ &= is_open(casters.cast(rays), found)
        surface = make_surface(casters.tables, rays, found)
        share = share * transmit(surface, shade(surface, rows))
    towards, _ = ends.find_way(chain[-1].position)
    distance = np.where(ends.distant > 0, np.inf, length(ends.light - chain[-1].position))
    direction = normalize(chain[0].position - ends.position)
    kept = np.flatnonzero(open_ & any_column(share > 0))
    rows, direction, towards, distance, share, spread = (
        take_rows(part, kept) for part in (rows, direction, towards, distance, share, spread)
    )
    return BentWays(rows, direction, towards, distance, share, spread, surface.select(kept))


def find_most(ends: Ends) -> Numbers:
    """Return the largest J (n,) that counts."""
    return np.maximum(CYCLES_SPREAD, MOST_FOCUS * np.maximum(ends.find_way(ends.position)[1] ** 2, ends.distant))


def is_open(hits: Hits, wanted: Hits) -> Booleans:
    """Return (n,) True where rays that come to a point at t = 1 meet that before anything else."""
    same = (hits.instance == wanted.instance) & (hits.distance >= 1.0 - SAME_PLACE)
    return ~hits.hit | same


def transmit(surface: Surface, shading: Shading) -> Colors:
    """Return what share of light (n, 3) goes straight by Snell's law through points of a surface, whose only such lobe
    is perfect: 1 - F, in the lobe's color."""
    share = make_zeros(len(surface))
    cosine = np.abs(dot(surface.shading_normal, surface.outgoing))
    for lobes in shading.lobes:
        if isinstance(lobes, Microfacets):
            passed = evaluate_fresnel(lobes, np.minimum(cosine[lobes.hit], 1.0))[1]
            if passed is not None:
                share[lobes.hit] += lobes.weight * passed
    return share


def find_spread(chain: Chain, ends: Ends) -> tuple[Numbers, Booleans]:
    """Return J (n,) of chains, and which have one."""
    bends = find_bends(chain, ends)
    pushes = [np.zeros((len(chain[0]), 2, 2)) for _ in chain]
    pushes[-1] = differentiate_by_light(chain[-1], bends[-1])
    moves, solvable = solve(differentiate(chain, bends), pushes)
    facing = np.abs(dot(bends[0].before, chain[0].geometric_normal)) * bends[0].near ** 2
    return np.abs(determinant(moves[0])) * facing, solvable
