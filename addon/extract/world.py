"""The world: what its shaders send from every direction, as one color or a program.

Shaders that shine add up to one value. Rays that the world is hidden from (Ray Visibility) see black, which is part of
the program. What Cycles' samples of light cannot tell apart, ours cannot either: to them all flags of rays are 0.
"""

from __future__ import annotations

from typing import Any

import raytracer
from raytracer.scene.programs import Program, Register, Value

from .. import versions
from .shaders.images import ImageTable
from .shaders.materials import read_shine
from .shaders.nodes import Place, read_color
from .shaders.programs import ProgramBuilder
from .warnings import WarningList


def extract_world(world: Any, warnings: WarningList, images: ImageTable | None = None) -> raytracer.World | None:
    """Return the world, or None for black: no world, no output, nothing linked."""
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
    builder = ProgramBuilder(place, images or ImageTable())
    shine = read_shine(output.inputs["Surface"], builder)
    if shine is None:
        return None
    color = hide_from_rays(builder, shine, world)
    if isinstance(color, Register):
        return raytracer.World(color, Program(builder.steps))
    return raytracer.World(color)


# The flags of a world's Ray Visibility, and the rays that they are for.
VISIBILITY = {
    "camera": "LIGHT_PATH Is Camera Ray",
    "diffuse": "LIGHT_PATH Is Diffuse Ray",
    "glossy": "LIGHT_PATH Is Glossy Ray",
    "transmission": "LIGHT_PATH Is Transmission Ray",
}


def hide_from_rays(builder: ProgramBuilder, color: Value, world: Any) -> Value:
    """Return the color, black to the kinds of rays that the world is hidden from."""
    for flag, operation in VISIBILITY.items():
        if not getattr(world.cycles_visibility, flag):
            hidden = next(iter(builder.add(operation, ()).values()))
            color = builder.scale(color, builder.complement(hidden))
    return color
