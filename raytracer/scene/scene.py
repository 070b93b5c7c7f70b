"""The scene: frozen records of arrays, checked when they are made; `scene_file` saves and loads them.

World space is Blender's: metres, right-handed, z up. Radiometry is linear RGB in the renderer's working space.
A record that a scene lacks is None or an empty tuple; what the content needs is derived from it (`features.py`).
Its parts stand beside this file: shapes, curves, camera, lights and world, materials, programs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from raytracer.scene.camera import Camera
from raytracer.scene.curves import Curves
from raytracer.scene.fields import make_records, require_text, set_field
from raytracer.scene.light_groups import LightGroups
from raytracer.scene.lights import Light, World
from raytracer.scene.materials import DEFAULT_MATERIAL, Material
from raytracer.scene.motion import Motion, require_fitting
from raytracer.scene.shapes import Instances, Mesh, Spheres


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything a render needs.

    meshes : Mesh records; each stands in the world as it is where `instances` is None
    spheres : Spheres, or a sequence of Spheres
    curves : Curves, or a sequence of Curves
    instances : Instances of the meshes, or None
    materials : Material records; empty = one grey diffuse material for all
    lights : light records
    world : World, or None for black
    light_groups : LightGroups, or None where what shines is in no groups
    camera : Camera, or None (a scene without a camera can be cast into, but not rendered)
    motion : Motion while the shutter is open, which only renders show; the other fields hold the moment in its middle.
        None = nothing moves
    neighbors : Motion from the frame before (time 0) to the next one (time 1), which the Vector pass tells of; None =
        it is 0, as where the shutter shows motion

    Examples
    --------
    >>> from raytracer import Camera, Closure, Material, Mesh, PointLight, Scene
    >>> floor = Mesh(positions=[(-9, -9, 0), (9, -9, 0), (0, 9, 0)], triangles=[(0, 1, 2)])
    >>> red = Material((Closure("diffuse", color=(0.8, 0.1, 0.1)),))
    >>> scene = Scene(meshes=[floor], materials=[red], lights=[PointLight((0, 0, 3), power=100)])
    >>> scene.instance_count
    1
    """

    meshes: Sequence[Mesh] = ()
    spheres: Any = ()
    instances: Instances | None = None
    materials: Sequence[Material] = ()
    lights: Sequence[Light] = ()
    world: World | None = None
    camera: Camera | None = None
    motion: Motion | None = None
    neighbors: Motion | None = None
    name: str = field(default="", compare=False)
    light_groups: LightGroups | None = None
    curves: Any = ()

    def __post_init__(self) -> None:
        sequences: tuple[tuple[str, Any], ...] = (
            *(("meshes", Mesh), ("spheres", Spheres), ("curves", Curves)),
            *(("materials", Material), ("lights", Light)),
        )
        for name, kind in sequences:
            set_field(self, name, make_records(getattr(self, name), kind, f"Scene: {name}"))
        optional: tuple[tuple[str, type], ...] = (
            *(("instances", Instances), ("world", World)),
            *(("camera", Camera), ("light_groups", LightGroups)),
            *(("motion", Motion), ("neighbors", Motion)),
        )
        for name, kind in optional:
            value = getattr(self, name)
            if value is not None and not isinstance(value, kind):
                raise ValueError(f"Scene: {name}: expected {kind.__name__} or None, got {type(value).__name__}")
        require_text(self.name, "Scene: name")
        if not self.materials:
            set_field(self, "materials", (DEFAULT_MATERIAL,))
        if self.instances is not None and len(self.instances):
            low, high = int(self.instances.mesh.min()), int(self.instances.mesh.max())
            if low < 0 or high >= len(self.meshes):
                raise ValueError(
                    f"Scene: instances: mesh: expected indices from 0 to {len(self.meshes) - 1}, "
                    f"got {low if low < 0 else high}"
                )
        for record in (*self.meshes, *self.groups):
            highest = int(np.max(record.material, initial=0))
            if highest >= len(self.materials):
                raise ValueError(
                    f"{type(record).__name__} {record.name!r}: material: expected indices below the scene's "
                    f"{len(self.materials)} materials, got {highest}"
                )
        for motion in filter(None, (self.motion, self.neighbors)):
            require_fitting(motion, self.instances, self.meshes, self.spheres, self.curves)
        if self.light_groups is not None:
            for name, count in (("lights", len(self.lights)), ("objects", self.instance_count + len(self.groups))):
                found = len(getattr(self.light_groups, name))
                if found != count:
                    raise ValueError(f"Scene: light_groups: {name}: expected {count} numbers, got {found}")

    @property
    def instance_count(self) -> int:
        """Number of mesh instances; `groups` are numbered after them in `Hits.instance`."""
        return len(self.meshes) if self.instances is None else len(self.instances)

    @property
    def groups(self) -> tuple[Spheres | Curves, ...]:
        """The objects that are no instances, as they are numbered: groups of spheres, then of curves."""
        return (*self.spheres, *self.curves)


def require_scene(value: Any, field: str) -> None:
    """Raise ValueError unless `value` is a Scene."""
    if not isinstance(value, Scene):
        raise ValueError(f"{field}: expected a Scene, got {type(value).__name__}")
