"""Materials: shader nodes to sums of weighted closures, and a program for all that varies over a surface.

The walk starts at the active output and ends at closures; Mix and Add Shader fold into weights. Stand-ins, each with a
warning: a shader that reflects colored light in a way we lack becomes glossy (Metallic) or diffuse (Translucent,
Subsurface, Sheen, Toon, Hair) of its own color; any other becomes the default grey diffuse; Holdout becomes black.
Multiscatter GGX, the nodes' default, is treated as GGX. Imports raytracer and this package.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import raytracer
from raytracer.nodes import list_attributes, list_steps
from raytracer.programs import Program, Register, Value
from raytracer.site_tables import TANGENT

from .. import versions
from .images import ImageTable
from .nodes import Groups, Place, find_link, find_socket, find_source, read_color, read_number
from .programs import ProgramBuilder
from .warnings import WarningList

GREY = 0.8  # what Cycles gives an object without a material
SMALLEST_IOR = 1e-5  # as in Cycles
LARGEST_IOR = float(np.finfo(np.float32).max)

STAND_IN_KINDS = {
    "BSDF_METALLIC": ("glossy", "Base Color"),
    "BSDF_TRANSLUCENT": ("diffuse", "Color"),
    "SUBSURFACE_SCATTERING": ("diffuse", "Color"),
    "BSDF_SHEEN": ("diffuse", "Color"),
    "BSDF_TOON": ("diffuse", "Color"),
    "BSDF_HAIR": ("diffuse", "Color"),
    "BSDF_HAIR_PRINCIPLED": ("diffuse", "Color"),
    "EEVEE_SPECULAR": ("diffuse", "Base Color"),
}

# Inputs that change the picture and that we do not honour, by node.
UNSUPPORTED_INPUTS = {
    "BSDF_PRINCIPLED": (
        *("Diffuse Roughness", "Subsurface Weight", "Anisotropic", "Coat Weight", "Sheen Weight"),
        *("Thin Film Thickness", "Thin Wall"),
    ),
    "BSDF_DIFFUSE": ("Roughness",),
    "BSDF_GLOSSY": ("Anisotropy",),
    "BSDF_GLASS": ("Thin Film Thickness",),
    "BSDF_REFRACTION": (),
}
SUPPORTED_DISTRIBUTIONS = ("GGX", "MULTI_GGX")


class NodeInputs:
    """Reads the inputs of one shader node: constants, or registers of the material's program.

    Where only constants will do (`constants_only`), what a program would compute is replaced by the socket's own value
    and reported.
    """

    def __init__(self, node: Any, groups: Groups, builder: ProgramBuilder, constants_only: bool) -> None:
        self.node, self.groups, self.builder = node, groups, builder
        self._constants_only = constants_only
        self._replaced: list[str] = []

    @property
    def place(self) -> Place:
        return self.builder.place

    def color(self, identifier: str) -> Value:
        """Return the input as linear RGB; a constant without negative parts."""
        value = self._read(identifier, "color")
        return value if isinstance(value, Register) else read_color(value)

    def number(self, identifier: str, low: float = 0.0, high: float = np.inf) -> Value:
        """Return the input as a number; a constant within what the shader takes."""
        value = self._read(identifier, "number")
        return value if isinstance(value, Register) else float(np.clip(value, low, high))

    def limited(self, identifier: str, low: float, high: float) -> Value:
        """Return the input as a number within a range."""
        return self.builder.limit(self._read(identifier, "number"), low, high)

    def normal(self, identifier: str = "Normal") -> Value | None:
        """Return the normal that feeds the shader, or None for the surface's own."""
        socket = find_socket(self.node.inputs, identifier)
        if socket is None or find_link(socket) is None:
            return None
        value = self._read(identifier, "vector")
        return value if isinstance(value, Register) or np.any(value) else None

    def _read(self, identifier: str, kind: str) -> Value:
        socket = find_socket(self.node.inputs, identifier)
        value = self.builder.value_of(socket, self.groups, kind)
        if not (self._constants_only and isinstance(value, Register)):
            return value
        own = socket.default_value
        source = find_source(socket, self.groups).socket
        shown = f"{own:.3g}" if np.ndim(own) == 0 else f"({', '.join(f'{part:.3g}' for part in own[:3])})"
        self._replaced.append(f"{socket.name} {shown} instead of node '{source.node.name}'")
        return read_number(own) if kind == "number" else read_color(own)

    def is_used(self, identifier: str) -> bool:
        """Return True where an optional input is linked, or set to something other than zero."""
        socket = find_socket(self.node.inputs, identifier)
        if socket is None or not socket.enabled:
            return False
        source = find_source(socket, self.groups).socket
        if source is None or source.is_output or socket.type == "VECTOR":
            return source is None or source.is_output
        return read_number(source.default_value) != 0

    def report(self) -> None:
        """Add one warning that lists the inputs that constants replaced."""
        if self._replaced:
            listed = ", ".join(self._replaced)
            self.place.warn(f"node '{self.node.name}': only constants are supported, used {listed}")


Fields = dict[str, Any]

# Operations that read what is stored for each instance.
OBJECT_READERS = frozenset(f"OBJECT_INFO {output}" for output in ("Color", "Alpha", "Random"))


def read_principled(inputs: NodeInputs) -> Fields:
    emission = inputs.builder.scale(inputs.color("Emission Color"), inputs.number("Emission Strength"))
    return {
        "kind": "principled",
        "color": inputs.color("Base Color"),
        "metallic": inputs.number("Metallic", high=1.0),
        "roughness": inputs.number("Roughness", high=1.0),
        "ior": inputs.limited("IOR", SMALLEST_IOR, LARGEST_IOR),
        "transmission": inputs.number("Transmission Weight", high=1.0),
        "specular": inputs.number("Specular IOR Level", high=1.0),
        "specular_tint": inputs.color("Specular Tint"),
        "emission": emission,
        "alpha": inputs.number("Alpha", high=1.0),
        "normal": inputs.normal(),
    }


def read_diffuse(inputs: NodeInputs) -> Fields:
    return {"kind": "diffuse", "color": inputs.color("Color"), "normal": inputs.normal()}


def read_glossy(inputs: NodeInputs) -> Fields:
    return {
        "kind": "glossy",
        "color": inputs.color("Color"),
        "roughness": inputs.number("Roughness", high=1.0),
        "normal": inputs.normal(),
    }


def read_dielectric(inputs: NodeInputs) -> Fields:
    return {
        "kind": "glass" if inputs.node.type == "BSDF_GLASS" else "refraction",
        "color": inputs.color("Color"),
        "roughness": inputs.number("Roughness", high=1.0),
        "ior": inputs.limited("IOR", SMALLEST_IOR, LARGEST_IOR),
        "normal": inputs.normal(),
    }


def read_transparent(inputs: NodeInputs) -> Fields:
    return {"kind": "transparent", "color": inputs.color("Color")}


def read_emission(inputs: NodeInputs) -> Fields:
    return {"kind": "emission", "color": inputs.builder.scale(inputs.color("Color"), inputs.number("Strength"))}


def read_holdout(inputs: NodeInputs) -> Fields:
    inputs.place.warn(f"node '{inputs.node.name}' (Holdout) is not supported, the surface is black")
    return {"kind": "diffuse", "color": 0.0}


def read_stand_in(inputs: NodeInputs) -> Fields:
    node = inputs.node
    kind, color_input = STAND_IN_KINDS.get(node.type, ("diffuse", ""))
    inputs.place.warn(f"node '{node.name}' ({node.bl_label}) is not supported, treated as {kind}")
    closure: Fields = {"kind": kind, "color": inputs.color(color_input) if color_input else GREY}
    if kind == "glossy":
        closure["roughness"] = inputs.number("Roughness", high=1.0)
    return closure


CLOSURE_READERS: dict[str, Callable[[NodeInputs], Fields]] = {
    "BSDF_PRINCIPLED": read_principled,
    "BSDF_DIFFUSE": read_diffuse,
    "BSDF_GLOSSY": read_glossy,
    "BSDF_GLASS": read_dielectric,
    "BSDF_REFRACTION": read_dielectric,
    "BSDF_TRANSPARENT": read_transparent,
    "EMISSION": read_emission,
    "BACKGROUND": read_emission,
    "HOLDOUT": read_holdout,
}


def read_shader(
    socket: Any, groups: Groups, weight: Value, builder: ProgramBuilder, constants_only: bool = False
) -> list[raytracer.Closure]:
    """Return the weighted closures that feed a shader socket; none where nothing is linked to it.

    constants_only : True replaces what would vary by the sockets' own values, with a warning
    """
    source = find_source(socket, groups)
    if (isinstance(weight, float) and weight == 0) or source.socket is None or not source.socket.is_output:
        return []
    if source.socket.type != "SHADER":  # a color on a shader socket: Cycles lets it emit
        color = builder.value_of(socket, groups, "color")
        return [raytracer.Closure("emission", color=color if isinstance(color, Register) else read_color(color))]
    node = source.socket.node
    inputs = NodeInputs(node, source.groups, builder, constants_only)
    if node.type in ("MIX_SHADER", "ADD_SHADER"):
        weights = read_weights(inputs, weight)
        inputs.report()
        return [
            closure
            for shader, share in zip(node.inputs[-2:], weights, strict=True)
            for closure in read_shader(shader, source.groups, share, builder, constants_only)
        ]
    fields = CLOSURE_READERS.get(node.type, read_stand_in)(inputs)
    inputs.report()
    warn_unsupported(inputs)
    return [raytracer.Closure(weight=weight, **fields)]


def read_weights(inputs: NodeInputs, weight: Value) -> tuple[Value, Value]:
    """Return the weights of the two shaders of a Mix or an Add Shader."""
    if inputs.node.type == "ADD_SHADER":
        return weight, weight
    share = inputs.limited("Fac", 0.0, 1.0)
    builder = inputs.builder
    return builder.multiply(weight, builder.complement(share)), builder.multiply(weight, share)


def read_constant_emission(socket: Any, place: Place) -> np.ndarray | None:
    """Return the constant radiance (3,) that feeds the output of a light or a world; None where nothing does."""
    closures = read_shader(socket, (), 1.0, ProgramBuilder(place, ImageTable()), constants_only=True)
    if not closures:
        return None
    shining = [closure.weight * closure.color for closure in closures if closure.kind == "emission"]
    return np.sum(shining, axis=0) if shining else np.zeros(3)


def warn_unsupported(inputs: NodeInputs) -> None:
    """Name the inputs of a shader that are set and have no effect, and a microfacet distribution that is not GGX."""
    node = inputs.node
    ignored = [name for name in UNSUPPORTED_INPUTS.get(node.type, ()) if inputs.is_used(name)]
    if ignored:
        inputs.place.warn(f"node '{node.name}': {', '.join(ignored)} not supported, left out")
    distribution = getattr(node, "distribution", "GGX")
    if node.type in UNSUPPORTED_INPUTS and distribution not in SUPPORTED_DISTRIBUTIONS:
        inputs.place.warn(f"node '{node.name}': distribution {distribution} is not supported, GGX is used")


def extract_material(material: Any, object_name: str, images: ImageTable, warnings: WarningList) -> raytracer.Material:
    """Return one evaluated Blender material; `object_name` is where it was met first.

    Without nodes it is diffuse of the viewport color, as in Cycles.
    """
    builder = ProgramBuilder(Place(warnings, object_name, material.name), images, material.pass_index)
    node_tree = versions.find_node_tree(material)
    if node_tree is None:
        closures = [raytracer.Closure("diffuse", color=read_color(material.diffuse_color))]
    else:
        closures = read_output(versions.find_output_node(node_tree), builder)
    program = find_program(closures, builder)
    return raytracer.Material(
        closures,
        pass_index=material.pass_index,
        name=material.name,
        program=program,
        transparent_shadow=material.use_transparent_shadow,
    )


def find_program(closures: Sequence[raytracer.Closure], builder: ProgramBuilder) -> Program | None:
    """Return the program that closures read, or None where all are constant."""
    return Program(builder.steps) if any(closure.registers for closure in closures) else None


def read_output(output: Any, builder: ProgramBuilder) -> list[raytracer.Closure]:
    """Return the closures of a material's output node: none (black) without one, transparent for a mere volume."""
    place = builder.place
    if output is None:
        place.warn("no output node, the surface is black")
        return []
    surface, volume, displacement = output.inputs["Surface"], output.inputs["Volume"], output.inputs["Displacement"]
    for socket in (volume, displacement):
        if socket.is_linked:
            place.warn(f"{socket.name} is not supported, left out")
    if volume.is_linked and not surface.is_linked:
        return [raytracer.Closure("transparent", color=1.0)]
    closures = read_shader(surface, (), 1.0, builder)
    if surface.is_linked and not closures:
        place.warn("no shader reaches the output node, the surface is black")
    return closures


class MaterialTable:
    """The scene's materials, each extracted once, numbered in the order they are met."""

    def __init__(self, warnings: WarningList) -> None:
        self.records: list[raytracer.Material] = []
        self._attributes: list[set[str]] = []
        self._indices: dict[int, int] = {}
        self._images = ImageTable()
        self._warnings = warnings

    def find_index(self, material: Any, object_name: str) -> int:
        """Return the index of an evaluated material, or of the default grey for None."""
        key = material.as_pointer() if material is not None else 0
        if key not in self._indices:
            self._indices[key] = len(self.records)
            record = (
                raytracer.Material((raytracer.Closure("diffuse", color=GREY),), name="default")
                if material is None
                else extract_material(material, object_name, self._images, self._warnings)
            )
            self.records.append(record)
            self._attributes.append(list_attributes(record.program) if record.program else set())
        return self._indices[key]

    def list_attributes(self, indices: Sequence[int]) -> set[str]:
        """Return the names of the mesh attributes that some of the materials read."""
        names = set().union(*(self._attributes[index] for index in indices))
        return {name.removeprefix(TANGENT) for name in names}

    @property
    def read_object_info(self) -> bool:
        """True where a material reads the random number or the color of its object."""
        programs = [record.program for record in self.records if record.program is not None]
        return any(step.operation in OBJECT_READERS for program in programs for step in list_steps(program))

    def find_slots(self, slots: Any, used: Sequence[int], override: Any, object_name: str) -> tuple[int, ...]:
        """Return the material index of each slot number in `used`; numbers beyond the last slot mean the last.

        slots : an object's material slots (data- or object-linked)
        override : the view layer's material for everything, or None
        """
        chosen = [slot.material for slot in slots] or [None]
        return tuple(self.find_index(override or chosen[min(slot, len(chosen) - 1)], object_name) for slot in used)
