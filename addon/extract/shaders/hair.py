"""Blender's hair shaders to the fields of closures, and what they compute from strand to strand.

References
----------
Blender, intern/cycles/kernel/svm/closure.h and scene/shader_nodes.cpp: PrincipledHairBsdfNode, HairBsdfNode.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from raytracer.scene.programs import Register, Value

from .node_inputs import LARGEST_IOR, SMALLEST_IOR, NodeInputs
from .programs import ProgramBuilder


def read_principled_hair(inputs: NodeInputs) -> dict[str, Any]:
    """Read the Principled Hair BSDF; as in Cycles, one random number of the strand varies roughness and melanin."""
    node, builder = inputs.node, inputs.builder
    factor = vary(inputs, "Random Roughness")
    roughness = radial = builder.multiply(factor, inputs.number("Roughness"))
    if node.model == "CHIANG":
        radial = builder.multiply(factor, inputs.number("Radial Roughness"))
    fields = {
        "absorption": read_absorption(inputs, radial),
        "roughness": builder.limit(roughness, 0.0, 1.0),
        "ior": inputs.limited("IOR", SMALLEST_IOR, LARGEST_IOR),
        "tilt": inputs.limited("Offset", -np.pi / 2.0, np.pi / 2.0),
        "across": builder.add("STRAND Across", ())["Across"],
        "tangent": builder.add("STRAND Along", ())["Along"],
    }
    if node.model != "CHIANG":
        return fields | read_huang(inputs, fields["across"])
    radial = builder.limit(radial, 0.0, 1.0)
    return {"kind": "hair", "radial_roughness": radial, "coat_weight": inputs.number("Coat", high=1.0), **fields}


def read_huang(inputs: NodeInputs, across: Value) -> dict[str, Any]:
    """Read what Huang's model has of its own; a strand that is not round is clear beside what is seen of it."""
    builder = inputs.builder
    gains = tuple(inputs.number(f"{name} lobe") for name in ("R", "TT", "TRT"))
    fields = {
        "kind": "hair_huang",
        "gains": join_gains(gains, builder),
        "coverage": builder.add("STRAND Coverage", ())["Coverage"],
        "chance": builder.add("STRAND Chance", ())["Chance"],
    }
    aspect = inputs.number("Aspect Ratio")
    if not isinstance(aspect, Register) and aspect == 1.0:
        return fields
    aspect = builder.add("STRAND Aspect", (aspect,))["Aspect"]
    axis = builder.add("STRAND Axis", ())["Axis"]
    inside = builder.add("STRAND Inside", (axis, aspect, across))["Inside"]
    return {**fields, "aspect": aspect, "axis": axis, "alpha": inside}


def join_gains(gains: tuple[Value, ...], builder: ProgramBuilder) -> Value:
    """Return what the reflections R, TT and TRT are multiplied by, as one triple."""
    if any(isinstance(gain, Register) for gain in gains):
        return builder.add("COMBXYZ", gains)["Vector"]
    return np.array(gains)


def read_absorption(inputs: NodeInputs, radial: Value) -> Value:
    """Return the absorption (3,) per radius, as the node's parametrization asks for it."""
    builder = inputs.builder
    if inputs.node.parametrization == "ABSORPTION":
        return inputs.color("Absorption Coefficient")
    by_color = "STRAND Absorption by Color"
    if inputs.node.parametrization == "COLOR":
        return builder.add(by_color, (inputs.color("Color"), radial))["Absorption"]
    melanin = builder.multiply(vary(inputs, "Random Color"), inputs.number("Melanin", low=-np.inf))
    redness = inputs.number("Melanin Redness", low=-np.inf)
    dark = builder.add("STRAND Absorption by Melanin", (melanin, redness))["Absorption"]
    tint = builder.add(by_color, (inputs.color("Tint"), radial))["Absorption"]
    return builder.add("VECT_MATH Vector", (dark, tint, np.zeros(3), 1.0), {"operation": "ADD"})["Vector"]


def vary(inputs: NodeInputs, identifier: str) -> Value:
    """Return the factor by which an input varies from strand to strand; 1 where it does not."""
    if not inputs.is_used(identifier):
        return 1.0
    random = inputs.number("Random", low=-np.inf)
    if not inputs.is_linked("Random"):
        random = inputs.builder.add("STRAND Random", (random,))["Random"]
    amount = inputs.number(identifier, high=1.0)
    return inputs.builder.add("STRAND Vary", (amount, random))["Factor"]


def read_hair(inputs: NodeInputs) -> dict[str, Any]:
    """Read the Hair BSDF; without a tangent of its own it follows strands, and surfaces along their other edge, where
    Cycles takes no offset."""
    builder, tangent = inputs.builder, inputs.normal("Tangent")
    offset = inputs.limited("Offset", -np.pi / 2.0, np.pi / 2.0)
    if tangent is None:
        tangent = builder.add("STRAND Aside", ())["Aside"]
        offset = builder.add("STRAND Offset", (offset,))["Offset"]
    return {
        "kind": f"hair_{inputs.node.component.lower()}",
        "color": inputs.color("Color"),
        "roughness": inputs.number("RoughnessU", high=1.0),
        "radial_roughness": inputs.number("RoughnessV", high=1.0),
        "tilt": offset,
        "tangent": tangent,
    }
