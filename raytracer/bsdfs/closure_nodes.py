"""Blender's shader nodes as sums of parts.

Each function takes closures of one kind, one per hit, and turns them into what they are made of: it adds to the diffuse
parts of the hits and returns lobes, of microfacets or of hair; `SCATTERING` lists them.

To add a shader that scatters: give its kind a name in `scene/materials.py` (CLOSURE_KINDS, and what parameters it
lacks), write one function here with one row of SCATTERING, say in `integrator/features.py` whether it is diffuse or
specular, and let the add-on read its sockets (`addon/extract/shaders/closures.py`, CLOSURE_READERS).

References
----------
Blender, intern/cycles/kernel/svm/closure.h: what the nodes are made of.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from raytracer.arrays.rows import any_column, repeat_column
from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import reflect
from raytracer.bsdfs.closures import Closures, Lobes, Points
from raytracer.bsdfs.diffuse import Toon, Velvet, make_sheen
from raytracer.bsdfs.fresnel import (
    CONDUCTOR,
    CONSTANT,
    DIELECTRIC,
    METAL,
    conductor_reflectance,
    metal_coefficient,
    metal_mean,
    metal_slope,
    normal_reflectance,
)
from raytracer.bsdfs.hair_closures import add_hair, add_hair_reflection, add_hair_transmission, add_huang_hair
from raytracer.bsdfs.lobes import Facets, make_lobes, read_film, read_grain, split_distributions, stretch_grain
from raytracer.bsdfs.microfacet import Microfacets
from raytracer.bsdfs.portals import Portals
from raytracer.bsdfs.principled import add_matte, add_principled


def _colors(closures: Closures) -> Floats:
    """(k, 3) weight times color."""
    return closures.weight[:, np.newaxis] * closures.color


def _add_diffuse(closures: Closures, points: Points) -> list[Microfacets]:
    color = closures.color
    add_matte(closures, points, closures.weight[:, np.newaxis] * color, color)
    return []


def _add_translucent(closures: Closures, points: Points) -> list[Microfacets]:
    """Lambertian on the far side."""
    points.add_part(-points.specular_normal()[0], _colors(closures), transmits=True)
    return []


def _add_subsurface(closures: Closures, points: Points) -> list[Microfacets]:
    color = closures.color
    points.add_subsurface(closures, _colors(closures), color, closures.subsurface_ior, closures.roughness)
    return []


def _add_sheen(closures: Closures, points: Points) -> list[Microfacets]:
    shape, albedo = make_sheen(points.normal, points.outgoing, closures.roughness)
    points.add_part(points.normal, _colors(closures) * albedo[:, np.newaxis], shape)
    return []


def _add_velvet(closures: Closures, points: Points) -> list[Microfacets]:
    points.add_part(points.normal, _colors(closures), Velvet(points.normal, points.outgoing, closures.roughness))
    return []


def _add_toon(closures: Closures, points: Points) -> list[Microfacets]:
    shape = Toon(points.normal, points.normal, closures.size, closures.smooth)
    points.add_part(points.normal, _colors(closures), shape)
    return []


def _add_glossy_toon(closures: Closures, points: Points) -> list[Microfacets]:
    """Toon around the mirror direction; sampled as a diffuse part."""
    axis = reflect(points.outgoing, points.normal)
    points.add_part(points.normal, _colors(closures), Toon(points.normal, axis, closures.size, closures.smooth))
    return []


def _add_glossy(closures: Closures, points: Points) -> list[Microfacets]:
    """Facets that reflect the color whatever the angle."""
    lobes = []
    for some, where, beckmann in split_distributions(closures, points):
        color, ones = some.color, np.ones(len(some))
        grain = stretch_grain(read_grain(some, beckmann), some, where, glossy=True)
        facets = Facets(CONSTANT, repeat_column(ones))
        lobes.append(make_lobes(some, where, _colors(some), ones, facets, grain, mean_color=color))
    return lobes


def _add_metal(closures: Closures, points: Points) -> list[Microfacets]:
    """Reflectance from the color at normal incidence to white at the border, tinted at 82 degrees."""
    lobes = []
    for some, where, beckmann in split_distributions(closures, points):
        f0 = np.minimum(some.color, 1.0)
        f82 = metal_coefficient(f0, np.minimum(some.specular_tint, 1.0))
        lobes.append(_reflect_metal(some, where, beckmann, METAL, f0, f82, metal_mean(f0, f82)))
    return lobes


def _add_conductor(closures: Closures, points: Points) -> list[Microfacets]:
    """Fresnel's reflectance of a complex index; further bounces by the metal that fits it at 0 and 82 degrees."""
    lobes = []
    for some, where, beckmann in split_distributions(closures, points):
        index, extinction = some.color, some.extinction
        f0, bent = (conductor_reflectance(np.array(cosine), index, extinction) for cosine in (1.0, 1.0 / 7.0))
        mean = np.clip(metal_mean(f0, metal_slope(f0, bent)), 0.0, 1.0)
        lobes.append(_reflect_metal(some, where, beckmann, CONDUCTOR, index, extinction, mean))
    return lobes


def _reflect_metal(
    closures: Closures, points: Points, beckmann: bool, fresnel: int, f0: Floats, f82: Floats, mean: Floats
) -> Microfacets:
    grain = stretch_grain(read_grain(closures, beckmann), closures, points)
    facets = Facets(fresnel, f0, f82, film=read_film(closures))
    weight, ones = repeat_column(closures.weight), np.ones(len(closures))
    return make_lobes(closures, points, weight, ones, facets, grain, mean_color=mean)


def _add_glass(closures: Closures, points: Points) -> list[Microfacets]:
    """Reflection and refraction with the color on both, as Fresnel's formulas share them out."""
    lobes = []
    for some, where, beckmann in split_distributions(closures, points):
        f0 = repeat_column(normal_reflectance(some.ior))
        film = read_film(some, where.find_outside_ior(some.ior))
        color = some.color
        facets = Facets(DIELECTRIC, f0, reflection=color, transmission=color, film=film)
        weight, eta = repeat_column(some.weight), where.relative_ior(some.ior)
        lobes.append(make_lobes(some, where, weight, eta, facets, read_grain(some, beckmann), mean_color=color))
    return lobes


def _add_refraction(closures: Closures, points: Points) -> list[Microfacets]:
    """Refraction of all the light, but for total reflection, without compensation for further bounces, as in Cycles."""
    lobes = []
    for some, where, beckmann in split_distributions(closures, points):
        white = repeat_column(np.ones(len(some)))
        facets = Facets(CONSTANT, white, reflection=0.0 * white, transmission=white)
        eta = where.relative_ior(some.ior)
        lobes.append(make_lobes(some, where, _colors(some), eta, facets, read_grain(some, beckmann), mean_color=None))
    return lobes


def _add_portal(closures: Closures, points: Points) -> list[Lobes]:
    """Light from elsewhere: straight on where a portal has no direction."""
    weight = _colors(closures)
    position = points.vectors.get("position", np.full_like(weight, np.nan))
    direction = points.vectors.get("direction", np.zeros_like(weight))
    direction = np.where(direction.any(axis=1)[:, np.newaxis], direction, -points.outgoing)
    open_ = np.flatnonzero(any_column(weight > 0))
    points.portals.append(Portals(points.rows, weight, position, direction).select(open_))
    return []


SCATTERING: dict[str, Callable[[Closures, Points], Sequence[Lobes]]] = {
    "principled": add_principled,
    "diffuse": _add_diffuse,
    "glossy": _add_glossy,
    "glass": _add_glass,
    "refraction": _add_refraction,
    "metal": _add_metal,
    "conductor": _add_conductor,
    "translucent": _add_translucent,
    "subsurface": _add_subsurface,
    "sheen": _add_sheen,
    "velvet": _add_velvet,
    "toon": _add_toon,
    "glossy_toon": _add_glossy_toon,
    "hair": add_hair,
    "hair_huang": add_huang_hair,
    "hair_reflection": add_hair_reflection,
    "hair_transmission": add_hair_transmission,
    "portal": _add_portal,
}
