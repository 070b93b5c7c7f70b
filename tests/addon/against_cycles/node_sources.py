"""What the tests of nodes share: functions that make nodes, sources of coordinates, bounds, and the comparison.

A bound states the largest difference, as a share of 1 + |value|. Both engines see the same points; what is left is
Cycles' float32, whose coordinates of up to 16 m are off by up to 1e-6 m, in proportion to a node's steepness.
"""

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np

from tests.addon.against_cycles.node_fixtures import Make, add_node, measure_differences

# What passes coordinates on, or is about as steep.
SMOOTH = 1e-5
# Functions tens of times as steep as their coordinates.
STEEP = 1e-4
# Cycles fits the colors of glowing bodies by rational functions.
GLOWING = 1e-2
# Cycles keeps a vertex's normal in 32 bits: its tangent plane is off by up to 1e-4.
PACKED_NORMALS = 4e-4


def make(kind: str, output: int | str = 0, inputs: dict[str, Any] | None = None, **properties: Any) -> Make:
    """Return a function that makes one node; inputs that are functions themselves make what they link to."""

    def build(tree: Any) -> Any:
        sockets = {name: value(tree) if callable(value) else value for name, value in (inputs or {}).items()}
        outputs = add_node(tree, kind, sockets, **properties).outputs
        return outputs[output] if isinstance(output, int) else find(outputs, output)

    return build


def find(sockets: Any, identifier: str) -> Any:
    return next(socket for socket in sockets if socket.identifier == identifier)


def list_items(kind: str, name: str) -> list[str]:
    """Return the values that an enumeration of a node has in this version of Blender."""
    return [item.identifier for item in getattr(bpy.types, kind).bl_rna.properties[name].enum_items]


def attribute(name: str, output: str = "Color") -> Make:
    return make("ShaderNodeAttribute", output, attribute_name=name)


def stretch(source: Make, factor: Any, offset: Any) -> Make:
    """source * factor + offset, vectors."""
    return make(
        "ShaderNodeVectorMath",
        inputs={"Vector": source, "Vector_001": factor, "Vector_002": offset},
        operation="MULTIPLY_ADD",
    )


def part(source: Make, output: str) -> Make:
    return make("ShaderNodeSeparateXYZ", output, {"Vector": source})


GENERATED = make("ShaderNodeTexCoord", "Generated")
CENTRED = stretch(GENERATED, (2.0, 2.0, 2.0), (-1.0, -1.0, -1.0))
WIDE = stretch(GENERATED, (7.0, 5.0, 6.0), (-3.0, -2.0, 1.0))
COLOR = attribute("Col")
X, Y = part(CENTRED, "X"), part(CENTRED, "Y")


def assert_agreement(
    configurations: dict[str, Make],
    bound: float,
    record: Callable[[str, object], None],
    share: float = 1.0,
    behind: bool = False,
) -> None:
    """Compare all configurations in one picture, of planes or of their backs; `share` of each one's pixels have to be
    within the bound."""
    scene = bpy.context.scene
    _, pictures, warnings = measure_differences(scene, configurations, behind)
    assert not warnings
    failing, largest = {}, {}
    for name, (ours, cycles) in pictures.items():
        assert np.isfinite(ours).all(), name
        difference = (np.abs(ours - cycles) / (1.0 + np.abs(cycles))).max(axis=2)
        largest[name] = float(np.quantile(difference, share, method="lower"))
        if largest[name] > bound:
            failing[name] = largest[name]
    record("largest_difference", largest)
    assert failing == {}
