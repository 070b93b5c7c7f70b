"""Shader node trees, read backwards from a socket: links, groups, sockets' own values.

A link leads through reroutes, muted nodes and node groups to the node that makes the value; `programs` turns what
nodes compute into steps.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..warnings import WarningList

Color = NDArray[np.float64]

# Relative luminance of linear Rec. 709, Blender's default working space: how a color becomes a number.
LUMINANCE = np.array((0.2126, 0.7152, 0.0722))
# The group nodes that a socket lies in, outermost first.
Groups = tuple[Any, ...]


class Place(NamedTuple):
    """Where nodes are used, for warnings; `prefix` begins the text where neither object nor material says it."""

    warnings: WarningList
    object: str = ""
    material: str = ""
    prefix: str = ""

    def warn(self, text: str) -> None:
        self.warnings.add(self.prefix + text, self.object, self.material)


class Source(NamedTuple):
    """Where a socket's value comes from.

    socket : the output socket of a node that computes, or the unlinked input whose own value counts; None where a
        link leads nowhere (a muted node that passes nothing on, a group without its tree)
    groups : the group nodes that `socket` lies in, outermost first
    """

    socket: Any
    groups: tuple[Any, ...]


def find_source(socket: Any, groups: tuple[Any, ...] = ()) -> Source:
    """Follow an input socket back to its Source."""
    while socket is not None:
        link = find_link(socket)
        if link is None:
            break
        node, output = link.from_node, link.from_socket
        if node.mute or node.type == "REROUTE":
            socket = next((inner.from_socket for inner in node.internal_links if inner.to_socket == output), None)
        elif node.type == "GROUP":
            socket, groups = find_group_output(node, output.identifier), (*groups, node)
        elif node.type == "GROUP_INPUT" and groups:
            socket, groups = find_socket(groups[-1].inputs, output.identifier), groups[:-1]
        else:
            return Source(output, groups)
    return Source(socket, groups)


def find_link(socket: Any) -> Any:
    """Return the link that feeds an input socket, or None."""
    return next((link for link in socket.links if link.is_valid and not link.is_muted), None)


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
    return np.maximum(np.nan_to_num(color), 0.0)


def read_number(value: Any) -> float:
    """Return a socket's value as a number: a color's luminance, NaN as 0."""
    number = float(value) if np.ndim(value) == 0 else float(LUMINANCE @ np.array(value[:3], dtype=np.float64))
    return float(np.nan_to_num(number))
