"""What a cast returns: Scene.ray_cast's results as arrays, and more of the hit, read only when it is asked for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Integers
from raytracer.casting.geometry import join_id, split_id
from raytracer.surfaces.surface_tables import measure_triangles

from .attributes import HitPlaces, read_attribute, read_materials
from .held import Held
from .placements import NO_ID, Placement

# With up to so many triangles for each hit, a table over all triangles costs less than measuring one for each hit.
SHARED_TRIANGLES = 16


class Objects(NamedTuple):
    """What the placements of a scene stand for.

    objects, instancers : the original objects that can be hit, and those that make instances of them
    object, instancer : (k + 1,) int32, index of each placement's; the last is -1, for misses
    persistent_ids : (k + 1, 8) int32, Blender's numbers of instances; 0 for what is none
    matrices : (k + 1, 4, 4) float64, world from object; the last is the identity
    missing : the original objects that renders show and the depsgraph does not hold
    """

    objects: tuple[Any, ...]
    instancers: tuple[Any, ...]
    object: Integers
    instancer: Integers
    persistent_ids: Integers
    matrices: Floats
    missing: tuple[Any, ...]


def make_objects(held: Held, placements: list[Placement], missing: tuple[Any, ...]) -> Objects:
    """Return what the placements of a call stand for."""
    objects, numbers = _number([placement.original for placement in placements])
    instancers, makers = _number([placement.instancer for placement in placements])
    identities = [*(placement.persistent_id for placement in placements), NO_ID]
    return Objects(
        objects,
        instancers,
        numbers,
        makers,
        np.array(identities, dtype=np.int32),
        np.concatenate([held.world_from_object, np.eye(4)[np.newaxis]]),
        missing,
    )


def _number(things: list[Any]) -> tuple[tuple[Any, ...], Integers]:
    """Return the distinct things, None left out, and the number of each thing, -1 for None; then -1."""
    distinct = tuple(dict.fromkeys(thing for thing in things if thing is not None))
    number = {thing: row for row, thing in enumerate(distinct)}
    return distinct, np.array([*(number.get(thing, -1) for thing in things), -1], dtype=np.int32)


@dataclass(frozen=True, eq=False)
class RayCastResult:
    """The results of n rays: those of Scene.ray_cast, in its order, as arrays.

    With `hits=k` all arrays are (n, k) where (n,) is said: the k surfaces that each ray meets first, in exact order.
    `result, location, normal, index, object, matrix = cast` unpacks what Scene.ray_cast returns.

    result : (n,) bool, True where the ray hits
    location : (n, 3) float64, metres, world; 0 for a miss
    normal : (n, 3) float64, unit, world, of the flat triangle, on the side of the object's own normal, whichever is
        hit; 0 for a miss. Scene.ray_cast's is not perpendicular under non-uniform scale before Blender 5.2
    index : (n,) int32, the polygon of the evaluated mesh; -1 for a miss, where Scene.ray_cast says 0
    object : (n,) int32, index into `objects`; -1 for a miss, where Scene.ray_cast says None
    objects : the original objects that have something to hit; of an instance, the object that is instanced
    placement : (n,) int32, row of `matrices`: tells instances apart that share an object; -1 for a miss
    matrices : (k + 1, 4, 4) float64, world from object, of what rays can hit; the last is the identity, for misses
    distance : (n,) float64, metres from the origin; inf for a miss
    distance_error : (n,) float64, metres, certified bound on |distance - exact|; 0 for a miss
    barycentric : (n, 2) float64, weights of corners 1 and 2 of the triangle that is hit; 0 for a miss
    vertices : (n, 3) int32, its corners, vertices of the evaluated mesh; -1 for a miss
    instancer : (n,) int32, index into `instancers`; -1 where what is hit is no instance, and for a miss
    instancers : the original objects that make instances
    missing : original objects that renders show, but this depsgraph does not hold, as they are disabled in viewports;
        none where visibility is 'viewport'
    """

    result: NDArray[np.bool_]
    location: Floats
    normal: Floats
    index: Integers
    object: Integers
    placement: Integers
    distance: Floats
    distance_error: Floats
    barycentric: Floats
    vertices: Integers
    shown: Objects
    places: HitPlaces

    def __len__(self) -> int:
        return len(self.result)

    def __iter__(self) -> Iterator[Any]:
        """Yield the six results of Scene.ray_cast, in its order."""
        yield from (self.result, self.location, self.normal, self.index, self.object, self.matrix)

    @property
    def objects(self) -> tuple[Any, ...]:
        return self.shown.objects

    @property
    def matrices(self) -> Floats:
        return self.shown.matrices

    @property
    def instancers(self) -> tuple[Any, ...]:
        return self.shown.instancers

    @property
    def missing(self) -> tuple[Any, ...]:
        return self.shown.missing

    @property
    def matrix(self) -> Floats:
        """(n, 4, 4) float64, world from object of what each ray hit; the identity for a miss. Made when asked for."""
        return self.shown.matrices[self.placement]

    @property
    def instancer(self) -> Integers:
        return self.shown.instancer[self.placement]

    @property
    def persistent_id(self) -> Integers:
        """(n, 8) int32, Blender's numbers of the instance that is hit; 0 for what is no instance, and for a miss."""
        return self.shown.persistent_ids[self.placement]

    def attribute(self, name: str, depsgraph: Any = None) -> Floats:
        """Return an attribute of the meshes that are hit, at the hits: UV maps, colors, vertex groups, any other.

        name : such as 'UVMap'; the attribute of that name, or else the vertex group
        depsgraph : the one that was cast into; None finds that of a view layer

        Returns
        -------
        (n,) float64, (n, k) for vectors and colors (linear, with alpha). Values of vertices and corners are
        interpolated by the barycentric weights, v = (1 - b1 - b2) v0 + b1 v1 + b2 v2; those of faces are as they are.
        NaN for a miss, and on meshes that have none.

        Raises
        ------
        ValueError
            If no mesh that is hit has it, its values are no numbers or belong to edges, it differs in width between
            meshes, or a mesh has changed since.
        """
        return read_attribute(self.places, name, depsgraph)

    @cached_property
    def _materials(self) -> tuple[tuple[Any, ...], Integers]:
        return read_materials(self.places)

    @property
    def materials(self) -> tuple[Any, ...]:
        """The original materials that are hit. Read when asked for, from the view layer that was cast into."""
        return self._materials[0]

    @property
    def material(self) -> Integers:
        """(n,) int32, index into `materials`; -1 for a miss, and where there is no material."""
        return self._materials[1]


def find_normals(held: Held, instance: Integers, primitive: Integers) -> Floats:
    """Return the unit normals (n, 3) of triangles, on the side of the object's normal as in Blender.

    Where many rays share a triangle, which is likely if there are not many more triangles than rays, each is measured
    once.
    """
    geometry = held.geometry
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


def find_surface(
    held: Held, hit: Booleans, instance: Integers, primitive: Integers
) -> tuple[Floats, Integers, Integers]:
    """Return normal (n, 3), polygon (n,) and vertices (n, 3) of triangles; 0, -1 and -1 for a miss."""
    index = held.polygons[held.first_polygon[instance] + primitive]  # a miss finds the last entries, -1
    normal, vertices = np.zeros((len(hit), 3)), np.full((len(hit), 3), -1, np.int32)
    rows = np.flatnonzero(hit)
    if len(rows):
        geometry = held.geometry
        normal[rows] = find_normals(held, instance[rows], primitive[rows])
        mesh = geometry.instance_mesh[instance[rows]]
        vertices[rows] = geometry.triangles[geometry.mesh_first[mesh] + primitive[rows]] - held.first_vertex[mesh, None]
    return normal, index, vertices
