"""Blender's shader nodes as sums of lobes.

Each function takes closures of one kind, one per hit, and turns them into what they are made of: it adds to the
diffuse albedo of the hits and returns microfacet lobes. Radiance and transparency, which need no direction, are summed
where the table of materials is made (`materials`).
Imports `microfacet`, `microfacet_albedo`, `rays`, `scene`.

References
----------
Blender, intern/cycles/kernel/svm/closure.h: how the nodes are layered.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.frames import normalize
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
from raytracer.programs import Register
from raytracer.rays import Floats
from raytracer.scene import CLOSURE_COLORS, Closure

# Cycles drops closures of a smaller weight.
SMALLEST_WEIGHT = 1e-5
# Cycles' limit on the reflectance that a specular level may ask for; above it the index of refraction runs to infinity.
LARGEST_REFLECTANCE = 0.99

# Cycles' limit: with a relative index of refraction this close to 1 light passes straight on, and the half vector of
# refraction, eta i + o, is not defined.
SMALLEST_ETA_STEP = 1e-4
# A rough lobe is picked at least so often, as a share of its weight.
SMALLEST_PICK = 2.0**-6

# What a Closure says in numbers and colours; its kind decides on the function, its normal stands in `Points`.
PARAMETERS = tuple(item.name for item in dataclasses.fields(Closure) if item.name not in ("kind", "normal"))
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


def pack_closures(closures: list[Closure]) -> Closures:
    """Stack Closure records of any kinds into arrays; what a program computes is NaN."""

    def read(item: Closure, name: str) -> Any:
        value = getattr(item, name)
        if not isinstance(value, Register):
            return value
        return np.full(3, np.nan) if name in CLOSURE_COLORS else np.nan

    return Closures(*(np.array([read(item, name) for item in closures], dtype=np.float64) for name in PARAMETERS))


@dataclass(frozen=True, eq=False, slots=True)
class TiltedDiffuse:
    """Lambertian parts whose normal a texture bends, for some points of a batch.

    hit : (m,) int64, ascending, the point in its batch
    normal : (m, 3) float64, unit
    albedo : (m, 3) float64
    """

    hit: Rows
    normal: Floats
    albedo: Floats


@dataclass(frozen=True, eq=False, slots=True)
class Shading:
    """What n points of a surface do with light.

    normal, geometric_normal : (n, 3) float64, unit, turned to the side that the ray came from
    outgoing : (n, 3) float64, unit, towards where the ray came from
    radiance : (n, 3) float64, that the surface shines with
    transparency : (n, 3) float64, share of light that passes straight through
    diffuse : (n, 3) float64, albedo of the Lambertian part, f = diffuse / pi
    lobes : microfacet lobes, each for some of the points
    tilted : Lambertian parts with normals of their own
    """

    normal: Floats
    geometric_normal: Floats
    outgoing: Floats
    radiance: Floats
    transparency: Floats
    diffuse: Floats
    lobes: tuple[Microfacets, ...]
    tilted: tuple[TiltedDiffuse, ...] = ()

    def __len__(self) -> int:
        return len(self.normal)

    def sum_diffuse(self) -> Floats:
        """(n, 3) the albedo of all Lambertian parts."""
        total = self.diffuse.copy() if self.tilted else self.diffuse
        for part in self.tilted:
            total[part.hit] += part.albedo
        return total

    def average_normal(self) -> Floats:
        """(n, 3) unit, the normals of all parts weighed by their weights, as far as a texture bends any of them."""
        if not self.tilted:
            return self.normal
        total = self.diffuse.mean(axis=1, keepdims=True) * self.normal
        for part in self.tilted:
            total[part.hit] += part.albedo.mean(axis=1, keepdims=True) * part.normal
        for lobes in self.lobes:
            total[lobes.hit] += lobes.weight.mean(axis=1, keepdims=True) * lobes.normal
        return np.where((total != 0).any(axis=1, keepdims=True), normalize(total), self.normal)


@dataclass(frozen=True, eq=False, slots=True)
class Points:
    """Where closures of one kind stand: rows (k,) of the batch, the side the ray came from, and their own normals
    (k, 3) or None."""

    rows: Rows
    front: NDArray[np.bool_]
    shading: Shading
    own_normal: Floats | None = None
    tilted: list[TiltedDiffuse] = field(default_factory=list)

    def select(self, part: NDArray[np.bool_]) -> Points:
        own = None if self.own_normal is None else self.own_normal[part]
        return Points(self.rows[part], self.front[part], self.shading, own, self.tilted)

    @property
    def normal(self) -> Floats:
        """(k, 3) the closures' normals."""
        return self.shading.normal[self.rows] if self.own_normal is None else self.own_normal

    def add_diffuse(self, albedo: Floats) -> None:
        """Add Lambertian parts of albedo (k, 3)."""
        if self.own_normal is None:
            self.shading.diffuse[self.rows] += albedo
        else:
            self.tilted.append(TiltedDiffuse(self.rows, self.own_normal, albedo))

    def specular_normal(self) -> tuple[Floats, Floats]:
        """Return the normals (k, 3) of microfacet lobes and the cosine (k,) of the view against them."""
        shading, rows = self.shading, self.rows
        outgoing = shading.outgoing[rows]
        normal = tilt_to_reflect(self.normal, shading.geometric_normal[rows], outgoing)
        return normal, dot(normal, outgoing)

    def relative_ior(self, ior: Floats) -> Floats:
        """Return the index of refraction behind the surface over that before it: 1 / ior from inside."""
        return np.where(self.front, ior, 1.0 / ior)


def _add_diffuse(closures: Closures, points: Points) -> list[Microfacets]:
    points.add_diffuse(closures.weight[:, np.newaxis] * closures.color)
    return []


@dataclass(frozen=True, eq=False, slots=True)
class Facets:
    """What the facets of k lobes do with light; fields as in `microfacet.Microfacets`."""

    fresnel: int
    f0: Floats
    f82: Floats
    reflection: Floats
    transmission: Floats


def _add_glossy(closures: Closures, points: Points) -> list[Microfacets]:
    """GGX that reflects its colour from every facet, whatever the angle."""
    white = np.ones_like(closures.color)
    facets = Facets(CONSTANT, white, 0.0 * white, white, 0.0 * white)
    weight = closures.weight[:, np.newaxis] * closures.color
    return [_make_lobes(points, weight, closures.roughness, white[:, 0], facets, mean_color=closures.color)]


def _add_glass(closures: Closures, points: Points) -> list[Microfacets]:
    """Reflection and refraction with the colour on both, as Fresnel's formulas share them out."""
    f0 = np.repeat(normal_reflectance(closures.ior)[:, np.newaxis], 3, axis=1)
    facets = Facets(DIELECTRIC, f0, 0.0 * f0, closures.color, closures.color)
    weight, eta = np.repeat(closures.weight[:, np.newaxis], 3, axis=1), points.relative_ior(closures.ior)
    return [_make_lobes(points, weight, closures.roughness, eta, facets, mean_color=closures.color)]


def _add_refraction(closures: Closures, points: Points) -> list[Microfacets]:
    """Refraction of all the light, but for total reflection, without compensation for further bounces, as in Cycles."""
    white = np.ones_like(closures.color)
    facets = Facets(CONSTANT, white, 0.0 * white, 0.0 * white, white)
    weight, eta = closures.weight[:, np.newaxis] * closures.color, points.relative_ior(closures.ior)
    return [_make_lobes(points, weight, closures.roughness, eta, facets, mean_color=None)]


def _add_principled(closures: Closures, points: Points) -> list[Microfacets]:
    """Layers from the top: what alpha lets through, metal, glass, a dielectric coat over a diffuse base."""
    weight = np.repeat((closures.weight * closures.alpha)[:, np.newaxis], 3, axis=1)
    lobes = [_principled_metal(closures, points, weight)]
    weight = weight * (1.0 - closures.metallic)[:, np.newaxis]
    lobes.append(_principled_glass(closures, points, weight))
    weight = weight * (1.0 - closures.transmission)[:, np.newaxis]
    specular, under = _principled_specular(closures, points, weight)
    points.add_diffuse(under * closures.color)
    return [*lobes, specular]


def _principled_metal(closures: Closures, points: Points, weight: Floats) -> Microfacets:
    """Reflectance from the base colour at normal incidence to white at the border, tinted at 82 degrees."""
    part = (closures.metallic > SMALLEST_WEIGHT) & (weight > 0).any(axis=1)
    closures, weight = closures.select(part), weight[part]
    f0 = np.minimum(closures.color, 1.0)
    f82 = metal_coefficient(f0, np.minimum(closures.specular_tint, 1.0))
    mean = f0 + (1.0 - f0) / 21.0 - f82 / 126.0  # 2 integral_0^1 F(c) c dc
    white = np.ones_like(f0)
    facets = Facets(METAL, f0, f82, white, 0.0 * white)
    weight = weight * closures.metallic[:, np.newaxis]
    return _make_lobes(points.select(part), weight, closures.roughness, white[:, 0], facets, mean_color=mean)


def _principled_glass(closures: Closures, points: Points, weight: Floats) -> Microfacets:
    """Glass whose base colour tints each passage by its square root, so that a solid has it once."""
    part = (closures.transmission > SMALLEST_WEIGHT) & (weight > 0).any(axis=1)
    closures, points, weight = closures.select(part), points.select(part), weight[part]
    tint = np.sqrt(np.minimum(closures.color, 1.0))
    f0 = np.minimum(normal_reflectance(closures.ior)[:, np.newaxis] * closures.specular_tint, 1.0)
    facets = Facets(DIELECTRIC, f0, 0.0 * f0, np.ones_like(f0), tint)
    weight, eta = weight * closures.transmission[:, np.newaxis], points.relative_ior(closures.ior)
    return _make_lobes(points, weight, closures.roughness, eta, facets, mean_color=tint)


def _principled_specular(closures: Closures, points: Points, weight: Floats) -> tuple[Microfacets, Floats]:
    """Return the dielectric reflection on top, and the weight (k, 3) left for what lies under it."""
    eta, f0 = _specular_level(closures.ior, closures.specular)
    part = (eta != 1.0) & (weight > 0).any(axis=1)
    closures, points = closures.select(part), points.select(part)
    under = weight.copy()
    weight, eta = weight[part], eta[part]
    tinted = np.minimum(f0[part, np.newaxis] * closures.specular_tint, 1.0)
    plain = normal_reflectance(eta)
    rise = np.clip((mean_dielectric_reflectance(eta) - plain) / (1.0 - plain), 0.0, 1.0)[:, np.newaxis]
    facets = Facets(DIELECTRIC, tinted, 0.0 * tinted, np.ones_like(tinted), 0.0 * tinted)
    mean = tinted + (1.0 - tinted) * rise
    lobes = _make_lobes(points, weight, closures.roughness, eta, facets, mean_color=mean)
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
    points: Points, weight: Floats, roughness: Floats, eta: Floats, facets: Facets, mean_color: Floats | None
) -> Microfacets:
    """Return lobes whose weight includes the bounces after the first, of colour `mean_color`; None leaves them out.

    Where a refracting surface has the same index on both sides nothing bends: the lobe is made perfect.
    """
    normal, cosine = points.specular_normal()
    cosine = np.clip(cosine, 0.0, 1.0)
    refracts = (facets.transmission > 0).any(axis=1)
    bends = np.abs(eta - 1.0) >= SMALLEST_ETA_STEP
    lobes = Microfacets(
        hit=points.rows,
        weight=weight,
        normal=normal,
        alpha=np.where(refracts & ~bends, 0.0, roughness * roughness),
        eta=eta,
        fresnel=np.full(len(points.rows), facets.fresnel, dtype=np.int8),
        f0=facets.f0,
        f82=facets.f82,
        reflection=facets.reflection,
        transmission=facets.transmission,
        albedo=np.ones(len(points.rows)),
    )
    scaled = weight.copy()
    for rows, read in (
        (np.flatnonzero(~lobes.is_perfect & ~refracts), lambda x, y, _: read_reflection(x, y)),
        (np.flatnonzero(~lobes.is_perfect & refracts), read_glass),
    ):
        if mean_color is not None and len(rows):
            share, mean = read(roughness[rows], cosine[rows], eta[rows])
            scaled[rows] *= compensate(share, mean, np.minimum(mean_color[rows], 1.0))
    return dataclasses.replace(lobes, weight=scaled, albedo=_estimate_albedo(lobes, cosine))


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


SCATTERING: dict[str, Callable[[Closures, Points], list[Microfacets]]] = {
    "principled": _add_principled,
    "diffuse": _add_diffuse,
    "glossy": _add_glossy,
    "glass": _add_glass,
    "refraction": _add_refraction,
}
