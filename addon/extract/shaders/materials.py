"""Materials: shader nodes to sums of weighted closures, and a program for all that varies over a surface.

The walk starts at the active output and ends at closures (`closures`); Mix and Add Shader fold into weights. Imports
raytracer and this package.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import raytracer
from raytracer.scene.programs import Program, Register, Value
from raytracer.shading.displacement import Displacement
from raytracer.shading.evaluate import list_attributes, list_steps
from raytracer.shading.site_tables import TANGENT, UNDEFORMED

from ... import versions
from ..custom_properties import find_layer
from ..displacing import SMOOTH, VERTEX_NORMAL
from ..kept import Kept
from ..warnings import Warning, WarningList
from .aovs import read_aovs
from .closures import CLOSURE_READERS, GREY, NodeInputs, read_stand_in, warn_unsupported
from .images import ImageTable
from .node_settings import DEFAULT_UV
from .nodes import Groups, Source, WarningContext, find_link, find_source, identify, read_color, read_links_once
from .programs import ProgramBuilder

# Pixels between the places where Cycles takes the height of a displacement, whatever Bump nodes say.
FILTER_WIDTH = 0.1
# Operations that read what is stored for each instance.
PROPERTY_READERS = frozenset(f"OBJECT_PROPERTY {output}" for output in ("Vector", "Fac", "Alpha"))
OBJECT_READERS = frozenset(f"OBJECT_INFO {output}" for output in ("Color", "Alpha", "Random"))


def read_shader(socket: Any, groups: Groups, weight: Value, builder: ProgramBuilder) -> list[raytracer.Closure]:
    """Return the weighted closures that feed a shader socket; none where nothing is linked to it.

    A shader that reaches the socket on several ways is read once, with the sum of their weights.
    """
    with read_links_once():
        return list(read_closures(FedShader.find(socket, groups), weight, builder))


def read_closures(root: FedShader, weight: Value, builder: ProgramBuilder) -> Iterator[raytracer.Closure]:
    """Yield the weighted closures of `read_shader`."""
    order = order_shaders(root)
    weights: dict[Any, Value] = {shader.key: weight for shader in order[:1]}
    for shader in order:
        weight = weights.get(shader.key, 0.0)
        if isinstance(weight, float) and weight == 0:
            continue
        if shader.is_mixed:
            inputs = NodeInputs(shader.node, shader.source.groups, builder)
            for mixed, share in zip(shader.list_mixed(), read_weights(inputs, weight), strict=True):
                if mixed.exists:
                    weights[mixed.key] = builder.sum(weights[mixed.key], share) if mixed.key in weights else share
        else:
            yield read_closure(shader, weight, builder)


class FedShader(NamedTuple):
    """A shader, and the input that it feeds.

    socket, groups : the input, and the group nodes that it lies in
    source : what feeds it
    """

    socket: Any
    groups: Groups
    source: Source

    @classmethod
    def find(cls, socket: Any, groups: Groups) -> FedShader:
        return cls(socket, groups, find_source(socket, groups))

    @property
    def exists(self) -> bool:
        return self.source.socket is not None and self.source.socket.is_output

    @property
    def key(self) -> tuple[int, ...]:
        return identify(self.source.socket, self.source.groups)

    @property
    def node(self) -> Any:
        return self.source.socket.node

    @property
    def is_mixed(self) -> bool:
        return self.node.type in ("MIX_SHADER", "ADD_SHADER")

    def list_mixed(self) -> list[FedShader]:
        """Return the two shaders of a Mix or an Add Shader."""
        return [self.find(socket, self.source.groups) for socket in self.node.inputs[-2:]]


def order_shaders(root: FedShader) -> list[FedShader]:
    """Return the shaders behind `root`, each once: first those that mix others, else in the order of the sockets."""
    order: list[FedShader] = []
    seen: set[Any] = set()
    stack = [(root, False)]
    while stack:
        shader, is_done = stack.pop()
        if is_done:
            order.append(shader)
        elif shader.exists and shader.key not in seen:
            seen.add(shader.key)
            stack.append((shader, True))
            stack.extend((mixed, False) for mixed in (shader.list_mixed() if shader.is_mixed else ()))
    return order[::-1]


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


def read_weights(inputs: NodeInputs, weight: Value) -> tuple[Value, Value]:
    """Return the weights of the two shaders of a Mix or an Add Shader."""
    if inputs.node.type == "ADD_SHADER":
        return weight, weight
    share = inputs.limited("Fac", 0.0, 1.0)
    builder = inputs.builder
    return builder.multiply(weight, builder.complement(share)), builder.multiply(weight, share)


def read_shine(socket: Any, builder: ProgramBuilder) -> Value | None:
    """Return all that shines of what feeds the output of a light or a world, as one color; None where nothing does."""
    closures = read_shader(socket, (), 1.0, builder)
    shining = [builder.scale(closure.color, closure.weight) for closure in closures if closure.kind == "emission"]
    if not shining:
        return None
    total = shining[0]
    for color in shining[1:]:
        inputs = (total, color, np.zeros(3), 1.0)
        total = builder.add("VECT_MATH Vector", inputs, {"operation": "ADD"})["Vector"]
    return total


def extract_material(
    material: Any, object_name: str, images: ImageTable, warnings: WarningList, aovs: Sequence[str] = ()
) -> raytracer.Material:
    """Return one evaluated Blender material; `object_name` is where it was met first, `aovs` passes that it may write.

    Without nodes it is diffuse of the viewport color, as in Cycles.
    """
    place = WarningContext(warnings, object_name, material.name)
    builder = ProgramBuilder(place, images, material.pass_index)
    node_tree = versions.find_node_tree(material)
    if node_tree is None:
        closures = [raytracer.Closure("diffuse", color=read_color(material.diffuse_color))]
    else:
        closures = read_output(versions.find_output_node(node_tree), builder)
    normal = None if node_tree is None else read_bump(material, node_tree, builder)
    return raytracer.Material(
        closures,
        pass_index=material.pass_index,
        name=material.name,
        program=find_program(closures, normal, builder),
        transparent_shadow=material.use_transparent_shadow,
        normal=normal,
        aovs=read_aovs(node_tree, aovs, ProgramBuilder(place, images, material.pass_index)),
    )


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
    node_tree = versions.find_node_tree(material) if material.displacement_method in methods else None
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


def read_output(output: Any, builder: ProgramBuilder) -> list[raytracer.Closure]:
    """Return the closures of a material's output node: none (black) without one, transparent for a mere volume."""
    place = builder.place
    if output is None:
        place.warn("no output node, the surface is black")
        return []
    surface, volume = output.inputs["Surface"], output.inputs["Volume"]
    if volume.is_linked:
        place.warn(f"{volume.name} is not supported, left out")
    if volume.is_linked and not surface.is_linked:
        return [raytracer.Closure("transparent", color=1.0)]
    closures = read_shader(surface, (), 1.0, builder)
    if surface.is_linked and not closures:
        place.warn("no shader reaches the output node, the surface is black")
    return closures


@dataclass(frozen=True)
class MaterialEntry:
    """One material.

    identity : its `session_uid`, 0 for the default grey
    object_name : where it was met first, which its warnings say
    attributes, properties : names of those of meshes and of instances that it reads
    warnings : what could not be honoured
    displacement : what moves its surface, or None
    aovs : the passes that it was read for
    moves : True where it shows an image sequence or properties of the view layer, which change though nothing says so
    """

    identity: int
    object_name: str
    record: raytracer.Material
    attributes: frozenset[str]
    warnings: tuple[Warning, ...]
    moves: bool = False
    properties: frozenset[str] = frozenset()
    displacement: Displacement | None = None
    aovs: tuple[str, ...] = ()


class MaterialTable:
    """The scene's materials, each extracted once, numbered in the order they are met.

    aovs : the passes that materials may write
    """

    def __init__(
        self, warnings: WarningList, kept: Kept | None = None, frame: int = 1, aovs: tuple[str, ...] = ()
    ) -> None:
        self._aovs = aovs
        self.entries: list[MaterialEntry] = []
        self._indices: dict[int, int] = {}
        self._warnings, self._kept = warnings, kept or Kept()
        self.images = ImageTable(self._kept, frame)

    @property
    def records(self) -> list[raytracer.Material]:
        return [entry.record for entry in self.entries]

    def find_index(self, material: Any, object_name: str) -> int:
        """Return the index of an evaluated material, or of Cycles' default, grey, for None."""
        identity = material.original.session_uid if material is not None else 0
        if not self.can_reuse(identity, object_name):
            self._add(self._read(material, identity, object_name))
        return self.reuse(identity)

    def can_reuse(self, identity: int, object_name: str) -> bool:
        """True where a material is known, or is as it was in the last extraction."""
        last = self._kept.materials.get(identity)
        if identity in self._indices or last is None:
            return identity in self._indices
        says_same = not last.warnings or last.object_name == object_name
        return says_same and last.aovs == self._aovs and self._kept.trusts_materials and self._kept.trusts(identity)

    def reuse(self, identity: int) -> int:
        """Return the index of a material that can be reused."""
        if identity not in self._indices:
            self._add(self._kept.materials[identity])
        return self._indices[identity]

    def _read(self, material: Any, identity: int, object_name: str) -> MaterialEntry:
        own, sequences, layer = WarningList(), self.images.sequences, find_layer()
        reads, displacement = layer.reads, None
        if material is None:
            record = raytracer.Material((raytracer.Closure(versions.default_shader(), color=GREY),), name="default")
        else:
            record = extract_material(material, object_name, self.images, own, self._aovs)
            place = WarningContext(own, object_name, material.name)
            displacement = read_displacement(material, place, self.images)
        programs = list(record.programs)
        attributes: set[str] = set()
        if displacement is not None:
            programs.append(displacement.program)
            attributes = {VERTEX_NORMAL, SMOOTH}
        attributes |= {name for program in programs for name in list_attributes(program)}
        properties = frozenset(name for program in programs for name in list_properties(program))
        moves = self.images.sequences > sequences or layer.reads > reads
        return MaterialEntry(
            *(identity, object_name, record, frozenset(attributes), own.records, moves, properties, displacement),
            aovs=self._aovs,
        )

    def _add(self, entry: MaterialEntry) -> None:
        self._indices[entry.identity] = len(self.entries)
        self.entries.append(entry)
        self._warnings.include(entry.warnings)

    def find_identity(self, index: int) -> int:
        """Return the `session_uid` of a material, 0 for the default grey."""
        return self.entries[index].identity

    def list_attributes(self, indices: Sequence[int]) -> set[str]:
        """Return the names of the mesh attributes that some of the materials read, or that tangents are made of."""
        names = set[str]().union(*(self.entries[index].attributes for index in indices))
        stand_in = {UNDEFORMED} if TANGENT + DEFAULT_UV in names else set()
        return {name.removeprefix(TANGENT) for name in names} | stand_in

    def list_properties(self, indices: Sequence[int]) -> frozenset[str]:
        """Return the names of the properties of instances that some of the materials read."""
        return frozenset().union(*(self.entries[index].properties for index in indices))

    @property
    def displacements(self) -> dict[int, Displacement]:
        """What moves surfaces, by the index of their material."""
        return {k: entry.displacement for k, entry in enumerate(self.entries) if entry.displacement is not None}

    @property
    def read_object_info(self) -> bool:
        """True where a material reads the random number or the color of its object."""
        programs = [program for record in self.records for program in record.programs]
        programs += [each.program for each in self.displacements.values()]
        return any(step.operation in OBJECT_READERS for program in programs for step in list_steps(program))

    def find_slots(self, slots: Any, used: Sequence[int], override: Any, object_name: str) -> tuple[int, ...]:
        """Return the material index of each slot number in `used`; numbers beyond the last slot mean the last.

        slots : an object's material slots (data- or object-linked)
        override : the view layer's material for everything, or None
        """
        chosen = [slot.material for slot in slots] or [None]
        return tuple(self.find_index(override or chosen[min(slot, len(chosen) - 1)], object_name) for slot in used)
