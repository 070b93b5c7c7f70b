"""The Principled BSDF: layers from the top, each of which leaves some weight to what lies under it.

What alpha lets through; sheen; a clear coat; then metal, glass, and a dielectric surface over a matte base. Layers that
no material of a table uses are not looked at.

References
----------
Blender, intern/cycles/kernel/svm/closure.h, svm_node_closure_bsdf: the order of the layers, and their weights.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.rows import any_column, largest_column, repeat_column, take_rows
from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import normalize
from raytracer.bsdfs.closures import Closures, Points
from raytracer.bsdfs.diffuse import make_rough_matte, make_sheen
from raytracer.bsdfs.fresnel import (
    DIELECTRIC,
    METAL,
    metal_coefficient,
    metal_mean,
    normal_reflectance,
    schlick_share,
    transmitted_cosine,
)
from raytracer.bsdfs.lobes import Facets, Grain, make_lobes, read_film, read_grain, stretch_grain
from raytracer.bsdfs.microfacet import Microfacets, evaluate_fresnel
from raytracer.bsdfs.microfacet_albedo import mean_dielectric_reflectance, read_reflection, read_schlick_share
from raytracer.bsdfs.thin_film import THINNEST
from raytracer.lecture import dot

# Cycles drops closures of a smaller weight.
SMALLEST_WEIGHT = 1e-5
# Cycles' limit on the reflectance that a specular level may ask for; above it the index of refraction runs to infinity.
LARGEST_REFLECTANCE = 0.99


def add_principled(closures: Closures, points: Points) -> list[Microfacets]:
    """Add what the layers of Principled closures are made of, from the top: sheen, coat, metal, glass, base."""
    lobes = []
    weight = repeat_column(closures.weight * closures.alpha)
    if closures.uses("sheen_weight"):
        weight = _add_sheen(closures, points, weight)
    if closures.uses("coat_weight"):
        coat, weight = _make_coat(closures, points, weight)
        lobes.append(coat)
    metallic = closures.metallic
    if metallic.any():
        lobes.append(_make_metal(closures, points, weight * metallic[:, np.newaxis]))
        weight = weight * (1.0 - metallic)[:, np.newaxis]
    transmission = closures.transmission
    if transmission.any():
        lobes.append(_make_glass(closures, points, weight * transmission[:, np.newaxis]))
        weight = weight * (1.0 - transmission)[:, np.newaxis]
    specular, under = _make_specular(closures, points, weight)
    color = closures.color
    if closures.uses("subsurface"):
        under = _add_subsurface(closures, points, under)
    add_matte(closures, points, under * color, color, full=True)
    return [*lobes, specular]


def add_matte(closures: Closures, points: Points, albedo: Floats, color: Floats, full: bool = False) -> None:
    """Add matte surfaces of an albedo (k, 3), rough ones by the model of Oren and Nayar, of a color (k, 3).

    full : True gives back all the light lost between rough facets, whatever the closures say
    """
    if not closures.uses("diffuse_roughness"):
        points.add_diffuse(albedo)
        return
    roughness = closures.diffuse_roughness
    rough = roughness >= SMALLEST_WEIGHT
    points.select(~rough).add_diffuse(take_rows(albedo, ~rough))
    where = points.select(rough)
    returned = np.ones(len(where.rows)) if full else closures.multiscatter[rough]
    shape = make_rough_matte(where.normal, where.outgoing, roughness[rough], take_rows(color, rough), returned)
    where.add_part(where.normal, take_rows(albedo, rough), shape)


def _leave_under(weight: Floats, albedo: Floats) -> Floats:
    """Return the weight (k, 3) left under a layer that sends `albedo` (k, 3) of it on: even, by the largest channel."""
    return weight * np.clip(1.0 - largest_column(albedo)[:, np.newaxis], 0.0, 1.0)


def _add_sheen(closures: Closures, points: Points, weight: Floats) -> Floats:
    """Add fibres on top, and return the weight left under them."""
    part = (closures.sheen_weight > SMALLEST_WEIGHT) & any_column(weight > 0)
    some, where = closures.select(part), points.select(part)
    normal = where.normal
    if "coat_normal" in where.vectors:
        coated = np.minimum(some.coat_weight, 1.0)[:, np.newaxis]
        normal = normalize(normal + coated * (where.vectors["coat_normal"] - normal))
    shape, albedo = make_sheen(normal, where.outgoing, some.sheen_roughness)
    tint = some.sheen_weight[:, np.newaxis] * some.sheen_tint * albedo[:, np.newaxis]
    where.add_part(normal, tint * take_rows(weight, part), shape)
    under = weight.copy("K")
    under[part] = _leave_under(take_rows(weight, part), tint)
    return under


def _make_coat(closures: Closures, points: Points, weight: Floats) -> tuple[Microfacets, Floats]:
    """Return clear varnish, and the weight left under it, tinted by its depth along the view: tint^(1 / cos)."""
    part = (closures.coat_weight > SMALLEST_WEIGHT) & any_column(weight > 0)
    some, where = closures.select(part), points.select(part)
    eta, amount = some.coat_ior, some.coat_weight[:, np.newaxis]
    f0, mean = repeat_column(normal_reflectance(eta)), repeat_column(mean_dielectric_reflectance(eta))
    facets = Facets(DIELECTRIC, f0)
    grain = Grain(some.coat_roughness, 1.0 - some.simple_coat)
    plain = amount * take_rows(weight, part)
    name = "coat_normal" if "coat_normal" in where.vectors else "normal"
    lobes = make_lobes(some, where, plain, eta, facets, grain, mean, name)
    under = weight.copy("K")
    under[part] = _leave_under(
        take_rows(weight, part), amount * _layer_albedo(lobes, where, plain, grain, some.simple_coat)
    )
    depth = 1.0 / transmitted_cosine(np.clip(dot(lobes.normal, where.outgoing), 0.0, 1.0), eta)
    tinted = some.coat_tint ** depth[:, np.newaxis]
    under[part] *= np.maximum(1.0 + amount * (tinted - 1.0), 0.0)
    return lobes, under


def _make_metal(closures: Closures, points: Points, weight: Floats) -> Microfacets:
    """Reflectance from the base color at normal incidence to white at the border, tinted at 82 degrees."""
    part = (closures.metallic > SMALLEST_WEIGHT) & any_column(weight > 0)
    some, where = closures.select(part), points.select(part)
    f0 = np.minimum(some.color, 1.0)
    f82 = metal_coefficient(f0, np.minimum(some.specular_tint, 1.0))
    facets = Facets(METAL, f0, f82, film=None if closures.uses("bare_metal") else read_film(some))
    grain, eta = stretch_grain(read_grain(some), some, where), np.ones(len(f0))
    return make_lobes(some, where, take_rows(weight, part), eta, facets, grain, mean_color=metal_mean(f0, f82))


def _make_glass(closures: Closures, points: Points, weight: Floats) -> Microfacets:
    """Glass whose base color tints each passage by its square root, so that a solid has it once."""
    part = (closures.transmission > SMALLEST_WEIGHT) & any_column(weight > 0)
    some, where = closures.select(part), points.select(part)
    tint = np.sqrt(np.minimum(some.color, 1.0))
    f0 = np.minimum(normal_reflectance(some.ior)[:, np.newaxis] * some.specular_tint, 1.0)
    film = read_film(some, where.find_outside_ior(some.ior))
    facets = Facets(DIELECTRIC, f0, transmission=tint, film=film)
    return make_lobes(
        some, where, take_rows(weight, part), where.relative_ior(some.ior), facets, read_grain(some), tint
    )


def _make_specular(closures: Closures, points: Points, weight: Floats) -> tuple[Microfacets, Floats]:
    """Return the dielectric reflection on top, and the weight (k, 3) left for what lies under it."""
    eta, f0 = _specular_level(closures.ior, closures.specular)
    film = read_film(closures)
    reflects = eta != 1.0 if film is None else (eta != 1.0) | (film.thickness > THINNEST)
    part = reflects & any_column(weight > 0)
    some, where = closures.select(part), points.select(part)
    plain, eta = take_rows(weight, part), eta[part]
    tinted = np.minimum(f0[part, np.newaxis] * some.specular_tint, 1.0)
    own = normal_reflectance(eta)
    rise = np.clip((mean_dielectric_reflectance(eta) - own) / (1.0 - own), 0.0, 1.0)[:, np.newaxis]
    facets = Facets(DIELECTRIC, tinted, film=None if film is None else film.select(part))
    grain = stretch_grain(read_grain(some), some, where)
    lobes = make_lobes(some, where, plain, eta, facets, grain, mean_color=tinted + (1.0 - tinted) * rise)
    under = weight.copy("K")
    under[part] = _leave_under(plain, _layer_albedo(lobes, where, plain, grain))
    return lobes, under


def _add_subsurface(closures: Closures, points: Points, weight: Floats) -> Floats:
    """Add what is scattered below the surface, and return the weight left for a matte base; light enters by the
    surface's own index of refraction, but skin has its own."""
    part = (closures.subsurface > 0) & any_column(weight > 0)
    some, where, share = closures.select(part), points.select(part), closures.subsurface[:, np.newaxis]
    color = np.minimum(some.color, 1.0)
    ior = np.where(some.skin > 0, some.subsurface_ior, _specular_level(some.ior, some.specular)[0])
    where.add_subsurface(some, weight[part] * share[part] * color, color, ior, some.roughness**2)
    return weight * (1.0 - share)


def _layer_albedo(
    lobes: Microfacets, points: Points, weight: Floats, grain: Grain, smooth: Floats | float = 0.0
) -> Floats:
    """Return what share (k, 3) of its weight a dielectric layer sends on.

    smooth : 1 where its Fresnel reflectance is taken at the normal, not as the mean over facets

    The lobes' own weight holds the factor for further bounces, which the mean over facets does not.
    """
    cosine = np.clip(dot(lobes.normal, points.outgoing), 0.0, 1.0)
    rough = read_schlick_share(grain.roughness, cosine, lobes.eta)
    share = np.where(smooth, schlick_share(cosine, lobes.eta), rough)[:, np.newaxis]
    single = np.ones_like(share)
    rows = np.flatnonzero(~lobes.is_perfect & (grain.multiscatter > 0))
    if len(rows):
        single[rows, 0] = read_reflection(grain.roughness[rows], cosine[rows])[0]
    further = np.divide(lobes.weight, weight, out=np.ones_like(weight), where=weight > 0)
    reflected = lobes.f0 + (1.0 - lobes.f0) * share
    if lobes.film is not None:  # no mean over facets is known
        reflected = np.where(
            lobes.film.thickness[:, np.newaxis] > THINNEST, evaluate_fresnel(lobes, cosine)[0], reflected
        )
    return reflected * single * further


def _specular_level(ior: Floats, level: Floats) -> tuple[Floats, Floats]:
    """Return the index of refraction and the reflectance at normal incidence of Blender's Specular IOR Level, which
    scales the latter by twice the level."""
    f0 = normal_reflectance(ior) * 2.0 * level
    root = np.sqrt(np.minimum(f0, LARGEST_REFLECTANCE))
    eta = (1.0 + root) / (1.0 - root)
    eta = np.where(ior < 1.0, 1.0 / eta, eta)
    return np.where(level == 0.5, ior, eta), f0
