"""The scene: frozen records of arrays, checked when they are made; `scene_file` saves and loads them.

World space is Blender's: metres, right-handed, z up. Radiometry is linear RGB in the renderer's working space.
A record that a scene lacks is None or an empty tuple; what the content needs is derived from it (`features.py`).
Imports `checks` and `programs`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.checks import as_array, require_choice, require_finite, require_range
from raytracer.programs import Program, Register, check_register, make_value


def _set(record: Any, name: str, value: Any) -> None:
    object.__setattr__(record, name, value)


def _set_array(record: Any, name: str, dtype: type, shape: Sequence[int | str], label: str) -> NDArray[Any]:
    """Replace a field by its checked, read-only array."""
    array = as_array(getattr(record, name), dtype, shape, f"{label}: {name}")
    if np.issubdtype(dtype, np.floating):
        require_finite(array, f"{label}: {name}")
    _set(record, name, array)
    return array


def _set_color(record: Any, name: str, label: str) -> None:
    """Replace a field by a non-negative linear RGB triple; a single number stands for grey."""
    value = getattr(record, name)
    _set(record, name, np.full(3, value, dtype=np.float64) if np.ndim(value) == 0 else value)
    require_range(_set_array(record, name, np.float64, (3,), label), 0.0, np.inf, f"{label}: {name}")


def _set_number(record: Any, name: str, low: float, high: float, label: str) -> None:
    require_range(_set_array(record, name, np.float64, (), label), low, high, f"{label}: {name}")
    _set(record, name, float(getattr(record, name)))


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
        positions = _set_array(self, "positions", np.float64, ("v", 3), label)
        triangles = _set_array(self, "triangles", np.int32, ("t", 3), label)
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
                _set_array(self, name, np.float64, shape, label)
        _set(self, "attributes", {name: self._check_attribute(name, label) for name in self.attributes})
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
        lowest = int(_set_array(record, "material", np.int32, (), label))
        _set(record, "material", lowest)
    else:
        lowest = int(_set_array(record, "material", np.int32, (count,), label).min(initial=0))
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
    """

    centres: Any
    radii: Any
    material: Any = 0
    pass_index: int = 0
    holdout: bool = False
    name: str = ""

    def __post_init__(self) -> None:
        label = f"Spheres {self.name!r}" if self.name else "Spheres"
        centres = _set_array(self, "centres", np.float64, ("s", 3), label)
        radii = _set_array(self, "radii", np.float64, (len(centres),), label)
        require_range(radii, np.nextafter(0.0, 1.0), np.inf, f"{label}: radii")
        _set_material(self, len(centres), label)


@dataclass(frozen=True, eq=False)
class Instances:
    """Placements of meshes; the true triangle of an instance is its world-space float64 triangle.

    mesh : (i,) int32, index into the scene's meshes
    world_from_object : (i, 4, 4) float64, affine, last row (0, 0, 0, 1); may mirror and shear
    pass_index : (i,) int32, the Object Index pass
    holdout : (i,) bool, True punches a hole into the image's alpha
    random : (i,) float64, 0 to 1, and color : (i, 4) float64, for programs that read them; None = 0, white
    """

    mesh: Any
    world_from_object: Any
    pass_index: Any = None
    holdout: Any = None
    random: Any = None
    color: Any = None

    def __post_init__(self) -> None:
        count = len(_set_array(self, "mesh", np.int32, ("i",), "Instances"))
        matrices = _set_array(self, "world_from_object", np.float64, (count, 4, 4), "Instances")
        affine = (matrices[:, 3] == (0.0, 0.0, 0.0, 1.0)).all(axis=1)
        if not affine.all():
            row = int(np.argmin(affine))
            raise ValueError(
                "Instances: world_from_object: expected (0, 0, 0, 1) as the last row of each matrix, "
                f"got {matrices[row, 3].tolist()} at row {row}"
            )
        for name, dtype in (("pass_index", np.int32), ("holdout", np.bool_)):
            if getattr(self, name) is None:
                _set(self, name, np.zeros(count, dtype=dtype))
            _set_array(self, name, dtype, (count,), "Instances")
        for name, shape in (("random", (count,)), ("color", (count, 4))):
            if getattr(self, name) is not None:
                _set_array(self, name, np.float64, shape, "Instances")

    def __len__(self) -> int:
        return len(self.mesh)


# The colours of a closure, and the range of each of its numbers.
CLOSURE_COLORS = ("color", "specular_tint", "emission")
CLOSURE_RANGES = {
    "weight": (0.0, np.inf),
    "ior": (float(np.nextafter(0.0, 1.0)), np.inf),
    **dict.fromkeys(("roughness", "metallic", "transmission", "specular", "alpha"), (0.0, 1.0)),
}
CLOSURE_KINDS = ("principled", "diffuse", "glossy", "glass", "refraction", "transparent", "emission")


@dataclass(frozen=True, eq=False)
class Closure:
    """One scattering or emitting part of a material; each parameter is a constant or a Register of its program.

    kind : one of CLOSURE_KINDS
    weight : factor in the material's sum (Mix and Add Shader fold into it)
    color : linear RGB; base colour of a principled closure, radiance scale of an emission
    roughness : Blender's roughness; GGX alpha is its square; 0 is a perfect mirror
    normal : world space, any length, on the side that the ray comes from; None = the surface's
    The remaining fields are those of Blender's Principled BSDF node.
    """

    kind: str
    color: Any = 0.8
    weight: Any = 1.0
    roughness: Any = 0.5
    ior: Any = 1.5
    metallic: Any = 0.0
    transmission: Any = 0.0
    specular: Any = 0.5
    specular_tint: Any = 1.0
    emission: Any = 0.0
    alpha: Any = 1.0
    normal: Any = None

    def __post_init__(self) -> None:
        label = f"Closure {self.kind!r}"
        require_choice(self.kind, CLOSURE_KINDS, "Closure: kind")
        computed = self.registers
        for name in CLOSURE_COLORS:
            if name not in computed:
                _set_color(self, name, label)
        for name, (low, high) in CLOSURE_RANGES.items():
            if name not in computed:
                _set_number(self, name, low, high, label)
        if self.normal is not None:
            _set(self, "normal", make_value(self.normal, f"{label}: normal"))

    @property
    def registers(self) -> dict[str, Register]:
        """The parameters that the material's program computes, by name."""
        return {name: value for name, value in vars(self).items() if isinstance(value, Register)}


@dataclass(frozen=True, eq=False)
class Material:
    """A named sum of weighted closures; no closures at all is black.

    program : computes the parameters that are Registers; None where all are constant
    transparent_shadow : False stops light all the same where the surface is transparent
    """

    closures: Sequence[Closure] = ()
    pass_index: int = 0
    name: str = ""
    program: Program | None = None
    transparent_shadow: bool = True

    def __post_init__(self) -> None:
        _set(self, "closures", tuple(self.closures))
        for closure in self.closures:
            for name, register in closure.registers.items():
                check_register(register, self.program, f"Material {self.name!r}: {closure.kind}: {name}")


DEFAULT_MATERIAL = Material((Closure("diffuse", color=0.8),), name="default")


@dataclass(frozen=True, eq=False)
class PointLight:
    """A sphere, or a point where radius is 0, that emits `power` watts (linear RGB) into all directions.

    soft_falloff : Blender's option: a disk that faces the shaded point instead of a true sphere
    """

    position: Any
    power: Any
    radius: float = 0.0
    soft_falloff: bool = True
    cast_shadow: bool = True
    name: str = ""

    def __post_init__(self) -> None:
        label = f"PointLight {self.name!r}"
        _set_array(self, "position", np.float64, (3,), label)
        _set_color(self, "power", label)
        _set_number(self, "radius", 0.0, np.inf, label)


@dataclass(frozen=True, eq=False)
class SpotLight(PointLight):
    """A point light limited to a cone.

    world_from_light : (3, 3) float64, the light shines along its -z axis; columns keep the object's scale
    spot_size : full opening angle, radians
    spot_blend : 0 to 1, softness of the cone's border
    """

    world_from_light: Any = None
    spot_size: float = np.pi / 4
    spot_blend: float = 0.15

    def __post_init__(self) -> None:
        super().__post_init__()
        label = f"SpotLight {self.name!r}"
        if self.world_from_light is None:
            _set(self, "world_from_light", np.eye(3))
        matrix = _set_array(self, "world_from_light", np.float64, (3, 3), label)
        if not abs(np.linalg.det(matrix)) > 0:
            raise ValueError(
                f"{label}: world_from_light: expected a matrix that can be inverted, got {matrix.tolist()}"
            )
        _set_number(self, "spot_size", 0.0, np.pi, label)
        _set_number(self, "spot_blend", 0.0, 1.0, label)


@dataclass(frozen=True, eq=False)
class SunLight:
    """A light at infinity.

    direction : (3,) float64, from the scene towards the sun, made unit length
    strength : linear RGB irradiance on a plane that faces the sun, W/m^2
    angle : angular diameter of the disc, radians; 0 is a point
    """

    direction: Any
    strength: Any
    angle: float = 0.0
    cast_shadow: bool = True
    name: str = ""

    def __post_init__(self) -> None:
        label = f"SunLight {self.name!r}"
        direction = _set_array(self, "direction", np.float64, (3,), label)
        length = np.linalg.norm(direction)
        if length == 0:
            raise ValueError(f"{label}: direction: expected a vector other than zero, got {direction.tolist()}")
        _set(self, "direction", direction / length)
        _set_color(self, "strength", label)
        _set_number(self, "angle", 0.0, np.pi, label)


@dataclass(frozen=True, eq=False)
class AreaLight:
    """A flat light that emits `power` watts from its front, the side its -z axis points to.

    position : (3,) centre
    axis_u, axis_v : (3,) float64, metres, the full width and height as vectors
    shape : 'rectangle' or 'ellipse'
    spread : full opening angle of the emission, radians; pi is Lambertian
    """

    position: Any
    axis_u: Any
    axis_v: Any
    power: Any
    shape: str = "rectangle"
    spread: float = np.pi
    cast_shadow: bool = True
    name: str = ""

    def __post_init__(self) -> None:
        label = f"AreaLight {self.name!r}"
        for name in ("position", "axis_u", "axis_v"):
            _set_array(self, name, np.float64, (3,), label)
        _set_color(self, "power", label)
        require_choice(self.shape, ("rectangle", "ellipse"), f"{label}: shape")
        _set_number(self, "spread", 0.0, np.pi, label)


Light = PointLight | SpotLight | SunLight | AreaLight


@dataclass(frozen=True, eq=False)
class World:
    """Constant radiance from every direction that hits nothing (linear RGB)."""

    color: Any = 0.0

    def __post_init__(self) -> None:
        _set_color(self, "color", "World")


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

    def __post_init__(self) -> None:
        tiny = np.nextafter(0.0, 1.0)
        _set_array(self, "world_from_camera", np.float64, (4, 4), "Camera")
        require_choice(self.projection, ("perspective", "orthographic"), "Camera: projection")
        require_choice(self.sensor_fit, ("auto", "horizontal", "vertical"), "Camera: sensor_fit")
        for name in ("focal_length", "sensor_width", "sensor_height", "ortho_scale", "pixel_aspect"):
            _set_number(self, name, tiny, np.inf, "Camera")
        for name in ("shift_x", "shift_y"):
            _set_number(self, name, -np.inf, np.inf, "Camera")
        _set_number(self, "clip_start", 0.0, np.inf, "Camera")
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
            _set(self, name, records)
        if not self.materials:
            _set(self, "materials", (DEFAULT_MATERIAL,))
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

    def save(self, path: str | Path) -> None:
        """Write the scene as one .npz (see `scene_file.save`)."""
        from raytracer import scene_file

        scene_file.save(self, path)

    @staticmethod
    def load(path: str | Path) -> Scene:
        """Read a scene from one .npz (see `scene_file.load`)."""
        from raytracer import scene_file

        return scene_file.load(path)
