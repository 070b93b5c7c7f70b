"""What the programs of a scene's materials read of curves, packed once: attributes of points and of strands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.casting.curves.strands import Strands
from raytracer.casting.geometry import invert_matrices
from raytracer.scene.curves import Curves
from raytracer.scene.scene import Scene

# A mesh's, or a strand's, own coordinates.
OWN_UV = "uv"


@dataclass(frozen=True, eq=False)
class StrandTables:
    """Curves, of groups (c,) with strands (s,) and points (p,) in all.

    first : the number of the first group, as of `Hits.instance`
    strands : the packed segments
    widths : by name, (c,) int64, numbers per value, 0 = the group lacks it; only what a group has
    points, each : by name, (p, k) and (s, k) float64, the values of points and of strands, 0 in groups without
    world_from_object, object_from_world : (c, 4, 4) float64
    """

    first: int
    strands: Strands
    widths: dict[str, NDArray[np.int64]]
    points: dict[str, Floats]
    each: dict[str, Floats]
    world_from_object: Floats
    object_from_world: Floats

    def read(self, name: str, segment: NDArray[np.int64], along: Floats) -> Floats:
        """Return values (n, k) at places (n,) along segments: those of strands, or straight from point to point."""
        if name in self.each:
            return self.each[name][self.strands.strand[segment]]
        start, end = self.strands.rows[segment, 1], self.strands.rows[segment, 2]
        values, u = self.points[name], along[:, np.newaxis]
        return (1.0 - u) * values[start] + u * values[end]

    def find_radius(self, segment: NDArray[np.int64], along: Floats) -> Floats:
        """Return radii (n,), metres, likewise straight from point to point, as Cycles tells them."""
        start, end = self.strands.rows[segment, 1], self.strands.rows[segment, 2]
        radii = self.strands.keys[:, 3]
        return (1.0 - along) * radii[start] + along * radii[end]


def make_strand_tables(scene: Scene, strands: Strands | None, names: set[str]) -> StrandTables | None:
    """Pack what programs read of a scene's curves, `names` of the attributes; None without curves."""
    groups = scene.curves
    if strands is None or not groups:
        return None
    of_strands = [_list_strand_values(group) for group in groups]
    found = sorted(names & set[str]().union(*(group.attributes for group in groups), *of_strands))
    on_points = [name for name in found if any(name in group.attributes for group in groups)]
    world_from_object = np.array([group.world_from_object for group in groups])
    pairs = list(zip(groups, of_strands, strict=True))
    return StrandTables(
        first=scene.instance_count + len(scene.spheres),
        strands=strands,
        widths={name: _find_widths(name, pairs) for name in found},
        points={name: _join([_spread(name, *pair) for pair in pairs]) for name in on_points},
        each={
            name: _join([held.get(name, np.zeros((len(group), 0))) for group, held in pairs])
            for name in found
            if name not in on_points
        },
        world_from_object=world_from_object,
        object_from_world=invert_matrices(world_from_object),
    )


def _list_strand_values(group: Curves) -> Mapping[str, Floats]:
    """Return by name the values of a group's strands (s, k), with its coordinates."""
    return group.strand_attributes if group.uvs is None else {OWN_UV: group.uvs, **group.strand_attributes}


def _find_widths(name: str, pairs: list[tuple[Curves, Mapping[str, Floats]]]) -> NDArray[np.int64]:
    """Return numbers per value (c,) of an attribute in each group."""
    values = [group.attributes.get(name, held.get(name)) for group, held in pairs]
    return np.array([0 if one is None else one.shape[-1] for one in values], dtype=np.int64)


def _spread(name: str, group: Curves, held: Mapping[str, Floats]) -> Floats:
    """Return the values (p, k) of a group's points, each that of its strand where strands have the attribute."""
    if name in held:
        return np.repeat(held[name], np.diff(group.strands), axis=0)
    values: Floats = group.attributes.get(name, np.zeros((len(group.points), 0)))
    return values


def _join(values: list[Floats]) -> Floats:
    """Return values (., k) of all groups below one another, with zeros behind those of fewer numbers."""
    width = max(one.shape[1] for one in values)
    return np.concatenate([np.pad(one, ((0, 0), (0, width - one.shape[1]))) for one in values])
