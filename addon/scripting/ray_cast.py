"""Scene.ray_cast for arrays: the same objects, the same results in the same order, a million rays at a time.

    cast = ray_cast(depsgraph, origins, directions)

`placements` lists what Scene.ray_cast sees, `shapes` reads its meshes, `held` keeps the caster from call to call.
The function is exported as `addon.ray_cast`; the folder has another name, or importing it would take that place.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytracer.arrays.checks import as_array
from raytracer.arrays.types import Floats, Integers
from raytracer.casting.geometry import join_id, split_id
from raytracer.casting.rays import Hits, Rays, make_rays
from raytracer.lecture import length
from raytracer.surfaces.surface_tables import measure_triangles

from .held import Held, find_held

# With up to so many triangles for each hit, a table over all triangles costs less than measuring one for each hit.
SHARED_TRIANGLES = 16


@dataclass(frozen=True, eq=False)
class RayCastResult:
    """The results of n rays: those of Scene.ray_cast, in its order, as arrays.

    result : (n,) bool, True where the ray hits
    location : (n, 3) float64, metres, world; 0 for a miss
    normal : (n, 3) float64, unit, world, of the flat triangle, on the side of the object's own normal, whichever is
        hit; 0 for a miss. Scene.ray_cast's is not perpendicular under non-uniform scale before Blender 5.2
    index : (n,) int32, the polygon of the evaluated mesh; -1 for a miss, where Scene.ray_cast says 0
    object : (n,) int32, index into `objects`; -1 for a miss, where Scene.ray_cast says None
    objects : the original objects that have something to hit; of an instance, the object that is instanced
    placement : (n,) int32, row of `matrices`: tells instances apart that share an object; -1 for a miss
    matrices : (k + 1, 4, 4) float64, world from object, of what rays can hit; the last is the identity, for misses
    """

    result: NDArray[np.bool_]
    location: Floats
    normal: Floats
    index: Integers
    object: Integers
    objects: tuple[Any, ...]
    placement: Integers
    matrices: Floats

    def __len__(self) -> int:
        return len(self.result)

    @property
    def matrix(self) -> Floats:
        """(n, 4, 4) float64, world from object of what each ray hit; the identity for a miss. Made when asked for."""
        return self.matrices[self.placement]


def ray_cast(depsgraph: Any, origins: ArrayLike, directions: ArrayLike, distance: ArrayLike = np.inf) -> RayCastResult:
    """Cast many rays into a scene, as `Scene.ray_cast(depsgraph, origin, direction, distance=...)` casts one.

    What is hit first is decided as exact arithmetic on the evaluated meshes would; the rays are not rounded to float32.

    Parameters
    ----------
    depsgraph : bpy.types.Depsgraph, evaluated, such as `bpy.context.evaluated_depsgraph_get()`
    origins, directions : (n, 3) or (3,), metres, world; directions of any length; one may stand for all rays
    distance : number or (n,), metres; only what is closer is hit

    Returns
    -------
    RayCastResult of n rays. NaN, infinite or zero-direction rays miss.

    Raises
    ------
    ValueError
        If `depsgraph` is none, or shapes do not fit.

    Notes
    -----
    Meshes are read again only where they changed; nothing of Blender's is kept between calls.

    Examples
    --------
    In Blender, with its default cube:

    >>> import bpy
    >>> from addon import ray_cast
    >>> depsgraph = bpy.context.evaluated_depsgraph_get()
    >>> cast = ray_cast(depsgraph, [(0, 0, 5), (9, 9, 5)], (0, 0, -1))
    >>> cast.result.tolist(), cast.location[0].tolist()
    ([True, False], [0.0, 0.0, 1.0])
    >>> cast.objects[cast.object[0]].name
    'Cube'
    """
    if not isinstance(depsgraph, bpy.types.Depsgraph):
        raise ValueError(f"depsgraph: expected a bpy.types.Depsgraph, got {type(depsgraph).__name__}")
    rays = limit_rays(make_rays(origins, directions), distance)
    held, originals = find_held(depsgraph)
    hits = held.caster.closest_hit(rays.origins, rays.directions, rays.t_min, rays.t_max)
    location, normal, index = describe_hits(held, rays, hits)
    objects = tuple(dict.fromkeys(originals))
    number = {shown: row for row, shown in enumerate(objects)}
    object_of_placement = np.array([*(number[shown] for shown in originals), -1], dtype=np.int32)
    matrices = np.concatenate([held.world_from_object, np.eye(4)[np.newaxis]])
    placed = object_of_placement[hits.instance]
    return RayCastResult(hits.hit, location, normal, index, placed, objects, hits.instance, matrices)


def limit_rays(rays: Rays, distance: ArrayLike) -> Rays:
    """Return the rays with t < distance / |d| as their range; the end itself is out, as in Blender."""
    metres = as_array(distance, np.float64, ("n",) if np.ndim(distance) else (), "distance")
    if metres.shape not in ((), (len(rays),)):
        raise ValueError(f"distance: expected a number or an array ({len(rays)},), got shape {metres.shape}")
    if metres.shape == () and metres == np.inf:
        return rays
    largest = np.abs(rays.directions).max(axis=1)  # (n,)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # Scaled before it is squared: a length below 1e-160 would be 0.
        end = metres / largest / length(rays.directions / largest[:, np.newaxis])
    t_max = np.where(metres == np.inf, np.inf, np.nextafter(end, -np.inf))
    return dataclasses.replace(rays, t_max=t_max)


def describe_hits(held: Held, rays: Rays, hits: Hits) -> tuple[Floats, Floats, Integers]:
    """Return location o + t d (n, 3), normal (n, 3) and polygon (n,) of hits; 0, 0 and -1 for a miss."""
    location: Floats = rays.origins + np.where(hits.hit, hits.distance, 0.0)[:, np.newaxis] * rays.directions
    location[~hits.hit] = 0.0
    index = held.polygons[held.first_polygon[hits.instance] + hits.primitive]  # a miss finds the last entries, -1
    normal = np.zeros((len(hits), 3))
    rows = np.flatnonzero(hits.hit)
    normal[rows] = find_normals(held, hits.instance[rows], hits.primitive[rows])
    return location, normal, index


def find_normals(held: Held, instance: Integers, primitive: Integers) -> Floats:
    """Return the unit normals (n, 3) of triangles, on the side of the object's normal as in Blender.

    Where many rays share a triangle, which is likely if there are not many more triangles than rays, each is measured
    once.
    """
    geometry = held.caster.geometry
    if geometry.sphere_id > SHARED_TRIANGLES * len(instance):
        return measure_triangles(geometry, held.mirrored, instance, primitive).normal
    ids = join_id(geometry, instance, primitive)  # (n,)
    is_hit = np.zeros(geometry.sphere_id, dtype=bool)
    is_hit[ids] = True
    distinct = np.flatnonzero(is_hit)  # (k,)
    row_of_id = np.empty(geometry.sphere_id, dtype=np.int32)
    row_of_id[distinct] = np.arange(len(distinct), dtype=np.int32)
    normal = measure_triangles(geometry, held.mirrored, *split_id(geometry, distinct)).normal
    return normal.take(row_of_id[ids], axis=0)
