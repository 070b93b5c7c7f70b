"""The two sides of a comparison of hits: this caster and a function of Blender's that casts one ray at a time.

Both answer in the same terms: which object (instances told apart), which polygon of its mesh, where, which normal.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.casting.caster import Caster
from raytracer.casting.geometry import world_corners
from raytracer.casting.rays import Hits

from .rays import Aimed

Integers = NDArray[np.int64]


# What tells instances apart in Blender's answers: the object's name and three rows of the matrix.
Key = tuple[str, tuple[float, ...]]


@dataclass(frozen=True, eq=False)
class Answers:
    """What one side says about n rays.

    target : (n,) number of the object; -1 = miss
    polygon : (n,) polygon of that object's mesh; -1 = miss
    location, normal : (n, 3) NaN = miss
    seconds : for all rays
    """

    target: Integers
    polygon: Integers
    location: Floats
    normal: Floats
    seconds: float


@dataclass(frozen=True, eq=False)
class Sides:
    """The same geometry on both sides.

    ray_cast : Blender's side: (origin, direction) to (result, location, normal, index, object, matrix)
    target_of_instance : (i,) number of the object that an instance of the caster's scene shows
    target_of_key : the same by the Key of Blender's answers
    polygons : per mesh (t,) polygon of each triangle, ascending
    """

    caster: Caster
    ray_cast: Callable[[Any, Any], Any]
    target_of_instance: Integers
    target_of_key: dict[Key, int]
    polygons: tuple[NDArray[np.int32], ...]

    def translate(self, instance: Any, triangle: Any) -> tuple[Integers, Integers]:
        """Return (target, polygon), (n,) each, of triangles given by instance and index in their mesh."""
        mesh = self.caster.geometry.instance_mesh[instance]
        polygon = np.empty(len(mesh), dtype=np.int64)
        for chosen in np.unique(mesh):
            polygon[mesh == chosen] = self.polygons[chosen][triangle[mesh == chosen]]
        return self.target_of_instance[instance], polygon

    def list_names(self) -> dict[int, str]:
        """Return the names of the objects by their numbers."""
        return {number: name for (name, _), number in self.target_of_key.items()}


def key_of(name: str, matrix: Any) -> Key:
    """Return the Key of an object shown with a 4x4 matrix, whose last row is none of its place: Blender ignores it."""
    return name, tuple(float(value) for row in matrix[:3] for value in row)


def cast_ours(sides: Sides, rays: Aimed) -> tuple[Answers, Hits]:
    """Answer with the ray tracer; timed is what a user waits for: the hits, not their translation."""
    started = time.perf_counter()
    hits = sides.caster.closest_hit(rays.origins, rays.directions)
    seconds = time.perf_counter() - started
    count, hit = len(hits), hits.hit
    target, polygon = np.full((2, count), -1, dtype=np.int64)
    location, normal = np.full((2, count, 3), np.nan)
    target[hit], polygon[hit] = sides.translate(hits.instance[hit], hits.primitive[hit])
    location[hit] = rays.origins[hit] + hits.distance[hit, None] * rays.directions[hit]
    normal[hit] = compute_normals(sides, hits.instance[hit], hits.primitive[hit])
    return Answers(target, polygon, location, normal, seconds), hits


def compute_normals(sides: Sides, instance: Any, triangle: Any) -> Floats:
    """Return the unit normals (n, 3) of triangles in world space, on the side of the object-space normal.

    A mirroring matrix reverses the winding of the corners, but not, in Blender, the side that the normal points to.
    """
    a, b, c = world_corners(sides.caster.geometry, instance, triangle)
    normal = np.cross(b - a, c - a)
    mirrored = np.linalg.det(sides.caster.geometry.world_from_object[instance, :3, :3]) < 0
    normal[mirrored] *= -1
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)


def cast_blender(sides: Sides, rays: Aimed) -> Answers:
    """Answer with a loop over `sides.ray_cast`; timed is the loop alone."""
    pairs = list(zip(rays.origins.tolist(), rays.directions.tolist(), strict=True))
    cast = sides.ray_cast
    started = time.perf_counter()
    found = [cast(origin, direction) for origin, direction in pairs]
    seconds = time.perf_counter() - started
    target, polygon = np.full((2, len(found)), -1, dtype=np.int64)
    location, normal = np.full((2, len(found), 3), np.nan)
    for row, (result, place, side, index, shown, matrix) in enumerate(found):
        if result:
            target[row], polygon[row] = sides.target_of_key[key_of(shown.name_full, matrix)], index
            location[row], normal[row] = place, side
    return Answers(target, polygon, location, normal, seconds)


def measure_normal_error(sides: Sides, hits: Hits, normals: Floats) -> Floats:
    """Return (n,) the distance of `normals` from that of the nearest triangle of the polygon hit; NaN for a miss.

    A ray through the diagonal of a quad hits both its triangles, whose normals differ where the quad is not flat.
    """
    error = np.full(len(hits), np.nan)
    row = np.flatnonzero(hits.hit)
    instance, triangle = hits.instance[row], hits.primitive[row]
    mesh = sides.caster.geometry.instance_mesh[instance]
    first, end = np.empty((2, len(row)), dtype=np.int64)
    for chosen in np.unique(mesh):
        polygons, here = sides.polygons[chosen], mesh == chosen
        polygon = polygons[triangle[here]]
        first[here] = np.searchsorted(polygons, polygon, side="left")
        end[here] = np.searchsorted(polygons, polygon, side="right")
    for offset in range(int((end - first).max(initial=0))):
        candidate = compute_normals(sides, instance, np.minimum(first + offset, end - 1))
        error[row] = np.fmin(error[row], np.linalg.norm(candidate - normals[row], axis=1))
    return error
