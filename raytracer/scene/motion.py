"""How a scene moves while the shutter is open: where things are at even steps of that time, and how they go between.

Times run from 0, where the shutter opens, to 1, where it closes; steps are even, the first at 0 and the last at 1.
`scene.moments` returns the scene at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from raytracer.arrays.checks import require_range
from raytracer.scene.curves import Curves
from raytracer.scene.fields import LARGEST, make_records, set_array, set_count, set_field, set_number
from raytracer.scene.shapes import Instances, Mesh, Spheres


@dataclass(frozen=True, eq=False)
class CameraMotion:
    """The camera's places.

    world_from_camera : (steps, 4, 4) float64, rigid
    extent : (steps of its own,) float64, positive, the film's size in that of the scene's camera, of a perspective one
        that zooms; None = it does not
    """

    world_from_camera: Any
    extent: Any = None

    def __post_init__(self) -> None:
        _set_matrices(self, "world_from_camera", ("s", 4, 4), "CameraMotion")
        if self.extent is not None:
            extent = set_array(self, "extent", np.float64, ("s",), "CameraMotion")
            _require_steps(len(extent), "CameraMotion: extent")
            require_range(extent, np.nextafter(0.0, 1.0), LARGEST, "CameraMotion: extent")


@dataclass(frozen=True, eq=False)
class InstanceMotion:
    """The places of instances that have equally many steps.

    instances : (k,) int32, which of the scene's, ascending
    world_from_object : (steps, k, 4, 4) float64, affine, as of Instances
    """

    instances: Any
    world_from_object: Any

    def __post_init__(self) -> None:
        count = len(set_array(self, "instances", np.int32, ("k",), "InstanceMotion"))
        if (np.diff(self.instances) <= 0).any():
            raise ValueError("InstanceMotion: instances: expected ascending numbers, each once")
        _set_matrices(self, "world_from_object", ("s", count, 4, 4), "InstanceMotion")


@dataclass(frozen=True, eq=False)
class MeshMotion:
    """The shapes of a mesh that deforms; its triangles stay the same.

    mesh : int, which of the scene's
    positions : (steps, v, 3) float64, metres, object space
    normals : (steps, v, 3) or (steps, t, 3, 3), as of Mesh; None where it has none
    """

    mesh: int
    positions: Any
    normals: Any = None

    def __post_init__(self) -> None:
        set_count(self, "mesh", "MeshMotion")
        steps = len(set_array(self, "positions", np.float64, ("s", "v", 3), "MeshMotion"))
        _require_steps(steps, "MeshMotion: positions")
        if self.normals is not None:
            rows = ("t", 3, 3) if np.ndim(self.normals) == 4 else ("v", 3)
            set_array(self, "normals", np.float64, (steps, *rows), "MeshMotion")


@dataclass(frozen=True, eq=False)
class SpheresMotion:
    """The places of a group of spheres that moves as a whole.

    group : int, which of the scene's
    centres, radii : (s, 3) and (s,) float64, of its object
    world_from_object : (steps, 4, 4) float64, affine; radii are scaled by the cube root of its determinant
    """

    group: int
    centres: Any
    radii: Any
    world_from_object: Any

    def __post_init__(self) -> None:
        set_count(self, "group", "SpheresMotion")
        count = len(set_array(self, "centres", np.float64, ("s", 3), "SpheresMotion"))
        radii = set_array(self, "radii", np.float64, (count,), "SpheresMotion")
        require_range(radii, np.nextafter(0.0, 1.0), np.inf, "SpheresMotion: radii")
        _set_matrices(self, "world_from_object", ("s", 4, 4), "SpheresMotion")


@dataclass(frozen=True, eq=False)
class CurvesMotion:
    """The places and shapes of a group of curves.

    group : int, which of the scene's
    points, radii : (steps, p, 3) and (steps, p) float64, of its object; a single step where its shape stays the same
    world_from_object : (steps of its own, 4, 4) float64, affine; radii are scaled by the cube root of its determinant
    """

    group: int
    points: Any
    radii: Any
    world_from_object: Any

    def __post_init__(self) -> None:
        set_count(self, "group", "CurvesMotion")
        points = set_array(self, "points", np.float64, ("s", "p", 3), "CurvesMotion")
        if not len(points):
            raise ValueError("CurvesMotion: points: expected 1 or more steps, got 0")
        require_range(points, -LARGEST, LARGEST, "CurvesMotion: points")
        radii = set_array(self, "radii", np.float64, points.shape[:2], "CurvesMotion")
        require_range(radii, 0.0, LARGEST, "CurvesMotion: radii")
        _set_matrices(self, "world_from_object", ("s", 4, 4), "CurvesMotion")


@dataclass(frozen=True, eq=False)
class Motion:
    """All that moves, and how the shutter opens and closes.

    shutter : (k,) float64, how far open it is in each of k even parts of the time, 0 or more; None = wide open
    rolling_shutter : None where all rows of the picture see light together; else rows see it one after the other, from
        the top to the bottom, each for this share of the time, 0 to 1
    """

    camera: CameraMotion | None = None
    instances: Any = ()
    meshes: Any = ()
    spheres: Any = ()
    curves: Any = ()
    shutter: Any = None
    rolling_shutter: float | None = None

    def __post_init__(self) -> None:
        if self.camera is not None and not isinstance(self.camera, CameraMotion):
            raise ValueError(f"Motion: camera: expected CameraMotion or None, got {type(self.camera).__name__}")
        kinds = {"instances": InstanceMotion, "meshes": MeshMotion, "spheres": SpheresMotion, "curves": CurvesMotion}
        for name, kind in kinds.items():
            set_field(self, name, make_records(getattr(self, name), kind, f"Motion: {name}"))
        if self.shutter is not None:
            shutter = set_array(self, "shutter", np.float64, ("k",), "Motion")
            require_range(shutter, 0.0, LARGEST, "Motion: shutter")
            if not shutter.any():
                raise ValueError("Motion: shutter: expected a number above 0 among them, got none")
        if self.rolling_shutter is not None:
            set_number(self, "rolling_shutter", 0.0, 1.0, "Motion")


def require_fitting(
    motion: Motion,
    instances: Instances | None,
    meshes: Sequence[Mesh],
    spheres: Sequence[Spheres],
    curves: Sequence[Curves],
) -> None:
    """Raise ValueError unless what moves is in the scene, and mesh for mesh, group for group as large."""
    for strands in motion.curves:
        if strands.group >= len(curves):
            raise ValueError(f"Motion: curves: expected groups below {len(curves)}, got {strands.group}")
        expected, found = len(curves[strands.group].points), strands.points.shape[1]
        if found != expected:
            raise ValueError(f"Motion: curves {strands.group}: points: expected {expected} of them, got {found}")
    for group in motion.spheres:
        if group.group >= len(spheres):
            raise ValueError(f"Motion: spheres: expected groups below {len(spheres)}, got {group.group}")
        if len(group.centres) != len(spheres[group.group].centres):
            expected, found = len(spheres[group.group].centres), len(group.centres)
            raise ValueError(f"Motion: spheres {group.group}: centres: expected {expected} of them, got {found}")
    count = 0 if instances is None else len(instances)
    for part in motion.instances:
        if len(part.instances) and not 0 <= part.instances[0] <= part.instances[-1] < count:
            raise ValueError(
                f"Motion: instances: expected numbers from 0 to {count - 1}, got {part.instances[[0, -1]].tolist()}"
            )
    for part in motion.meshes:
        if part.mesh >= len(meshes):
            raise ValueError(f"Motion: meshes: expected numbers below {len(meshes)}, got {part.mesh}")
        mesh = meshes[part.mesh]
        for name in ("positions", "normals"):
            steps, still = getattr(part, name), getattr(mesh, name)
            shape = None if steps is None else steps.shape[1:]
            wanted = None if still is None else still.shape
            if shape != wanted:
                raise ValueError(f"Motion: mesh {part.mesh}: {name}: expected {wanted} at each step, got {shape}")


def _set_matrices(record: Any, name: str, shape: tuple[int | str, ...], label: str) -> None:
    matrices = set_array(record, name, np.float64, shape, label)
    _require_steps(len(matrices), f"{label}: {name}")
    if (matrices[..., 3, :] != (0.0, 0.0, 0.0, 1.0)).any():
        raise ValueError(f"{label}: {name}: expected (0, 0, 0, 1) as the last row of each matrix")


def _require_steps(steps: int, field: str) -> None:
    if steps < 2:
        raise ValueError(f"{field}: expected 2 or more steps, got {steps}")
