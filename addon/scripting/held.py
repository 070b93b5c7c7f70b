"""The caster that is kept from call to call, one for each view layer and mode, and brought up to date by comparison.

Only arrays are kept, no handle to Blender's data: undo, deletion and a new file cannot leave anything dangling. A new
file lets go of the arrays as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent
from numpy.typing import NDArray

import raytracer
from raytracer.arrays.types import Booleans
from raytracer.casting.geometry import Geometry, pack_geometry
from raytracer.casting.moving import MovingCaster, follow_moving
from raytracer.casting.rays import Hits, Rays

from ..handlers import HANDLERS, join, leave
from .placements import Key, Placement, ShapeTable, list_placements
from .selection import Selection
from .shapes import Shape

# A scene's `session_uid`, the name of its view layer, viewport or render mode, and what is cast into of it.
View = tuple[int, str, str, Selection]
# Casters that are kept: those used last. A script rarely turns between more views, and each may be large.
MOST_HELD = 4
EVERYTHING = Selection()


@dataclass(eq=False)
class Casters:
    """What casts rays into a scene: one caster of the whole, built when it is asked for, or of what stays and moves.

    before : the caster of the whole scene as it was when there was one last
    moving : where a few placements move
    """

    scene: raytracer.Scene
    geometry: Geometry
    before: raytracer.Caster | None = None
    moving: MovingCaster | None = None
    _whole: raytracer.Caster | None = None

    @property
    def whole(self) -> raytracer.Caster:
        if self._whole is None:
            self._whole, self.before = raytracer.build(self.scene, last=self.before), None
        return self._whole

    @property
    def latest(self) -> raytracer.Caster | None:
        """The last caster of a whole scene."""
        return self._whole or self.before

    def closest_hit(self, rays: Rays) -> Hits:
        """Return the closest hit of each ray."""
        if self.moving is not None:
            return self.moving.closest_hit(rays)
        return self.whole.closest_hit(rays.origins, rays.directions, rays.t_min, rays.t_max)

    def any_hit(self, rays: Rays) -> Booleans:
        """Return (n,) bool, whether anything is hit."""
        if self.moving is not None:
            return self.moving.any_hit(rays)
        return self.whole.any_hit(rays.origins, rays.directions, rays.t_min, rays.t_max)


@dataclass(frozen=True, eq=False)
class Held:
    """What rays are cast into, and what it was made from.

    view : what it is kept for
    shapes : by key
    shape_of_placement : (i,) the shape of each placement; placements are the scene's instances
    world_from_object : (i, 4, 4) float64
    mirrored : (i,) bool, True where the matrix turns the winding around
    polygons : (t + 1,) int32, the polygons of all triangles of all shapes, then -1
    first_polygon : (i + 1,) int64, entry of `polygons` at which each placement's begin; then t + 1, so that a miss,
        with instance and primitive -1, finds -1
    first_vertex : (m,) int64, the first vertex of each of the scene's meshes among those of all
    """

    view: View
    shapes: dict[Key, Shape]
    shape_of_placement: tuple[Shape, ...]
    world_from_object: NDArray[np.float64]
    mirrored: NDArray[np.bool_]
    polygons: NDArray[np.int32]
    first_polygon: NDArray[np.int64]
    first_vertex: NDArray[np.int64]
    casters: Casters

    @property
    def caster(self) -> raytracer.Caster:
        """The caster of the whole scene."""
        return self.casters.whole

    @property
    def geometry(self) -> Geometry:
        return self.casters.geometry


_held: dict[View, Held] = {}


def find_held(depsgraph: Any, selection: Selection = EVERYTHING) -> tuple[Held, list[Placement]]:
    """Return what can be hit as it is now, and its placements.

    Raises
    ------
    ValueError
        If `depsgraph` is none.
    """
    if not isinstance(depsgraph, bpy.types.Depsgraph):
        raise ValueError(f"depsgraph: expected a bpy.types.Depsgraph, got {type(depsgraph).__name__}")
    view = depsgraph.scene.session_uid, depsgraph.view_layer.name, depsgraph.mode, selection
    last = _held.pop(view, None)
    table = ShapeTable(last.shapes if last else {})
    placements = list_placements(depsgraph, table, selection)
    held = renew(last, view, table.shapes, placements)
    _held[view] = held  # at the end: the order is that of use
    while len(_held) > MOST_HELD:
        del _held[next(iter(_held))]
    join(forget, HANDLERS.load_post)
    return held, placements


def renew(last: Held | None, view: View, shapes: dict[Key, Shape], placements: list[Placement]) -> Held:
    """Return `last` where nothing moved or changed, or what takes its place; trees of what did not move are kept."""
    shape_of_placement = tuple(placement.shape for placement in placements)
    matrices = np.array([placement.world_from_object for placement in placements]).reshape(-1, 4, 4)
    if last and last.shape_of_placement == shape_of_placement and np.array_equal(last.world_from_object, matrices):
        return last
    distinct = list(dict.fromkeys(shape_of_placement))
    number = {shape: row for row, shape in enumerate(distinct)}
    mesh = np.array([number[shape] for shape in shape_of_placement], dtype=np.int32)
    scene = raytracer.Scene(
        meshes=[shape.mesh for shape in distinct],
        instances=raytracer.Instances(mesh=mesh, world_from_object=matrices),
    )
    polygons = np.concatenate([*(shape.polygons for shape in distinct), np.array([-1], dtype=np.int32)])
    first = np.cumsum([0, *(len(shape.polygons) for shape in distinct)])
    return Held(
        view,
        shapes,
        shape_of_placement,
        matrices,
        mirrored=np.linalg.det(matrices[:, :3, :3]) < 0,
        polygons=polygons,
        first_polygon=np.append(first[mesh], len(polygons)),
        first_vertex=np.cumsum([0, *(len(shape.mesh.positions) for shape in distinct)])[:-1],
        casters=renew_casters(last, scene, shape_of_placement, matrices),
    )


def renew_casters(
    last: Held | None, scene: raytracer.Scene, shape_of_placement: tuple[Shape, ...], matrices: NDArray[np.float64]
) -> Casters:
    """Return what casts into a scene that has changed."""
    geometry = pack_geometry(scene)
    if last is None:
        return Casters(scene, geometry)
    casters = Casters(scene, geometry, last.casters.latest)
    if len(last.shape_of_placement) == len(shape_of_placement):
        changed = (last.world_from_object != matrices).any(axis=(1, 2))
        changed |= [one is not other for one, other in zip(last.shape_of_placement, shape_of_placement, strict=True)]
        casters.moving = follow_moving(scene, geometry, changed, last.casters.moving)
    return casters


@persistent
def forget(*_: Any) -> None:
    """Let go of all casters; called when a file is loaded."""
    _held.clear()


def unregister() -> None:
    """Let go of all casters, and of being called."""
    forget()
    leave(forget, HANDLERS.load_post)
