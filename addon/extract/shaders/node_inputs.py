"""The inputs of one shader node, as the readers of closures ask for them: constants, or registers of a program."""

from __future__ import annotations

from typing import Any

import numpy as np

from raytracer.scene.programs import Register, Value

from .node_settings import GENERATED
from .nodes import Groups, WarningContext, find_socket, find_way, is_fed, read_color, read_number
from .programs import ProgramBuilder

SMALLEST_IOR = 1e-5  # as in Cycles
LARGEST_IOR = float(np.finfo(np.float32).max)


class NodeInputs:
    """Reads the inputs of one shader node: constants, or registers of the material's program."""

    def __init__(self, node: Any, groups: Groups, builder: ProgramBuilder) -> None:
        self.node, self.groups, self.builder = node, groups, builder

    @property
    def place(self) -> WarningContext:
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
        value = self.vector(identifier)
        return None if not isinstance(value, Register) and (value is None or not np.any(value)) else value

    def vector(self, identifier: str) -> Value | None:
        """Return what feeds the input, as a vector, or None where nothing is linked."""
        return self._read(identifier, "vector") if self.is_linked(identifier) else None

    def tangent(self, anisotropy: str) -> Value | None:
        """Return the direction along which highlights are stretched, or None where they are not: what is linked, else
        around the object's z axis."""
        if not self.is_used(anisotropy):
            return None
        linked = self.normal("Tangent")
        radial = {"axis": "Z", "name": GENERATED}
        return linked if linked is not None else self.builder.add("TANGENT RADIAL", (), radial)["Tangent"]

    def facets(self) -> dict[str, Any]:
        """Return how the node's facets are distributed."""
        chosen = self.node.distribution
        fields: dict[str, Any] = {"multiscatter": float(chosen == "MULTI_GGX")}
        if chosen == "BECKMANN":
            fields["distribution"] = "beckmann"
        elif chosen not in ("GGX", "MULTI_GGX"):
            self.place.warn(f"node '{self.node.name}': distribution {chosen} is not supported, GGX is used")
        return fields

    def _read(self, identifier: str, kind: str) -> Value:
        return self.builder.value_of(find_socket(self.node.inputs, identifier), self.groups, kind)

    def is_linked(self, identifier: str) -> bool:
        """Return True where something feeds an input."""
        socket = find_socket(self.node.inputs, identifier)
        return socket is not None and is_fed(socket, self.groups)

    def is_used(self, identifier: str) -> bool:
        """Return True where an optional input is linked, or set to something other than zero."""
        socket = find_socket(self.node.inputs, identifier)
        if socket is None or not socket.enabled:
            return False
        way = find_way(socket, self.groups)
        if way.source is not None or way.is_empty or socket.type == "VECTOR":
            return way.source is not None
        return read_number(way.hops[-1].socket.default_value) != 0
