"""The world: one constant radiance (Background nodes with constants). Imports raytracer and this package."""

from __future__ import annotations

from typing import Any

import raytracer

from .. import versions
from .materials import read_constant_emission
from .nodes import Place, read_color
from .warnings import WarningList


def extract_world(world: Any, warnings: WarningList) -> raytracer.World | None:
    """Return the world, or None for black: no world, no output, nothing linked.

    Textures and skies that feed a Background are replaced by the socket's own color, with a warning.
    """
    if world is None:
        return None
    node_tree = versions.find_node_tree(world)
    if node_tree is None:
        return raytracer.World(read_color(world.color))
    place = Place(warnings, prefix=f"world '{world.name}': ")
    output = versions.find_output_node(node_tree)
    if output is None:
        return None
    if output.inputs["Volume"].is_linked:
        place.warn("volume is not supported, left out")
    color = read_constant_emission(output.inputs["Surface"], place)
    return None if color is None else raytracer.World(color)
