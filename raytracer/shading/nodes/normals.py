"""Normals that textures, or edges, bend: Normal Map, Bump, Bevel and Displacement; and Tangent.

References
----------
M. S. Mikkelsen, "Bump Mapping Unparametrized Surfaces on the GPU", 2010.
Blender, intern/cycles/kernel/svm/tex_coord.h (svm_node_normal_map, svm_node_tangent), displace.h (svm_node_set_bump).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from raytracer.arrays.vectors import make_slanted_frame, normalize
from raytracer.lecture import cross, dot
from raytracer.scene.programs import Program
from raytracer.shading.bevel import round_off
from raytracer.shading.nodes.operation import Array, Operation, mix, saturate, spread
from raytracer.shading.site import Site
from raytracer.shading.site_tables import UNDISPLACED


def map_normal(site: Site, strength: Any, color: Any, *, space: str, name: str, invert_green: bool) -> Array:
    """The normal whose components in tangent, object or world space a color holds, as (n + 1) / 2."""
    count = len(site)
    local = np.broadcast_to(2.0 * np.asarray(color, float) - 1.0, (count, 3)).copy()
    strength = np.broadcast_to(np.asarray(strength, float), (count,))
    if invert_green:
        local[:, 1] *= -1.0
    if space == "TANGENT":
        found = _from_tangent_space(site, local, strength, name)
    else:
        if space.startswith("BLENDER"):
            local[:, 1:] *= -1.0
        found = site.normal_to_world(local) if space.endswith("OBJECT") else normalize(local)
        found = np.where(site.front[:, np.newaxis], found, -found)
        full = np.maximum(strength, 0.0)[:, np.newaxis]
        found = np.where(full != 1.0, normalize(mix(site.normal, found, full)), found)
    usable = np.isfinite(found).all(axis=1) & (found != 0).any(axis=1)
    return np.where(usable[:, np.newaxis], found, site.normal)


def _from_tangent_space(site: Site, local: Array, strength: Array, name: str) -> Array:
    """x along the direction in which u grows, y along v, z along the normal, all in object space."""
    tangent, sign = site.read_tangent(name)
    normal = np.where(site.is_smooth[:, np.newaxis], site.read_object_normal(), site.flat_object_normal())
    scaled = local * spread(strength)
    height = mix(1.0, local[:, 2:], spread(saturate(strength)))
    bitangent = spread(sign) * cross(normal, tangent)
    found = site.normal_to_world(normalize(scaled[:, 0:1] * tangent + scaled[:, 1:2] * bitangent + height * normal))
    found = np.where(site.front[:, np.newaxis], found, -found)
    return np.where(spread(sign) != 0, found, site.normal)


def bump(
    site: Site,
    strength: Any,
    distance: Any,
    filter_width: Any,
    normal: Any,
    *,
    height: Program,
    invert: bool,
    evaluate: Callable[[Program, Site], Array],
    of_object: bool = False,
) -> Array:
    """The normal of the surface raised by distance times the height, to first order (Mikkelsen).

    The height's slope is a difference over `filter_width` pixels along two directions in the flat surface; it is a
    program, which `evaluate` runs at three places.

    of_object : True measures slopes in the object's space, of the height where the surface was before it was displaced
    """
    count = len(site)
    along, across = pixel_axes(site)
    width = spread(np.broadcast_to(np.asarray(filter_width, float), (count,)))
    site = replace(site, apart=width[:, 0] * site.footprint)
    centre, right, up = (
        np.broadcast_to(evaluate(height, _look_beside(site, offset, of_object)), (count,))
        for offset in (np.zeros((count, 3)), along * width, across * width)
    )
    normal = np.broadcast_to(np.asarray(normal, float), (count, 3))
    if of_object:
        normal = site.normal_to_object(normal)
        along, across = (site.from_world(axis, "OBJECT", "VECTOR") for axis in (along, across))
    over_x, over_y = cross(across, normal), cross(normal, along)
    determinant = spread(dot(along, over_x))
    slope = spread(right - centre) * over_x + spread(up - centre) * over_y
    reach = spread(np.broadcast_to(np.asarray(distance, float), (count,))) * (-1.0 if invert else 1.0)
    raised = normalize(width * np.abs(determinant) * normal - reach * np.sign(determinant) * slope)
    share = spread(np.maximum(np.broadcast_to(np.asarray(strength, float), (count,)), 0.0))
    blended = normalize(share * raised + (1.0 - share) * normal)
    found = np.where((raised != 0).any(axis=1, keepdims=True), blended, normal)
    return site.normal_to_world(found) if of_object else found


def _look_beside(site: Site, offset: Array, of_object: bool) -> Site:
    """Return the site an offset (n, 3) further in the flat surface.

    Attributes change the other way on back faces, as in Cycles, whose parameters of a surface run backwards there: what
    stands out in front is sunk in behind, while heights of positions stand out on both sides. Of a displaced surface
    it is the position that changes the other way, for it is an attribute.
    """
    side = spread(np.where(site.front, 1.0, -1.0))
    if of_object:
        return site.shift(side * offset).put_back().slide(offset - side * offset)
    return site.shift(offset).slide(side * offset - offset)


def bevel(site: Site, radius: Any, normal: Any, *, samples: int) -> Array:
    """A normal turned as the surface's own is by what of the object is around, within a radius.

    Where no rays are cast, at lights, for shadow rays and in the world, the surface's own stands.
    """
    own = site.normal
    if site.probe is None:
        return own
    radius = np.broadcast_to(np.asarray(radius, float), len(site))
    rounded = round_off(site.probe, site.tables.surface, own, radius, samples)
    return normalize(np.asarray(normal, float) + (rounded - own))


def displace(site: Site, height: Any, midlevel: Any, scale: Any, normal: Any, *, space: str) -> Array:
    """The way that a height moves the surface along a normal, in the size of the object or of the world."""
    count = len(site)
    normal = np.broadcast_to(np.asarray(normal, float), (count, 3))
    reach = spread(np.broadcast_to((np.asarray(height) - midlevel) * scale, (count,)))
    if space == "WORLD":
        return reach * normal
    return site.to_world(reach * site.normal_to_object(normal), "OBJECT", "VECTOR")


def displace_freely(site: Site, vector: Any, midlevel: Any, scale: Any, *, space: str, name: str) -> Array:
    """The way that a vector moves the surface: in tangent space x runs along u, y along the normal, z along v."""
    count = len(site)
    moved = np.broadcast_to((np.asarray(vector, float) - spread(midlevel)) * spread(scale), (count, 3))
    if space == "TANGENT":
        tangent, sign = site.read_tangent(name)
        normal = site.normal_to_object(site.normal)
        bitangent = spread(sign) * normalize(cross(normal, tangent))
        moved = moved[:, 0:1] * tangent + moved[:, 1:2] * normal + moved[:, 2:3] * bitangent
    return moved if space == "WORLD" else site.to_world(moved, "OBJECT", "VECTOR")


def pixel_axes(site: Site) -> tuple[Array, Array]:
    """Two vectors (n, 3) of a pixel's size at right angles in the flat surface."""
    first, second = make_slanted_frame(site.geometric_normal)
    size = site.footprint[:, np.newaxis]
    return size * first, size * second


def read_tangent_of_map(site: Site, *, name: str) -> Array:
    """The direction in which u grows, in the surface."""
    tangent, sign = site.read_tangent(name)
    found = _lay_down(site, site.normal_to_world(tangent))
    return np.where(spread(sign) != 0, found, 0.0)


AROUND = {"X": (0, 2, 1), "Y": (1, 2, 0), "Z": (2, 1, 0)}


def read_radial_tangent(site: Site, *, axis: str, name: str) -> Array:
    """The direction around an axis of the object through the middle of its box, in the surface."""
    place = site.read_attribute(name)[:, :3] - 0.5
    _, first, second = AROUND[axis]
    tangent = np.zeros((len(site), 3))
    tangent[:, second], tangent[:, first] = -place[:, first], place[:, second]
    return _lay_down(site, site.normal_to_world(tangent))


def _lay_down(site: Site, tangent: Array) -> Array:
    return cross(site.normal, normalize(cross(tangent, site.normal)))


def name_of_map(settings: Mapping[str, Any]) -> tuple[str, ...]:
    return ("tangent " + settings["name"],)


_NORMAL = {"Normal": "NEW_GEOMETRY Normal"}

OPERATIONS = {
    "NORMAL_MAP": Operation(
        map_normal,
        ("Strength", "Color"),
        ("Normal",),
        ("space", "name", "invert_green"),
        reads_site=True,
        attributes=lambda settings: name_of_map(settings) if settings["space"] == "TANGENT" else (),
    ),
    "BUMP": Operation(
        bump,
        ("Strength", "Distance", "Filter Width", "Normal"),
        ("Normal",),
        ("height", "invert", "of_object"),
        reads_site=True,
        runs_programs=True,
        links=_NORMAL,
        attributes=lambda settings: (UNDISPLACED,) if settings.get("of_object") else (),
    ),
    "BEVEL": Operation(bevel, ("Radius", "Normal"), ("Normal",), ("samples",), reads_site=True, links=_NORMAL),
    "DISPLACEMENT": Operation(
        displace,
        ("Height", "Midlevel", "Scale", "Normal"),
        ("Displacement",),
        ("space",),
        reads_site=True,
        links=_NORMAL,
    ),
    "VECTOR_DISPLACEMENT": Operation(
        displace_freely,
        ("Vector", "Midlevel", "Scale"),
        ("Displacement",),
        ("space", "name"),
        reads_site=True,
        attributes=lambda settings: name_of_map(settings) if settings["space"] == "TANGENT" else (),
    ),
    "TANGENT UV_MAP": Operation(
        read_tangent_of_map, (), ("Tangent",), ("name",), reads_site=True, attributes=name_of_map
    ),
    "TANGENT RADIAL": Operation(
        read_radial_tangent,
        (),
        ("Tangent",),
        ("axis", "name"),
        reads_site=True,
        attributes=lambda settings: (settings["name"],),
    ),
}
