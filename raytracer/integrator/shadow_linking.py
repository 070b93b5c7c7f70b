"""Shadow linking: the light of some emitters is shadowed by some objects only, whichever way it is sampled.

What a path meets on its way decides where it goes on, and cannot be told to stop at an object for one light and not for
another. So of emitters with blockers of their own a path knows nothing but what the camera sees straight; a ray that a
surface has scattered looks for all of them on its line, near and far, and casts a shadow ray to each, weighed against
light sampling as ever. Emitters whose shadows are not linked are left to the path.

Notes
-----
Cycles stops looking at the first opaque surface that is in no blocker collection, also where that is no blocker of what
lies behind it: a share of the light of its light sampling is missing there, as its pictures show when multiple
importance sampling is turned off. Here nothing is.

References
----------
Blender, intern/cycles/kernel/integrator/intersect_dedicated_light.h, shade_dedicated_light.h; bvh/util.h:
intersection_skip_shadow_link.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Numbers
from raytracer.casting.passed import bound_distances
from raytracer.casting.rays import Rays
from raytracer.integrator.bounces import classify_rays, meet_lights
from raytracer.integrator.contributions import add_emission_met, add_light_met
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.path_passes import PathPasses
from raytracer.integrator.paths import Paths
from raytracer.integrator.ray_descriptions import describe_rays
from raytracer.integrator.shadow_rays import Shadows
from raytracer.lecture import dot
from raytracer.lights.emitters import stop_before
from raytracer.lights.lights import evaluate_light
from raytracer.media.stack import Immersed
from raytracer.sampling.streams import Noise, hash_columns
from raytracer.scene.fields import ALL_SETS, SEEN_BY
from raytracer.scene.lights import Light
from raytracer.shading.light_path import Depths
from raytracer.shading.materials import find_radiance
from raytracer.surfaces.surface import make_surface


def add_linked_light(integrator: Integrator, passes: PathPasses, paths: Paths) -> None:
    """Add the light of shadow-linked emitters that lie on the way of paths, which a surface has just scattered."""
    for light in integrator.visible_lights:
        if light.blockers != ALL_SETS:
            add_linked_light_of(integrator, light, passes, paths)
    if integrator.emitters is not None and integrator.shadow_links is not None:
        add_linked_emission(integrator, passes, paths)


def add_linked_light_of(integrator: Integrator, light: Light, passes: PathPasses, paths: Paths) -> None:
    """Add the light of one light that paths head for."""
    seen = evaluate_light(light, paths.scatter_origin, paths.rays.directions)
    met = (seen.density > 0) & meet_lights(paths.kind, light.seen_by)
    if integrator.links is not None:
        met &= integrator.links.find_lit(light.receivers, paths.scatterer)
    if integrator.caustics is not None:
        met &= ~integrator.caustics.leaves(light, paths)
    rows = np.flatnonzero(met)
    if len(rows):
        paths, seen = paths.select(rows), seen.select(rows)
        blockers = np.full(len(rows), light.blockers, np.int64)
        add_light_met(integrator, light, passes, pass_blockers(integrator, paths, seen.distance, blockers), seen)


def add_linked_emission(integrator: Integrator, passes: PathPasses, paths: Paths) -> None:
    """Add the light of all the shadow-linked surfaces on the way of paths, one after the other."""
    emitters, links = integrator.emitters, integrator.shadow_links
    assert emitters is not None
    assert links is not None
    hits = integrator.cast(paths.rays, classify_rays(paths.kind))
    again = np.zeros(len(paths), dtype=np.bool_)
    while hits.hit.any():
        rows = np.flatnonzero(hits.hit)
        paths, hits = paths.select(rows), hits.select(rows)
        rows = np.flatnonzero(links.is_linked(hits.instance) & ~again[rows])
        if len(rows):
            met, found = paths.select(rows), hits.select(rows)
            surface = make_surface(integrator.tables, met.rays, found)
            radiance = find_radiance(integrator.materials, surface, describe_rays(met, found.distance))
            cosine = np.abs(dot(surface.geometric_normal, surface.outgoing))
            reach = stop_before(found.distance, cosine, surface.position_error, np.zeros(len(rows)))
            met = pass_blockers(integrator, met, reach, links.blockers[found.instance])
            add_emission_met(integrator, emitters, passes, met, surface, radiance)
        last, hits = hits, integrator.cast(replace(paths.rays, after=hits), classify_rays(paths.kind))
        # Triangles around an edge that a ray meets are one surface.
        again = hits.hit & (hits.instance == last.instance) & (bound_distances(hits)[0] <= bound_distances(last)[1])


def hash_rays(rays: Rays) -> Noise:
    """Return streams of random numbers (k,) for rays whose directions are random themselves."""
    return hash_columns(*rays.origins.T, *rays.directions.T)


def pass_blockers(integrator: Integrator, paths: Paths, reach: Numbers, blockers: NDArray[np.int64]) -> Paths:
    """Return paths with what sets of objects, `blockers` (k,), as bits, leave of their throughput over a reach (k,).

    As in Cycles, what stands between is met as shadow rays meet it.
    """
    shadows = Shadows(
        replace(paths.rays, t_max=np.minimum(paths.rays.t_max, reach)),
        Depths(paths.passages, paths.bounces if integrator.tells_paths else None),
        unstopped=np.zeros(len(paths), dtype=np.bool_),
        cast_as=np.full(len(paths), SEEN_BY["shadow"], np.uint8),
        blockers=blockers,
        immersed=None if paths.media is None else Immersed(paths.media, hash_rays(paths.rays)),
    )
    return replace(paths, throughput=paths.throughput * integrator.visibility(shadows))
