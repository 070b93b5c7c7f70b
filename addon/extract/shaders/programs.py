"""Shader node graphs to the tracer's programs: one pass from the sockets that a shader reads back to constants.

Groups are inlined, reroutes and frames vanish, muted nodes pass on what they pass on in Blender, constants fold, and
only what a shader reads is visited. A node that the tracer lacks is named once, and each socket that it feeds keeps its
own value.
"""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np

from raytracer.scene.programs import Program, Register, Step, Value
from raytracer.shading.evaluate import OPERATIONS, fold_step, make_constant

from ... import versions
from .images import ImageTable
from .node_settings import find_item, find_passed, is_of_hit, read_settings
from .nodes import Groups, WarningContext, find_socket, find_way, identify, is_fed, read_number
from .skies import SKY_TYPES
from .texture_mapping import map_texture

# Blender's types of sockets, as kinds of values.
SOCKET_KINDS = {"VALUE": "number", "INT": "number", "BOOLEAN": "number", "VECTOR": "vector", "RGBA": "color"}
# Those that hand a value on; a color may pass where shaders do, to shine in the end.
PASSED_KINDS = {**SOCKET_KINDS, "SHADER": "color"}
# Nodes that hold their value in their output.
CONSTANT_NODES = ("RGB", "VALUE")
# The height of a Bump is evaluated at three points, so that one whose height depends on another, and so on to this
# depth, takes 3^4 evaluations.
MOST_NESTED_PROGRAMS = 4


def read_constant(socket: Any, kind: str) -> Value:
    """Return an unlinked socket's own value, as a kind."""
    value = socket.default_value
    if kind == "number":
        return read_number(value)
    if np.ndim(value) == 0:
        return make_constant(np.full(3, value, dtype=np.float64))
    return make_constant(np.array([*value, 0.0, 0.0][:3], dtype=np.float64))


class ComputedSocket(NamedTuple):
    """An output that a node computes.

    groups : the group nodes that it lies in; fed : the input that it feeds, for warnings
    """

    output: Any
    groups: Groups
    fed: Any

    @property
    def key(self) -> tuple[tuple[int, ...], str]:
        return identify(self.output.node, self.groups), self.output.identifier


class Trail(NamedTuple):
    """How an input socket is fed.

    hops : the input sockets on the way, near end first, each with the kind of value that is wanted there
    source : what computes the value, or None
    constant : the output of a node that holds it, or None; without either, the last hop's own value counts
    is_zero : True where it is 0 instead
    """

    hops: list[tuple[Any, str]]
    source: ComputedSocket | None = None
    constant: Any = None
    is_zero: bool = False


def follow(socket: Any, groups: Groups, kind: str) -> Trail:
    """Follow an input socket back through reroutes, muted nodes and groups."""
    way, hops = find_way(socket, groups), [(socket, kind)]
    for hop in way.hops[1:]:
        if hop.kind not in PASSED_KINDS:
            return Trail(hops)
        hops.append((hop.socket, PASSED_KINDS[hop.kind]))
    if way.source is None or way.source.socket.type not in SOCKET_KINDS:
        return Trail(hops, is_zero=way.is_empty)
    if way.source.socket.node.type in CONSTANT_NODES:
        return Trail(hops, constant=way.source.socket)
    return Trail(hops, ComputedSocket(way.source.socket, way.source.groups, hops[-1][0]))


def reads_default(socket: Any, groups: Groups, name: str) -> bool:
    """Return whether something stands in for what an input of the operation `name` takes, as nothing feeds it."""
    operation = OPERATIONS[name]
    return socket.identifier in operation.links and not is_fed(socket, groups, not operation.reads_site)


def find_read_socket(node: Any, name: str, identifier: str, groups: Groups) -> Any:
    """Return the input of a node whose value its operation `name` takes; None where something stands in for it."""
    socket = find_socket(node.inputs, identifier)
    if socket is None or reads_default(socket, groups, name):
        return None
    return socket if socket.enabled else None


class ProgramBuilder:
    """Collects the steps of one material's program; shaders ask `value_of` for what their sockets carry."""

    def __init__(
        self, place: WarningContext, images: ImageTable, pass_index: int = 0, outer: ProgramBuilder | None = None
    ) -> None:
        self.place, self.images, self.pass_index = place, images, pass_index
        self.steps: list[Step] = []
        self._known: dict[Any, Value | None] = {}
        # Programs that steps run themselves, shared with those inside them.
        self._inner: dict[Any, Program] = outer._inner if outer else {}
        self._depth: int = outer._depth + 1 if outer else 0

    @property
    def program(self) -> Program | None:
        """The program, or None where all is constant."""
        return Program(self.steps) if self.steps else None

    def value_of(self, socket: Any, groups: Groups, kind: str) -> Value:
        """Return what an input socket carries, as a kind: a constant, or a register of the program.

        Nodes can stand in chains of any length: what the socket depends on is computed first, one node after another.

        groups : the group nodes that the socket lies in, outermost first
        """
        trail = follow(socket, groups, kind)
        waiting = [trail.source] if trail.source else []
        while waiting:
            missing = [source for source in self._list_sources(waiting[-1]) if source.key not in self._known]
            if missing:
                waiting.extend(reversed(missing))
            else:
                self._compute(waiting.pop())
        return self._read(trail)

    def _list_sources(self, source: ComputedSocket) -> list[ComputedSocket]:
        """Return what a node that is to be computed reads; nothing for one that is known, or that the tracer lacks."""
        name = find_operation(source.output.node, source.output.identifier)
        if name is None or source.key in self._known:
            return []
        node, groups = source.output.node, source.groups
        inputs = [find_read_socket(node, name, item, groups) for item in OPERATIONS[name].inputs]
        trails = [follow(socket, source.groups, SOCKET_KINDS[socket.type]) for socket in inputs if socket is not None]
        return [trail.source for trail in trails if trail.source is not None]

    def _read(self, trail: Trail) -> Value:
        """Return the value at the near end of a trail, converted there, and at sockets on the way that convert."""
        socket, have = trail.hops[-1]
        value = None
        if trail.source is not None and (value := self._known[trail.source.key]) is not None:
            have = SOCKET_KINDS[trail.source.output.type]
        elif trail.constant is not None:
            have = SOCKET_KINDS[trail.constant.type]
            value = read_constant(trail.constant, have)
        elif trail.is_zero:
            value = 0.0 if have == "number" else np.zeros(3)
        if value is None:
            value = read_constant(socket, have)
        is_joined = isinstance(value, Register) or (trail.constant is not None and trail.constant.node.type == "RGB")
        hops = trail.hops[:1] if is_joined and not versions.CONVERTS_ON_THE_WAY else trail.hops
        for _, want in reversed(hops):
            value, have = self._convert(value, have, want), want
        return value

    def _convert(self, value: Value, have: str, want: str) -> Value:
        """Convert between kinds of sockets as Blender does; vectors and colors are alike."""
        if (have == "number") == (want == "number"):
            return value
        return self.add(f"{have} to {'number' if want == 'number' else 'vector'}", (value,))["Value"]

    def _compute(self, source: ComputedSocket) -> None:
        """Make an output of a node known, with the node's others; None stands for a node that the tracer lacks."""
        if source.key in self._known:
            return
        node, output = source.output.node, source.output
        name = find_operation(node, output.identifier)
        if name is None:
            self._warn_unknown(node, source.fed)
            self._known[source.key] = None
            return
        outputs = self._add_node(node, name, source.groups, output.identifier)
        if len(outputs) == 1:  # under whatever name
            outputs = dict.fromkeys([output.identifier], next(iter(outputs.values())))
        self._known |= {(source.key[0], identifier): value for identifier, value in outputs.items()}

    def _add_node(self, node: Any, name: str, groups: Groups, output: str) -> dict[str, Value]:
        """Add a node's step and return its outputs."""
        operation = OPERATIONS[name]
        values = {identifier: self._read_input(node, name, identifier, groups) for identifier in operation.inputs}
        if "Vector" in values:
            values["Vector"] = map_texture(self, node, values["Vector"])
        inputs = tuple(values.values())
        passed = find_passed(node, output, groups)
        if passed is not None:
            value = inputs[operation.inputs.index(passed)]
            if node.type == "BUMP" and not isinstance(value, Register):
                value = self._read_default(operation.links[passed])  # Cycles folds constant normals away before
            return {operation.outputs[0]: value}
        return self.add(name, inputs, read_settings(self, node, name, groups, output))

    def _read_input(self, node: Any, name: str, identifier: str, groups: Groups) -> Value:
        """Return one input of a node: what feeds it, or stands in for a missing link or a missing socket."""
        socket = find_socket(node.inputs, identifier)
        if socket is None:
            return MISSING_INPUTS[identifier]
        kind, read = SOCKET_KINDS[socket.type], find_read_socket(node, name, identifier, groups)
        if read is not None:
            return self.value_of(read, groups, kind)
        if reads_default(socket, groups, name):
            return self._read_default(OPERATIONS[name].links[identifier])
        return 0.0 if kind == "number" else np.zeros(3)

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
        if self._depth == MOST_NESTED_PROGRAMS:
            self.place.warn(
                f"node '{socket.node.name}': {socket.name} depends on more than {MOST_NESTED_PROGRAMS} others in turn, "
                "0 is used"
            )
            return Program((), 0.0)
        key = (self._depth, *identify(socket, groups))
        if key not in self._inner:
            inner = ProgramBuilder(self.place, self.images, self.pass_index, self)
            result = inner.value_of(socket, groups, "number")
            self._inner[key] = Program(inner.steps, result)
        return self._inner[key]

    # What shaders do with numbers

    def multiply(self, first: Value, second: Value) -> Value:
        """Return the product of two numbers."""
        if first == 1.0:
            return second
        return self.add("MATH", (first, second, 0.0), {"operation": "MULTIPLY"})["Value"]

    def sum(self, first: Value, second: Value) -> Value:
        """Return the sum of two numbers."""
        return self.add("MATH", (first, second, 0.0), {"operation": "ADD"})["Value"]

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
    "NEW_GEOMETRY Tangent": "TANGENT RADIAL",
    **{f"PARTICLE_INFO {output}": "OBJECT_PROPERTY Fac" for output in ("Index", "Random", "Age", "Lifetime", "Size")},
    **{f"PARTICLE_INFO {output}": "OBJECT_PROPERTY Vector" for output in ("Location", "Velocity", "Angular Velocity")},
    "TEX_COORD Generated": "ATTRIBUTE Vector",
    "TEX_COORD UV": "ATTRIBUTE Vector",
    "VOLUME_INFO Color": "ATTRIBUTE Vector",
    **{f"VOLUME_INFO {output}": "ATTRIBUTE Fac" for output in ("Density", "Flame", "Temperature")},
}


# Properties that the add-on resolves before the tracer sees them, at the values that it knows.
RESOLVED: dict[str, dict[str, tuple[str, ...]]] = {"TEX_SKY": {"sky_type": SKY_TYPES}}


# Nodes that are several, by the property that chooses between them.
VARIANTS = {"TANGENT": "direction_type", "TEX_SKY": "sky_type"}


def name_operation(node: Any, output: str) -> str:
    """Return how the table of operations would call an output of a node."""
    chosen = VARIANTS.get(node.type)
    if chosen:
        return f"{node.type} {getattr(node, chosen)}"
    if is_of_hit(node, output):
        read = "Alpha" if output.endswith("_Alpha") else "Vector"
        return f"{node.type} {'Fac' if find_item(node, output).data_type == 'FLOAT' else read}"
    kind = getattr(node, "attribute_type", "GEOMETRY")
    if kind != "GEOMETRY":
        owner = "VIEW_LAYER_PROPERTY" if kind == "VIEW_LAYER" else "OBJECT_PROPERTY"
        return f"{owner} {'Vector' if output == 'Color' else output}"
    if getattr(node, "from_instancer", False) and output in ("Generated", "UV"):
        return "OBJECT_PROPERTY Vector"
    return f"{node.type} {output}"


def find_operation(node: Any, output: str) -> str | None:
    """Return the name of the tracer's operation for an output of a node, or None."""
    name = name_operation(node, output)
    found = next((name for name in (ALIASES.get(name, name), node.type) if name in OPERATIONS), None)
    if found is None:
        return None
    choices = {**OPERATIONS[found].choices, **RESOLVED.get(found, {})}
    return found if all(getattr(node, setting) in values for setting, values in choices.items()) else None
