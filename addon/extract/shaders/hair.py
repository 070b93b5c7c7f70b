"""Blender's hair shaders to the fields of closures, and what they compute from strand to strand.

References
----------
Blender, intern/cycles/kernel/svm/closure.h and scene/shader_nodes.cpp: PrincipledHairBsdfNode, HairBsdfNode.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from raytracer.scene.programs import Value

from .node_inputs import LARGEST_IOR, SMALLEST_IOR, NodeInputs


def read_principled_hair(inputs: NodeInputs) -> dict[str, Any]:
    """Read the Principled Hair BSDF; as in Cycles, one random number of the strand varies roughness and melanin."""
    node, builder = inputs.node, inputs.builder
    if node.model != "CHIANG":
        inputs.place.warn(f"node '{node.name}': model {node.model.title()} is not supported, Chiang is used")
    factor = vary(inputs, "Random Roughness")
    roughness = builder.multiply(factor, inputs.number("Roughness"))
    radial = builder.multiply(factor, inputs.number("Radial Roughness"))
    return {
        "kind": "hair",
        "absorption": read_absorption(inputs, radial),
        "roughness": builder.limit(roughness, 0.0, 1.0),
        "radial_roughness": builder.limit(radial, 0.0, 1.0),
        "coat_weight": inputs.number("Coat", high=1.0),
        "ior": inputs.limited("IOR", SMALLEST_IOR, LARGEST_IOR),
        "tilt": inputs.limited("Offset", -np.pi / 2.0, np.pi / 2.0),
        "across": builder.add("STRAND Across", ())["Across"],
        "tangent": builder.add("STRAND Along", ())["Along"],
    }


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
