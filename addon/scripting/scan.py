"""A range scan of a scene: a scanner's rays, and what they hit as a mesh of points with attributes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import ArrayLike, NDArray

from raytracer.arrays.types import Floats
from raytracer.casting.rays import make_rays
from raytracer.lecture import dot

from .point_object import Attribute, make_point_object
from .ray_cast import cast_selected, is_count, limit_rays
from .results import RayCastResult
from .selection import make_selection

FULL_TURN = 2 * np.pi
# Angles of a turn may be off by what rounds from degrees to radians and to float32, sixteen roundings at most.
ANGLE_ROUNDING = 16 * 2.0**-24
# The scanner's axes, forward, left and up, as columns in the axes of a camera, which looks along -Z with Y up, and of
# other objects, which scan around Z, from Y on.
CAMERA_AXES = np.array([(0, -1, 0), (0, 0, 1), (-1, 0, 0)], dtype=np.float64)
OBJECT_AXES = np.array([(0, -1, 0), (1, 0, 0), (0, 0, 1)], dtype=np.float64)


@dataclass(frozen=True)
class ScanPattern:
    """A grid of rays around a scanner.

    horizontal, vertical : (first, last) angles, radians; to the left from forward, and up from the horizon. A full turn
        leaves out its last column, which would be the first again
    columns, rows : how many rays; rows are a scanner's rings, the lowest first
    """

    horizontal: tuple[float, float] = (-np.pi, np.pi)
    vertical: tuple[float, float] = (-np.radians(25.0), np.radians(15.0))
    columns: int = 900
    rows: int = 32

    def __post_init__(self) -> None:
        for name in ("columns", "rows"):
            if not is_count(getattr(self, name)):
                raise ValueError(f"{name}: expected a whole number of at least 1, got {getattr(self, name)!r}")
        for name, most in (("horizontal", FULL_TURN), ("vertical", np.pi)):
            angles = np.asarray(getattr(self, name), dtype=np.float64)
            if (
                angles.shape != (2,)
                or not np.isfinite(angles).all()
                or abs(angles[1] - angles[0]) > most * (1 + ANGLE_ROUNDING)
            ):
                raise ValueError(
                    f"{name}: expected two angles in radians at most {most:.4g} apart, got {getattr(self, name)!r}"
                )

    def make_directions(self) -> Floats:
        """Return unit directions (rows * columns, 3), forward, left and up: (cos e cos a, cos e sin a, sin e)."""
        first, last = self.horizontal
        is_full = abs(last - first) >= FULL_TURN * (1 - ANGLE_ROUNDING)
        azimuth = np.linspace(first, last, self.columns, endpoint=not is_full)
        elevation = np.linspace(*self.vertical, self.rows)[:, np.newaxis]
        flat = np.cos(elevation)
        parts = (flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation) + 0 * azimuth)
        return np.stack(parts, axis=-1).reshape(-1, 3)


def scan(
    depsgraph: Any,
    origin: Any,
    *,
    horizontal: tuple[float, float] = ScanPattern.horizontal,
    vertical: tuple[float, float] = ScanPattern.vertical,
    columns: int = ScanPattern.columns,
    rows: int = ScanPattern.rows,
    distance: float = 100.0,
    near: float = 0.0,
    echoes: int = 1,
    noise: float = 0.0,
    seed: int = 0,
    radius: float = 0.0,
    objects: Any = None,
    collection: Any = None,
    visibility: str = "viewport",
    name: str = "Scan",
) -> Any:
    """Scan a scene as a range scanner does, and return the points as a new object in the scene's collection.

    Parameters
    ----------
    depsgraph : bpy.types.Depsgraph, evaluated
    origin : the scanner: an object, such as a camera, which looks along its -Z; others scan around their Z from their Y
        on, and do not see themselves. Or a place (3,), or a matrix (4, 4) of such an object, metres
    horizontal, vertical : (first, last) angles in radians, to the left from forward and up from the horizon
    columns, rows : how many rays around, and one above the other
    distance, near : metres, the range: near <= distance from the scanner < distance
    echoes : how many surfaces each ray returns
    noise : metres, the standard deviation of distances that are measured, along the ray; `seed` chooses it
    radius : metres, of the spheres that renders show, kept as an attribute; 0 shows none
    objects, collection, visibility : what is scanned, as `ray_cast`
    name : of the object and its mesh

    Returns
    -------
    bpy.types.Object, a mesh of a vertex per return, in world coordinates, with the attributes
    `distance` (metres, measured), `intensity` (the cosine of the angle to the surface: 1 head-on, 0 grazing), `normal`,
    `object_index` (number in the mesh's property `objects`, which has their names), `echo` (1 for the first),
    `row` and `column` of the ray.

    Raises
    ------
    ValueError
        If an argument is not what is said above; the sentence names it.

    Examples
    --------
    The default cube from its inside, through the hull:

    >>> import bpy, math
    >>> from addon import scan
    >>> points = scan(bpy.context.evaluated_depsgraph_get(), (0, 0, 0), columns=4, rows=1, vertical=(0, 0))
    >>> len(points.data.vertices), points.data.attributes["distance"].data[0].value
    (4, 1.0)
    """
    pattern = ScanPattern(horizontal, vertical, columns, rows)
    if not is_count(echoes):
        raise ValueError(f"echoes: expected a whole number of at least 1, got {echoes!r}")
    try:
        np.random.default_rng(seed)
    except (TypeError, ValueError):
        raise ValueError(f"seed: expected a whole number of at least 0, got {seed!r}") from None
    for label, value in (("noise", noise), ("radius", radius)):
        if not isinstance(value, int | float | np.number) or not 0 <= value < np.inf:
            raise ValueError(f"{label}: expected metres of at least 0, got {value!r}")
    selection = make_selection(objects, collection, visibility)
    place, axes = find_scanner(depsgraph, origin)
    if isinstance(origin, bpy.types.Object):
        selection = replace(selection, without=origin.original.session_uid)
    directions = pattern.make_directions() @ axes.T
    rays = limit_rays(make_rays(place, directions), near, distance)
    cast = cast_selected(depsgraph, selection, rays, echoes)
    location, attributes = list_returns(cast, directions, pattern.columns, noise, seed)
    names = {str(number): thing.name for number, thing in enumerate(cast.objects)}
    return make_point_object(name, location, attributes, names, radius, depsgraph.scene)


def find_scanner(depsgraph: Any, origin: Any) -> tuple[Floats, Floats]:
    """Return a scanner's place (3,), and its forward, left and up in the world as columns (3, 3)."""
    axes = OBJECT_AXES
    if isinstance(origin, bpy.types.Object):
        matrix = np.array(origin.evaluated_get(depsgraph).matrix_world, dtype=np.float64)
        axes = CAMERA_AXES if origin.type == "CAMERA" else OBJECT_AXES
    else:
        matrix = read_matrix(origin)
    if not np.isfinite(matrix).all():
        raise ValueError("origin: expected a finite place, got NaN or infinity")
    turn = np.array(Matrix(matrix.tolist()).to_quaternion().to_matrix(), dtype=np.float64)
    return matrix[:3, 3], turn @ axes


def read_matrix(origin: ArrayLike) -> Floats:
    """Return a matrix (4, 4), or a place (3,) as one without rotation."""
    try:
        given: NDArray[np.float64] = np.asarray(origin, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"origin: expected an object, a place or a matrix, got {type(origin).__name__}") from None
    if given.shape == (4, 4):
        return given
    if given.shape != (3,):
        raise ValueError(f"origin: expected an object, a place (3,) or a matrix (4, 4), got shape {given.shape}")
    matrix = np.eye(4)
    matrix[:3, 3] = given
    return matrix


def list_returns(
    cast: RayCastResult, directions: Floats, columns: int, noise: float, seed: int
) -> tuple[Floats, list[Attribute]]:
    """Return the places (k, 3) that a scanner measures, ray by ray, and what it knows of them."""
    ray, echo = np.nonzero(cast.result)
    distance, location, normal = cast.distance[ray, echo], cast.location[ray, echo], cast.normal[ray, echo]
    if noise > 0:
        error = np.random.default_rng(seed).normal(scale=noise, size=len(ray))
        distance, location = distance + error, location + error[:, np.newaxis] * directions[ray]
    attributes = [
        Attribute("distance", "FLOAT", distance),
        Attribute("intensity", "FLOAT", np.abs(dot(normal, directions[ray]))),
        Attribute("normal", "FLOAT_VECTOR", normal),
        Attribute("object_index", "INT", cast.object[ray, echo]),
        Attribute("echo", "INT", echo + 1),
        Attribute("row", "INT", ray // columns),
        Attribute("column", "INT", ray % columns),
    ]
    return location, attributes


def scan_frames(
    scene: Any, origin: Any, frames: Iterable[int] | None = None, **options: Any
) -> Iterator[tuple[int, Any]]:
    """Scan the frames of an animation: yield (frame, object of points) for each; the scene's frame is set back then.

    From frame to frame only meshes that changed are read again, and only what moved is built again.

    Parameters
    ----------
    scene : bpy.types.Scene; of the view layer in use, or the first
    origin : the scanner, as `scan`; an object that moves is followed
    frames : whole numbers; None for the scene's range and step
    options : those of `scan`; `name` becomes 'name.0001' and so on

    Examples
    --------
    >>> import bpy
    >>> from addon import scan_frames
    >>> points = dict(scan_frames(bpy.context.scene, bpy.context.scene.camera, range(1, 3), columns=8, rows=4))
    >>> [points[frame].name for frame in points]
    ['Scan.0001', 'Scan.0002']
    """
    if not isinstance(scene, bpy.types.Scene):
        raise ValueError(f"scene: expected a bpy.types.Scene, got {type(scene).__name__}")
    if frames is None:
        frames = range(scene.frame_start, scene.frame_end + 1, scene.frame_step)
    name, before = options.pop("name", "Scan"), (scene.frame_current, scene.frame_subframe)
    layer = bpy.context.view_layer if bpy.context.scene == scene else scene.view_layers[0]
    try:
        for frame in frames:
            scene.frame_set(frame)
            layer.update()
            yield frame, scan(layer.depsgraph, origin, name=f"{name}.{frame:04d}", **options)
    finally:
        scene.frame_set(before[0], subframe=before[1])
