"""The mapping that every texture node has in the sidebar of the editor, besides Mapping nodes.

References
----------
Blender, intern/cycles/scene/shader_nodes.cpp, TextureMapping: skip, compute_transform.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from raytracer.scene.programs import Value

AXES = {"X": 0, "Y": 1, "Z": 2}


class Adder(Protocol):
    """What is asked of the builder of a program, `programs.ProgramBuilder`."""

    def add(self, name: str, inputs: tuple[Value, ...], settings: dict[str, Any] | None = None) -> dict[str, Value]: ...


def map_texture(builder: Adder, node: Any, vector: Value) -> Value:
    """Return the coordinates of a texture node as its own mapping changes them; a node without one changes nothing.

    First each axis is given the coordinate that is projected to it, or 0.
    """
    mapping = getattr(node, "texture_mapping", None)
    if mapping is None:
        return vector
    sources = mapping.mapping_x, mapping.mapping_y, mapping.mapping_z
    if sources != tuple(AXES):
        parts = tuple(builder.add("SEPXYZ", (vector,)).values())
        vector = builder.add("COMBXYZ", tuple(parts[AXES[name]] if name in AXES else 0.0 for name in sources))["Vector"]
    moved, turned, scale = (
        np.array(values, dtype=np.float64) for values in (mapping.translation, mapping.rotation, mapping.scale)
    )
    if not (moved.any() or turned.any() or (scale != 1.0).any()):
        return vector
    return builder.add("MAPPING", (vector, moved, turned, scale), {"vector_type": mapping.vector_type})["Vector"]
