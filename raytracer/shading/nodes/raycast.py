"""What rays meet that a program casts: the Raycast node of Blender 5.2.

References
----------
Blender, intern/cycles/kernel/svm/raycast.h: where rays start, and what they see.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from raytracer.arrays.types import Indices
from raytracer.casting.rays import Hits, Rays, join_rays
from raytracer.lecture import length
from raytracer.shading.nodes.inputs import name_of, read_alpha, read_factor, read_vector
from raytracer.shading.nodes.operation import Array, Operation
from raytracer.shading.site import Site
from raytracer.surfaces.departing import depart
from raytracer.surfaces.surface import Surface, make_surface

# Within a bump, rays leave out what is as near as the places that it compares, and a tenth more.
BUMP_MARGIN = 1.1


class Met(NamedTuple):
    """What rays have hit: rows (k,) of the points that they belong to, their hits, the surfaces there."""

    rows: Indices
    hits: Hits
    surface: Surface


def cast(site: Site, position: Any, direction: Any, reach: Any, *, only_local: bool) -> Met | None:
    """Cast a ray for each point; None where no rays are cast: at lights, for shadow rays and in the world.

    reach : in lengths of the directions; 0 or less meets nothing
    only_local : True where only the point's own object counts, which has to be a mesh
    """
    if site.probe is None:
        return None
    position, direction = (np.broadcast_to(np.asarray(v, float), (len(site), 3)) for v in (position, direction))
    reach = np.broadcast_to(np.asarray(reach, float), len(site))
    wanted = (reach > 0) & (site.is_triangle if only_local else True)
    here = (position == site.position).all(axis=1)
    leaving, elsewhere = np.flatnonzero(wanted & here), np.flatnonzero(wanted & ~here)
    parts = [
        depart(site.surface.select(leaving), direction[leaving], reach[leaving]),
        Rays(position[elsewhere], direction[elsewhere], np.zeros(len(elsewhere)), reach[elsewhere]),
    ]
    rays, rows = join_rays(parts), np.concatenate([leaving, elsewhere])
    if site.apart is not None:
        size = length(rays.directions)
        least = np.divide(BUMP_MARGIN * site.apart[rows], size, out=np.zeros(len(rays)), where=size > 0)
        rays = replace(rays, t_min=least)
    caster = site.probe.caster
    hits = caster.inside(rays, site.surface.instance[rows]) if only_local else caster.closest(rays)
    met = np.flatnonzero(hits.hit)
    rays, hits = rays.select(met), hits.select(met)
    return Met(rows[met], hits, make_surface(site.tables.surface, rays, hits))


def raycast(
    site: Site, position: Any, direction: Any, reach: Any, *, only_local: bool
) -> tuple[Array, Array, Array, Array, Array]:
    """Whether anything is hit, and the point's own object; how far away, in lengths of the direction; where; and the
    normal there, on the ray's side. What misses is as far as it reaches."""
    met = cast(site, position, direction, reach, only_local=only_local)
    hit, own = np.zeros(len(site)), np.zeros(len(site))
    place, normal = np.zeros((len(site), 3)), np.zeros((len(site), 3))
    distance = np.array(np.broadcast_to(np.asarray(reach, float), len(site)))
    if met is not None:
        rows, found = met.rows, met.surface
        hit[rows], own[rows] = 1.0, found.instance == site.surface.instance[rows]
        distance[rows] = met.hits.distance
        way = distance[:, np.newaxis] * np.asarray(direction, float)
        place[rows] = (position + way)[rows]
        normal[rows] = np.where(found.front[:, np.newaxis], found.shading_normal, -found.shading_normal)
    return hit, own, distance, place, normal


def read_met(read: Callable[..., Array], width: int) -> Callable[..., Array]:
    """Return the function for an attribute of what is hit, 0 where nothing is; width : its numbers."""

    def read_there(site: Site, position: Any, direction: Any, reach: Any, *, only_local: bool, name: str) -> Array:
        values = np.zeros((len(site), width) if width > 1 else len(site))
        met = cast(site, position, direction, reach, only_local=only_local)
        if met is not None:
            there = Site(met.surface, site.tables, None, np.zeros(len(met.rows)))
            values[met.rows] = read(there, name=name)
        return values

    return read_there


_INPUTS = ("Position", "Direction", "Length")
_LINKS = {"Position": "NEW_GEOMETRY Position", "Direction": "NEW_GEOMETRY Normal"}

OPERATIONS = {
    "MATERIAL_RAYCAST": Operation(
        raycast,
        _INPUTS,
        ("Is Hit", "Self Hit", "Hit Distance", "Hit Position", "Hit Normal"),
        ("only_local",),
        reads_site=True,
        links=_LINKS,
    ),
    **{
        f"MATERIAL_RAYCAST {output}": Operation(
            read_met(read, width),
            _INPUTS,
            (output,),
            ("only_local", "name"),
            reads_site=True,
            links=_LINKS,
            attributes=name_of,
        )
        for output, read, width in (("Vector", read_vector, 3), ("Fac", read_factor, 1), ("Alpha", read_alpha, 1))
    },
}
