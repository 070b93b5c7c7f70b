"""This caster against Blender's Scene.ray_cast: the same rays into the same evaluated scene, differences judged.

Where the two disagree, and on a sample of the rays where they agree, `judge` decides in integers which is wrong.
Scene.ray_cast knows no point clouds and no hair, so they are left out, and what it alone knows is added: emitters of
particles and others that renders do not show.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats
from raytracer.casting.caster import build
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Instances

from ...extract.camera import extract_camera
from ...extract.scene import extract_scene
from ...extract.warnings import WarningList
from ...scripting.placements import Placement, ShapeTable, list_placements
from ...scripting.selection import Selection
from ..verdicts import AGREES, DIFFERS
from .judge import Judge
from .rays import Aimed, aim_rays
from .sides import Answers, Key, Sides, cast_blender, cast_ours, key_of, measure_normal_error

# Rays on which both sides agree and which are judged all the same.
JUDGED_AGREEING = 256


@dataclass(frozen=True, eq=False)
class RayCastComparison:
    """The answers of both sides to n rays, and what the judge says.

    position_error, normal_error : (n,) between the two sides, metres and unit vectors; NaN where a side misses
    judged : (j,) the rays that were judged; ours_wrong, blender_wrong : (j,) bool
    """

    rays: Aimed
    ours: Answers
    blender: Answers
    position_error: Floats
    normal_error: Floats
    judged: NDArray[np.intp]
    ours_wrong: Booleans
    blender_wrong: Booleans

    @property
    def agreeing(self) -> Booleans:
        """(n,) rays on which both hit the same polygon of the same object."""
        return find_same(self.ours, self.blender) & (self.ours.target >= 0)

    def summarise(self) -> dict[str, Any]:
        """Return the numbers that the command line prints, one JSON object."""
        ours, blender, agreeing = self.ours.target, self.blender.target, self.agreeing
        both = (ours >= 0) & (blender >= 0)
        return {
            "rays": len(ours),
            "wrong_hit": int(((ours >= 0) != (blender >= 0)).sum()),
            "wrong_object": int((both & (ours != blender)).sum()),
            "wrong_polygon": int((both & (ours == blender) & ~agreeing).sum()),
            "max_position_error": float(self.position_error[agreeing].max(initial=0.0)),
            "max_normal_error": float(self.normal_error[agreeing].max(initial=0.0)),
            "judged": len(self.judged),
            "ours_wrong": int(self.ours_wrong.sum()),
            "blender_wrong": int(self.blender_wrong.sum()),
            "ours_seconds": self.ours.seconds,
            "blender_seconds": self.blender.seconds,
            **dict(zip(("verdict", "reason"), self.decide(), strict=True)),
        }

    def decide(self) -> tuple[str, str]:
        """Return the verdict on this caster, `AGREES` (with exact arithmetic) or `DIFFERS`, and the reason in words."""
        wrong, judged = int(self.ours_wrong.sum()), len(self.judged)
        if wrong:
            return DIFFERS, f"ours is wrong on {wrong} of {judged} rays judged by exact arithmetic"
        return (
            AGREES,
            f"ours is right on all {judged} rays judged by exact arithmetic, with all on which the two differ",
        )


def find_same(ours: Answers, blender: Answers) -> Booleans:
    """Return (n,) True where both sides hit the same polygon of the same object, or both miss."""
    return (ours.target == blender.target) & (ours.polygon == blender.polygon)


def compare_with_ray_cast(
    scene: Any, depsgraph: Any, width: int, height: int, count: int, seed: int = 0
) -> tuple[RayCastComparison, Sides]:
    """Cast the camera's rays (width x height) and `count` rays of each other family of `rays` on both sides, at
    geometry that no material moves: Blender's rays know of no other."""
    sides = make_sides(scene, depsgraph)
    camera = extract_camera(depsgraph.scene_eval, WarningList())
    rays = aim_rays(sides.caster.geometry, camera, width, height, count, seed)
    return compare_sides(sides, rays, seed), sides


def make_sides(scene: Any, depsgraph: Any) -> Sides:
    """Return both sides for what a depsgraph shows."""
    extraction = extract_scene(depsgraph, geometry_only=True)
    meshes, instances = extraction.scene.meshes, extraction.scene.instances
    assert instances is not None
    matrices = instances.world_from_object
    keys = [key_of(shown.name, matrix) for shown, matrix in zip(extraction.objects, matrices, strict=False)]
    hidden = list_hidden(depsgraph, set(keys))
    keys += hidden
    # Instances that look the same to Blender, name and matrix, count as one: the first.
    target_of_key = {key: number for number, key in reversed(list(enumerate(keys)))}
    shapes = [placement.shape for placement in hidden.values()]
    both = Instances(
        mesh=np.append(instances.mesh, len(meshes) + np.arange(len(hidden))).astype(np.int32),
        world_from_object=np.array([*matrices, *(placement.world_from_object for placement in hidden.values())]),
    )
    return Sides(
        caster=build(Scene(meshes=[*meshes, *(shape.mesh for shape in shapes)], instances=both)),
        ray_cast=partial(scene.ray_cast, depsgraph),
        target_of_instance=np.array([target_of_key[key] for key in keys], dtype=np.int64),
        target_of_key=target_of_key,
        polygons=(*extraction.polygons, *(shape.polygons for shape in shapes)),
    )


def list_hidden(depsgraph: Any, shown: set[Key]) -> dict[Key, Placement]:
    """Return what Scene.ray_cast hits besides what is shown, by its Key."""
    placements = list_placements(depsgraph, ShapeTable({}), Selection())
    named = {key_of(found.original.name_full, found.world_from_object): found for found in placements}
    return {key: found for key, found in named.items() if key not in shown}


def compare_sides(sides: Sides, rays: Aimed, seed: int = 0) -> RayCastComparison:
    """Cast the rays on both sides, and judge where they differ and `JUDGED_AGREEING` of the others."""
    (ours, hits), blender = cast_ours(sides, rays), cast_blender(sides, rays)
    same = find_same(ours, blender)
    sample = np.random.default_rng(seed).permutation(np.flatnonzero(same))[:JUDGED_AGREEING]
    judged = np.concatenate([np.flatnonzero(~same), np.sort(sample)])
    return RayCastComparison(
        rays,
        ours,
        blender,
        np.linalg.norm(ours.location - blender.location, axis=1),
        measure_normal_error(sides, hits, blender.normal),
        judged,
        *judge_answers(sides, rays, judged, (ours, blender)),
    )


def judge_answers(sides: Sides, rays: Aimed, judged: NDArray[np.intp], answers: tuple[Answers, ...]) -> Booleans:
    """Return (sides, judged) True where a side's answer is none of those that exact arithmetic allows."""
    judge = Judge(sides.caster.geometry)
    wrong = np.zeros((len(answers), len(judged)), dtype=bool)
    for place, ray in enumerate(judged):
        first = judge.find_first(rays.origins[ray], rays.directions[ray])
        accepted = {(-1, -1)}
        if first:
            targets, polygons = sides.translate(*np.array(sorted(first)).T)
            accepted = set(zip(targets.tolist(), polygons.tolist(), strict=True))
        for side, answer in enumerate(answers):
            wrong[side, place] = (int(answer.target[ray]), int(answer.polygon[ray])) not in accepted
    return wrong
