"""Materials: shader nodes to sums of weighted closures, with constants for all that varies over a surface.

The walk starts at the active output and ends at closures; Mix and Add Shader fold into weights. Stand-ins, each with a
warning: a shader that reflects colored light in a way we lack becomes glossy (Metallic) or diffuse (Translucent,
Subsurface, Sheen, Toon, Hair) of its own color; any other becomes the default grey diffuse; Holdout becomes black.
Multiscatter GGX, the nodes' default, is treated as GGX. Imports raytracer and this package.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import raytracer

from .. import versions
from .nodes import NodeInputs, Place, find_source, read_color
from .warnings import WarningList

GREY = 0.8  # what Cycles gives an object without a material
SMALLEST_IOR = 1e-5  # as in Cycles

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
        *("Normal", "Diffuse Roughness", "Subsurface Weight", "Anisotropic", "Coat Weight", "Sheen Weight"),
        *("Thin Film Thickness", "Thin Wall"),
    ),
    "BSDF_DIFFUSE": ("Normal", "Roughness"),
    "BSDF_GLOSSY": ("Normal", "Anisotropy"),
    "BSDF_GLASS": ("Normal", "Thin Film Thickness"),
    "BSDF_REFRACTION": ("Normal",),
}
SUPPORTED_DISTRIBUTIONS = ("GGX", "MULTI_GGX")


def read_principled(inputs: NodeInputs) -> dict[str, Any]:
    return {
        "kind": "principled",
        "color": inputs.color("Base Color"),
        "metallic": inputs.number("Metallic", high=1.0),
        "roughness": inputs.number("Roughness", high=1.0),
        "ior": inputs.number("IOR", low=SMALLEST_IOR),
        "transmission": inputs.number("Transmission Weight", high=1.0),
        "specular": inputs.number("Specular IOR Level", high=1.0),
        "specular_tint": inputs.color("Specular Tint"),
        "emission": inputs.color("Emission Color") * inputs.number("Emission Strength"),
        "alpha": inputs.number("Alpha", high=1.0),
    }


def read_diffuse(inputs: NodeInputs) -> dict[str, Any]:
    return {"kind": "diffuse", "color": inputs.color("Color")}


def read_glossy(inputs: NodeInputs) -> dict[str, Any]:
    return {"kind": "glossy", "color": inputs.color("Color"), "roughness": inputs.number("Roughness", high=1.0)}


def read_dielectric(inputs: NodeInputs) -> dict[str, Any]:
    return {
        "kind": "glass" if inputs.node.type == "BSDF_GLASS" else "refraction",
        "color": inputs.color("Color"),
        "roughness": inputs.number("Roughness", high=1.0),
        "ior": inputs.number("IOR", low=SMALLEST_IOR),
    }


def read_transparent(inputs: NodeInputs) -> dict[str, Any]:
    return {"kind": "transparent", "color": inputs.color("Color")}


def read_emission(inputs: NodeInputs) -> dict[str, Any]:
    return {"kind": "emission", "color": inputs.color("Color") * inputs.number("Strength")}


def read_constant(inputs: NodeInputs) -> dict[str, Any]:
    """Read a plain color on a shader socket: Cycles lets it emit."""
    return {"kind": "emission", "color": read_color(inputs.node.outputs[0].default_value)}


def read_holdout(inputs: NodeInputs) -> dict[str, Any]:
    inputs.place.warn(f"node '{inputs.node.name}' (Holdout) is not supported, the surface is black")
    return {"kind": "diffuse", "color": 0.0}


def read_stand_in(inputs: NodeInputs) -> dict[str, Any]:
    node = inputs.node
    kind, color_input = STAND_IN_KINDS.get(node.type, ("diffuse", ""))
    inputs.place.warn(f"node '{node.name}' ({node.bl_label}) is not supported, treated as {kind}")
    closure: dict[str, Any] = {"kind": kind, "color": inputs.color(color_input) if color_input else GREY}
    if kind == "glossy":
        closure["roughness"] = inputs.number("Roughness", high=1.0)
    return closure


CLOSURE_READERS: dict[str, Callable[[NodeInputs], dict[str, Any]]] = {
    "BSDF_PRINCIPLED": read_principled,
    "BSDF_DIFFUSE": read_diffuse,
    "BSDF_GLOSSY": read_glossy,
    "BSDF_GLASS": read_dielectric,
    "BSDF_REFRACTION": read_dielectric,
    "BSDF_TRANSPARENT": read_transparent,
    "EMISSION": read_emission,
    "BACKGROUND": read_emission,
    "RGB": read_constant,
    "VALUE": read_constant,
    "HOLDOUT": read_holdout,
}


def read_shader(socket: Any, groups: tuple[Any, ...], weight: float, place: Place) -> list[raytracer.Closure]:
    """Return the weighted closures that feed a shader socket; none where nothing is linked to it."""
    source = find_source(socket, groups)
    if weight == 0 or source.socket is None or not source.socket.is_output:
        return []
    node = source.socket.node
    inputs = NodeInputs(node, source.groups, place)
    if node.type in ("MIX_SHADER", "ADD_SHADER"):
        first, second = node.inputs[-2], node.inputs[-1]
        share = inputs.number("Fac", high=1.0) if node.type == "MIX_SHADER" else None
        inputs.report()
        weights = (weight, weight) if share is None else (weight * (1 - share), weight * share)
        return [
            *read_shader(first, source.groups, weights[0], place),
            *read_shader(second, source.groups, weights[1], place),
        ]
    fields = CLOSURE_READERS.get(node.type, read_stand_in)(inputs)
    inputs.report()
    warn_unsupported(inputs)
    return [raytracer.Closure(weight=weight, **fields)]


def warn_unsupported(inputs: NodeInputs) -> None:
    """Name the inputs of a shader that are set and have no effect, and a microfacet distribution that is not GGX."""
    node = inputs.node
    ignored = [name for name in UNSUPPORTED_INPUTS.get(node.type, ()) if inputs.is_used(name)]
    if ignored:
        inputs.place.warn(f"node '{node.name}': {', '.join(ignored)} not supported, left out")
    distribution = getattr(node, "distribution", "GGX")
    if node.type in UNSUPPORTED_INPUTS and distribution not in SUPPORTED_DISTRIBUTIONS:
        inputs.place.warn(f"node '{node.name}': distribution {distribution} is not supported, GGX is used")


def extract_material(material: Any, object_name: str, warnings: WarningList) -> raytracer.Material:
    """Return one evaluated Blender material; `object_name` is where it was met first.

    Without nodes it is diffuse of the viewport color, as in Cycles.
    """
    place = Place(warnings, object_name, material.name)
    node_tree = versions.find_node_tree(material)
    if node_tree is None:
        closures = [raytracer.Closure("diffuse", color=read_color(material.diffuse_color))]
    else:
        closures = read_output(versions.find_output_node(node_tree), place)
    return raytracer.Material(closures, pass_index=material.pass_index, name=material.name)


def read_output(output: Any, place: Place) -> list[raytracer.Closure]:
    """Return the closures of a material's output node: none (black) without one, transparent for a mere volume."""
    if output is None:
        place.warn("no output node, the surface is black")
        return []
    surface, volume, displacement = output.inputs["Surface"], output.inputs["Volume"], output.inputs["Displacement"]
    for socket in (volume, displacement):
        if socket.is_linked:
            place.warn(f"{socket.name} is not supported, left out")
    if volume.is_linked and not surface.is_linked:
        return [raytracer.Closure("transparent", color=1.0)]
    closures = read_shader(surface, (), 1.0, place)
    if surface.is_linked and not closures:
        place.warn("no shader reaches the output node, the surface is black")
    return closures


class MaterialTable:
    """The scene's materials, each extracted once, numbered in the order they are met."""

    def __init__(self, warnings: WarningList) -> None:
        self.records: list[raytracer.Material] = []
        self._indices: dict[int, int] = {}
        self._warnings = warnings

    def find_index(self, material: Any, object_name: str) -> int:
        """Return the index of an evaluated material, or of the default grey for None."""
        key = material.as_pointer() if material is not None else 0
        if key not in self._indices:
            self._indices[key] = len(self.records)
            self.records.append(
                raytracer.Material((raytracer.Closure("diffuse", color=GREY),), name="default")
                if material is None
                else extract_material(material, object_name, self._warnings)
            )
        return self._indices[key]

    def find_slots(self, slots: Any, used: Sequence[int], override: Any, object_name: str) -> tuple[int, ...]:
        """Return the material index of each slot number in `used`; numbers beyond the last slot mean the last.

        slots : an object's material slots (data- or object-linked)
        override : the view layer's material for everything, or None
        """
        chosen = [slot.material for slot in slots] or [None]
        return tuple(self.find_index(override or chosen[min(slot, len(chosen) - 1)], object_name) for slot in used)
