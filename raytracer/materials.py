"""Materials at the points that rays hit: Blender's shader nodes as sums of lobes.

A material is a sum of closures (`scene.Closure`). At each hit every closure becomes what it is made of: radiance that
shines, light that passes straight through, a diffuse share, and microfacet lobes. All work on arrays of hits, grouped
by kind of closure; parameters are arrays with one row per hit, so that they may vary over a surface.
Imports `microfacet`, `microfacet_albedo`, `rays`, `scene`.

References
----------
Blender, intern/cycles/kernel/svm/closure.h: how the nodes are layered.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.lecture import dot
from raytracer.microfacet import (
    CONSTANT,
    DIELECTRIC,
    METAL,
    Microfacets,
    evaluate_fresnel,
    metal_coefficient,
    normal_reflectance,
    tilt_to_reflect,
)
from raytracer.microfacet_albedo import (
    compensate,
    mean_dielectric_reflectance,
    read_glass,
    read_reflection,
    read_schlick_share,
)
from raytracer.rays import Floats, Integers, Surface
from raytracer.scene import CLOSURE_KINDS, Closure, Scene

# Cycles drops closures of a smaller weight.
SMALLEST_WEIGHT = 1e-5
# Cycles' limit on the reflectance that a specular level may ask for; above it the index of refraction runs to infinity.
LARGEST_REFLECTANCE = 0.99

# A rough lobe is picked at least so often, as a share of its weight.
SMALLEST_PICK = 2.0**-6

PARAMETERS = tuple(field.name for field in dataclasses.fields(Closure) if field.name != "kind")
Rows = NDArray[np.int64]


@dataclass(frozen=True, eq=False, slots=True)
class Closures:
    """n closures of one kind: Closure's fields as arrays, (n,), or (n, 3) for colours."""

    color: Floats
    weight: Floats
    roughness: Floats
    ior: Floats
    metallic: Floats
    transmission: Floats
    specular: Floats
    specular_tint: Floats
    emission: Floats
    alpha: Floats

    def select(self, rows: Any) -> Closures:
        """Return some of the closures: index or boolean array."""
        return Closures(*(getattr(self, name)[rows] for name in PARAMETERS))


@dataclass(frozen=True, eq=False)
class MaterialTable:
    """All materials of a scene; slot s of a material is its closure number s.

    kinds : tuple of (materials,) int64 per slot, index into CLOSURE_KINDS, -1 = the material has no such closure
    parameters : tuple of Closures per slot, one row per material
    radiance : (materials, 3) float64, that the material's surface shines with
    transparency : (materials, 3) float64, share of light that passes straight through
    pass_index : (materials,) int32
    """

    kinds: tuple[NDArray[np.int64], ...]
    parameters: tuple[Closures, ...]
    radiance: Floats
    transparency: Floats
    pass_index: Integers


def make_material_table(scene: Scene) -> MaterialTable:
    """Pack the closures of a scene's materials; closures without weight are left out."""
    kept = [[item for item in material.closures if item.weight > 0] for material in scene.materials]
    slots = range(max(map(len, kept)))
    columns = [[items[slot] if slot < len(items) else None for items in kept] for slot in slots]
    return MaterialTable(
        kinds=tuple(
            np.array([-1 if item is None else CLOSURE_KINDS.index(item.kind) for item in column]) for column in columns
        ),
        parameters=tuple(pack_closures([item or Closure("transparent") for item in column]) for column in columns),
        radiance=_sum_colors(kept, _radiance_of),
        transparency=_sum_colors(kept, _transparency_of),
        pass_index=np.array([material.pass_index for material in scene.materials], dtype=np.int32),
    )


def pack_closures(closures: list[Closure]) -> Closures:
    """Stack Closure records of any kinds into arrays."""
    return Closures(*(np.array([getattr(item, name) for item in closures], dtype=np.float64) for name in PARAMETERS))


def _sum_colors(kept: list[list[Closure]], part: Callable[[Closure], Any]) -> Floats:
    return np.array([sum((item.weight * part(item) for item in items), start=np.zeros(3)) for items in kept])


def _radiance_of(closure: Closure) -> Any:
    if closure.kind == "principled":
        return closure.alpha * closure.emission
    return closure.color if closure.kind == "emission" else np.zeros(3)


def _transparency_of(closure: Closure) -> Any:
    if closure.kind == "principled":
        return np.full(3, 1.0 - closure.alpha)
    return closure.color if closure.kind == "transparent" else np.zeros(3)


@dataclass(frozen=True, eq=False, slots=True)
class Shading:
    """What n points of a surface do with light.

    normal, geometric_normal : (n, 3) float64, unit, turned to the side that the ray came from
    outgoing : (n, 3) float64, unit, towards where the ray came from
    radiance : (n, 3) float64, that the surface shines with
    transparency : (n, 3) float64, share of light that passes straight through
    diffuse : (n, 3) float64, albedo of the Lambertian part, f = diffuse / pi
    lobes : microfacet lobes, each for some of the points
    """

    normal: Floats
    geometric_normal: Floats
    outgoing: Floats
    radiance: Floats
    transparency: Floats
    diffuse: Floats
    lobes: tuple[Microfacets, ...]

    def __len__(self) -> int:
        return len(self.normal)


def make_shading(table: MaterialTable, surface: Surface) -> Shading:
    """Return the Shading at n points of a surface."""
    sign = np.where(surface.front, 1.0, -1.0)[:, np.newaxis]
    lobes: list[Microfacets] = []
    shading = Shading(
        normal=sign * surface.shading_normal,
        geometric_normal=sign * surface.geometric_normal,
        outgoing=surface.outgoing,
        radiance=table.radiance[surface.material],
        transparency=table.transparency[surface.material],
        diffuse=np.zeros((len(surface), 3)),
        lobes=(),
    )
    for kinds, parameters in zip(table.kinds, table.parameters, strict=True):
        kind_of_hit = kinds[surface.material]
        for kind, add_closures in SCATTERING.items():
            rows = np.flatnonzero(kind_of_hit == CLOSURE_KINDS.index(kind))
            if len(rows):
                points = _Points(rows, surface.front[rows], shading)
                lobes.extend(add_closures(parameters.select(surface.material[rows]), points))
    return dataclasses.replace(shading, lobes=tuple(lobe for lobe in lobes if len(lobe)))


@dataclass(frozen=True, eq=False, slots=True)
class _Points:
    """Where closures of one kind stand: rows (k,) of the batch, and the side the ray came from."""

    rows: Rows
    front: NDArray[np.bool_]
    shading: Shading

    def select(self, part: NDArray[np.bool_]) -> _Points:
        return _Points(self.rows[part], self.front[part], self.shading)

    def specular_normal(self) -> tuple[Floats, Floats]:
        """Return the normals (k, 3) of microfacet lobes and the cosine (k,) of the view against them."""
        shading, rows = self.shading, self.rows
        outgoing = shading.outgoing[rows]
        normal = tilt_to_reflect(shading.normal[rows], shading.geometric_normal[rows], outgoing)
        return normal, dot(normal, outgoing)

    def relative_ior(self, ior: Floats) -> Floats:
        """Return the index of refraction behind the surface over that before it: 1 / ior from inside."""
        return np.where(self.front, ior, 1.0 / ior)


# The nodes -----------------------------------------------------------------------------------------------------------


def _add_diffuse(closures: Closures, points: _Points) -> list[Microfacets]:
    points.shading.diffuse[points.rows] += closures.weight[:, np.newaxis] * closures.color
    return []


def _add_glossy(closures: Closures, points: _Points) -> list[Microfacets]:
    """GGX that reflects its colour from every facet, whatever the angle."""
    white = np.ones_like(closures.color)
    lobes = _make_lobes(
        points,
        closures.weight[:, np.newaxis] * closures.color,
        closures.roughness,
        np.ones(len(points.rows)),
        CONSTANT,
        white,
        np.zeros_like(white),
        white,
        np.zeros_like(white),
        mean_color=closures.color,
    )
    return [lobes]


def _add_glass(closures: Closures, points: _Points) -> list[Microfacets]:
    """Reflection and refraction with the colour on both, as Fresnel's formulas share them out."""
    f0 = np.repeat(normal_reflectance(closures.ior)[:, np.newaxis], 3, axis=1)
    lobes = _make_lobes(
        points,
        np.repeat(closures.weight[:, np.newaxis], 3, axis=1),
        closures.roughness,
        points.relative_ior(closures.ior),
        DIELECTRIC,
        f0,
        np.zeros_like(f0),
        closures.color,
        closures.color,
        mean_color=closures.color,
    )
    return [lobes]


def _add_refraction(closures: Closures, points: _Points) -> list[Microfacets]:
    """Refraction of all the light, but for total reflection, without compensation for further bounces, as in Cycles."""
    white = np.ones_like(closures.color)
    lobes = _make_lobes(
        points,
        closures.weight[:, np.newaxis] * closures.color,
        closures.roughness,
        points.relative_ior(closures.ior),
        CONSTANT,
        white,
        np.zeros_like(white),
        np.zeros_like(white),
        white,
        mean_color=None,
    )
    return [lobes]


def _add_principled(closures: Closures, points: _Points) -> list[Microfacets]:
    """Layers from the top: what alpha lets through, metal, glass, a dielectric coat over a diffuse base."""
    weight = np.repeat((closures.weight * closures.alpha)[:, np.newaxis], 3, axis=1)
    lobes = [_principled_metal(closures, points, weight)]
    weight = weight * (1.0 - closures.metallic)[:, np.newaxis]
    lobes.append(_principled_glass(closures, points, weight))
    weight = weight * (1.0 - closures.transmission)[:, np.newaxis]
    specular, under = _principled_specular(closures, points, weight)
    points.shading.diffuse[points.rows] += under * closures.color
    return [*lobes, specular]


def _principled_metal(closures: Closures, points: _Points, weight: Floats) -> Microfacets:
    """Reflectance from the base colour at normal incidence to white at the border, tinted at 82 degrees."""
    part = (closures.metallic > SMALLEST_WEIGHT) & (weight > 0).any(axis=1)
    closures, weight = closures.select(part), weight[part]
    f0 = np.minimum(closures.color, 1.0)
    f82 = metal_coefficient(f0, np.minimum(closures.specular_tint, 1.0))
    mean = f0 + (1.0 - f0) / 21.0 - f82 / 126.0  # 2 integral_0^1 F(c) c dc
    white = np.ones_like(f0)
    return _make_lobes(
        points.select(part),
        weight * closures.metallic[:, np.newaxis],
        closures.roughness,
        white[:, 0],
        METAL,
        f0,
        f82,
        white,
        np.zeros_like(white),
        mean_color=mean,
    )


def _principled_glass(closures: Closures, points: _Points, weight: Floats) -> Microfacets:
    """Glass whose base colour tints each passage by its square root, so that a solid has it once."""
    part = (closures.transmission > SMALLEST_WEIGHT) & (weight > 0).any(axis=1)
    closures, points, weight = closures.select(part), points.select(part), weight[part]
    tint = np.sqrt(np.minimum(closures.color, 1.0))
    f0 = np.minimum(normal_reflectance(closures.ior)[:, np.newaxis] * closures.specular_tint, 1.0)
    return _make_lobes(
        points,
        weight * closures.transmission[:, np.newaxis],
        closures.roughness,
        points.relative_ior(closures.ior),
        DIELECTRIC,
        f0,
        np.zeros_like(f0),
        np.ones_like(f0),
        tint,
        mean_color=tint,
    )


def _principled_specular(closures: Closures, points: _Points, weight: Floats) -> tuple[Microfacets, Floats]:
    """Return the dielectric reflection on top, and the weight (k, 3) left for what lies under it."""
    eta, f0 = _specular_level(closures.ior, closures.specular)
    part = (eta != 1.0) & (weight > 0).any(axis=1)
    closures, points = closures.select(part), points.select(part)
    under = weight.copy()
    weight, eta = weight[part], eta[part]
    tinted = np.minimum(f0[part, np.newaxis] * closures.specular_tint, 1.0)
    plain = normal_reflectance(eta)
    rise = np.clip((mean_dielectric_reflectance(eta) - plain) / (1.0 - plain), 0.0, 1.0)[:, np.newaxis]
    white = np.ones_like(tinted)
    lobes = _make_lobes(
        points,
        weight,
        closures.roughness,
        eta,
        DIELECTRIC,
        tinted,
        np.zeros_like(tinted),
        white,
        np.zeros_like(tinted),
        mean_color=tinted + (1.0 - tinted) * rise,
    )
    cosine = np.clip(dot(lobes.normal, points.shading.outgoing[points.rows]), 0.0, 1.0)
    share = read_schlick_share(closures.roughness, cosine, eta)[:, np.newaxis]
    single = np.ones_like(share)
    rough = np.flatnonzero(~lobes.is_perfect)
    if len(rough):
        single[rough, 0] = read_reflection(closures.roughness[rough], cosine[rough])[0]
    # What the lobe sends on: its weight holds the factor for further bounces, which the mean over facets does not.
    albedo = (
        (tinted + (1.0 - tinted) * share)
        * single
        * np.divide(lobes.weight, weight, out=np.ones_like(weight), where=weight > 0)
    )
    under[part] = weight * np.clip(1.0 - albedo.max(axis=1, keepdims=True), 0.0, 1.0)
    return lobes, under


def _specular_level(ior: Floats, level: Floats) -> tuple[Floats, Floats]:
    """Return the index of refraction and the reflectance at normal incidence of Blender's Specular IOR Level, which
    scales the latter by twice the level."""
    f0 = normal_reflectance(ior) * 2.0 * level
    root = np.sqrt(np.minimum(f0, LARGEST_REFLECTANCE))
    eta = (1.0 + root) / (1.0 - root)
    eta = np.where(ior < 1.0, 1.0 / eta, eta)
    return np.where(level == 0.5, ior, eta), f0


def _make_lobes(
    points: _Points,
    weight: Floats,
    roughness: Floats,
    eta: Floats,
    fresnel: int,
    f0: Floats,
    f82: Floats,
    reflection: Floats,
    transmission: Floats,
    mean_color: Floats | None,
) -> Microfacets:
    """Return lobes whose weight includes the bounces after the first, of colour `mean_color`; None leaves them out."""
    normal, cosine = points.specular_normal()
    cosine = np.clip(cosine, 0.0, 1.0)
    lobes = Microfacets(
        points.rows,
        weight,
        normal,
        roughness * roughness,
        eta,
        np.full(len(points.rows), fresnel, dtype=np.int8),
        f0,
        f82,
        reflection,
        transmission,
        albedo=np.ones(len(points.rows)),
    )
    lobes = dataclasses.replace(lobes, albedo=_estimate_albedo(lobes, cosine))
    rough = np.flatnonzero(~lobes.is_perfect)
    if mean_color is None or not len(rough):
        return lobes
    if fresnel == DIELECTRIC and (transmission > 0).any():
        share, mean = read_glass(roughness[rough], cosine[rough], eta[rough])
    else:
        share, mean = read_reflection(roughness[rough], cosine[rough])
    scaled = weight.copy()
    scaled[rough] *= compensate(share, mean, np.minimum(mean_color[rough], 1.0))
    return dataclasses.replace(lobes, weight=scaled)


def _estimate_albedo(lobes: Microfacets, cosine: Floats) -> Floats:
    """Return about how much light (m,) each lobe sends on, by which one of them is picked.

    The estimate is that of a smooth surface. Rough lobes keep a small share where that is black, for some of their
    facets are met at other angles; refraction keeps its full share in total reflection.
    """
    reflected, passed = evaluate_fresnel(lobes, cosine)
    tints = (lobes.reflection + lobes.transmission).mean(axis=1)
    smooth = (reflected + passed).mean(axis=1)
    smooth = np.where(lobes.fresnel == CONSTANT, tints, smooth)
    return np.where(lobes.is_perfect, smooth, np.maximum(smooth, SMALLEST_PICK * tints))


SCATTERING: dict[str, Callable[[Closures, _Points], list[Microfacets]]] = {
    "principled": _add_principled,
    "diffuse": _add_diffuse,
    "glossy": _add_glossy,
    "glass": _add_glass,
    "refraction": _add_refraction,
}
