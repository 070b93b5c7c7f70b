"""Attributes of point clouds: read only for materials that ask, and of the points that are kept."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from addon.extract import instances
from addon.extract.kept import Changes, Kept
from addon.extract.scene import extract_scene
from tests.addon.against_cycles.node_fixtures import make_material
from tests.addon.against_cycles.test_points import add_camera, add_cloud, make_values, read

pytestmark = pytest.mark.usefixtures("registered_addon")


def extract(kept: Kept | None = None) -> Any:
    depsgraph = bpy.context.evaluated_depsgraph_get()
    depsgraph.update()
    return extract_scene(depsgraph, kept=kept)


@pytest.fixture
def cloud(empty_scene: Any) -> Any:
    add_camera(empty_scene)
    return add_cloud(empty_scene, 0, "FLOAT_VECTOR", read("grade", "Vector"))


def test_attributes_of_points_are_read_by_name(cloud: Any) -> None:
    (spheres,) = extract().scene.spheres
    assert list(spheres.attributes) == ["grade"]
    np.testing.assert_array_equal(spheres.attributes["grade"], make_values("FLOAT_VECTOR").reshape(-1, 3))


def test_what_no_material_reads_is_not_read_of_points(cloud: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[set[str]] = []

    def note(data: Any, points: Any, names: set[str]) -> dict[str, Any]:
        asked.append(set(names))
        return {}

    monkeypatch.setattr(instances, "read_point_attributes", note)
    material = make_material("Plain", lambda tree: tree.nodes.new("ShaderNodeRGB").outputs[0])
    bpy.context.view_layer.material_override = material
    assert extract().scene.spheres[0].attributes == {}
    assert asked in ([], [set()])


def test_points_that_are_left_out_leave_their_attributes_out(cloud: Any) -> None:
    cloud.data.vertices[1].co = (np.nan, 0.0, 0.0)
    cloud.data.update()
    (spheres,) = extract().scene.spheres
    kept = make_values("FLOAT_VECTOR").reshape(-1, 3)[[0, 2, 3]]
    np.testing.assert_array_equal(spheres.attributes["grade"], kept)


def test_values_that_are_not_numbers_are_0(cloud: Any) -> None:
    cloud.data.attributes["grade"].data[2].vector = (np.nan, 1.0, np.nan)
    cloud.data.update()
    assert extract().scene.spheres[0].attributes["grade"][2].tolist() == [0.0, 1.0, 0.0]


@pytest.mark.parametrize("scale", [(0, 0, 0), (1, 1, 0)])
def test_points_that_are_scaled_to_nothing_are_not_there(cloud: Any, scale: tuple[float, ...]) -> None:
    """Things that grow from nothing are keyed so; it must not end the render."""
    cloud.scale = scale
    found = extract()
    assert (found.scene.spheres, found.objects) == ((), ())


def test_points_that_did_not_change_keep_their_attributes(cloud: Any) -> None:
    kept = Kept()
    first = extract(kept).scene.spheres[0].attributes["grade"]
    kept.changes = Changes()
    assert np.shares_memory(extract(kept).scene.spheres[0].attributes["grade"], first)
