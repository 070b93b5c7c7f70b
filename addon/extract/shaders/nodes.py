"""Shader node trees, read backwards from a socket: links, groups, sockets' own values.

A link leads through reroutes, muted nodes and node groups to the node that makes the value; `programs` turns what
nodes compute into steps.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextvars import ContextVar
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.scene.fields import LARGEST

from ... import versions
from ..warnings import WarningList

Color = NDArray[np.float64]

# Relative luminance of linear Rec. 709, Blender's default working space: how a color becomes a number.
LUMINANCE = np.array((0.2126, 0.7152, 0.0722))
# The group nodes that a socket lies in, outermost first.
Groups = tuple[Any, ...]


class WarningContext(NamedTuple):
    """Where nodes are used, for warnings; `prefix` begins the text where neither object nor material says it."""

    warnings: WarningList
    object: str = ""
    material: str = ""
    prefix: str = ""

    def warn(self, text: str) -> None:
        self.warnings.add(self.prefix + text, self.object, self.material)


class Source(NamedTuple):
    """Where a socket's value comes from: a socket, and the group nodes that it lies in, outermost first."""

    socket: Any
    groups: Groups


class Hop(NamedTuple):
    """An input on the way of a value; kind : the type of the output that hands it on, "" for the input asked about."""

    socket: Any
    groups: Groups
    kind: str = ""


class Way(NamedTuple):
    """How an input is fed.

    hops : the inputs that hand the value on, near end first
    source : the output of the node that computes it; None where the last hop's own value counts
    is_empty : True where a group gives nothing, as it lacks its tree or an output node: that is 0
    """

    hops: list[Hop]
    source: Source | None = None
    is_empty: bool = False


# Types of nodes that show a tree of their own; those of the second kind are defined by add-ons.
GROUP_NODES = ("GROUP", "CUSTOM GROUP")


def find_way(socket: Any, groups: Groups = ()) -> Way:
    """Follow an input back through reroutes, muted nodes and groups.

    A reroute or a muted node that nothing is linked to hands nothing on, not even its own value, and neither does a
    muted node without a fitting input: what they feed counts as not linked. What a group is given counts, linked or
    not (Blender, nodes/intern/shader_nodes_inline.cc, DanglingValue).
    """
    hops, counted = [Hop(socket, groups)], 1
    while (link := find_link(socket)) is not None:
        passed = pass_through(link.from_socket, groups)
        if passed is None:
            return Way(hops, Source(link.from_socket, groups))
        if passed.socket is None and not link.from_node.mute:
            return Way(hops, is_empty=True)
        if passed.socket is None:
            break
        socket, groups = passed
        hops.append(Hop(socket, groups, link.from_socket.type))
        if not (socket.node.mute or socket.node.type == "REROUTE"):
            counted = len(hops)
    return Way(hops[:counted])


def find_source(socket: Any, groups: Groups = ()) -> Source:
    """Return the output that computes an input's value, or the input whose own value counts."""
    way = find_way(socket, groups)
    return way.source or Source(way.hops[-1].socket, way.hops[-1].groups)


def is_fed(socket: Any, groups: Groups = (), is_pure: bool = False) -> bool:
    """Return whether an input, whose value nodes compute by themselves where nothing is linked, is given another.

    is_pure : True where its node depends on its inputs alone
    """
    way = find_way(socket, groups)
    if way.source is not None or (len(way.hops) == 1 and not way.is_empty):
        return way.source is not None
    converts = any(hop.socket.type != socket.type for hop in way.hops)  # which makes it a value of its own
    return versions.hands_on_values(socket, way.hops[-1].socket, is_pure or way.is_empty or converts)


def pass_through(output: Any, groups: Groups) -> Source | None:
    """Return the input whose value an output hands on (reroutes, muted nodes, groups), or None where its node makes it.

    The socket is None where a node hands nothing on: a muted one that has no fitting input, a group without its tree.
    """
    node = output.node
    if node.mute or node.type == "REROUTE":
        return Source(
            next((inner.from_socket for inner in node.internal_links if inner.to_socket == output), None), groups
        )
    if node.type in GROUP_NODES:
        return Source(find_group_output(node, output.identifier), (*groups, node))
    if node.type == "GROUP_INPUT" and groups:
        return Source(find_socket(groups[-1].inputs, output.identifier), groups[:-1])
    return None


def identify(socket: Any, groups: Groups) -> tuple[int, ...]:
    """Return what tells a socket, or a node, inside these groups from all others: their addresses."""
    return (socket.as_pointer(), *(group.as_pointer() for group in groups))


class LinkTable(NamedTuple):
    """The links of a tree: by the address of the input that each feeds, and of the output that feeds all of a list."""

    to: dict[int, Any]
    of: dict[int, list[Any]]


# While trees are read: the links of each tree; by thread, as it renders.
_links: ContextVar[dict[int, LinkTable] | None] = ContextVar("links", default=None)


@contextlib.contextmanager
def read_links_once() -> Iterator[None]:
    """Look up links in tables inside the block, which must not change a tree.

    Blender goes through all links of a tree for those of one socket (`NodeSocket.links` of its bpy_types.py), so that a
    tree of n nodes would take n^2 steps.
    """
    token = _links.set({})
    try:
        yield
    finally:
        _links.reset(token)


def find_links(tree: Any) -> LinkTable:
    """Return the links of a tree that hand values on."""
    known, key = _links.get(), tree.as_pointer()
    if known is not None and key in known:
        return known[key]
    table = LinkTable({}, {})
    for link in tree.links:
        if link.is_valid and not link.is_muted:
            table.to[link.to_socket.as_pointer()] = link
            table.of.setdefault(link.from_socket.as_pointer(), []).append(link)
    if known is not None:
        known[key] = table
    return table


def find_link(socket: Any) -> Any:
    """Return the link that feeds an input socket, or None."""
    if _links.get() is None:
        return next((link for link in socket.links if link.is_valid and not link.is_muted), None)
    return find_links(socket.id_data).to.get(socket.as_pointer())


def reaches_output(output: Any, groups: Groups) -> bool:
    """Return whether what an output gives comes to one of the shader's own outputs, on whatever way.

    groups : the group nodes that the output lies in
    """
    waiting, known = [Source(output, groups)], set()
    while waiting:
        source = waiting.pop()
        key = identify(source.socket, source.groups)
        if key in known:
            continue
        known.add(key)
        for link in find_links(source.socket.id_data).of.get(source.socket.as_pointer(), ()):
            node = link.to_node
            if node.type == "OUTPUT_AOV" or (
                node.type.startswith("OUTPUT_") and node == versions.find_output_node(node.id_data)
            ):
                return True
            waiting += hand_on(node, link.to_socket, source.groups)
    return False


def hand_on(node: Any, socket: Any, groups: Groups) -> list[Source]:
    """Return the outputs that depend on an input of a node; of a group those that give the value within it."""
    if node.mute or node.type == "REROUTE":
        return [Source(inner.to_socket, groups) for inner in node.internal_links if inner.from_socket == socket]
    if node.type == "GROUP_OUTPUT":
        found = find_socket(groups[-1].outputs, socket.identifier) if groups and node.is_active_output else None
        return [] if found is None else [Source(found, groups[:-1])]
    if node.type not in GROUP_NODES:
        return [Source(found, groups) for found in node.outputs]
    starts = [inner for inner in node.node_tree.nodes if inner.type == "GROUP_INPUT"] if node.node_tree else []
    inside = (find_socket(start.outputs, socket.identifier) for start in starts)
    return [Source(found, (*groups, node)) for found in inside if found is not None]


def find_group_output(group: Any, identifier: str) -> Any:
    """Return the socket inside a group that feeds its output `identifier`, or None."""
    nodes = group.node_tree.nodes if group.node_tree else ()
    output = next((node for node in nodes if node.type == "GROUP_OUTPUT" and node.is_active_output), None)
    return find_socket(output.inputs, identifier) if output else None


def find_socket(sockets: Any, identifier: str) -> Any:
    """Return the socket with `identifier` (names repeat, are translated and change), or None."""
    return next((socket for socket in sockets if socket.identifier == identifier), None)


def read_color(value: Any) -> Color:
    """Return a socket's value as (3,) linear RGB, without NaN and negative parts (Cycles clamps them as well)."""
    color = np.full(3, value, dtype=np.float64) if np.ndim(value) == 0 else np.array(value[:3], dtype=np.float64)
    return np.clip(np.nan_to_num(color, posinf=LARGEST), 0.0, LARGEST)


def read_number(value: Any) -> float:
    """Return a socket's value as a number: a color's luminance, NaN as 0."""
    number = float(value) if np.ndim(value) == 0 else float(LUMINANCE @ np.array(value[:3], dtype=np.float64))
    return float(np.nan_to_num(number, posinf=LARGEST, neginf=-LARGEST))
