"""Questions of points instead of rays: what is closest, what lies inside, what is seen from where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytracer.arrays.types import Booleans, Floats, Integers
from raytracer.casting.inside import as_points
from raytracer.casting.rays import make_rays
from raytracer.lecture import length

from .attributes import HitPlaces, read_attribute
from .held import find_held
from .ray_cast import check_metres
from .results import Objects, find_surface, make_objects
from .selection import list_missing, make_selection

# Coordinates that Blender holds as float32, and brought through a matrix of float32, are off by up to eight roundings.
FLOAT32_COORDINATES = 8 * 2.0**-24


@dataclass(frozen=True, eq=False)
class ClosestPointResult:
    """The closest points of a scene to n points: what Object.closest_point_on_mesh returns, in its order, as arrays.

    `result, location, normal, index = closest` unpacks that.

    result : (n,) bool, True where something is near enough
    location : (n, 3) float64, metres, world, the closest point; 0 where there is none
    normal : (n, 3) float64, unit, world, of the flat triangle, on the side of the object's normal; 0 where there is
        none
    index : (n,) int32, the polygon of the evaluated mesh; -1 where there is none
    distance : (n,) float64, metres; inf where there is none
    distance_error : (n,) float64, metres, certified bound on |distance - exact|
    object, objects, placement, matrices : as in RayCastResult
    barycentric, vertices : as in RayCastResult
    """

    result: NDArray[np.bool_]
    location: Floats
    normal: Floats
    index: Integers
    distance: Floats
    distance_error: Floats
    object: Integers
    placement: Integers
    barycentric: Floats
    vertices: Integers
    shown: Objects
    places: HitPlaces

    def __len__(self) -> int:
        return len(self.result)

    def __iter__(self) -> Any:
        """Yield the four results of Object.closest_point_on_mesh, in its order."""
        yield from (self.result, self.location, self.normal, self.index)

    @property
    def objects(self) -> tuple[Any, ...]:
        return self.shown.objects

    @property
    def matrices(self) -> Floats:
        return self.shown.matrices

    def attribute(self, name: str, depsgraph: Any = None) -> Floats:
        """Return an attribute at the closest points, as `RayCastResult.attribute` does at hits."""
        return read_attribute(self.places, name, depsgraph)


def closest_point(
    depsgraph: Any,
    points: ArrayLike,
    distance: ArrayLike = np.inf,
    *,
    objects: Any = None,
    collection: Any = None,
    visibility: str = "viewport",
) -> ClosestPointResult:
    """Return the closest point of a scene to each of many points: BVHTree.find_nearest for arrays and whole scenes.

    Minimizes |x - p| over all x of all triangles, in the world: also where objects are scaled differently along their
    axes.

    Parameters
    ----------
    depsgraph : bpy.types.Depsgraph, evaluated
    points : (n, 3) or (3,), metres, world
    distance : number or (n,), metres; what is farther is not found
    objects, collection, visibility : what can be found, as `ray_cast`

    Returns
    -------
    ClosestPointResult of n points. Points that are NaN or infinite find nothing. `distance_error` is proven: the exact
    distance lies between a plane that the triangle is behind and the point that was found.

    Raises
    ------
    ValueError
        If an argument is not what is said above; the sentence names it.

    Examples
    --------
    >>> import bpy
    >>> from addon import closest_point
    >>> closest = closest_point(bpy.context.evaluated_depsgraph_get(), [(3, 0.5, 0.25), (1, 2, 3)], distance=2.5)
    >>> closest.result.tolist(), closest.distance.tolist(), closest.location.tolist()
    ([True, True], [2.0, 2.23606797749979], [[1.0, 0.5, 0.25], [1.0, 1.0, 1.0]])
    >>> bool(closest.distance_error.max() < 1e-13)
    True

    References
    ----------
    C. Ericson, "Real-Time Collision Detection" (2005), section 5.1.5, for the closest point of a triangle;
    S. Boyd and L. Vandenberghe, "Convex Optimization" (2004), section 8.1.3: any plane that separates is a lower bound.
    """
    selection = make_selection(objects, collection, visibility)
    places = as_points(points)
    held, placements = find_held(depsgraph, selection)
    shown = make_objects(held, placements, list_missing(selection, depsgraph))
    found = held.caster.closest_point(places, check_metres(distance, len(places), "distance"))
    normal, index, vertices = find_surface(held, found.found, found.instance, found.primitive)
    places_hit = HitPlaces(
        view=held.view,
        shapes=held.shapes,
        shape_of_placement=held.shape_of_placement,
        placement=found.instance,
        primitive=found.primitive,
        weights=found.barycentric,
        shape=(len(found),),
    )
    return ClosestPointResult(
        result=found.found,
        location=found.location,
        normal=normal,
        index=index,
        distance=found.distance,
        distance_error=found.distance_error,
        object=shown.object[found.instance],
        placement=found.instance,
        barycentric=found.barycentric,
        vertices=vertices,
        shown=shown,
        places=places_hit,
    )


def inside(
    depsgraph: Any, points: ArrayLike, *, objects: Any = None, collection: Any = None, visibility: str = "viewport"
) -> Booleans:
    """Return (n,) bool: which points lie inside an object.

    Exact, by the parity of the faces that a ray from the point crosses, counted for each object by itself. Only closed
    meshes have an inside: those whose edges all belong to an even number of triangles, where vertices at one position
    count as one. A point on a face lies inside on one of two opposite faces.

    Parameters
    ----------
    depsgraph : bpy.types.Depsgraph, evaluated
    points : (n, 3) or (3,), metres, world
    objects, collection, visibility : what points may lie in, as `ray_cast`; name one object to ask for that

    Raises
    ------
    ValueError
        If an argument is not what is said above; the sentence names it.

    Examples
    --------
    >>> import bpy
    >>> from addon import inside
    >>> inside(bpy.context.evaluated_depsgraph_get(), [(0.5, 0.5, 0.5), (1.5, 0, 0)]).tolist()
    [True, False]

    References
    ----------
    H. Edelsbrunner and E. Muecke, "Simulation of simplicity" (1990), for points and rays that touch edges and vertices.
    """
    selection = make_selection(objects, collection, visibility)
    places = as_points(points)
    held, _ = find_held(depsgraph, selection)
    return held.caster.inside(places)


def visible(
    depsgraph: Any,
    points: ArrayLike,
    from_: ArrayLike,
    *,
    tolerance: ArrayLike | None = None,
    objects: Any = None,
    collection: Any = None,
    visibility: str = "viewport",
) -> Booleans:
    """Return (n,) bool: which points are seen from a place, with nothing on the straight way between.

    The way starts at the point and leaves out its first `tolerance` metres, because points of a surface lie before or
    behind it by what rounds; the place itself counts as free.

    Parameters
    ----------
    depsgraph : bpy.types.Depsgraph, evaluated
    points : (n, 3) or (3,), metres, world
    from_ : (n, 3) or (3,), metres, world, for instance the camera's location
    tolerance : number or (n,), metres; None: eight roundings of float32 of the largest coordinate, which is what
        coordinates of Blender's are off by. 0 for points that are exact, such as vertices of an object that is not
        transformed
    objects, collection, visibility : what can hide a point, as `ray_cast`

    Returns
    -------
    (n,) bool. Points that are NaN or infinite are not seen.

    Raises
    ------
    ValueError
        If an argument is not what is said above; the sentence names it.

    Examples
    --------
    >>> import bpy
    >>> from addon import visible
    >>> visible(bpy.context.evaluated_depsgraph_get(), [(0, 0, 1), (0, 0, -1), (5, 0, 0)], (4, 3, 5)).tolist()
    [True, False, True]
    """
    selection = make_selection(objects, collection, visibility)
    ends, starts = as_points(points), as_eyes(from_)
    count = max(len(ends), len(starts)) if len(ends) and len(starts) else 0
    if len(starts) not in (1, len(ends)) and len(ends) != 1:
        raise ValueError(f"from_: expected one place or as many as points, {len(ends)}, got {len(starts)}")
    ends, starts = (np.broadcast_to(rows, (count, 3)) for rows in (ends, starts))
    finite = np.isfinite(ends).all(axis=1) & np.isfinite(starts).all(axis=1)
    if tolerance is None:
        tolerance = FLOAT32_COORDINATES * np.where(finite, np.maximum(np.abs(ends), np.abs(starts)).max(axis=1), 0.0)
    kept_free = check_metres(tolerance, count, "tolerance")
    held, _ = find_held(depsgraph, selection)
    with np.errstate(invalid="ignore", divide="ignore"):
        way = starts - ends
        first = kept_free / length(way)
    # What is hit at the very point is no more in the way than what is hit within the tolerance.
    first = np.where(finite & (first >= 0), np.maximum(first, np.nextafter(0.0, 1.0)), np.nextafter(0.0, 1.0))
    return finite & ~held.casters.any_hit(make_rays(ends, way, first, np.nextafter(1.0, 0.0)))


def as_eyes(from_: ArrayLike) -> Floats:
    """Return the places of `from_`; the sentence of an error names it."""
    try:
        return as_points(from_)
    except ValueError as error:
        raise ValueError(str(error).replace("points", "from_", 1)) from None
