"""Shapes: meshes of triangles, groups of spheres, and instances of meshes."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from raytracer.arrays.checks import require_range
from raytracer.scene.fields import (
    ALL_SETS,
    SEEN_BY_ALL,
    SET_COUNT,
    require_text,
    set_array,
    set_attributes,
    set_field,
    set_material,
    set_object,
    set_properties,
)
from raytracer.scene.media import Grid


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in object space.

    positions : (v, 3) float64, metres
    triangles : (t, 3) int32, vertex indices of the corners, counter-clockwise seen from the front
    normals : (v, 3) per vertex or (t, 3, 3) per corner, float64; None = flat
    uvs : (v, 2) per vertex or (t, 3, 2) per corner, float64; None = none
    material : int, or (t,) int32, index into the scene's materials
    attributes : by name, (v, k) per vertex or (t, 3, k) per corner, float64, for the programs of materials; k = 1
        number, 2 as uvs, 3 vector, 4 color with alpha. "generated" holds Blender's Generated coordinates
    grids : by name, a Grid each, for the programs of volumes

    Examples
    --------
    >>> quad = Mesh(positions=[(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], triangles=[(0, 1, 2), (0, 2, 3)])
    >>> quad.positions.shape, quad.triangles.dtype.name
    ((4, 3), 'int32')
    >>> Mesh(positions=[(0, 0, 0)], triangles=[(0, 0, 7)])
    Traceback (most recent call last):
    ValueError: Mesh: triangles: expected vertex indices from 0 to 0, got [0, 0, 7] at row 0
    """

    positions: Any
    triangles: Any
    normals: Any = None
    uvs: Any = None
    material: Any = 0
    name: str = ""
    attributes: Mapping[str, Any] = field(default_factory=dict)
    grids: Mapping[str, Grid] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_text(self.name, "Mesh: name")
        label = f"Mesh {self.name!r}" if self.name else "Mesh"
        positions = set_array(self, "positions", np.float64, ("v", 3), label)
        triangles = set_array(self, "triangles", np.int32, ("t", 3), label)
        if triangles.size and (triangles.min() < 0 or triangles.max() >= len(positions)):
            wrong = int(np.argmax(((triangles < 0) | (triangles >= len(positions))).any(axis=1)))
            raise ValueError(
                f"{label}: triangles: expected vertex indices from 0 to {len(positions) - 1}, "
                f"got {triangles[wrong].tolist()} at row {wrong}"
            )
        for name, width in (("normals", 3), ("uvs", 2)):
            if getattr(self, name) is not None:
                per_corner = np.ndim(getattr(self, name)) == 3
                shape = (len(triangles), 3, width) if per_corner else (len(positions), width)
                set_array(self, name, np.float64, shape, label)
        set_attributes(self, len(positions), len(triangles), label)
        _check_grids(self.grids, label)
        set_material(self, len(triangles), label)

    def with_material(self, material: Any, attributes: Mapping[str, Any] | None = None) -> Mesh:
        """Return the mesh with another material, and with `attributes` unless None; its arrays are not checked again.

        Examples
        --------
        >>> mesh = Mesh(positions=[(0, 0, 0), (1, 0, 0), (0, 1, 0)], triangles=[(0, 1, 2)])
        >>> painted = mesh.with_material(3)
        >>> painted.material, painted.positions is mesh.positions
        (3, True)
        """
        mesh, label = copy.copy(self), f"Mesh {self.name!r}" if self.name else "Mesh"
        set_field(mesh, "material", material)
        set_material(mesh, len(self.triangles), label)
        if attributes is not None:
            set_field(mesh, "attributes", attributes)
            set_attributes(mesh, len(self.positions), len(self.triangles), label)
        return mesh


def _check_grids(grids: Any, label: str) -> None:
    if not isinstance(grids, Mapping):
        raise ValueError(f"{label}: grids: expected a table, got {type(grids).__name__}")
    for name, grid in grids.items():
        require_text(name, f"{label}: grids")
        if not isinstance(grid, Grid):
            raise ValueError(f"{label}: grid {name!r}: expected a Grid, got {type(grid).__name__}")


@dataclass(frozen=True, eq=False)
class Spheres:
    """True spheres in world space (a Blender point cloud is one such group).

    centres : (s, 3) float64, metres
    radii : (s,) float64, metres, positive
    material : int, or (s,) int32, index into the scene's materials
    pass_index : int, the Object Index pass
    holdout : bool, True punches a hole into the image's alpha
    seen_by : bits of SEEN_BY, the classes of rays that see them
    shadow_catcher, light_set, receivers, shadow_set, blockers : bool, and four int, as in Instances
    random, color, properties : of the group, one number, (4,), and (4,) by name, float64, as in Instances
    attributes : by name, (s, k) float64, of each sphere, for the programs of materials; k as in Mesh
    """

    centres: Any
    radii: Any
    material: Any = 0
    pass_index: int = 0
    holdout: bool = False
    name: str = ""
    seen_by: int = SEEN_BY_ALL
    shadow_catcher: bool = False
    light_set: int = 0
    receivers: int = ALL_SETS
    shadow_set: int = 0
    blockers: int = ALL_SETS
    random: float = 0.0
    color: Any = (1.0, 1.0, 1.0, 1.0)
    properties: Mapping[str, Any] = field(default_factory=dict)
    attributes: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_text(self.name, "Spheres: name")
        label = f"Spheres {self.name!r}" if self.name else "Spheres"
        centres = set_array(self, "centres", np.float64, ("s", 3), label)
        radii = set_array(self, "radii", np.float64, (len(centres),), label)
        require_range(radii, np.nextafter(0.0, 1.0), np.inf, f"{label}: radii")
        set_material(self, len(centres), label)
        set_object(self, label)
        set_attributes(self, len(centres), None, label)


@dataclass(frozen=True, eq=False)
class Instances:
    """Placements of meshes; the true triangle of an instance is its world-space float64 triangle.

    mesh : (i,) int32, index into the scene's meshes
    world_from_object : (i, 4, 4) float64, affine, last row (0, 0, 0, 1); may mirror and shear
    pass_index : (i,) int32, the Object Index pass
    holdout : (i,) bool, True punches a hole into the image's alpha
    seen_by : (i,) int32, bits of SEEN_BY, the classes of rays that see it; None = all
    shadow_catcher : (i,) bool, True for what stands for a surface of the footage behind the picture: the camera sees of
        it only how the other objects change its light
    light_set : (i,) int32, the set of objects it belongs to, 0 to 62, which lights and emissive objects may light or
        not; None = 0
    receivers : (i,) int64, the sets that it lights where it shines, as bits: 1 << light_set; None = all
    shadow_set : (i,) int32, the set of objects it belongs to, 0 to 62, which may shadow a light or not; None = 0
    blockers : (i,) int64, the sets that shadow its light where it shines, as bits: 1 << shadow_set; None = all
    terminator_geometry, terminator_shading : (i,) float64, 0 to 1, Blender's offsets of the shadow terminator of smooth
        meshes; None = 0
    random : (i,) float64, 0 to 1, and color : (i, 4) float64, for programs that read them; None = 0, white
    properties : by name, (i, 4) float64, color and alpha, what programs read of each instance besides
    volume_density : (i,) float64, factor of all that its volume absorbs, scatters and emits; None = 1
    caustics_caster, caustics_receiver : (i,) bool, True for what bends light of lights that make caustics, where it is
        a smooth mesh of clear glass, and for what that light is looked for on; None = False
    """

    mesh: Any
    world_from_object: Any
    pass_index: Any = None
    holdout: Any = None
    random: Any = None
    color: Any = None
    seen_by: Any = None
    shadow_catcher: Any = None
    light_set: Any = None
    receivers: Any = None
    shadow_set: Any = None
    blockers: Any = None
    terminator_geometry: Any = None
    terminator_shading: Any = None
    properties: Mapping[str, Any] = field(default_factory=dict)
    volume_density: Any = None
    caustics_caster: Any = None
    caustics_receiver: Any = None

    def __post_init__(self) -> None:
        count = len(set_array(self, "mesh", np.int32, ("i",), "Instances"))
        matrices = set_array(self, "world_from_object", np.float64, (count, 4, 4), "Instances")
        affine = (matrices[:, 3] == (0.0, 0.0, 0.0, 1.0)).all(axis=1)
        if not affine.all():
            row = int(np.argmin(affine))
            raise ValueError(
                "Instances: world_from_object: expected (0, 0, 0, 1) as the last row of each matrix, "
                f"got {matrices[row, 3].tolist()} at row {row}"
            )
        properties = {"pass_index": np.int32, "holdout": np.bool_, "shadow_catcher": np.bool_}
        for name, dtype in (properties | dict.fromkeys(("light_set", "shadow_set"), np.int32)).items():
            if getattr(self, name) is None:
                set_field(self, name, np.zeros(count, dtype=dtype))
            set_array(self, name, dtype, (count,), "Instances")
        for name, shape in (("random", (count,)), ("color", (count, 4))):
            if getattr(self, name) is not None:
                set_array(self, name, np.float64, shape, "Instances")
        set_properties(self, (count, 4), "Instances")
        for name in ("terminator_geometry", "terminator_shading"):
            if getattr(self, name) is not None:
                offset = set_array(self, name, np.float64, (count,), "Instances")
                require_range(offset, 0.0, 1.0, f"Instances: {name}")
        if self.volume_density is not None:
            factor = set_array(self, "volume_density", np.float64, (count,), "Instances")
            require_range(factor, 0.0, np.inf, "Instances: volume_density")
        if self.seen_by is not None:
            mask = set_array(self, "seen_by", np.int32, (count,), "Instances")
            require_range(mask, 0, SEEN_BY_ALL, "Instances: seen_by")
        for name in ("caustics_caster", "caustics_receiver"):
            if getattr(self, name) is not None:
                set_array(self, name, np.bool_, (count,), "Instances")
        for name in ("light_set", "shadow_set"):
            require_range(getattr(self, name), 0, SET_COUNT - 1, f"Instances: {name}")
        for name in ("receivers", "blockers"):
            if getattr(self, name) is None:
                set_field(self, name, np.full(count, ALL_SETS, dtype=np.int64))
            require_range(set_array(self, name, np.int64, (count,), "Instances"), 0, ALL_SETS, f"Instances: {name}")

    def __len__(self) -> int:
        return len(self.mesh)
