"""Instances of emissive meshes, sampled in two steps, so that their triangles are never listed in the world.

Instance i is picked with probability P_i = W_i / W, its share of the power of all emitters, then triangle t of its mesh
with probability q_t. With A_it the triangle's area in the world and L_t the mean radiance of its material

    W_i = sum_t L_t A_it,    q_t ~ L_t sum_i A_it over the instances of the mesh,    density per area P_i q_t / A_it

The density is exact for all matrices. Where those of a mesh turn, mirror and scale it, or stretch it alike, A_it is
s_i A_t, and the density is L_t / W: the same as if triangles were picked one by one. Where each instance is stretched
in its own way, its triangles are picked by their mean area instead, which costs some noise and no bias.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import any_column
from raytracer.arrays.types import Floats, Integers
from raytracer.lecture import cross, dot, length
from raytracer.surfaces.surface_tables import LARGEST_TABLE, SurfaceTables

Ids = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class InstancedEmitters:
    """Emissive meshes that are sampled by instance and triangle; k of their triangles, packed mesh by mesh.

    instance : (j,) int32, their instances, in rising order
    power : (instances,) float64, W_i of each of the scene's instances; 0 of others
    first : (instances,) int64, row of `cumulative` at which the mesh of each begins; -1 of others
    count : (instances,) int64, triangles of the mesh
    cumulative : (k,) float64, running sum of q_t over each mesh, ending at 1
    chance : (k,) float64, q_t
    """

    instance: Integers
    power: Floats
    first: Ids
    count: Ids
    cumulative: Floats
    chance: Floats


def find_instanced_meshes(tables: SurfaceTables, radiance: Floats, records: Integers, largest: int) -> Integers:
    """Return the emissive meshes with several instances, where all emissive triangles are more than `largest`.

    radiance : (materials, 3); records : (r,) the instances and groups that count
    """
    geometry = tables.geometry
    instances = records[records < len(geometry.instance_mesh)]
    meshes, first, counts = np.unique(geometry.instance_mesh[instances], return_index=True, return_counts=True)
    if counts.max(initial=0) < 2:
        return meshes[:0]
    shining = np.array([len(find_emissive(tables, record, radiance)) for record in instances[first]])
    if (shining * counts).sum() <= largest:
        return meshes[:0]
    return meshes[(counts > 1) & (shining > 0)]


def find_emissive(tables: SurfaceTables, record: int, radiance: Floats) -> Integers:
    """Return the emissive primitives of one instance or group."""
    first_id = tables.geometry.first_id
    primitives = np.arange(first_id[record + 1] - first_id[record], dtype=np.int32)
    material = find_materials(tables, np.full(len(primitives), record, dtype=np.int32), primitives)
    return primitives[any_column(radiance[material] != 0)]


def find_materials(tables: SurfaceTables, instance: Integers, primitive: Integers) -> Integers:
    """Return the materials (n,) of primitives."""
    return tables.material[tables.material_first[instance] + tables.material_step[instance] * primitive]


def make_instanced_emitters(
    tables: SurfaceTables, meshes: Integers, records: Integers, radiance: Floats, mean: Floats
) -> InstancedEmitters | None:
    """Measure the instances, among `records`, of some meshes; None where there are no meshes.

    radiance : (materials, 3), other than 0 where a material shines; mean : (materials,) its size
    """
    if not len(meshes):
        return None
    geometry = tables.geometry
    total = len(geometry.instance_mesh)
    power, first, count = np.zeros(total), np.full(total, -1, dtype=np.int64), np.zeros(total, dtype=np.int64)
    instances = records[records < total]
    cumulative, chance, start = [], [], 0
    for mesh in meshes:
        placed = instances[geometry.instance_mesh[instances] == mesh]
        areas, power[placed] = _measure_mesh(tables, placed, radiance, mean)
        running = np.cumsum(areas)
        first[placed], count[placed] = start, len(areas)
        cumulative.append(running / running[-1] if running[-1] > 0 else running)
        chance.append(areas / running[-1] if running[-1] > 0 else areas)
        start += len(areas)
    instance = np.flatnonzero(power > 0).astype(np.int32)
    return InstancedEmitters(instance, power, first, count, np.concatenate(cumulative), np.concatenate(chance))


def _measure_mesh(tables: SurfaceTables, placed: Integers, radiance: Floats, mean: Floats) -> tuple[Floats, Floats]:
    """Return sum_i L_t A_it (t,) and W_i (i,) of the instances `placed` (i,) of one mesh.

    M u x M v = cof(M) (u x v): A_it is the length of the cofactor matrix times the triangle's area vector.
    """
    geometry, mesh = tables.geometry, tables.geometry.instance_mesh[placed[0]]
    rows = slice(geometry.mesh_first[mesh], geometry.mesh_first[mesh] + geometry.mesh_count[mesh])
    a, b, c = (geometry.positions[geometry.triangles[rows, corner]] for corner in range(3))
    vectors = np.concatenate([cross(b - a, c - a) / 2.0, np.zeros((len(a), 0))], axis=1)
    primitive = np.arange(len(a), dtype=np.int32)
    material = find_materials(tables, np.full(len(a), placed[0], dtype=np.int32), primitive)
    size = np.where(any_column(radiance[material] != 0), mean[material], 0.0)
    by_triangle, by_instance = np.zeros(len(a)), []
    step = max(LARGEST_TABLE // len(a), 1)
    for begin in range(0, len(placed), step):
        cofactors = tables.normal_from_object[placed[begin : begin + step], np.newaxis]
        areas = length(dot(cofactors, vectors[:, np.newaxis, :]))
        powers = areas * size
        by_triangle += powers.sum(axis=0)
        by_instance.append(powers.sum(axis=1))
    return by_triangle, np.concatenate(by_instance)


def pick_triangles(instanced: InstancedEmitters, instance: Integers, choice: Floats) -> Ids:
    """Return triangles (n,) of the meshes of `instance` (n,) with probabilities q_t, for uniform numbers (n,) below 1.

    The first whose running sum is above the number, by bisection within the mesh's rows.
    """
    low = instanced.first[instance]
    high = low + instanced.count[instance] - 1
    for _ in range(int(instanced.count.max(initial=1) - 1).bit_length()):
        middle = (low + high) // 2
        above = instanced.cumulative[middle] > choice
        high = np.where(above, middle, high)
        low = np.where(above, low, np.minimum(middle + 1, high))
    return low - instanced.first[instance]


def find_chances(instanced: InstancedEmitters, instance: Integers, primitive: Integers) -> tuple[Ids, Floats]:
    """Return the rows (k,) of those of n triangles that are picked by instance, and W_i q_t of each of them."""
    first = instanced.first[instance]
    rows = np.flatnonzero(first >= 0)
    return rows, instanced.power[instance[rows]] * instanced.chance[first[rows] + primitive[rows]]
