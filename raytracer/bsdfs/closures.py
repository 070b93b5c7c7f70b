"""What closures say of points, and what they are made of: diffuse albedo, Lambertian and other diffuse parts, lobes.

Nodes (`closure_nodes`, `principled`) take Closures of one kind at Points, one closure per point, add to the Shading of
the batch and return lobes. Radiance and transparency, which need no direction, are summed where the table of
materials is made (`materials`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import add_rows, any_column, lay_columns, mean_column, shorten_rows, take_rows
from raytracer.arrays.types import Booleans, Floats
from raytracer.arrays.vectors import normalize
from raytracer.bsdfs.diffuse import DiffuseShape
from raytracer.bsdfs.hair import HairLobes
from raytracer.bsdfs.microfacet import Microfacets
from raytracer.bsdfs.portals import Portals, close_portals
from raytracer.bsdfs.subsurface import Subsurface, split_radii
from raytracer.bsdfs.tilted_normals import tilt_to_reflect
from raytracer.lecture import dot
from raytracer.scene.materials import CLOSURE_COLORS, CLOSURE_VECTORS, Closure
from raytracer.scene.programs import Register

Rows = NDArray[np.int64]
# What a column of lobes may be.
Lobes = Microfacets | HairLobes

# What a Closure says in numbers and colors; its kind decides on the function, its directions stand in `Points`.
PARAMETERS = tuple(
    item.name for item in dataclasses.fields(Closure) if item.name not in ("kind", "distribution", *CLOSURE_VECTORS)
)


@dataclass(frozen=True, eq=False)
class Closures:
    """n closures of one kind: each of PARAMETERS as an attribute, (n,), or (n, 3) for colors, gathered when asked for.

    columns : by name, one row per material; NaN where a program computes it
    rows : (n,) int64, the material of each closure
    computed : by name, (n,) or (n, 3), what programs have computed; NaN elsewhere
    """

    columns: Mapping[str, Floats]
    rows: NDArray[Any]
    computed: Mapping[str, Floats] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.rows)

    def __getattr__(self, name: str) -> Floats:
        if name not in (*PARAMETERS, "beckmann"):
            raise AttributeError(name)
        values: Floats = take_rows(self.columns[name], self.rows)
        if name in self.computed:
            values = np.where(np.isnan(values), self.computed[name], values)
        return values

    def uses(self, name: str) -> bool:
        """False where a parameter is 0 in all materials of the table."""
        return bool(self.columns[name].any())

    def select(self, rows: Any) -> Closures:
        """Return some of the closures: index or boolean array."""
        computed = {name: take_rows(values, rows) for name, values in self.computed.items()}
        return Closures(self.columns, self.rows[rows], computed)


def pack_closures(closures: list[Closure]) -> Closures:
    """Stack Closure records of any kinds into arrays; what a program computes is NaN, Beckmann's distribution 1."""

    def read(item: Closure, name: str) -> Any:
        value = getattr(item, name)
        if not isinstance(value, Register):
            return value
        return np.full(3, np.nan) if name in CLOSURE_COLORS else np.nan

    columns = {name: lay_columns(np.array([read(item, name) for item in closures], np.float64)) for name in PARAMETERS}
    columns["beckmann"] = np.array([item.distribution == "beckmann" for item in closures], dtype=np.float64)
    return Closures(columns, np.arange(len(closures)))


@dataclass(frozen=True, eq=False, slots=True)
class TiltedDiffuse:
    """Diffuse parts that a texture bends, that are not Lambertian, or that light passes through, for some points of a
    batch. Sampled as Lambertian ones; their normal points to where light leaves from.

    hit : (m,) int64, ascending, the point in its batch
    normal : (m, 3) float64, unit
    albedo : (m, 3) float64
    shape : None where Lambertian
    transmits : True where the normal points away from the viewer
    """

    hit: Rows
    normal: Floats
    albedo: Floats
    shape: DiffuseShape | None = None
    transmits: bool = False

    def select(self, rows: Rows) -> TiltedDiffuse:
        """Return some of the parts."""
        shape = None if self.shape is None else self.shape.select(rows)
        return TiltedDiffuse(
            self.hit[rows], take_rows(self.normal, rows), take_rows(self.albedo, rows), shape, self.transmits
        )

    def evaluate(self, incoming: Floats) -> Floats:
        """Return f cos (m, 3) for light from unit directions (m, 3): albedo max(n . i, 0) / pi if Lambertian."""
        if self.shape is not None:
            return self.albedo * self.shape.evaluate(incoming)
        cosine = np.maximum(dot(self.normal, incoming), 0.0) / np.pi
        return self.albedo * cosine[:, np.newaxis]


@dataclass(frozen=True, eq=False, slots=True)
class Shading:
    """What n points of a surface do with light.

    normal, geometric_normal : (n, 3) float64, unit, turned to the side that the ray came from
    outgoing : (n, 3) float64, unit, towards where the ray came from
    radiance : (n, 3) float64, that the surface shines with
    transparency : (n, 3) float64, share of light that passes straight through
    diffuse : (n, 3) float64, albedo of the Lambertian part, f = diffuse / pi
    lobes : microfacet lobes and those of hair, each for some of the points
    tilted : other diffuse parts
    frequency : (n,) float64, factor of the angle between diffuse parts' normals and light (`terminator`); None for 1
    holdout : (n,) float64, share of the surface that is a hole in the picture; None where no material has one
    subsurface : parts whose light goes on below the surface, each for some of the points
    portals : parts that rays enter to go on elsewhere, likewise
    fades_bumps : (n,) bool, False where normals of diffuse parts may bend as they like; None where all fade
    """

    normal: Floats
    geometric_normal: Floats
    outgoing: Floats
    radiance: Floats
    transparency: Floats
    diffuse: Floats
    lobes: tuple[Lobes, ...]
    tilted: tuple[TiltedDiffuse, ...] = ()
    frequency: Floats | None = None
    holdout: Floats | None = None
    subsurface: tuple[Subsurface, ...] = ()
    portals: tuple[Portals, ...] = ()
    fades_bumps: Booleans | None = None

    def __len__(self) -> int:
        return len(self.normal)

    def select(self, rows: Rows) -> Shading:
        """Return some of the points, in their order; parts keep their places, also where none is left of them."""
        number = np.full(len(self), -1)
        number[rows] = np.arange(len(rows))

        def select_parts(parts: tuple[Any, ...]) -> tuple[Any, ...]:
            chosen = (part.select(np.flatnonzero(number[part.hit] >= 0)) for part in parts)
            return tuple(dataclasses.replace(part, hit=number[part.hit]) for part in chosen)

        fields: dict[str, Any] = {item.name: getattr(self, item.name) for item in dataclasses.fields(self)}
        for name, value in fields.items():
            if value is not None:
                fields[name] = select_parts(value) if isinstance(value, tuple) else take_rows(value, rows)
        return Shading(**fields)

    def find_receptive(self) -> Booleans:
        """(n,) True where more than perfect lobes and passages sends light on, so that light samples can be."""
        receptive = any_column(self.diffuse != 0)
        for part in self.tilted:
            receptive[part.hit] = True
        for lobes in self.lobes:
            receptive[lobes.hit] |= ~lobes.is_perfect
        return receptive

    @property
    def passage(self) -> Floats:
        """(n, 3) the share of light that passes straight through, or through portals."""
        if not self.portals:
            return self.transparency
        total = self.transparency.copy("K")
        for part in self.portals:
            total[part.hit] += part.weight
        return total

    def close_portals(self, rows: Booleans) -> Shading:
        """Return it without the portals of some points (n,)."""
        return dataclasses.replace(self, portals=close_portals(self.portals, rows)) if self.portals else self

    def sum_diffuse(self) -> Floats:
        """(n, 3) the albedo of all diffuse parts, with what is below the surface."""
        total = self.diffuse.copy("K") if self.tilted or self.subsurface else self.diffuse
        for part in self.tilted:
            total[part.hit] += part.albedo
        for buried in self.subsurface:
            total[buried.hit] += buried.weight
        return total

    def average_diffuse_normal(self) -> Floats:
        """(n, 3) unit, the normals of diffuse parts weighed by their albedos; the surface's where there are none."""
        if not self.tilted:
            return self.normal
        total = mean_column(self.diffuse)[:, np.newaxis] * self.normal
        for part in self.tilted:
            side = -part.normal if part.transmits else part.normal
            total[part.hit] += mean_column(part.albedo)[:, np.newaxis] * side
        return np.where((total != 0).any(axis=1)[:, np.newaxis], normalize(total), self.normal)

    def lay_open(self) -> Shading:
        """Return what is below the surface as matte parts of it."""
        if not self.subsurface:
            return self
        matte = (TiltedDiffuse(buried.hit, buried.normal, buried.weight) for buried in self.subsurface)
        return dataclasses.replace(self, tilted=(*self.tilted, *matte), subsurface=())

    def average_normal(self) -> Floats:
        """(n, 3) unit, the normals of all parts weighed by their weights: textures bend them, and lobes are tilted to
        reflect to the surface's front. Where nothing has a normal of its own it is the surface's, to the last bit,
        whatever the batch holds besides."""
        if not self.tilted and not self.lobes and not self.subsurface:
            return self.normal
        is_bent = np.zeros(len(self.normal), dtype=np.bool_)
        for parts in (self.tilted, self.lobes, self.subsurface):
            for hit in (part.hit for part in parts):
                is_bent[hit] = True
        total = mean_column(self.diffuse)[:, np.newaxis] * self.normal
        for part in self.tilted:
            side = -part.normal if part.transmits else part.normal
            total[part.hit] += mean_column(part.albedo)[:, np.newaxis] * side
        for buried in self.subsurface:
            total[buried.hit] += mean_column(buried.weight)[:, np.newaxis] * buried.normal
        for lobes in self.lobes:
            weight = mean_column(lobes.weight) / lobes.energy_scale  # Cycles keeps that factor apart
            total[lobes.hit] += weight[:, np.newaxis] * lobes.show_normal(take_rows(self.outgoing, lobes.hit))
        is_bent &= (total != 0).any(axis=1)
        return np.where(is_bent[:, np.newaxis], normalize(total), self.normal)


@dataclass(frozen=True, eq=False, slots=True)
class Points:
    """Where closures of one kind stand: rows (k,) of the batch, the side the ray came from, and the directions (k, 3)
    that they have of their own, of CLOSURE_VECTORS by name."""

    rows: Rows
    front: NDArray[np.bool_]
    shading: Shading
    vectors: Mapping[str, Floats] = field(default_factory=dict)
    tilted: list[TiltedDiffuse] = field(default_factory=list)
    subsurface: list[Subsurface] = field(default_factory=list)
    portals: list[Portals] = field(default_factory=list)

    def select(self, part: NDArray[np.bool_]) -> Points:
        vectors = {name: take_rows(values, part) for name, values in self.vectors.items()}
        return dataclasses.replace(self, rows=self.rows[part], front=self.front[part], vectors=vectors)

    @property
    def normal(self) -> Floats:
        """(k, 3) the closures' normals."""
        return self.find_normal("normal")

    @property
    def outgoing(self) -> Floats:
        """(k, 3) directions to where the rays came from."""
        return take_rows(self.shading.outgoing, self._places)

    @property
    def _places(self) -> Rows | slice:
        return shorten_rows(self.rows, len(self.shading))

    def find_normal(self, name: str) -> Floats:
        """Return the normals (k, 3) of a name, or the surface's where closures have none."""
        return self.vectors[name] if name in self.vectors else take_rows(self.shading.normal, self._places)

    def add_diffuse(self, albedo: Floats) -> None:
        """Add Lambertian parts of albedo (k, 3)."""
        if "normal" not in self.vectors:
            add_rows(self.shading.diffuse, self._places, albedo)
        else:
            self.add_part(self.normal, albedo)

    def add_part(
        self, normal: Floats, albedo: Floats, shape: DiffuseShape | None = None, transmits: bool = False
    ) -> None:
        """Add diffuse parts of albedo (k, 3) with normals (k, 3)."""
        self.tilted.append(TiltedDiffuse(self.rows, normal, albedo, shape, transmits))

    def add_subsurface(self, closures: Closures, weight: Floats, color: Floats, ior: Floats, roughness: Floats) -> None:
        """Add parts of a weight (k, 3) whose light is scattered below the surface; roughness : alpha (k,) of facets."""
        normal, _ = self.specular_normal()
        anisotropy, skin, similar = closures.subsurface_anisotropy, closures.skin > 0, closures.similar > 0
        part = Subsurface(self.rows, normal, weight, color, closures.radius, anisotropy, ior, roughness, skin, similar)
        inside, matte = split_radii(part)
        self.subsurface.append(inside)
        stays = any_column(matte > 0)
        if stays.any():
            self.select(stays).add_diffuse(matte[stays])

    def specular_normal(self, name: str = "normal") -> tuple[Floats, Floats]:
        """Return the normals (k, 3) of microfacet lobes and the cosine (k,) of the view against them."""
        outgoing = self.outgoing
        normal = tilt_to_reflect(
            self.find_normal(name), take_rows(self.shading.geometric_normal, self._places), outgoing
        )
        return normal, dot(normal, outgoing)

    def find_outside_ior(self, ior: Floats) -> Floats:
        """Return the index of refraction before the surface, with 1 outside."""
        return np.where(self.front, 1.0, ior)

    def relative_ior(self, ior: Floats) -> Floats:
        """Return the index of refraction behind the surface over that before it: 1 / ior from inside."""
        return np.where(self.front, ior, 1.0 / ior)
