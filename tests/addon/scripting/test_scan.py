"""Range scans: the pattern, what is measured, and frames."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from addon import scan, scan_frames
from addon.scripting.scan import ScanPattern
from tests.addon.scripting.ray_cast_fixtures import (
    find_depsgraph,
    forget_casters,  # noqa: F401  (a fixture, found by its name)
    link,
    make_quad,
)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("forget_casters")]
LEVEL = (0.0, 0.0)


def read(points: Any, name: str, width: int = 1) -> Any:
    """Return an attribute of a scan, or its positions."""
    data = points.data.vertices if name == "co" else points.data.attributes[name].data
    field = name if name == "co" else ("vector" if width == 3 else "value")
    values = np.empty(len(data) * width, dtype=np.float32)
    data.foreach_get(field, values)
    return values if width == 1 else values.reshape(-1, width)


@pytest.fixture
def room(empty_scene: Any) -> Any:
    """A cube of 4 metres around the origin."""
    bpy.ops.mesh.primitive_cube_add(size=4)
    return bpy.context.object


def test_a_full_turn_leaves_out_its_last_column(empty_scene: Any) -> None:
    directions = ScanPattern(vertical=(-0.5, 0.25), columns=4, rows=2).make_directions()
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=1e-15)
    flat = directions / np.linalg.norm(directions[:, :2], axis=1)[:, np.newaxis]
    around = [(-1, 0), (0, -1), (1, 0), (0, 1)]
    np.testing.assert_allclose(flat[:, :2], around * 2, atol=1e-15)
    np.testing.assert_allclose(np.arcsin(directions[:, 2]), np.repeat([-0.5, 0.25], 4), atol=1e-15)
    sector = ScanPattern((0, np.pi / 2), LEVEL, 3, 1).make_directions()
    np.testing.assert_allclose(sector, [(1, 0, 0), (0.5**0.5, 0.5**0.5, 0), (0, 1, 0)], atol=1e-15)


def test_a_scan_of_a_room_is_the_room(room: Any) -> None:
    points = scan(find_depsgraph(), (0.5, 0.25, -0.5), columns=90, rows=15, vertical=(-1.5, 1.5))
    location = read(points, "co", 3)
    assert len(location) == 90 * 15
    np.testing.assert_allclose(np.abs(location).max(axis=1), 2, rtol=1e-6)  # on the walls
    offset = location - (0.5, 0.25, -0.5)
    np.testing.assert_allclose(read(points, "distance"), np.linalg.norm(offset, axis=1), rtol=1e-6)
    normal = read(points, "normal", 3)
    cosine = np.abs((normal * offset).sum(axis=1)) / np.linalg.norm(offset, axis=1)
    np.testing.assert_allclose(read(points, "intensity"), cosine, atol=1e-6)
    assert read(points, "echo").tolist() == [1] * 1350
    np.testing.assert_array_equal(read(points, "row") * 90 + read(points, "column"), np.arange(1350))
    assert dict(points.data["objects"]) == {"0": "Cube"}
    assert points.name in bpy.context.scene.collection.objects


def test_echoes_are_in_order_and_numbered_from_one(empty_scene: Any) -> None:
    link("Panes", make_quad(copies=3), (0, 0, 1))  # at 1, 0.9, 0.8
    points = scan(find_depsgraph(), (0.25, 0.5, 3), columns=1, rows=1, vertical=(-np.pi / 2, 0), echoes=2)
    np.testing.assert_allclose(read(points, "distance"), [2, 2.1], rtol=1e-6)
    assert read(points, "echo").tolist() == [1, 2]


def test_a_camera_scans_what_it_looks_at_and_an_object_scans_from_its_y_axis(scene_with_camera: Any) -> None:
    camera = scene_with_camera.camera
    camera.location, camera.rotation_euler = (0, 0, 5), (0, 0, 0.7)
    link("Floor", make_quad(3))
    forward = {"horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1), "columns": 5, "rows": 3}
    points = scan(find_depsgraph(), camera, **forward)
    location = read(points, "co", 3)
    assert len(location) == 15
    np.testing.assert_allclose(location.mean(axis=0), (0, 0, 0), atol=1e-6)
    # Left and up of the camera: its -X and its Y, turned with it.
    axes = np.array(camera.matrix_world)[:3, :3]
    first, last = location[0] @ axes, location[-1] @ axes
    assert first[0] > 0 > first[1]
    assert last[0] < 0 < last[1]
    wall = link("Wall", make_quad(9), (0, 6, 0))
    wall.rotation_euler = (np.pi / 2, 0, 0)
    scanner = link("Scanner", make_quad(2), (0, 0, 1))
    location = read(scan(find_depsgraph(), scanner, **forward), "co", 3)
    np.testing.assert_allclose(location[:, 1], 6, rtol=1e-6)


def test_the_scanner_does_not_see_itself(room: Any) -> None:
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.5)
    housing = bpy.context.object
    level = {"vertical": LEVEL, "rows": 1, "columns": 8}
    assert read(scan(find_depsgraph(), housing, **level), "distance").min() > 1.9
    assert read(scan(find_depsgraph(), (0, 0, 0), **level), "distance").max() < 0.6


def test_noise_is_along_the_ray_and_the_same_for_a_seed(room: Any) -> None:
    options = {"columns": 200, "rows": 20, "noise": 0.05}
    exact = read(scan(find_depsgraph(), (0, 0, 0), columns=200, rows=20), "distance")
    one, again = (read(scan(find_depsgraph(), (0, 0, 0), **options), "distance") for _ in range(2))
    other = read(scan(find_depsgraph(), (0, 0, 0), seed=1, **options), "distance")
    np.testing.assert_array_equal(one, again)
    assert (one != other).any()
    assert abs((one - exact).std() - 0.05) < 0.05 * 4 / np.sqrt(2 * len(one))
    points = scan(find_depsgraph(), (0, 0, 0), **options)
    np.testing.assert_allclose(np.linalg.norm(read(points, "co", 3), axis=1), read(points, "distance"), rtol=1e-5)


def test_spheres_of_points_are_shown_to_renders(room: Any) -> None:
    points = scan(find_depsgraph(), (0, 0, 0), columns=8, rows=2, radius=0.25)
    shown = [instance.object.data for instance in find_depsgraph().object_instances
             if instance.object.type == "POINTCLOUD"]  # fmt: skip
    assert len(shown) == 1
    assert len(shown[0].points) == 16
    assert all(abs(point.radius - 0.25) < 1e-6 for point in shown[0].points)
    assert len(shown[0].attributes["distance"].data) == 16
    bpy.data.node_groups[0].nodes.clear()  # a group of the same name that is another
    assert (
        scan(find_depsgraph(), (0, 0, 0), columns=8, rows=2, radius=0.25).modifiers[0].node_group.name
        == "Scan Points.001"
    )
    assert points.modifiers


def test_nothing_in_range_leaves_an_object_without_points(room: Any) -> None:
    points = scan(find_depsgraph(), (0, 0, 0), distance=1)
    assert len(points.data.vertices) == 0
    assert "distance" in points.data.attributes


def test_frames_follow_what_moves_and_set_the_frame_back(room: Any) -> None:
    scene = bpy.context.scene
    for frame, z in ((1, 0.0), (11, 1.0)):
        room.location.z = z
        room.keyframe_insert("location", frame=frame)
    scene.frame_set(4, subframe=0.25)
    options = {"vertical": (-np.pi / 2, 0), "columns": 1, "rows": 1, "name": "Fall"}
    heights = {frame: float(read(points, "distance")[0]) for frame, points in
               scan_frames(scene, (0, 0, 1), (1, 11), **options)}  # fmt: skip
    np.testing.assert_allclose([heights[1], heights[11]], [3, 2], rtol=1e-6)
    assert scene.frame_current_final == 4.25
    assert {"Fall.0001", "Fall.0011"} <= set(bpy.data.objects.keys())


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"columns": 0}, "columns: expected a whole number of at least 1, got 0"),
        ({"rows": 2.5}, "rows: expected a whole number"),
        ({"echoes": 0}, "echoes: expected a whole number"),
        ({"horizontal": (0, 7)}, "horizontal: expected two angles in radians at most 6.283 apart"),
        ({"vertical": (0, np.nan)}, "vertical: expected two angles"),
        ({"noise": -1}, "noise: expected metres of at least 0, got -1"),
        ({"noise": "loud"}, "noise: expected metres of at least 0, got 'loud'"),
        ({"radius": np.inf}, "radius: expected metres"),
        ({"noise": 0.1, "seed": -1}, "seed: expected a whole number of at least 0, got -1"),
        ({"origin": (0, 0)}, r"origin: expected an object, a place \(3,\) or a matrix \(4, 4\), got shape \(2,\)"),
        ({"origin": "Camera"}, "origin: expected an object, a place or a matrix, got str"),
        ({"origin": (0, 0, np.inf)}, "origin: expected a finite place"),
        ({"visibility": "all"}, "visibility: expected one of"),
    ],
)
def test_arguments_that_do_not_fit_are_named(empty_scene: Any, options: dict[str, Any], sentence: str) -> None:
    before = len(bpy.data.objects)
    with pytest.raises(ValueError, match=sentence):
        scan(find_depsgraph(), **{"origin": (0, 0, 0), **options})
    assert len(bpy.data.objects) == before
    with pytest.raises(ValueError, match=r"scene: expected a bpy\.types\.Scene, got NoneType"):
        next(scan_frames(None, (0, 0, 0)))
