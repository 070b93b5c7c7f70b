"""What nodes read of the triangle or the point that is hit: Wireframe and Point Info.

References
----------
Blender, intern/cycles/kernel/svm/wireframe.h, geometry.h (svm_node_point_info), blender/pointcloud.cpp.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from raytracer.casting.geometry import world_corners
from raytracer.lecture import cross, dot, length
from raytracer.shading.nodes.normals import pixel_axes
from raytracer.shading.nodes.operation import Array, Operation
from raytracer.shading.site import Site
from raytracer.textures.noise import LARGEST_WORD, hash_words


def draw_wires(site: Site, size: Any, *, use_pixel_size: bool) -> Array:
    """1 as near as size / 2 to an edge of the triangle, metres or pixels as they are seen; 0 elsewhere.

    The distance from p to the edge from a to b is |(b - a) x (p - a)| / |b - a|.
    """
    found = np.zeros(len(site))
    rows = np.flatnonzero(site.is_triangle)
    width = np.broadcast_to(np.asarray(size, float) / 2.0, len(site))
    if use_pixel_size:
        width = width * _measure_pixel(site)
    corners = world_corners(site.tables.geometry, site.surface.instance[rows], site.surface.primitive[rows])
    for start, end in zip(corners, (corners[1], corners[2], corners[0]), strict=True):
        edge = end - start
        area = cross(edge, site.position[rows] - start)
        found[rows] = np.maximum(found[rows], dot(area, area) < dot(edge, edge) * width[rows] ** 2)
    return found


def _measure_pixel(site: Site) -> Array:
    """The mean length (n,) of two sides of a pixel that lies in the surface, seen from where the ray came."""
    first, second = (axis - dot(axis, site.outgoing)[:, np.newaxis] * site.outgoing for axis in pixel_axes(site))
    return (length(first) + length(second)) / 2.0


def read_point_position(site: Site) -> Array:
    """(n, 3) the middle of the sphere; 0 on meshes."""
    return _read_spheres(site, site.tables.geometry.centres)


def read_point_radius(site: Site) -> Array:
    """(n,) the radius of the sphere; 0 on meshes."""
    return _read_spheres(site, site.tables.geometry.radii)


def read_point_random(site: Site) -> Array:
    """(n,) a random number of each point of its cloud, 0 to 1: a hash of its number; 0 on meshes."""
    random = hash_words(site.surface.primitive, 0).astype(np.float64) / LARGEST_WORD
    return np.where(site.is_sphere, random, 0.0)


def _read_spheres(site: Site, table: Array) -> Array:
    values, rows = np.zeros((len(site), *table.shape[1:])), np.flatnonzero(site.is_sphere)
    values[rows] = table[site.find_spheres(rows)]
    return values


OPERATIONS = {
    "WIREFRAME": Operation(draw_wires, ("Size",), ("Fac",), ("use_pixel_size",), reads_site=True),
    "POINT_INFO Position": Operation(read_point_position, (), ("Position",), reads_site=True),
    "POINT_INFO Radius": Operation(read_point_radius, (), ("Radius",), reads_site=True),
    "POINT_INFO Random": Operation(read_point_random, (), ("Random",), reads_site=True),
}
