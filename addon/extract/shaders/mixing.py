"""Shaders that Mix and Add Shader put together: each that counts, with its weight in the sum.

The walk starts at a socket of an output and ends at shaders that mix no others; what these are, closures of surfaces
or parts of volumes, their reader says.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, TypeVar

from raytracer.scene.programs import Value

from ... import versions
from .closures import NodeInputs
from .nodes import Groups, Source, find_source, identify, read_links_once
from .programs import ProgramBuilder

Part = TypeVar("Part")


def read_parts(
    socket: Any,
    groups: Groups,
    weight: Value,
    builder: ProgramBuilder,
    read: Callable[[FedShader, Value, ProgramBuilder], Part],
) -> list[Part]:
    """Return what `read` makes of the shaders that feed a socket and mix no others, given their weights; nothing where
    nothing is linked to it.

    A shader that reaches the socket on several ways is read once, with the sum of their weights.
    """
    with read_links_once():
        root = FedShader.find(socket, groups)
        return [read(shader, share, builder) for shader, share in weigh_shaders(root, weight, builder)]


def weigh_shaders(root: FedShader, weight: Value, builder: ProgramBuilder) -> Iterator[tuple[FedShader, Value]]:
    """Yield the shaders behind `root` that mix no others, with their weights, but for those of weight 0."""
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
            yield shader, weight


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
        """True where a shader feeds the input, or a color that shines: an output, or what a group is given."""
        found = self.source.socket
        if found.is_output or found.type == "SHADER":
            return bool(found.is_output)
        return versions.hands_on_values(self.socket, found, True)

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


def read_weights(inputs: NodeInputs, weight: Value) -> tuple[Value, Value]:
    """Return the weights of the two shaders of a Mix or an Add Shader."""
    if inputs.node.type == "ADD_SHADER":
        return weight, weight
    share = inputs.limited("Fac", 0.0, 1.0)
    builder = inputs.builder
    return builder.multiply(weight, builder.complement(share)), builder.multiply(weight, share)
