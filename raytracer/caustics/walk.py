"""The walk from a chain that light does not take to one that it does: Newton's method, with steps along surfaces.

Each step solves the linearized constraints for how far the points would have to move in their triangles' planes, takes
a share of that, and casts a ray from the point before through each new place: where it meets the point's object, the
point goes on. Where it does not, or where the chain would no longer go through its surfaces, the share is halved; after
a step that could be taken it is doubled, up to the whole.

Which chains are found, and which of several solutions, is for these rules to say; they are those of Cycles, so that
what both engines find is the same. Cycles is content with h . s and h . t below 0.001; chains that have come that far
take a few whole steps more here, to where rounding ends them.

References
----------
J. Hanika, M. Droske, L. Fascione, "Manifold Next Event Estimation", Computer Graphics Forum 34(4), 2015.
Blender, intern/cycles/kernel/integrator/mnee.h: mnee_newton_solver.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from raytracer.arrays.types import Booleans, Indices, Numbers, Pairs, Vectors
from raytracer.casting.rays import Hits, Rays
from raytracer.caustics.blocks import solve
from raytracer.caustics.casters import Cast
from raytracer.caustics.constraints import Chain, Ends, differentiate, find_bends, find_misses, passes_all
from raytracer.caustics.vertices import Vertex, make_vertex
from raytracer.lecture import dot, length
from raytracer.surfaces.surface_tables import SurfaceTables

# Cycles' numbers (kernel/integrator/mnee.h): steps of a walk, where it ends, the first and the smallest share of a
# step, where rays to a new place end, in units of the way there, and how many surfaces a ray looks behind.
MOST_STEPS = 64
SOLVED = 1e-3
FIRST_SHARE, SMALLEST_SHARE = 0.1, 1e-4
REACH = 2.0
MOST_MET = 10
# Chains that do not move have come to the border of their object. A first step to a point just outside SOLVED is
# FIRST_SHARE SOLVED, 1e-4, of the way to the point before; a hundredth of that is none. Cycles gives up where one point
# has not moved, though others may have to.
SMALLEST_MOVE = 2.0**-20
# Whole steps at the end: each doubles the digits, from 3 to 6 to 12; then there is only rounding left.
LAST_STEPS = 3


def make_chain(tables: SurfaceTables, hits: Sequence[Hits], eta: Sequence[Numbers]) -> Chain:
    """Return the points of chains that are hit; eta : (n,) of each, as in `Vertex`."""
    return tuple(make_vertex(tables, found, index) for found, index in zip(hits, eta, strict=True))


def find_paths(
    cast: Cast, tables: SurfaceTables, ends: Ends, hits: Sequence[Hits], eta: Sequence[Numbers]
) -> tuple[Indices, list[Hits]]:
    """Return which of n chains light takes at the end of their walks, ascending rows (m,), and what those hit.

    hits : where the chains begin, k times n; they are overwritten
    eta : k times (n,), as in `Vertex`
    """
    count = len(ends.position)
    share, found, walking = np.full(count, FIRST_SHARE), np.zeros(count, np.bool_), np.arange(count)
    for _ in range(MOST_STEPS):
        ends_here, index = ends.select(walking), [part[walking] for part in eta]
        chain = make_chain(tables, [part.select(walking) for part in hits], index)
        miss, steps, solvable = linearize(chain, ends_here)
        solved = miss < SOLVED
        found[walking[solved]] = True
        going = np.flatnonzero(~solved & solvable)
        walking, ends_here = walking[going], ends_here.select(going)
        chain, index = [vertex.select(going) for vertex in chain], [part[going] for part in index]
        if not len(walking):
            break
        steps = [-share[walking, np.newaxis] * step[going] for step in steps]
        landing, landed, stuck = move_chain(cast, ends_here, chain, [part.select(walking) for part in hits], steps)
        tried = make_chain(tables, landing, index)
        taken = landed & ~stuck & passes_all(tried, find_bends(tried, ends_here))
        for part, new in zip(hits, landing, strict=True):
            part.put(walking[taken], new.select(taken))
        share[walking] = np.where(taken, np.minimum(2.0 * share[walking], 1.0), 0.5 * share[walking])
        walking = walking[~stuck & (share[walking] >= SMALLEST_SHARE)]
    rows = np.flatnonzero(found)
    return rows, refine(cast, tables, ends.select(rows), [part.select(rows) for part in hits], [p[rows] for p in eta])


def refine(cast: Cast, tables: SurfaceTables, ends: Ends, hits: list[Hits], eta: Sequence[Numbers]) -> list[Hits]:
    """Return what chains hit that light takes nearly, after a few whole steps, but those that make it worse."""
    for _ in range(LAST_STEPS):
        chain = make_chain(tables, hits, eta)
        miss, steps, solvable = linearize(chain, ends)
        landing, landed, _ = move_chain(cast, ends, chain, hits, [-step for step in steps])
        tried = make_chain(tables, landing, eta)
        bends = find_bends(tried, ends)
        better = measure_misses(find_misses(tried, bends)) < miss
        rows = np.flatnonzero(solvable & landed & better & passes_all(tried, bends))
        for part, new in zip(hits, landing, strict=True):
            part.put(rows, new.select(rows))
    return hits


def linearize(chain: Chain, ends: Ends) -> tuple[Numbers, list[Pairs], Booleans]:
    """Return how far chains are from Snell's law (n,), the steps (n, 2) of each point back from where the linearized
    law holds, and which chains have such steps (n,)."""
    bends = find_bends(chain, ends)
    misses = find_misses(chain, bends)
    steps, solvable = solve(differentiate(chain, bends), misses)
    return measure_misses(misses), steps, solvable


def measure_misses(misses: Sequence[Pairs]) -> Numbers:
    """Return how far chains are from Snell's law (n,), where they are farthest."""
    return np.max([np.hypot(*miss.T) for miss in misses], axis=0)


def move_chain(
    cast: Cast, ends: Ends, chain: Chain, hits: Sequence[Hits], steps: Sequence[Pairs]
) -> tuple[list[Hits], Booleans, Booleans]:
    """Return where n chains land after steps (n, 2) at each point, whether all points have landed (n,), and whether
    none has moved (n,). What has not landed stays.

    A first point below the lit surface is mirrored to the other side, as in Cycles.
    """
    landed, stuck = np.ones((2, len(ends.position)), np.bool_)
    landing = []
    for number, (vertex, old, step) in enumerate(zip(chain, hits, steps, strict=True)):
        before = ends if number == 0 else chain[number - 1]
        place = vertex.move(step)
        if number == 0:
            below = dot(ends.side, place - ends.position) <= 0
            place = np.where(below[:, np.newaxis], vertex.move(-step), place)
        rays = aim(before, place, REACH)
        new = meet_object(cast, rays, old)
        landed &= new.hit
        reached = np.where(new.hit, new.distance, 0.0)
        moved = length(rays.origins + rays.directions * reached[:, np.newaxis] - vertex.position)
        stuck &= new.hit & (moved < SMALLEST_MOVE * length(vertex.position - rays.origins))
        kept = np.flatnonzero(~new.hit)
        new.put(kept, old.select(kept))
        landing.append(new)
    return landing, landed, stuck


def aim(before: Ends | Vertex, place: Vectors, reach: float) -> Rays:
    """Return rays that leave points for others (n, 3), which they come to at t = 1."""
    origins = before.leave(place - before.position)
    return Rays(origins, place - origins, np.zeros(len(place)), np.full(len(place), reach))


def meet_object(cast: Cast, rays: Rays, wanted: Hits) -> Hits:
    """Return where rays first hit the instances of `wanted` (n,), whatever is before them; misses where nowhere."""
    hits = replace(cast(rays), tied=None)
    for _ in range(MOST_MET - 1):
        rows = np.flatnonzero(hits.hit & (hits.instance != wanted.instance))
        if not len(rows):
            return hits
        hits.put(rows, cast(replace(rays.select(rows), after=hits.select(rows))))
    return hits.forget(hits.instance != wanted.instance)
