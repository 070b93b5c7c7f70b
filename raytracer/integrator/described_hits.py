"""A ray's hit written down (`traced_rays`), and checked once more in the lecture's own arithmetic."""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.bsdfs.closures import Shading
from raytracer.casting.caster import Caster
from raytracer.casting.geometry import Kind, join_id, world_corners
from raytracer.casting.rays import Hits, Rays
from raytracer.integrator.traced_rays import Hit
from raytracer.lecture import Region, classify_barycentric, cross, intersect_sphere, intersect_triangle, length
from raytracer.surfaces.surface import Surface


def find_start(rays: Rays) -> float:
    """Return t where one ray goes on behind what it has passed straight; 0 where it has not."""
    return float(rays.after.distance[0]) if rays.after is not None and rays.after.hit[0] else 0.0


def describe_hit(caster: Caster, rays: Rays, hits: Hits, surface: Surface, shading: Shading) -> Hit:
    """Return the record of the hit of one ray."""
    geometry, weights, region = caster.geometry, None, Region.INSIDE
    origin, direction = rays.origins[0], rays.directions[0]
    kind = next(kind for kind in Kind if geometry.belongs_to_kind(hits.instance, kind)[0])
    if kind == Kind.TRIANGLE:
        a, b, c = (corner[0] for corner in world_corners(geometry, hits.instance, hits.primitive))
        beta, gamma = hits.barycentric[0]
        weights = np.array([1.0 - beta - gamma, beta, gamma])
        region = Region(int(classify_barycentric(weights, measure_tolerance(surface, a, b, c))))
        lecture_distance = float(intersect_triangle(origin, direction, a, b, c).t)
    elif kind == Kind.CURVE:
        lecture_distance = np.nan
    else:
        number = geometry.find_rows(join_id(geometry, hits.instance, hits.primitive), Kind.SPHERE)[0]
        roots = intersect_sphere(origin, direction, geometry.centres[number], geometry.radii[number])
        ahead = roots[roots >= rays.t_min[0]]
        lecture_distance = float(ahead[0]) if len(ahead) else np.nan
    return Hit(
        distance=float(hits.distance[0]) - find_start(rays),
        distance_error=float(hits.distance_error[0]),
        lecture_distance=lecture_distance - find_start(rays),
        kind=kind,
        instance=int(hits.instance[0]),
        primitive=int(hits.primitive[0]),
        material=int(surface.material[0]),
        barycentric=weights,
        region=region,
        position=surface.position[0],
        position_error=float(surface.position_error[0]),
        geometric_normal=surface.geometric_normal[0],
        shading_normal=surface.shading_normal[0],
        front=bool(surface.front[0]),
        emitted=shading.radiance[0],
    )


def measure_tolerance(surface: Surface, a: Floats, b: Floats, c: Floats) -> float:
    """Return how much a weight changes over the error of the position: that error over the triangle's least height.

    The height over a side is twice the area over the side's length.
    """
    longest = max(float(length(side)) for side in (b - a, c - b, a - c))
    doubled_area = float(length(cross(b - a, c - a)))
    return float(surface.position_error[0]) * longest / doubled_area if doubled_area > 0 else 0.0
