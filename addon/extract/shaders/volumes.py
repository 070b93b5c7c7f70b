"""Volumes: shader nodes to sums of weighted parts of a medium, and a program for all that varies in space.

One reader for each node, listed in `VOLUME_READERS`; any other shader does nothing in a volume, as in Cycles. What
programs can read at a point in space is less than on a surface: grids, coordinates and the object.

References
----------
Blender, intern/cycles/kernel/svm/closure.h (svm_node_closure_volume, svm_node_principled_volume,
svm_node_volume_coefficients), kernel/geom/volume.h, kernel/svm/tex_coord.h.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import numpy as np

import raytracer
from raytracer.scene.media import MEDIUM_RANGES
from raytracer.scene.programs import Program, Register, Value
from raytracer.shading.evaluate import LIGHT_PATH, OPERATIONS

from ..warnings import WarningList
from .closures import NodeInputs
from .images import ImageTable
from .mixing import FedShader, read_parts
from .node_settings import GENERATED, SPACE_OFFSET, SPACE_SCALE
from .nodes import WarningContext, find_socket, read_color
from .programs import ProgramBuilder

Fields = dict[str, Any]

# What there is on surfaces alone, and what it hands on in a volume: one of its inputs, or what it is where nothing
# tells it.
SURFACE_ONLY = ("BUMP", "WIREFRAME", "NORMAL_MAP", "TANGENT UV_MAP", "TANGENT RADIAL", "VECTOR_DISPLACEMENT")
MISSING: dict[str, Value] = {"Vector": np.zeros(3), "Normal": np.zeros(3), "Tangent": np.zeros(3), "Alpha": 1.0}


class VolumeBuilder(ProgramBuilder):
    """Collects the steps of a program that is run at points in space.

    grids : the names of the grids of the object; attributes of other names are missing, and so constant
    is_world : True for the world's volume, whose object space is the world
    """

    def __init__(
        self,
        place: WarningContext,
        images: ImageTable,
        pass_index: int = 0,
        grids: Collection[str] = (),
        is_world: bool = False,
    ) -> None:
        super().__init__(place, images, pass_index)
        self.grids, self.is_world = grids, is_world

    def add(self, name: str, inputs: tuple[Value, ...], settings: Fields | None = None) -> dict[str, Value]:
        """Add a step as `ProgramBuilder` does, or what stands in space for one of a surface."""
        settings = settings or {}
        operation = OPERATIONS[name]
        if name.startswith(LIGHT_PATH):
            self.place.warn("volume: Light Path tells nothing of rays in a volume, its outputs are 0 there")
            return dict.fromkeys(operation.outputs, 0.0)
        if name in SURFACE_ONLY or not set(operation.attributes(settings)) <= {GENERATED, *self.grids}:
            return {output: self._miss(name, output) for output in operation.outputs}
        if self.is_world and name == "TEX_COORD Object" and settings["object_from_world"] is None:
            return {"Object": self._locate()}
        if operation.attributes(settings) == (GENERATED,):
            return dict.fromkeys(operation.outputs, self._find_generated())
        return super().add(name, inputs, settings)

    def find_grid(self, name: str, output: str) -> Value | None:
        """Return what a grid holds, as number ("Fac") or color ("Vector"); None where the object has none of the
        name."""
        return self.add(f"ATTRIBUTE {output}", (), {"name": name})[output] if name in self.grids else None

    def _miss(self, name: str, output: str) -> Value:
        return 0.0 if name.startswith("VERTEX_COLOR") else MISSING.get(output, 0.0)

    def _locate(self) -> Value:
        return super().add("NEW_GEOMETRY Position", ())["Position"]

    def _find_generated(self) -> Value:
        """Return Generated coordinates, which in a volume are those of object space, scaled and moved; in the world,
        the position."""
        if self.is_world:
            return self._locate()
        scale, offset = (
            super(VolumeBuilder, self).add("OBJECT_PROPERTY Vector", (), {"name": name})["Vector"]
            for name in (SPACE_SCALE, SPACE_OFFSET)
        )
        place = super().add("TEX_COORD Object", (), {"object_from_world": None})["Object"]
        return super().add("VECT_MATH Vector", (place, scale, offset, 1.0), {"operation": "MULTIPLY_ADD"})["Vector"]


def read_volume(socket: Any, builder: VolumeBuilder) -> raytracer.Volume | None:
    """Return what feeds the Volume socket of an output node; None for nothing that absorbs, scatters or shines."""
    found = read_parts(socket, (), 1.0, builder, read_part)
    closures = [closure for closure in found if closure is not None]
    if not closures:
        return None
    is_computed = any(closure.registers for closure in closures)
    return raytracer.Volume(closures, Program(builder.steps) if is_computed else None)


def make_default_volume(images: ImageTable, grids: Collection[str]) -> raytracer.Material:
    """Return what a volume object without a material is made of: a Principled Volume as new nodes are."""
    builder = VolumeBuilder(WarningContext(WarningList()), images, grids=grids)
    density = builder.find_grid("density", "Fac")
    closure = raytracer.VolumeClosure("principled", color=0.5, density=1.0 if density is None else density)
    volume = raytracer.Volume([closure], builder.program)
    return raytracer.Material(name="default volume", volume=volume, only_volume=True)


def read_part(shader: FedShader, weight: Value, builder: ProgramBuilder) -> raytracer.VolumeClosure | None:
    """Return one part of a medium, or None for a shader that does nothing in a volume."""
    if shader.source.socket.type != "SHADER":  # a color on a shader socket: Cycles lets it emit
        color = builder.value_of(shader.socket, shader.groups, "color")
        color = color if isinstance(color, Register) else read_color(color)
        return raytracer.VolumeClosure("emission", emission=color, weight=weight)
    reader = VOLUME_READERS.get(shader.node.type)
    if reader is None:
        return None
    fields = reader(NodeInputs(shader.node, shader.source.groups, builder))
    return raytracer.VolumeClosure(weight=weight, **fields)


def read_phase(inputs: NodeInputs) -> Fields:
    """Return how a node's light is turned; Blender up to 4.2 knows Henyey and Greenstein's way alone."""
    phase = getattr(inputs.node, "phase", "HENYEY_GREENSTEIN")
    names = {
        "HENYEY_GREENSTEIN": ("Anisotropy",),
        "FOURNIER_FORAND": ("IOR", "Backscatter"),
        "DRAINE": ("Anisotropy", "Alpha"),
        "MIE": ("Diameter",),
    }.get(phase, ())
    return {"phase": phase.lower()} | {name.lower(): read_number(inputs, name) for name in names}


def read_number(inputs: NodeInputs, identifier: str) -> Value:
    """Return an input that the medium has a number of, within its range where it is a constant."""
    return inputs.number(identifier, *MEDIUM_RANGES[identifier.lower()])


def read_scatter(inputs: NodeInputs) -> Fields:
    return {
        "kind": "scatter",
        "color": inputs.color("Color"),
        "density": inputs.number("Density"),
        **read_phase(inputs),
    }


def read_absorption(inputs: NodeInputs) -> Fields:
    return {"kind": "absorption", "color": inputs.color("Color"), "density": inputs.number("Density")}


def read_coefficients(inputs: NodeInputs) -> Fields:
    return {
        "kind": "coefficients",
        "absorption": inputs.color("Absorption Coefficients"),
        "scattering": inputs.color("Scatter Coefficients"),
        "emission": inputs.color("Emission Coefficients"),
        **read_phase(inputs),
    }


def read_principled(inputs: NodeInputs) -> Fields:
    """Return a Principled Volume's medium: attributes that the object lacks count as 1."""
    builder = inputs.builder
    density, color = inputs.number("Density"), inputs.color("Color")
    if (grid := find_grid(inputs, "Density Attribute", "Fac")) is not None:
        density = builder.multiply(grid, keep_positive(density, builder))
    if (grid := find_grid(inputs, "Color Attribute", "Vector")) is not None:
        color = builder.add("VECT_MATH Vector", (color, grid, np.zeros(3), 1.0), {"operation": "MULTIPLY"})["Vector"]
    fields = {
        "kind": "principled",
        "color": color,
        "density": density,
        "anisotropy": read_number(inputs, "Anisotropy"),
        "absorption_color": inputs.color("Absorption Color"),
    }
    if inputs.is_used("Emission Strength"):
        strength = keep_positive(inputs.number("Emission Strength"), builder)
        fields["emission"] = builder.scale(inputs.color("Emission Color"), strength)
    if inputs.is_used("Blackbody Intensity"):
        temperature = inputs.number("Temperature")
        if (grid := find_grid(inputs, "Temperature Attribute", "Fac")) is not None:
            temperature = builder.multiply(keep_positive(grid, builder), temperature)
        fields |= {
            "blackbody": inputs.number("Blackbody Intensity"),
            "blackbody_tint": inputs.color("Blackbody Tint"),
            "temperature": temperature,
        }
    return fields


def keep_positive(value: Value, builder: ProgramBuilder) -> Value:
    """Return a number, 0 where it is below."""
    return builder.add("MATH", (value, 0.0, 0.0), {"operation": "MAXIMUM"})["Value"]


def find_grid(inputs: NodeInputs, identifier: str, output: str) -> Value | None:
    """Return what a grid holds whose name an input says, or None where the object has none of that name."""
    assert isinstance(inputs.builder, VolumeBuilder)
    return inputs.builder.find_grid(find_socket(inputs.node.inputs, identifier).default_value, output)


def read_emission(inputs: NodeInputs) -> Fields:
    strength = inputs.number("Strength", low=-np.inf)
    return {"kind": "emission", "emission": inputs.builder.scale(inputs.color("Color"), strength)}


VOLUME_READERS: dict[str, Callable[[NodeInputs], Fields]] = {
    "PRINCIPLED_VOLUME": read_principled,
    "VOLUME_SCATTER": read_scatter,
    "VOLUME_ABSORPTION": read_absorption,
    "VOLUME_COEFFICIENTS": read_coefficients,
    "EMISSION": read_emission,
}
