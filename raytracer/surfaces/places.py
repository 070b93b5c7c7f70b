"""The order in which rays meet surfaces that lie at one place, by the layers that those are (`layers`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Integers
from raytracer.casting.geometry import join_id
from raytracer.casting.order import STOPPING, SortKeys
from raytracer.lecture import dot
from raytracer.surfaces.layers import MEDIUM, OPAQUE
from raytracer.surfaces.surface_tables import SurfaceTables, measure_triangles

# The key of the first instance of glass and the like; those of the others, before it, are beyond all sheets' keys.
BOUNDARY = 1 << 33
# The key of a surface that nothing passes, for the rays that leave it: all that lies upon it comes after.
LEFT_BEHIND = np.iinfo(np.int64).min


def find_layers(tables: SurfaceTables, instance: Integers, primitive: Integers) -> SortKeys:
    """Return the keys (k,) of primitives as rays meet them from their front; from the back they are the negative,
    except from STOPPING on; none is 0."""
    assert tables.layers is not None
    material = tables.material[tables.material_first[instance] + tables.material_step[instance] * primitive]
    kind = tables.layers.kind[material]
    number = instance.astype(np.int64)
    layer = np.where(kind == MEDIUM, BOUNDARY - number, 1 + number)
    stopping = STOPPING * (1 + tables.layers.stage[instance]) + join_id(tables.geometry, instance, primitive)
    return np.where(kind == OPAQUE, stopping, layer)


def turn_layers(layers: SortKeys, front: Booleans) -> SortKeys:
    """Return the keys (k,) of layers for rays that come to the front, or not."""
    return np.where(front | (layers >= STOPPING), layers, -layers)


@dataclass(frozen=True, eq=False)
class SurfaceOrder:
    """The Order (`casting.order`) of a scene's surfaces. Spheres have but one side here: they lie on nothing flat."""

    tables: SurfaceTables

    def find_keys(self, directions: Floats, instance: Integers, primitive: Integers) -> SortKeys:
        """Return (k,) keys of primitives as rays of directions (k, 3) meet them."""
        front = self._project(directions, instance, primitive) <= 0
        return turn_layers(find_layers(self.tables, instance, primitive), front)

    def find_crossed(self, directions: Floats, approach: Floats, instance: Integers, primitive: Integers) -> Booleans:
        """Return (k,) True where a ray leads to the other side of a triangle than `approach` (k, 3) is on."""
        ahead = self._project(directions, instance, primitive)
        return ahead * self._project(approach, instance, primitive) < 0

    def _project(self, vectors: Floats, instance: Integers, primitive: Integers) -> Floats:
        """Return the components (k,) of vectors along triangles' geometric normals; 0 for spheres."""
        along = np.zeros(len(vectors))
        flat = np.flatnonzero(instance < self.tables.instance_count)
        if len(flat):
            along[flat] = dot(self._find_normals(instance[flat], primitive[flat]), vectors[flat])
        return along

    def _find_normals(self, instance: Integers, primitive: Integers) -> NDArray[np.float64]:
        tables = self.tables
        if tables.triangles is None:
            return measure_triangles(tables.geometry, tables.mirrored, instance, primitive).normal
        return tables.triangles.normal.take(join_id(tables.geometry, instance, primitive), axis=0)


def make_order(tables: SurfaceTables) -> SurfaceOrder | None:
    """Return the order of a scene's surfaces; None where it makes no difference."""
    return None if tables.layers is None else SurfaceOrder(tables)
