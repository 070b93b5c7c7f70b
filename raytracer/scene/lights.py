"""Lights, in Blender's units: watts, and W/m^2 for the sun. Light below 0 takes light away."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from raytracer.arrays.checks import require_choice
from raytracer.arrays.types import Floats
from raytracer.scene.fields import (
    ALL_SETS,
    SEEN_BY,
    SEEN_BY_ALL,
    require_text,
    set_array,
    set_count,
    set_field,
    set_flags,
    set_light,
    set_linked_sets,
    set_number,
    set_seen_by,
)
from raytracer.scene.media import Volume, check_volume
from raytracer.scene.programs import Aovs, Program, Register, check_aovs, check_program, check_register
from raytracer.scene.shapes import Instances

# Axes of area lights, often in float32, may be so far from a right angle, as a cosine.
LARGEST_SHEAR = 2.0**-12
# Blender's default ray visibility of a light; shadow rays are not affected.
LIGHT_SEEN_BY = SEEN_BY_ALL - SEEN_BY["camera"]


def check_shared_fields(light: Any) -> str:
    """Check what all lights have; return how messages name the light."""
    require_text(light.name, f"{type(light).__name__}: name")
    label = f"{type(light).__name__} {light.name!r}"
    set_flags(light, ("cast_shadow", "shadow_catcher", "caustics"), label)
    set_seen_by(light, label)
    set_linked_sets(light, label)
    if light.max_bounces is not None:
        set_count(light, "max_bounces", label)
    if light.nodes is not None and not isinstance(light.nodes, LightNodes):
        raise ValueError(f"{label}: nodes: expected LightNodes or None, got {type(light.nodes).__name__}")
    return label


@dataclass(frozen=True, eq=False)
class LightNodes:
    """What a light's nodes make of it: a factor of its radiance that a program computes at each sample.

    color : linear RGB, a Register of `program`
    placed : one instance, whose matrix, color and numbers are those of the light's object
    """

    color: Register
    program: Program
    placed: Instances

    def __post_init__(self) -> None:
        check_program(self.program, "LightNodes: program")
        if not isinstance(self.color, Register) or self.program is None:
            raise ValueError(f"LightNodes: color: expected a Register of the program, got {self.color!r:.80}")
        check_register(self.color, self.program, "LightNodes: color")
        if not isinstance(self.placed, Instances) or len(self.placed) != 1:
            given = f"{len(self.placed)}" if isinstance(self.placed, Instances) else type(self.placed).__name__
            raise ValueError(f"LightNodes: placed: expected one instance, got {given}")


@dataclass(frozen=True, eq=False)
class PointLight:
    """A sphere, or a point where radius is 0, that emits `power` watts (linear RGB) into all directions.

    soft_falloff : Blender's option: a disk that faces the shaded point instead of a true sphere
    seen_by : bits of SEEN_BY, the classes of rays that meet the light; what it sends to a surface is reflected only in
        the ways in which it is seen. So for all lights
    shadow_catcher : True for a light that is part of what shadow catchers stand for: they know its light without the
        other objects. So for all lights
    receivers : the sets of objects that it lights, as bits: 1 << light_set. So for all lights
    blockers : the sets of objects that shadow its light, as bits: 1 << shadow_set. So for all lights
    max_bounces : it lights nothing that a path has bounced to more often; None without limit. So for all lights
    nodes : LightNodes, or None for an even light. So for all lights
    caustics : True for a light that is looked for through objects that cast caustics. So for all lights
    """

    position: Any
    power: Any
    radius: float = 0.0
    soft_falloff: bool = True
    cast_shadow: bool = True
    name: str = ""
    seen_by: int = LIGHT_SEEN_BY
    shadow_catcher: bool = True
    receivers: int = ALL_SETS
    blockers: int = ALL_SETS
    max_bounces: int | None = None
    nodes: LightNodes | None = None
    caustics: bool = False

    def __post_init__(self) -> None:
        label = check_shared_fields(self)
        set_array(self, "position", np.float64, (3,), label)
        set_flags(self, ("soft_falloff",), label)
        set_light(self, "power", label)
        set_number(self, "radius", 0.0, np.inf, label)


@dataclass(frozen=True, eq=False)
class SpotLight(PointLight):
    """A point light limited to a cone.

    world_from_light : (3, 3) float64, the light shines along its -z axis; columns keep the object's scale
    spot_size : full opening angle, radians
    spot_blend : 0 to 1, softness of the cone's border
    """

    world_from_light: Any = None
    spot_size: float = np.pi / 4
    spot_blend: float = 0.15

    def __post_init__(self) -> None:
        super().__post_init__()
        label = f"SpotLight {self.name!r}"
        if self.world_from_light is None:
            set_field(self, "world_from_light", np.eye(3))
        matrix = set_array(self, "world_from_light", np.float64, (3, 3), label)
        if not abs(np.linalg.det(matrix)) > 0:
            raise ValueError(
                f"{label}: world_from_light: expected a matrix that can be inverted, got {matrix.tolist()}"
            )
        set_number(self, "spot_size", 0.0, np.pi, label)
        set_number(self, "spot_blend", 0.0, 1.0, label)


@dataclass(frozen=True, eq=False)
class SunLight:
    """A light at infinity.

    direction : (3,) float64, from the scene towards the sun, made unit length
    strength : linear RGB irradiance on a plane that faces the sun, W/m^2
    angle : angular diameter of the disc, radians; 0 is a point
    """

    direction: Any
    strength: Any
    angle: float = 0.0
    cast_shadow: bool = True
    name: str = ""
    seen_by: int = LIGHT_SEEN_BY
    shadow_catcher: bool = True
    receivers: int = ALL_SETS
    blockers: int = ALL_SETS
    max_bounces: int | None = None
    nodes: LightNodes | None = None
    caustics: bool = False

    def __post_init__(self) -> None:
        label = check_shared_fields(self)
        direction = set_array(self, "direction", np.float64, (3,), label)
        largest = np.abs(direction).max()
        if largest == 0:
            raise ValueError(f"{label}: direction: expected a vector other than zero, got {direction.tolist()}")
        # Where a square would leave float64, or a length is not 1 to the last bit: scaled by a power of 2, exactly.
        scaled = np.ldexp(direction, -int(np.frexp(largest)[1]))
        set_field(self, "direction", scaled / np.linalg.norm(scaled))
        set_light(self, "strength", label)
        set_number(self, "angle", 0.0, np.pi, label)


@dataclass(frozen=True, eq=False)
class AreaLight:
    """A flat light that emits `power` watts from its front, the side its -z axis points to.

    position : (3,) centre
    axis_u, axis_v : (3,) float64, metres, the full width and height as vectors, at right angles
    shape : 'rectangle' or 'ellipse'
    spread : full opening angle of the emission, radians; pi is Lambertian
    """

    position: Any
    axis_u: Any
    axis_v: Any
    power: Any
    shape: str = "rectangle"
    spread: float = np.pi
    cast_shadow: bool = True
    name: str = ""
    seen_by: int = LIGHT_SEEN_BY
    shadow_catcher: bool = True
    receivers: int = ALL_SETS
    blockers: int = ALL_SETS
    max_bounces: int | None = None
    nodes: LightNodes | None = None
    caustics: bool = False

    def __post_init__(self) -> None:
        label = check_shared_fields(self)
        for name in ("position", "axis_u", "axis_v"):
            set_array(self, name, np.float64, (3,), label)
        if is_askew(self.axis_u, self.axis_v):
            given = self.axis_v.tolist()
            raise ValueError(f"{label}: axis_v: expected a vector at right angles to axis_u, got {given}")
        set_light(self, "power", label)
        require_choice(self.shape, ("rectangle", "ellipse"), f"{label}: shape")
        set_number(self, "spread", 0.0, np.pi, label)


def is_askew(axis_u: Floats, axis_v: Floats) -> bool:
    """True where axes (3,) are not at right angles."""
    lengths = np.sqrt((axis_u**2).sum()) * np.sqrt((axis_v**2).sum())
    return bool(abs((axis_u * axis_v).sum()) > LARGEST_SHEAR * lengths)


Light = PointLight | SpotLight | SunLight | AreaLight


@dataclass(frozen=True, eq=False)
class World:
    """Radiance from every direction that hits nothing.

    color : linear RGB, or a Register of `program`
    program : Program, evaluated over directions, or None where the color is constant
    seen_by : bits of SEEN_BY, the classes of rays that see it, which are the ways in which surfaces reflect its light
    max_bounces : it is not sampled as a light where a path has bounced more often; None without limit. As in Cycles,
        what is reflected there goes on to see it, in the share that sampling would have left it (all of it in mirrors),
        and an even world has no limit
    aovs : what it writes to passes that the scene names, where it is seen straight; None writes nothing
    volume : the medium that fills all space; None for none
    """

    color: Any = 0.0
    program: Program | None = None
    seen_by: int = SEEN_BY_ALL
    max_bounces: int | None = None
    aovs: Aovs | None = None
    volume: Volume | None = None

    def __post_init__(self) -> None:
        check_program(self.program, "World: program")
        check_volume(self.volume, "World: volume")
        check_aovs(self.aovs, "World: aovs")
        set_seen_by(self, "World")
        if self.max_bounces is not None:
            set_count(self, "max_bounces", "World")
        if isinstance(self.color, Register):
            check_register(self.color, self.program, "World: color")
        else:
            set_light(self, "color", "World")
