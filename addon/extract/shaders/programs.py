"""Shader node graphs to the tracer's programs: one pass from the sockets that a shader reads back to constants.

Groups are inlined, reroutes and frames vanish, muted nodes pass on what they pass on in Blender, constants fold, and
only what a shader reads is visited. A node that the tracer lacks is named once, and each socket that it feeds keeps its
own value.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from raytracer.scene.programs import Program, Register, Step, Value
from raytracer.shading.evaluate import OPERATIONS, fold_step, make_constant
from raytracer.shading.nodes.operation import Operation

from .images import ImageTable
from .node_settings import is_left_out, read_settings
from .nodes import Groups, Place, find_group_output, find_link, find_socket, read_number
from .skies import SKY_TYPES

# Blender's types of sockets, as kinds of values.
SOCKET_KINDS = {"VALUE": "number", "INT": "number", "BOOLEAN": "number", "VECTOR": "vector", "RGBA": "color"}
# Nodes that hold their value in their output.
CONSTANT_NODES = ("RGB", "VALUE")


def read_constant(socket: Any, kind: str) -> Value:
    """Return an unlinked socket's own value, as a kind."""
    value = socket.default_value
    if kind == "number":
        return read_number(value)
    if np.ndim(value) == 0:
        return make_constant(np.full(3, value, dtype=np.float64))
    return make_constant(np.array([*value, 0.0, 0.0][:3], dtype=np.float64))


class ProgramBuilder:
    """Collects the steps of one material's program; shaders ask `value_of` for what their sockets carry."""

    def __init__(self, place: Place, images: ImageTable, pass_index: int = 0) -> None:
        self.place, self.images, self.pass_index = place, images, pass_index
        self.steps: list[Step] = []
        self._known: dict[Any, Value | None] = {}

    @property
    def program(self) -> Program | None:
        """The program, or None where all is constant."""
        return Program(self.steps) if self.steps else None

    def value_of(self, socket: Any, groups: Groups, kind: str) -> Value:
        """Return what an input socket carries, as a kind: a constant, or a register of the program.

        groups : the group nodes that the socket lies in, outermost first
        """
        link = find_link(socket)
        found = None if link is None else self._trace(link.from_socket, groups, socket)
        return read_constant(socket, kind) if found is None else self._convert(*found, kind)

    def _trace(self, output: Any, groups: Groups, fed: Any) -> tuple[Value, str] | None:
        """Return the value and kind of an output socket, or None where nothing computes it.

        fed : the input that it feeds, for the warning
        """
        node, kind = output.node, SOCKET_KINDS.get(output.type)
        if node.mute or node.type == "REROUTE":
            inner = next((inner for inner in node.internal_links if inner.to_socket == output), None)
            passed, groups = inner and inner.from_socket, groups
        elif node.type == "GROUP":
            passed, groups = find_group_output(node, output.identifier), (*groups, node)
        elif node.type == "GROUP_INPUT" and groups:
            passed, groups = find_socket(groups[-1].inputs, output.identifier), groups[:-1]
        elif kind is None:
            return None
        elif node.type in CONSTANT_NODES:
            return read_constant(output, kind), kind
        else:
            value = self._compute(node, output, groups, fed)
            return None if value is None else (value, kind)
        return None if passed is None or kind is None else (self.value_of(passed, groups, kind), kind)

    def _convert(self, value: Value, have: str, want: str) -> Value:
        """Convert between kinds of sockets as Blender does; vectors and colors are alike."""
        if (have == "number") == (want == "number"):
            return value
        return self.add(f"{have} to {'number' if want == 'number' else 'vector'}", (value,))["Value"]

    def _compute(self, node: Any, output: Any, groups: Groups, fed: Any) -> Value | None:
        """Return the output of a node that computes, or None for one that the tracer lacks."""
        key = (node.as_pointer(), *(group.as_pointer() for group in groups))
        if (key, output.identifier) not in self._known:
            name = find_operation(node, output.identifier)
            if name is None:
                self._warn_unknown(node, fed)
                self._known[key, output.identifier] = None
            else:
                outputs = self._add_node(node, name, groups, output.identifier)
                if len(outputs) == 1:  # under whatever name
                    outputs = dict.fromkeys([output.identifier], next(iter(outputs.values())))
                self._known |= {(key, identifier): value for identifier, value in outputs.items()}
        return self._known[key, output.identifier]

    def _add_node(self, node: Any, name: str, groups: Groups, output: str) -> dict[str, Value]:
        """Add a node's step and return its outputs."""
        operation = OPERATIONS[name]
        inputs = tuple(self._read_input(node, identifier, operation, groups) for identifier in operation.inputs)
        if is_left_out(node):
            return {operation.outputs[0]: inputs[-1]}
        return self.add(name, inputs, read_settings(self, node, name, groups, output))

    def _read_input(self, node: Any, identifier: str, operation: Operation, groups: Groups) -> Value:
        """Return one input of a node: what feeds it, or stands in for a missing link or a missing socket."""
        socket = find_socket(node.inputs, identifier)
        if socket is None:
            return MISSING_INPUTS[identifier]
        kind = SOCKET_KINDS[socket.type]
        if identifier in operation.links and find_link(socket) is None:
            return self._read_default(operation.links[identifier])
        if not socket.enabled:
            return 0.0 if kind == "number" else np.zeros(3)
        return self.value_of(socket, groups, kind)

    def _read_default(self, link: str) -> Value:
        """Return what an unlinked socket reads: an operation, with the name of its attribute where it reads one."""
        if link not in self._known:
            name, attribute = link.rsplit(" ", 1) if link.startswith("ATTRIBUTE") else (link, "")
            self._known[link] = next(iter(self.add(name, (), {"name": attribute} if attribute else {}).values()))
        return cast(Value, self._known[link])

    def add(self, name: str, inputs: tuple[Value, ...], settings: dict[str, Any] | None = None) -> dict[str, Value]:
        """Add a step, or fold it away where it is constant; return its outputs by identifier."""
        step = Step(name, inputs, settings or {})
        folded = fold_step(step)
        if folded is not None:
            return folded
        self.steps.append(step)
        return {output: Register(len(self.steps) - 1, output) for output in OPERATIONS[name].outputs}

    def build_inner(self, socket: Any, groups: Groups) -> Program:
        """Return a program of its own for the number that feeds a socket, for a step that runs it elsewhere as well."""
        inner = ProgramBuilder(self.place, self.images, self.pass_index)
        result = inner.value_of(socket, groups, "number")
        return Program(inner.steps, result)

    # What shaders do with numbers

    def multiply(self, first: Value, second: Value) -> Value:
        """Return the product of two numbers."""
        if first == 1.0:
            return second
        return self.add("MATH", (first, second, 0.0), {"operation": "MULTIPLY"})["Value"]

    def scale(self, color: Value, factor: Value) -> Value:
        """Return a color times a number."""
        if isinstance(factor, float) and factor == 1.0:
            return color
        inputs = (color, np.zeros(3), np.zeros(3), factor)
        return self.add("VECT_MATH Vector", inputs, {"operation": "SCALE"})["Vector"]

    def limit(self, value: Value, low: float, high: float) -> Value:
        """Return a number cut to a range."""
        return self.add("CLAMP", (value, low, high), {"clamp_type": "MINMAX"})["Result"]

    def complement(self, value: Value) -> Value:
        """Return 1 - value."""
        return self.add("MATH", (1.0, value, 0.0), {"operation": "SUBTRACT"})["Value"]

    def _warn_unknown(self, node: Any, fed: Any) -> None:
        self.place.warn(
            f"node '{node.name}' ({node.bl_label}) is not supported, "
            f"'{fed.name}' of node '{fed.node.name}' keeps its own value"
        )


# Sockets that older versions of Blender lack, at what they mean there.
MISSING_INPUTS: dict[str, Value] = {"Filter Width": 1.0}


# Nodes and outputs that are read as others are.
ALIASES = {
    "ATTRIBUTE Color": "ATTRIBUTE Vector",
    "VERTEX_COLOR Color": "ATTRIBUTE Vector",
    "UVMAP UV": "ATTRIBUTE Vector",
    "TEX_COORD Generated": "ATTRIBUTE Vector",
    "TEX_COORD UV": "ATTRIBUTE Vector",
}


# Properties that the add-on resolves before the tracer sees them, at the values that it knows.
RESOLVED: dict[str, dict[str, tuple[str, ...]]] = {"TEX_SKY": {"sky_type": SKY_TYPES}}


def find_operation(node: Any, output: str) -> str | None:
    """Return the name of the tracer's operation for an output of a node, or None."""
    variant = node.direction_type if node.type == "TANGENT" else output
    name = f"{node.type} {variant}"
    found = next((name for name in (ALIASES.get(name, name), node.type) if name in OPERATIONS), None)
    if found is None:
        return None
    choices = {**OPERATIONS[found].choices, **RESOLVED.get(found, {})}
    return found if all(getattr(node, setting) in values for setting, values in choices.items()) else None
