"""Curves: strands of hair, each a smooth line through points with a radius at each of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from raytracer.arrays.checks import require_choice, require_range
from raytracer.scene.fields import (
    ALL_SETS,
    LARGEST,
    SEEN_BY_ALL,
    require_text,
    set_array,
    set_attributes,
    set_material,
    set_object,
)

CURVE_SHAPES = ("ribbon", "thick")


@dataclass(frozen=True, eq=False)
class Curves:
    """Strands in world space, of one object (a Blender Curves object or a particle system is one such group).

    Between two points of a strand runs a *segment*, for 0 <= u <= 1: the uniform Catmull-Rom spline of these two and
    the ones before and after, its ends taken twice where a strand begins or ends, as in Cycles:

        P(u) = ((2 p1) + (p2 - p0) u + (2 p0 - 5 p1 + 4 p2 - p3) u^2 + (3 p1 - p0 - 3 p2 + p3) u^3) / 2

    Radii r(u) are interpolated likewise, and count as 0 where that comes below.

    points : (p, 3) float64, metres, world, from the root of each strand to its tip, strand after strand
    radii : (p,) float64, metres, 0 or more, 0 where a strand ends in a point
    strands : (s + 1,) int32, the first point of each strand, ascending from 0, then p; a strand of one point shows
        nothing
    shape : "ribbon", flat bands that face each ray, with the normals of round ones; or "thick", round ones without
        caps, of which only the outside is seen
    material : int, or (s,) int32 by strand, index into the scene's materials
    uvs : (s, 2) float64 by strand, most often of the surface where its root is; None = none
    attributes : by name, (p, k) float64 of each point, for the programs of materials; along a segment they run straight
        from one to the other. k as in Mesh
    strand_attributes : by name, (s, k) float64, of each strand; other names than those of `attributes`
    pass_index, holdout, seen_by, shadow_catcher, light_set, receivers, shadow_set, blockers, random, color,
        properties : as in Spheres
    world_from_object : (4, 4) float64, affine, where the object stands, for programs that read coordinates in its space

    References
    ----------
    Blender, intern/cycles/kernel/geom/curve_intersect.h: catmull_rom_basis_eval, curve_intersect.

    Examples
    --------
    >>> hair = Curves(points=[(0, 0, 0), (0, 0, 1), (1, 0, 0), (1, 0, 2)], radii=[0.1] * 4, strands=[0, 2, 4])
    >>> len(hair), hair.strands.tolist()
    (2, [0, 2, 4])
    """

    points: Any
    radii: Any
    strands: Any
    shape: str = "ribbon"
    material: Any = 0
    uvs: Any = None
    name: str = ""
    attributes: Mapping[str, Any] = field(default_factory=dict)
    strand_attributes: Mapping[str, Any] = field(default_factory=dict)
    pass_index: int = 0
    holdout: bool = False
    seen_by: int = SEEN_BY_ALL
    shadow_catcher: bool = False
    light_set: int = 0
    receivers: int = ALL_SETS
    shadow_set: int = 0
    blockers: int = ALL_SETS
    random: float = 0.0
    color: Any = (1.0, 1.0, 1.0, 1.0)
    properties: Mapping[str, Any] = field(default_factory=dict)
    world_from_object: Any = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        require_text(self.name, "Curves: name")
        label = f"Curves {self.name!r}" if self.name else "Curves"
        points = set_array(self, "points", np.float64, ("p", 3), label)
        # Their powers, up to the sixth, are finite.
        require_range(points, -LARGEST, LARGEST, f"{label}: points")
        radii = set_array(self, "radii", np.float64, (len(points),), label)
        require_range(radii, 0.0, LARGEST, f"{label}: radii")
        strands = set_array(self, "strands", np.int32, ("s + 1",), label)
        if not len(strands) or strands[0] != 0 or strands[-1] != len(points) or (np.diff(strands) < 1).any():
            raise ValueError(
                f"{label}: strands: expected ascending numbers from 0 to {len(points)}, got {strands.tolist()!r:.80}"
            )
        require_choice(self.shape, CURVE_SHAPES, f"{label}: shape")
        set_material(self, len(self), label)
        if self.uvs is not None:
            set_array(self, "uvs", np.float64, (len(self), 2), label)
        set_object(self, label)
        set_attributes(self, len(points), None, label)
        set_attributes(self, len(self), None, label, "strand_attributes")
        for name in self.attributes.keys() & self.strand_attributes.keys():
            raise ValueError(f"{label}: attribute {name!r}: expected values of points or of strands, got both")
        matrix = set_array(self, "world_from_object", np.float64, (4, 4), label)
        if (matrix[3] != (0.0, 0.0, 0.0, 1.0)).any():
            raise ValueError(
                f"{label}: world_from_object: expected (0, 0, 0, 1) as the last row, got {matrix[3].tolist()}"
            )

    def __len__(self) -> int:
        """The number of strands."""
        return len(self.strands) - 1

    @property
    def segment_count(self) -> int:
        """The number of segments: one fewer than points, of each strand."""
        return len(self.points) - len(self)
