"""A caster of some of a scene's objects, which numbers what it hits as the whole scene does."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from raytracer.arrays.types import Booleans, Floats, Integers
from raytracer.casting.caster import Caster, build
from raytracer.casting.order import Order, SortKeys
from raytracer.casting.ray_visibility import SceneCaster
from raytracer.casting.rays import Hits
from raytracer.scene.curves import Curves
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Instances, Spheres


class SubsetCaster:
    """Casts into those instances and groups of `whole` that are `present` (instances + groups,) bool."""

    def __init__(self, whole: SceneCaster, present: Booleans) -> None:
        self._number = np.flatnonzero(present).astype(np.int32)
        self._place = np.cumsum(present).astype(np.int32) - 1
        self._caster: Caster = build(take_part(whole.scene, present), whole.primitives.precision)

    @property
    def roundoff(self) -> float:
        return self._caster.roundoff

    def closest_hit(
        self, *arguments: Any, after: Hits | None = None, order: Order | None = None, **keywords: Any
    ) -> Hits:
        """Return what `Caster.closest_hit` does; after : hits of objects that are present."""
        if after is not None:
            after = replace(after, instance=np.where(after.hit, self._place[after.instance], -1))
        if order is not None:
            order = PartOrder(order, self._number)
        hits = self._caster.closest_hit(*arguments, after=after, order=order, **keywords)
        met = hits.hit
        hits.instance[met] = self._number[hits.instance[met]]
        return hits

    def any_hit(self, *arguments: Any, order: Order | None = None, **keywords: Any) -> Booleans:
        """Return what `Caster.any_hit` does."""
        if order is not None:
            order = PartOrder(order, self._number)
        return self._caster.any_hit(*arguments, order=order, **keywords)


@dataclass(frozen=True, eq=False)
class PartOrder:
    """The Order of a whole scene, asked by the numbers of a part's instances.

    number : (k,) int32, of each of them in the whole scene
    """

    whole: Order
    number: Integers

    def find_keys(self, directions: Floats, instance: Integers, primitive: Integers) -> SortKeys:
        """Return what the whole scene's order does."""
        return self.whole.find_keys(directions, self.number[instance], primitive)

    def find_crossed(self, directions: Floats, approach: Floats, instance: Integers, primitive: Integers) -> Booleans:
        """Return what the whole scene's order does."""
        return self.whole.find_crossed(directions, approach, self.number[instance], primitive)


def take_part(scene: Scene, present: Booleans) -> Scene:
    """Return the geometry of a scene's instances and groups that are `present`, in their order, at this moment."""
    count = scene.instance_count
    placed = np.flatnonzero(present[:count])
    mesh, matrices = np.arange(count), np.broadcast_to(np.eye(4), (count, 4, 4))
    if scene.instances is not None:
        mesh, matrices = scene.instances.mesh, scene.instances.world_from_object
    used, mesh = np.unique(mesh[placed], return_inverse=True)
    groups = [group for group, stays in zip(scene.groups, present[count:], strict=True) if stays]
    return replace(
        scene,
        meshes=[scene.meshes[index] for index in used],
        instances=Instances(mesh, matrices[placed]),
        spheres=[group for group in groups if isinstance(group, Spheres)],
        curves=[group for group in groups if isinstance(group, Curves)],
        # Which number objects, and meshes.
        light_groups=None,
        motion=None,
        neighbors=None,
    )
