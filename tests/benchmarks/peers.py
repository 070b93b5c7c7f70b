"""Who takes part in a benchmark, and how each is asked.

A Peer builds its own acceleration structure over a triangle mesh. The built peer is asked in three steps, so that
only the middle one is timed: `prepare` brings rays into the peer's own form, `cast` finds what they hit, `read`
translates into an Answer. Peers that are not installed are skipped with their reason.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from addon import interrupts

# Modules that offer PEERS, name -> loader. A loader returns a Peer, or raises ImportError.
MODULES = ("peers_ours", "peers_blender", "peers_nodes", "peers_libraries", "peers_formulas")


class Answer(NamedTuple):
    """What a peer says of n rays.

    t : (n,) float64, in units of the direction's length; infinity = miss
    primitive : (n,) int64, -1 = miss
    t_error : (n,) float64, the bound the peer promises for |t - exact|, or None
    """

    t: np.ndarray
    primitive: np.ndarray
    t_error: np.ndarray | None = None


@dataclass(frozen=True)
class Built:
    """A peer with a mesh in it.

    prepare : (origins, directions, reach) -> rays; (n, 3) float64 arrays, reach = t_max, a number
    cast : rays -> anything, the closest hits
    read : what `cast` returned -> Answer
    occlude : rays -> anything; is there any hit up to `reach`? None = the peer has no such query
    count_exact : (origins, directions) -> how many of the rays were decided in integers; None = no such notion
    """

    prepare: Callable[[np.ndarray, np.ndarray, float], Any]
    cast: Callable[[Any], Any]
    read: Callable[[Any], Answer]
    occlude: Callable[[Any], Any] | None = None
    count_exact: Callable[[np.ndarray, np.ndarray], int] | None = None


@dataclass(frozen=True)
class Peer:
    """A ray caster that takes part.

    build : (positions (v, 3) float64, triangles (t, 3) int32) -> Built
    ray_limit : how many rays are affordable; None = any number
    lowest_index : it promises the lowest index among equal distances; the others may name any of them
    """

    name: str
    version: str
    build: Callable[[np.ndarray, np.ndarray], Built]
    ray_limit: int | None = None
    lowest_index: bool = False

    def limit(self, count):
        """Return how many of `count` rays this peer gets."""
        return count if self.ray_limit is None else min(count, self.ray_limit)


def find_loaders():
    """Return name -> loader of all peers, in the order of the tables."""
    loaders = {}
    for module in MODULES:
        loaders |= import_module(f"tests.benchmarks.{module}").PEERS
    return loaders


def load_peers(loaders):
    """Return (peers, skipped): the Peers that could be loaded, and name -> reason of those that could not."""
    peers, skipped = [], {}
    for name, load in loaders.items():
        try:
            with interrupts.hold():  # what others compiled is not made to be interrupted while it is loaded
                peers.append(load(name))
        except ImportError as error:
            skipped[name] = f"not installed: {error}"
    return peers, skipped


def ask(built, origins, directions, reach=np.inf):
    """Return a built peer's Answer to rays."""
    return built.read(built.cast(built.prepare(origins, directions, reach)))


def miss_all(count):
    """Return the arrays (t, primitive) of `count` misses, to be filled in."""
    return np.full(count, np.inf), np.full(count, -1, dtype=np.int64)


def project_location(origins, directions, locations):
    """Return t of points on rays, (n,): (x - o) . d / (d . d), for peers that tell the point only."""
    return ((locations - origins) * directions).sum(axis=1) / (directions * directions).sum(axis=1)
