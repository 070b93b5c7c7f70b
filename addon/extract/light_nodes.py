"""The nodes of lights: a factor of their power, a color or a program, read once for all instances of a light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from raytracer.scene.programs import Program, Register, Value

from .. import versions
from .shaders.images import ImageTable
from .shaders.materials import list_properties, read_shine
from .shaders.nodes import WarningContext
from .shaders.programs import ProgramBuilder
from .shaders.trees import find_tree


@dataclass(frozen=True)
class LightFactor:
    """What a light's own nodes put on its power.

    value : a color, or the register of `program` that holds it
    properties : names of what the program reads of instances
    """

    value: Value
    program: Program | None = None
    properties: frozenset[str] = frozenset()


NO_NODES = LightFactor(1.0)


def read_light_nodes(light: Any, place: WarningContext, images: ImageTable) -> LightFactor:
    """Return what the nodes of a light make of it; images : those of the scene."""
    node_tree = find_tree(light)
    output = versions.find_output_node(node_tree) if node_tree is not None else None
    if output is None:
        return NO_NODES if node_tree is None else LightFactor(0.0)
    builder = ProgramBuilder(place, images)
    shine = read_shine(output.inputs["Surface"], builder)
    if not isinstance(shine, Register):
        return LightFactor(0.0 if shine is None else shine)
    program = Program(builder.steps)
    return LightFactor(shine, program, list_properties(program))
