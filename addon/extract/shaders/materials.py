"""Materials: shader nodes to sums of weighted closures, and a program for all that varies over a surface.

The walk (`mixing`) starts at the active output and ends at closures (`closures`); Mix and Add Shader fold into weights.
What is inside of a surface, `volumes` reads. All of a scene's materials stand in `material_table`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

import raytracer
from raytracer.scene.programs import Program, Register, Value
from raytracer.shading.displacement import Displacement
from raytracer.shading.evaluate import list_steps

from ... import versions
from ..warnings import WarningList
from .aovs import read_aovs
from .closures import CLOSURE_READERS, NodeInputs, read_stand_in, warn_unsupported
from .images import ImageTable
from .mixing import FedShader, read_parts
from .nodes import Groups, WarningContext, find_link, read_color
from .programs import ProgramBuilder
from .trees import find_tree
from .volumes import VolumeBuilder, read_volume

# Pixels between the places where Cycles takes the height of a displacement, whatever Bump nodes say.
FILTER_WIDTH = 0.1
# Operations that read what is stored for each instance.
PROPERTY_READERS = frozenset(f"OBJECT_PROPERTY {output}" for output in ("Vector", "Fac", "Alpha"))


def read_shader(socket: Any, groups: Groups, weight: Value, builder: ProgramBuilder) -> list[raytracer.Closure]:
    """Return the weighted closures that feed a shader socket; none where nothing is linked to it."""
    return read_parts(socket, groups, weight, builder, read_closure)


def read_closure(shader: FedShader, weight: Value, builder: ProgramBuilder) -> raytracer.Closure:
    """Return the closure of a shader that mixes no others."""
    if shader.source.socket.type != "SHADER":  # a color on a shader socket: Cycles lets it emit
        color = builder.value_of(shader.socket, shader.groups, "color")
        color = color if isinstance(color, Register) else read_color(color)
        return raytracer.Closure("emission", color=color, weight=weight)
    inputs = NodeInputs(shader.node, shader.source.groups, builder)
    fields = CLOSURE_READERS.get(shader.node.type, read_stand_in)(inputs)
    warn_unsupported(inputs)
    return raytracer.Closure(weight=weight, **fields)


def read_shine(socket: Any, builder: ProgramBuilder) -> Value | None:
    """Return all that shines of what feeds the output of a light or a world, as one color; None where nothing does."""
    closures = read_shader(socket, (), 1.0, builder)
    shining = [builder.scale(closure.color, closure.weight) for closure in closures if closure.kind == "emission"]
    for closure in closures:
        if closure.kind == "principled" and (isinstance(closure.emission, Register) or np.any(closure.emission)):
            shining.append(builder.scale(builder.scale(closure.emission, closure.alpha), closure.weight))
    if not shining:
        return None
    total = shining[0]
    for color in shining[1:]:
        inputs = (total, color, np.zeros(3), 1.0)
        total = builder.add("VECT_MATH Vector", inputs, {"operation": "ADD"})["Vector"]
    return total


def extract_material(
    material: Any,
    object_name: str,
    images: ImageTable,
    warnings: WarningList,
    aovs: Sequence[str] = (),
    grids: Collection[str] | None = None,
) -> raytracer.Material:
    """Return one evaluated Blender material.

    Without nodes it is diffuse of the viewport color, as in Cycles.

    Parameters
    ----------
    object_name : where it was met first
    aovs : passes that it may write
    grids : names of those of the volumes that it is read for, which have no surface; None for surfaces
    """
    place = WarningContext(warnings, object_name, material.name)
    builder = ProgramBuilder(place, images, material.pass_index)
    node_tree = find_tree(material)
    output = None if node_tree is None else versions.find_output_node(node_tree)
    volume, has_surface = None, False
    if output is not None:
        inside = VolumeBuilder(place, images, material.pass_index, grids or ())
        volume, has_surface = read_volume(output.inputs["Volume"], inside), is_linked(output.inputs["Surface"])
    if grids is not None:
        if has_surface and volume is not None:
            place.warn("a volume has no surface, what is linked to Surface is left out")
        return raytracer.Material(name=material.name, pass_index=material.pass_index, volume=volume, only_volume=True)
    if node_tree is None:
        closures = [raytracer.Closure("diffuse", color=read_color(material.diffuse_color))]
    else:
        closures = read_output(output, builder)
    normal = None if node_tree is None else read_bump(material, node_tree, builder)
    return raytracer.Material(
        closures,
        pass_index=material.pass_index,
        name=material.name,
        program=find_program(closures, normal, builder),
        transparent_shadow=material.use_transparent_shadow,
        normal=normal,
        aovs=read_aovs(node_tree, aovs, ProgramBuilder(place, images, material.pass_index)),
        volume=volume,
        only_volume=volume is not None and not has_surface,
        fades_bumps=fades_bumps(material),
    )


def fades_bumps(material: Any) -> bool:
    """True where Cycles' settings of a material keep its Bump Map Correction, as they do where there are none.

    Those of the original are read: a script that changes them lets no evaluated copy know.
    """
    return bool(getattr(getattr(material.original, "cycles", None), "use_bump_map_correction", True))


def find_program(
    closures: Sequence[raytracer.Closure], normal: Register | None, builder: ProgramBuilder
) -> Program | None:
    """Return the program that closures and the normal read, or None where all are constant."""
    is_read = normal is not None or any(closure.registers for closure in closures)
    return Program(builder.steps) if is_read else None


def list_properties(program: Program) -> frozenset[str]:
    """Return the names of the properties of instances that a program reads."""
    return frozenset(step.settings["name"] for step in list_steps(program) if step.operation in PROPERTY_READERS)


def find_displacement_socket(material: Any, methods: tuple[str, ...]) -> Any:
    """Return the socket that a material's displacement feeds, or None where none does or it is of another method."""
    node_tree = find_tree(material) if material.displacement_method in methods else None
    output = None if node_tree is None else versions.find_output_node(node_tree)
    socket = None if output is None else output.inputs["Displacement"]
    return None if socket is None or find_link(socket) is None else socket


def read_displacement(material: Any, place: WarningContext, images: ImageTable) -> Displacement | None:
    """Return what moves the surface of a material, or None where nothing does."""
    socket = find_displacement_socket(material, ("DISPLACEMENT", "BOTH"))
    if socket is None:
        return None
    builder = ProgramBuilder(place, images, material.pass_index)
    moved = builder.value_of(socket, (), "vector")
    return Displacement(Program(builder.steps), moved, material.displacement_method == "DISPLACEMENT")


def read_bump(material: Any, node_tree: Any, builder: ProgramBuilder) -> Register | None:
    """Return the normal of a surface that a displacement bends as a bump, or None where none does.

    As in Cycles (scene/shader_graph.cpp, bump_from_displacement) the height is the part of the displacement along the
    normal, its slope that over a tenth of a pixel.
    """
    socket = find_displacement_socket(material, ("BUMP", "BOTH"))
    if socket is None:
        return None
    inner = ProgramBuilder(builder.place, builder.images, builder.pass_index, builder)
    moved = inner.value_of(socket, (), "vector")
    if not isinstance(moved, Register):
        return None
    normal = inner.add("NEW_GEOMETRY Normal", ())["Normal"]
    height = inner.add("VECT_MATH Value", (moved, normal), {"operation": "DOT_PRODUCT"})["Value"]
    inputs = (1.0, 1.0, FILTER_WIDTH, builder.add("NEW_GEOMETRY Normal", ())["Normal"])
    settings = {"height": Program(inner.steps, height), "invert": False}
    if material.displacement_method == "BOTH":
        settings["of_object"] = True
    bent = builder.add("BUMP", inputs, settings)["Normal"]
    assert isinstance(bent, Register)
    return bent


def is_linked(socket: Any) -> bool:
    """Return whether a node computes what an input of an output node gets: as in Cycles no loose reroute, muted link,
    or group that leaves its output empty."""
    return FedShader.find(socket, ()).exists


def read_output(output: Any, builder: ProgramBuilder) -> list[raytracer.Closure]:
    """Return the closures of a material's output node: none (black) without one, transparent for a mere volume."""
    place = builder.place
    if output is None:
        place.warn("no output node, the surface is black")
        return []
    surface = output.inputs["Surface"]
    if is_linked(output.inputs["Volume"]) and not is_linked(surface):
        return [raytracer.Closure("transparent", color=1.0)]
    closures = read_shader(surface, (), 1.0, builder)
    if surface.is_linked and not closures:
        place.warn("no shader reaches the output node, the surface is black")
    return closures
