"""The scene: frozen records of arrays, checked when they are made; `scene_file` saves and loads them.

World space is Blender's: metres, right-handed, z up. Radiometry is linear RGB in the renderer's working space.
A record that a scene lacks is None or an empty tuple; what the content needs is derived from it (`features.py`).
Geometry, camera and world stand here; lamps and materials come from `light_records` and `material_records`.
Imports those, `checks` and `records`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.checks import as_array, require_choice, require_finite, require_range
from raytracer.light_records import AreaLight, Light, PointLight, SpotLight, SunLight
from raytracer.material_records import (
    CLOSURE_COLORS,
    CLOSURE_KINDS,
    CLOSURE_RANGES,
    DEFAULT_MATERIAL,
    Closure,
    Material,
)
from raytracer.programs import Program, Register, check_register
from raytracer.records import (
    ALL_SETS,
    SEEN_BY,
    SEEN_BY_ALL,
    SET_COUNT,
    set_array,
    set_color,
    set_field,
    set_number,
    set_receivers,
    set_seen_by,
)

__all__ = [
    "CLOSURE_COLORS",
    "CLOSURE_KINDS",
    "CLOSURE_RANGES",
    "DEFAULT_MATERIAL",
    "SEEN_BY",
    "SEEN_BY_ALL",
    "AreaLight",
    "Camera",
    "Closure",
    "Instances",
    "Light",
    "Material",
    "Mesh",
    "PointLight",
    "Scene",
    "Spheres",
    "SpotLight",
    "SunLight",
    "World",
]


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
    """

    positions: Any
    triangles: Any
    normals: Any = None
    uvs: Any = None
    material: Any = 0
    name: str = ""
    attributes: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
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
        set_field(self, "attributes", {name: self._check_attribute(name, label) for name in self.attributes})
        _set_material(self, len(triangles), label)

    def _check_attribute(self, name: str, label: str) -> NDArray[Any]:
        value = np.asarray(self.attributes[name])
        rows = (len(self.triangles), 3) if value.ndim == 3 else (len(self.positions),)
        array = as_array(value, np.float64, (*rows, "k"), f"{label}: attribute {name!r}")
        require_range(np.asarray(array.shape[-1]), 1, 4, f"{label}: attribute {name!r}: width")
        require_finite(array, f"{label}: attribute {name!r}")
        return array


def _set_material(record: Any, count: int, label: str) -> None:
    """Material indices are one int for all primitives, or one per primitive."""
    if np.ndim(record.material) == 0:
        lowest = int(set_array(record, "material", np.int32, (), label))
        set_field(record, "material", lowest)
    else:
        lowest = int(set_array(record, "material", np.int32, (count,), label).min(initial=0))
    if lowest < 0:
        raise ValueError(f"{label}: material: expected indices of 0 or more, got {lowest}")


@dataclass(frozen=True, eq=False)
class Spheres:
    """True spheres in world space (a Blender point cloud is one such group).

    centres : (s, 3) float64, metres
    radii : (s,) float64, metres, positive
    material : int, or (s,) int32, index into the scene's materials
    pass_index : int, the Object Index pass
    holdout : bool, True punches a hole into the image's alpha
    seen_by : bits of SEEN_BY, the classes of rays that see them
    shadow_catcher, light_set, receivers : bool, int, int, as in Instances
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

    def __post_init__(self) -> None:
        label = f"Spheres {self.name!r}" if self.name else "Spheres"
        centres = set_array(self, "centres", np.float64, ("s", 3), label)
        radii = set_array(self, "radii", np.float64, (len(centres),), label)
        require_range(radii, np.nextafter(0.0, 1.0), np.inf, f"{label}: radii")
        _set_material(self, len(centres), label)
        set_seen_by(self, label)
        set_receivers(self, label)
        require_range(set_array(self, "light_set", np.int32, (), label), 0, SET_COUNT - 1, f"{label}: light_set")
        set_field(self, "light_set", int(self.light_set))


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
    light_set : (i,) int32, the set of objects it belongs to, 0 to 62, that lamps and what shines may light or not;
        None = 0
    receivers : (i,) int64, the sets that it lights where it shines, as bits: 1 << light_set; None = all
    random : (i,) float64, 0 to 1, and color : (i, 4) float64, for programs that read them; None = 0, white
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
        properties = {"pass_index": np.int32, "holdout": np.bool_, "shadow_catcher": np.bool_, "light_set": np.int32}
        for name, dtype in properties.items():
            if getattr(self, name) is None:
                set_field(self, name, np.zeros(count, dtype=dtype))
            set_array(self, name, dtype, (count,), "Instances")
        for name, shape in (("random", (count,)), ("color", (count, 4))):
            if getattr(self, name) is not None:
                set_array(self, name, np.float64, shape, "Instances")
        if self.seen_by is not None:
            mask = set_array(self, "seen_by", np.int32, (count,), "Instances")
            require_range(mask, 0, SEEN_BY_ALL, "Instances: seen_by")
        require_range(self.light_set, 0, SET_COUNT - 1, "Instances: light_set")
        if self.receivers is None:
            set_field(self, "receivers", np.full(count, ALL_SETS, dtype=np.int64))
        receivers = set_array(self, "receivers", np.int64, (count,), "Instances")
        require_range(receivers, 0, ALL_SETS, "Instances: receivers")

    def __len__(self) -> int:
        return len(self.mesh)


@dataclass(frozen=True, eq=False)
class World:
    """Radiance from every direction that hits nothing.

    color : linear RGB, or a Register of `program`
    program : Program, evaluated over directions, or None where the color is constant
    """

    color: Any = 0.0
    program: Program | None = None

    def __post_init__(self) -> None:
        if isinstance(self.color, Register):
            check_register(self.color, self.program, "World: color")
        else:
            set_color(self, "color", "World")


@dataclass(frozen=True, eq=False)
class Camera:
    """Blender's camera: looks along its -z axis, y up.

    world_from_camera : (4, 4) float64, rigid (scale is removed where the camera is extracted)
    projection : 'perspective' or 'orthographic'
    focal_length, sensor_width, sensor_height : millimetres; sensor_fit : 'auto', 'horizontal' or 'vertical'
    ortho_scale : metres, the larger (or fitted) side of an orthographic view
    shift_x, shift_y : Blender's lens shift, in units of the fitted side
    clip_start, clip_end : metres along the view axis
    pixel_aspect : width over height of a pixel (Blender's pixel_aspect_x / pixel_aspect_y)
    aperture_radius : metres, of the lens that rays start from; 0 is a pinhole, all in focus
    focus_distance : metres along the view axis, where all rays of a point of the picture meet
    aperture_blades : corners of the aperture's polygon; fewer than 3 make a disk
    aperture_rotation : radians, counter-clockwise as the camera sees; aperture_ratio : height over width
    """

    world_from_camera: Any
    projection: str = "perspective"
    focal_length: float = 50.0
    sensor_width: float = 36.0
    sensor_height: float = 24.0
    sensor_fit: str = "auto"
    ortho_scale: float = 6.0
    shift_x: float = 0.0
    shift_y: float = 0.0
    clip_start: float = 0.0
    clip_end: float = np.inf
    pixel_aspect: float = 1.0
    aperture_radius: float = 0.0
    focus_distance: float = 10.0
    aperture_blades: int = 0
    aperture_rotation: float = 0.0
    aperture_ratio: float = 1.0

    def __post_init__(self) -> None:
        tiny = np.nextafter(0.0, 1.0)
        set_array(self, "world_from_camera", np.float64, (4, 4), "Camera")
        require_choice(self.projection, ("perspective", "orthographic"), "Camera: projection")
        require_choice(self.sensor_fit, ("auto", "horizontal", "vertical"), "Camera: sensor_fit")
        lens = ("focal_length", "sensor_width", "sensor_height", "ortho_scale", "pixel_aspect")
        for name in (*lens, "focus_distance", "aperture_ratio"):
            set_number(self, name, tiny, np.inf, "Camera")
        for name in ("shift_x", "shift_y", "aperture_rotation"):
            set_number(self, name, -np.inf, np.inf, "Camera")
        for name in ("clip_start", "aperture_radius"):
            set_number(self, name, 0.0, np.inf, "Camera")
        require_range(set_array(self, "aperture_blades", np.int32, (), "Camera"), 0, np.inf, "Camera: aperture_blades")
        set_field(self, "aperture_blades", int(self.aperture_blades))
        require_range(np.asarray(self.clip_end), self.clip_start, np.inf, "Camera: clip_end")


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything a render needs.

    meshes : Mesh records; each stands in the world as it is where `instances` is None
    spheres : Spheres, or a sequence of Spheres
    instances : Instances of the meshes, or None
    materials : Material records; empty = one grey diffuse material for all
    lights : light records
    world : World, or None for black
    camera : Camera, or None (a scene without a camera can be cast into, but not rendered)
    """

    meshes: Sequence[Mesh] = ()
    spheres: Any = ()
    instances: Instances | None = None
    materials: Sequence[Material] = ()
    lights: Sequence[Light] = ()
    world: World | None = None
    camera: Camera | None = None
    name: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        for name, kind in (("meshes", Mesh), ("spheres", Spheres), ("materials", Material), ("lights", Light)):
            value = getattr(self, name)
            records = (value,) if isinstance(value, kind) else tuple(value or ())
            for record in records:
                if not isinstance(record, kind):
                    wanted = getattr(kind, "__name__", "light")
                    raise ValueError(f"Scene: {name}: expected {wanted} records, got {type(record).__name__}")
            set_field(self, name, records)
        if not self.materials:
            set_field(self, "materials", (DEFAULT_MATERIAL,))
        if self.instances is not None and len(self.instances):
            low, high = int(self.instances.mesh.min()), int(self.instances.mesh.max())
            if low < 0 or high >= len(self.meshes):
                raise ValueError(
                    f"Scene: instances: mesh: expected indices from 0 to {len(self.meshes) - 1}, "
                    f"got {low if low < 0 else high}"
                )
        for record in (*self.meshes, *self.spheres):
            highest = int(np.max(record.material, initial=0))
            if highest >= len(self.materials):
                raise ValueError(
                    f"{type(record).__name__} {record.name!r}: material: expected indices below the scene's "
                    f"{len(self.materials)} materials, got {highest}"
                )

    @property
    def instance_count(self) -> int:
        """Number of mesh instances; groups of spheres are numbered after them in `Hits.instance`."""
        return len(self.meshes) if self.instances is None else len(self.instances)
