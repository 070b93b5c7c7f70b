"""A caster of some of a scene's objects, which numbers what it hits as the whole scene does."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from raytracer.arrays.types import Booleans
from raytracer.casting.caster import Caster, build
from raytracer.casting.ray_visibility import SceneCaster
from raytracer.casting.rays import Hits
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Instances


class SubsetCaster:
    """Casts into those instances and groups of spheres of `whole` that are `present` (instances + groups,) bool."""

    def __init__(self, whole: SceneCaster, present: Booleans) -> None:
        self._number = np.flatnonzero(present).astype(np.int32)
        self._caster: Caster = build(take_part(whole.scene, present), whole.primitives.precision)

    @property
    def roundoff(self) -> float:
        return self._caster.roundoff

    def closest_hit(self, *arguments: Any, **keywords: Any) -> Hits:
        """Return what `Caster.closest_hit` does."""
        hits = self._caster.closest_hit(*arguments, **keywords)
        met = hits.hit
        hits.instance[met] = self._number[hits.instance[met]]
        return hits

    def any_hit(self, *arguments: Any, **keywords: Any) -> Booleans:
        """Return what `Caster.any_hit` does."""
        return self._caster.any_hit(*arguments, **keywords)


def take_part(scene: Scene, present: Booleans) -> Scene:
    """Return the geometry of a scene's instances and groups of spheres that are `present`, in their order."""
    count = scene.instance_count
    placed = np.flatnonzero(present[:count])
    mesh, matrices = np.arange(count), np.broadcast_to(np.eye(4), (count, 4, 4))
    if scene.instances is not None:
        mesh, matrices = scene.instances.mesh, scene.instances.world_from_object
    used, mesh = np.unique(mesh[placed], return_inverse=True)
    return replace(
        scene,
        meshes=[scene.meshes[index] for index in used],
        instances=Instances(mesh, matrices[placed]),
        spheres=[group for group, stays in zip(scene.spheres, present[count:], strict=True) if stays],
    )
