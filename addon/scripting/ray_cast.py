"""Scene.ray_cast for arrays: the same objects, the same results in the same order, a million rays at a time.

    cast = ray_cast(depsgraph, origins, directions)

`placements` lists what Scene.ray_cast sees, `selection` what is to be hit instead, `shapes` reads its meshes, `held`
keeps the caster from call to call, `results` says what comes back, and `attributes` reads more of the hits.
The function is exported as `addon.ray_cast`; the folder has another name, or importing it would take that place.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from raytracer.arrays.checks import as_array
from raytracer.arrays.types import Floats
from raytracer.casting.rays import Hits, Rays, make_misses, make_rays
from raytracer.lecture import length
from raytracer.predicates.rounding import gamma

from .attributes import HitPlaces
from .held import Held, find_held
from .results import Objects, RayCastResult, find_surface, make_objects
from .selection import Selection, list_missing, make_selection

# t |d| in float64: the length (three products, two sums, a root; scaled, two more), and the product.
LENGTH_ERROR = gamma(8)


def ray_cast(
    depsgraph: Any,
    origins: ArrayLike,
    directions: ArrayLike,
    distance: ArrayLike = np.inf,
    *,
    near: ArrayLike = 0.0,
    hits: float | None = None,
    objects: Any = None,
    collection: Any = None,
    visibility: str = "viewport",
) -> RayCastResult:
    """Cast many rays into a scene, as `Scene.ray_cast(depsgraph, origin, direction, distance=...)` casts one.

    What is hit first is decided as exact arithmetic on the evaluated meshes would; the rays are not rounded to float32.

    Parameters
    ----------
    depsgraph : bpy.types.Depsgraph, evaluated, such as `bpy.context.evaluated_depsgraph_get()`
    origins, directions : (n, 3) or (3,), metres, world; directions of any length; one may stand for all rays
    distance : number or (n,), metres; only what is closer is hit
    near : number or (n,), metres; only what is at least as far is hit
    hits : None for the first hit of each ray, as (n,); k for the first k surfaces in exact order, as (n, k); inf for
        all, as (n, the most that any ray meets). What an object has at one distance is one surface, also where faces
        share an edge or a vertex
    objects, collection : only these objects, and those of this collection, are hit; an object stands also for the
        instances of it and for those that it makes
    visibility : 'viewport', the meshes that viewports show, as Scene.ray_cast; 'render', those that renders show;
        'camera', of these what cameras see. `missing` lists what they have disabled: it is in no viewport's depsgraph

    Returns
    -------
    RayCastResult of n rays. NaN, infinite or zero-direction rays miss.

    Raises
    ------
    ValueError
        If an argument is not what is said above; the sentence names it.

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

    All that a ray meets, and how thick the cube is:

    >>> echoes = ray_cast(depsgraph, (0.5, 0.25, 5), (0, 0, -1), hits=2)
    >>> echoes.distance.tolist(), (echoes.distance[:, 1] - echoes.distance[:, 0]).tolist()
    ([[4.0, 6.0]], [2.0])

    Attributes and materials at the hits:

    >>> cast.attribute("UVMap").shape, cast.materials[cast.material[0]].name
    ((2, 2), 'Material')
    """
    selection = make_selection(objects, collection, visibility)
    return cast_selected(depsgraph, selection, limit_rays(make_rays(origins, directions), near, distance), hits)


def cast_selected(depsgraph: Any, selection: Selection, rays: Rays, hits: float | None) -> RayCastResult:
    """Return what `ray_cast` does, of rays with their ranges."""
    most = check_hits(hits)
    held, placements = find_held(depsgraph, selection)
    shown = make_objects(held, placements, list_missing(selection, depsgraph))
    if most is None:
        found = held.casters.closest_hit(rays)
        return make_result(held, shown, rays, found, (len(rays),))
    everything = held.caster.all_hits(
        rays.origins, rays.directions, rays.t_min, rays.t_max, None if most == np.inf else int(most)
    )
    width = int(everything.count.max(initial=0) if most == np.inf else most)
    found = make_misses(np.repeat(rays.valid(), width))
    found.put(everything.ray * width + everything.layer, everything.hits)
    rays = rays.select(np.repeat(np.arange(len(rays)), width))
    return make_result(held, shown, rays, found, (len(rays) // width if width else len(everything.count), width))


def ray_cast_layers(
    depsgraph: Any,
    origins: ArrayLike,
    directions: ArrayLike,
    distance: ArrayLike = np.inf,
    *,
    near: ArrayLike = 0.0,
    objects: Any = None,
    collection: Any = None,
    visibility: str = "viewport",
) -> Iterator[RayCastResult]:
    """Yield the next surface of each of n rays, until all miss: RayCastResults; arguments as `ray_cast`.

    For rays that meet many surfaces, a few of them deep: no array is larger than n.

    Examples
    --------
    >>> import bpy
    >>> from addon import ray_cast_layers
    >>> depsgraph = bpy.context.evaluated_depsgraph_get()
    >>> [cast.distance.tolist() for cast in ray_cast_layers(depsgraph, [(0, 0, 5), (0, 0, 0)], (0, 0, -1))]
    [[4.0, 1.0], [6.0, inf]]
    """
    selection = make_selection(objects, collection, visibility)
    rays = limit_rays(make_rays(origins, directions), near, distance)
    held, placements = find_held(depsgraph, selection)
    shown = make_objects(held, placements, list_missing(selection, depsgraph))
    for found in held.caster.layers(rays.origins, rays.directions, rays.t_min, rays.t_max):
        yield make_result(held, shown, rays, found, (len(rays),))


def check_hits(hits: Any) -> float | None:
    """Return the number of hits asked for, None where it is one by itself."""
    if hits is None or (not isinstance(hits, bool) and np.ndim(hits) == 0 and (hits == np.inf or is_count(hits))):
        return hits
    raise ValueError(f"hits: expected a whole number of at least 1, inf or None, got {hits!r}")


def is_count(number: Any) -> bool:
    """Return True for a whole number of at least 1."""
    return isinstance(number, int | np.integer) and int(number) >= 1


def limit_rays(rays: Rays, near: ArrayLike, distance: ArrayLike) -> Rays:
    """Return the rays with near / |d| <= t < distance / |d| as range; the far end itself is out, as in Blender."""
    first, last = (check_metres(value, len(rays), name) for value, name in ((near, "near"), (distance, "distance")))
    if last.shape == () and last == np.inf and first.shape == () and first <= 0:
        return rays
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scale, size = measure_directions(rays)
        t_min, end = first / scale / size, last / scale / size
    t_max = np.where(last == np.inf, np.inf, np.nextafter(end, -np.inf))
    return dataclasses.replace(rays, t_min=np.where(first <= 0, 0.0, t_min), t_max=t_max)


def check_metres(value: ArrayLike, count: int, name: str) -> Floats:
    """Return a number, or one per ray."""
    metres = as_array(value, np.float64, ("n",) if np.ndim(value) else (), name)
    if metres.shape not in ((), (count,)):
        raise ValueError(f"{name}: expected a number or an array ({count},), got shape {metres.shape}")
    return metres


def measure_directions(rays: Rays) -> tuple[Floats, Floats]:
    """Return (scale, size), (n,) each, whose product is |d|; scaled first, or a length below 1e-160 would be 0."""
    scale = np.abs(rays.directions).max(axis=1)
    return scale, length(rays.directions / scale[:, np.newaxis])


def make_result(held: Held, shown: Objects, rays: Rays, hits: Hits, shape: tuple[int, ...]) -> RayCastResult:
    """Return the results of rays, one row each, as arrays of `shape`."""
    hit = hits.hit
    t = np.where(hit, hits.distance, 0.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # of rays that are infinite, and miss
        location: Floats = rays.origins + t[:, np.newaxis] * rays.directions
        location[~hit] = 0.0
        scale, size = measure_directions(rays)
        distance = np.where(hit, t * scale * size, np.inf)
        error = np.where(hit, (hits.distance_error * scale * size + LENGTH_ERROR * distance) * (1 + LENGTH_ERROR), 0.0)
    normal, index, vertices = find_surface(held, hit, hits.instance, hits.primitive)
    places = HitPlaces(
        held.view, held.shapes, held.shape_of_placement, hits.instance, hits.primitive, hits.barycentric, shape
    )
    return RayCastResult(
        result=hit.reshape(shape),
        location=location.reshape(*shape, 3),
        normal=normal.reshape(*shape, 3),
        index=index.reshape(shape),
        object=shown.object[hits.instance].reshape(shape),
        placement=hits.instance.reshape(shape),
        distance=distance.reshape(shape),
        distance_error=error.reshape(shape),
        barycentric=hits.barycentric.reshape(*shape, 2),
        vertices=vertices.reshape(*shape, 3),
        shown=shown,
        places=places,
    )
