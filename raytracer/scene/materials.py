"""Materials: weighted closures whose parameters are constants, or registers of a program."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from raytracer.arrays.checks import require_choice
from raytracer.scene.fields import (
    make_records,
    require_text,
    set_color,
    set_count,
    set_field,
    set_flags,
    set_light,
    set_number,
)
from raytracer.scene.media import Volume, check_volume
from raytracer.scene.programs import Aovs, Program, Register, check_aovs, check_program, check_register, make_value

# The colors of a closure, its vectors, and the range of each of its numbers.
CLOSURE_COLORS = (
    "color",
    "specular_tint",
    "emission",
    "coat_tint",
    "sheen_tint",
    "extinction",
    "radius",
    "absorption",
    "gains",
)
CLOSURE_VECTORS = ("normal", "coat_normal", "tangent", "position", "direction", "axis")
# Flatter hair than this is a sheet, which is met nowhere from its edge.
SMALLEST_ASPECT = 1e-3
CLOSURE_RANGES = {
    "weight": (0.0, np.inf),
    "ior": (float(np.nextafter(0.0, 1.0)), np.inf),
    **dict.fromkeys(("roughness", "metallic", "transmission", "alpha"), (0.0, 1.0)),
    **dict.fromkeys(("diffuse_roughness", "coat_roughness", "sheen_roughness"), (0.0, 1.0)),
    **dict.fromkeys(("specular", "coat_weight", "sheen_weight"), (0.0, np.inf)),
    "coat_ior": (1.0, np.inf),
    "anisotropy": (-1.0, 1.0),
    "rotation": (-np.inf, np.inf),
    **dict.fromkeys(("size", "smooth", "multiscatter", "simple_coat"), (0.0, 1.0)),
    **dict.fromkeys(("subsurface", "skin", "similar"), (0.0, 1.0)),
    "subsurface_ior": (0.0, np.inf),
    # Sharper phase functions are as good as none (Cycles, kernel/closure/bssrdf.h).
    "subsurface_anisotropy": (-0.99, 0.99),
    "film_thickness": (0.0, np.inf),
    "film_ior": (float(np.nextafter(0.0, 1.0)), np.inf),
    "bare_metal": (0.0, 1.0),
    "radial_roughness": (0.0, 1.0),
    "tilt": (-np.pi / 2.0, np.pi / 2.0),
    "across": (-1.0, 1.0),
    "coverage": (0.0, np.inf),
    "aspect": (SMALLEST_ASPECT, 1.0),
    "chance": (0.0, 1.0),
}
# These need a tangent.
HAIR_KINDS = ("hair", "hair_huang", "hair_reflection", "hair_transmission")
CLOSURE_KINDS = (
    *("principled", "diffuse", "glossy", "glass", "refraction", "transparent", "emission"),
    *("metal", "conductor", "translucent", "sheen", "velvet", "toon", "glossy_toon", "holdout", "subsurface"),
    *HAIR_KINDS,
    "portal",
)
DISTRIBUTIONS = ("ggx", "beckmann")


def shines(kind: str, name: str) -> bool:
    """True for a parameter that is light and may be below 0, which takes light away; other colors may not."""
    return name == "emission" or (kind == "emission" and name == "color")


@dataclass(frozen=True, eq=False)
class Closure:
    """One scattering or emitting part of a material; each parameter is a constant or a Register of its program.

    kind : one of CLOSURE_KINDS; a holdout is black, and a hole in the picture's alpha where it is seen straight
    weight : factor in the material's sum (Mix and Add Shader fold into it)
    color : linear RGB; base color of a principled closure, radiance scale of an emission, reflectance of a metal at
        normal incidence, index of refraction of a conductor
    roughness : Blender's roughness; alpha of facets is its square; 0 is a perfect mirror
    extinction : imaginary part of a conductor's index of refraction
    size, smooth : of toon, as shares of a right angle
    distribution : of facets, one of DISTRIBUTIONS
    multiscatter : share of the light lost between facets that is given back
    subsurface : share of the base of a principled closure whose light is scattered below the surface
    radius : metres that red, green and blue light get there
    subsurface_ior, subsurface_anisotropy : index of refraction by which light enters skin or a subsurface closure, mean
        cosine of scattering
    skin, similar : 1 for light that enters as through skin, for albedos inverted by similarity (`bsdfs.subsurface`)
    film_thickness, film_ior : of a thin film on top, nanometres, and its index of refraction; 0 nanometres are none
    bare_metal : 1 leaves the film off the metallic part of a principled closure
    simple_coat : 1 gives no light lost between a coat's facets back, and dims what is under it as a smooth one would
    anisotropy, rotation : how far highlights are stretched along the tangent; which turns, in rounds
    absorption : of light by hair, per radius of the strand
    radial_roughness, tilt : of hair, around the strand; by which angle its scales, or the cone of light, lean, radians
    across : where hair is met across its width, from -1 to 1: the sine of the angle around it to its nearest side
    coverage : half the width of a pixel on hair, in its radii; 1 and more sees no part of it by itself
    aspect : of the cross section of hair, its shorter axis over the longer one
    gains : of hair's three reflections, R, TT and TRT
    chance : a uniform number, from which others are made where hair scatters light
    normal, coat_normal : world space, any length, on the side that the ray comes from; None = the surface's
    tangent : world space, any length; None stretches nothing; of hair along the strand, from root to tip
    axis : world space, the longer one of hair's cross section; None turns it to the viewer, as 0 does
    position, direction : world space, where rays come out of a portal, and where they go, any length; None is where
        they enter it, and straight on; so is a direction of 0
    The remaining fields are those of Blender's Principled BSDF node.
    """

    kind: str
    color: Any = 0.8
    weight: Any = 1.0
    roughness: Any = 0.5
    ior: Any = 1.5
    metallic: Any = 0.0
    transmission: Any = 0.0
    specular: Any = 0.5
    specular_tint: Any = 1.0
    emission: Any = 0.0
    alpha: Any = 1.0
    diffuse_roughness: Any = 0.0
    coat_weight: Any = 0.0
    coat_roughness: Any = 0.03
    coat_ior: Any = 1.5
    coat_tint: Any = 1.0
    sheen_weight: Any = 0.0
    sheen_roughness: Any = 0.5
    sheen_tint: Any = 1.0
    anisotropy: Any = 0.0
    rotation: Any = 0.0
    multiscatter: Any = 1.0
    extinction: Any = 0.0
    simple_coat: Any = 0.0
    size: Any = 0.5
    smooth: Any = 0.0
    subsurface: Any = 0.0
    radius: Any = 1.0
    subsurface_ior: Any = 1.4
    subsurface_anisotropy: Any = 0.0
    skin: Any = 0.0
    similar: Any = 0.0
    film_thickness: Any = 0.0
    film_ior: Any = 1.33
    bare_metal: Any = 0.0
    absorption: Any = 0.0
    radial_roughness: Any = 0.3
    tilt: Any = 0.0
    across: Any = 0.0
    coverage: Any = 1.0
    aspect: Any = 1.0
    gains: Any = 1.0
    chance: Any = 0.5
    distribution: str = "ggx"
    normal: Any = None
    coat_normal: Any = None
    tangent: Any = None
    position: Any = None
    direction: Any = None
    axis: Any = None

    def __post_init__(self) -> None:
        label = f"Closure {self.kind!r}"
        require_choice(self.kind, CLOSURE_KINDS, "Closure: kind")
        require_choice(self.distribution, DISTRIBUTIONS, f"{label}: distribution")
        computed = self.registers
        for name in CLOSURE_COLORS:
            if name not in computed:
                (set_light if shines(self.kind, name) else set_color)(self, name, label)
        for name, (low, high) in CLOSURE_RANGES.items():
            if name not in computed:
                set_number(self, name, low, high, label)
        if self.kind in HAIR_KINDS and self.tangent is None:
            raise ValueError(f"{label}: tangent: expected a direction along the strand, got None")
        for name in self.vectors:
            set_field(self, name, make_value(getattr(self, name), f"{label}: {name}"))

    @cached_property
    def registers(self) -> dict[str, Register]:
        """The parameters that the material's program computes, by name."""
        return {name: value for name, value in vars(self).items() if isinstance(value, Register)}

    @property
    def vectors(self) -> dict[str, Any]:
        """The directions, and the position, that it has of its own, by name."""
        return {name: getattr(self, name) for name in CLOSURE_VECTORS if getattr(self, name) is not None}


@dataclass(frozen=True, eq=False)
class Material:
    """A named sum of weighted closures; no closures at all is black.

    program : computes the parameters that are Registers; None where all are constant
    transparent_shadow : False stops light all the same where the surface is transparent
    normal : a Register of `program`, the normal that stands for the surface's own, for closures and for the rest of the
        program, or None (a displacement that is shown as a bump)
    aovs : what it writes to passes that the scene names; None writes nothing
    volume : what is inside of closed meshes that have this material; None for nothing
    only_volume : True for a surface that is nothing but the border of its volume, which rays pass as if it were not
        there: it has no closures of its own, and a clear one stands for them
    fades_bumps : False lets light that grazes bent normals of diffuse closures arrive undimmed
    """

    closures: Sequence[Closure] = ()
    pass_index: int = 0
    name: str = ""
    program: Program | None = None
    transparent_shadow: bool = True
    normal: Register | None = None
    aovs: Aovs | None = None
    volume: Volume | None = None
    only_volume: bool = False
    fades_bumps: bool = True

    def __post_init__(self) -> None:
        require_text(self.name, "Material: name")
        label = f"Material {self.name!r}"
        set_count(self, "pass_index", label)
        set_flags(self, ("transparent_shadow", "only_volume", "fades_bumps"), label)
        check_volume(self.volume, f"{label}: volume")
        if self.only_volume:
            self._clear(label)
        check_program(self.program, f"{label}: program")
        if self.normal is not None and not isinstance(self.normal, Register):
            raise ValueError(f"{label}: normal: expected a Register or None, got {type(self.normal).__name__}")
        check_register(self.normal, self.program, f"{label}: normal")
        check_aovs(self.aovs, f"{label}: aovs")
        set_field(self, "closures", make_records(self.closures, Closure, f"{label}: closures"))
        for closure in self.closures:
            for name, register in closure.registers.items():
                check_register(register, self.program, f"{label}: {closure.kind}: {name}")

    def _clear(self, label: str) -> None:
        """Give the border of a volume the closure of what is not there."""
        closures = make_records(self.closures, Closure, f"{label}: closures")
        if any(closure.kind != "transparent" for closure in closures):
            raise ValueError(f"{label}: closures: expected none of a material that is only a volume")
        set_field(self, "closures", closures or (Closure("transparent", color=1.0),))
        set_field(self, "transparent_shadow", True)

    @property
    def programs(self) -> tuple[Program, ...]:
        """All programs that it has."""
        others = (None if part is None else part.program for part in (self.aovs, self.volume))
        found = (self.program, *others)
        return tuple(program for program in found if program is not None)


DEFAULT_MATERIAL = Material((Closure("diffuse", color=0.8),), name="default")
