"""The world: what its shaders send from every direction, as one color or a program.

Shaders that shine add up to one value. What Cycles' samples of light cannot tell apart, ours cannot either: to them all
flags of rays are 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import raytracer
from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL
from raytracer.scene.programs import Program, Register

from .. import versions
from .shaders.aovs import read_aovs
from .shaders.images import ImageTable
from .shaders.materials import read_shine
from .shaders.nodes import WarningContext, read_color
from .shaders.programs import ProgramBuilder
from .shaders.trees import find_tree
from .shaders.volumes import VolumeBuilder, read_volume
from .warnings import WarningList

# Cycles' flags of a world, and the classes of rays that they stand for.
WORLD_VISIBILITY = {
    **{name: name for name in ("camera", "diffuse", "glossy", "transmission")},
    "scatter": "volume",
}


def extract_world(
    world: Any, warnings: WarningList, images: ImageTable | None = None, aovs: Sequence[str] = ()
) -> raytracer.World | None:
    """Return the world, or None for black: no world, no output, nothing linked; aovs : passes that it may write."""
    if world is None:
        return None
    node_tree = find_tree(world)
    if node_tree is None:
        return raytracer.World(read_color(world.color), seen_by=find_world_visibility(world))
    place = WarningContext(warnings, prefix=f"world '{world.name}': ")
    output = versions.find_output_node(node_tree)
    if output is None:
        return None
    images = images or ImageTable()
    volume = read_volume(output.inputs["Volume"], VolumeBuilder(place, images, is_world=True))
    builder = ProgramBuilder(place, images)
    shine = read_shine(output.inputs["Surface"], builder)
    written = read_aovs(node_tree, aovs, ProgramBuilder(place, images))
    if shine is None:
        return None if written is None and volume is None else raytracer.World(0.0, aovs=written, volume=volume)
    seen_by = find_world_visibility(world)
    if isinstance(shine, Register):
        limit = versions.read_world_bounces(world)
        return raytracer.World(shine, Program(builder.steps), seen_by, limit, written, volume)
    return raytracer.World(shine, seen_by=seen_by, aovs=written, volume=volume)


def find_world_visibility(world: Any) -> int:
    """Return the classes of rays that see a world, as bits of SEEN_BY."""
    visibility = getattr(world, "cycles_visibility", None)  # of Cycles' add-on, which can be off
    hidden = [label for name, label in WORLD_VISIBILITY.items() if not getattr(visibility, name, True)]
    return SEEN_BY_ALL - sum(SEEN_BY[label] for label in hidden)
