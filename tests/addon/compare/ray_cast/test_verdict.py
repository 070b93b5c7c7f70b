"""Both sides' answers to rays in exact arithmetic, whatever it is that Scene.ray_cast hits."""

from __future__ import annotations

from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import bpy
import pytest

from addon.compare.ray_cast import verdict
from addon.compare.ray_cast.comparison import compare_with_ray_cast
from addon.compare.window import describe
from tests.addon.compare.comparison_fixtures import stage
from tests.addon.engine.engine_fixtures import HEIGHT, WIDTH

__all__ = ["stage"]  # a fixture


def hide_from_rays(plane: Any) -> None:
    for kind in ("camera", "diffuse", "glossy", "transmission", "shadow", "volume_scatter"):
        setattr(plane, f"visible_{kind}", False)


def hide_below_hair(plane: Any) -> None:
    plane.modifiers.new("Hair", "PARTICLE_SYSTEM").particle_system.settings.type = "HAIR"
    plane.show_instancer_for_viewport = False


def turn_last_row(plane: Any) -> None:
    plane.parent = bpy.data.objects.new("Parent", None)
    bpy.context.collection.objects.link(plane.parent)
    plane.matrix_parent_inverse[3][0] = 0.5


@pytest.mark.parametrize("change", [hide_from_rays, hide_below_hair, turn_last_row])
def test_what_only_scene_ray_cast_hits_is_compared(stage: Any, change: Any) -> None:
    """It was a KeyError, of the comparison and of Judge Ray."""
    stage.objects["Plane"].rotation_euler = (0, 0, 0)
    change(stage.objects["Plane"])
    depsgraph = bpy.context.evaluated_depsgraph_get()
    comparison, _ = compare_with_ray_cast(stage, depsgraph, WIDTH, HEIGHT, 50)
    assert not comparison.ours_wrong.any()
    assert comparison.agreeing.sum() >= 100  # of the camera's rays alone
    verdicts = verdict.judge_ray(stage, depsgraph, (-3.0, 1.0, 3.0), (0.0, 0.0, -3.0))
    assert [found.answer for found in verdicts] == [("Plane", 0)] * 2


def test_verdict_is_exact_arithmetics(stage: Any) -> None:
    stage.objects["Plane"].rotation_euler = (0, 0, 0)
    stage.objects["Plane"].location.z = 0.5
    depsgraph = bpy.context.evaluated_depsgraph_get()
    ours, blender = verdict.judge_ray(stage, depsgraph, (-3.0, 1.0, 3.0), (0.0, 0.0, -3.0))
    assert ours.exact_distance == blender.exact_distance == Fraction(5, 6)
    assert (ours.answer, ours.exact_surfaces) == (("Plane", 0), {("Plane", 0)})
    assert ours.is_right
    assert blender.is_right
    assert ours.distance_error is not None
    assert ours.t_error <= ours.distance_error <= 2.0**-52
    assert describe.format_fraction(Fraction(5, 6)) == "0.83333333333333333333"
    miss, _ = verdict.judge_ray(stage, depsgraph, (50.0, 1.0, 3.0), (0.0, 0.0, -3.0))
    assert (miss.answer, miss.exact_distance, miss.is_right) == (None, None, True)
    assert [values for _, values in describe.describe_exact(miss)] == [("the ray hits nothing",)]


def test_wrong_answer_is_called_wrong(stage: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    made = verdict.make_sides

    def lie(scene: Any, depsgraph: Any) -> Any:
        sides = made(scene, depsgraph)
        return SimpleNamespace(
            caster=sides.caster,
            translate=sides.translate,
            polygons=sides.polygons,
            ray_cast=lambda origin, direction: (False, None, None, -1, None, None),
            target_of_key={},
            list_names=sides.list_names,
        )

    monkeypatch.setattr(verdict, "make_sides", lie)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    ours, blender = verdict.judge_ray(stage, depsgraph, (-3.0, 1.0, 5.0), (0.0, 0.0, -1.0))
    assert (ours.is_right, blender.is_right) == (True, False)
    assert dict(describe.describe_verdict(blender)) == {"Answer": ("a miss",), "Right is": ("Plane, polygon 0",)}
