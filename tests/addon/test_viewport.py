"""The viewport without a window: what is seen, what is read again, what a session asks for and says."""

from __future__ import annotations

import itertools
import pickle
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

import addon
import raytracer
from addon.extract import Changes, Kept, extract_scene, mesh_table
from addon.extract.camera import extract_camera
from addon.extract.warnings import WarningList
from addon.versions import find_node_tree
from addon.viewport import session as session_module
from addon.viewport.drawing import BAND_PIXELS, Canvas
from addon.viewport.session import Session, make_target
from addon.viewport.views import EmptyBorderError, read_view, read_window
from raytracer.camera import locate_on_film
from raytracer.progressive import Picture
from tests.addon.engine_fixtures import add_plane, make_emission, make_stage

# A window matrix comes from a float32 chain of about 8 operations.
FLOAT32_CHAIN = 8 * np.finfo(np.float32).eps
WIDTH, HEIGHT = 300, 200
# Seconds; a test that waits longer has failed.
PATIENCE = 120.0


@pytest.fixture(autouse=True, scope="module")
def _registered() -> Iterator[None]:
    addon.register()
    yield
    addon.unregister()


@pytest.fixture
def stage(empty_scene: Any) -> Any:
    """Return a scene with a red plane left of a green one, in a picture of 24 x 16."""
    make_stage(empty_scene)
    add_plane(empty_scene.collection, "Red", (0.75, 0.125, 0.0), (-12.0, 0.0), (-8.0, 8.0))
    add_plane(empty_scene.collection, "Green", (0.0, 0.5, 0.25), (0.0, 12.0), (-8.0, 8.0))
    return empty_scene


def update() -> Any:
    """Return the depsgraph, up to date."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    depsgraph.update()
    return depsgraph


def make_region(width: int = WIDTH, height: int = HEIGHT) -> Any:
    return SimpleNamespace(width=width, height=height)


def look_through(
    camera: Any, width: int, height: int, zoom: float = 1.0, offset: tuple[float, float] = (0.0, 0.0)
) -> Any:
    """Return a region's data in camera view, by Blender's own projection matrix of a camera.

    zoom and offset move the picture as those of a viewport do: x -> zoom x + offset in the region's coordinates.
    """
    depsgraph = update()
    matrix = np.array(camera.calc_matrix_camera(depsgraph, x=width, y=height), dtype=np.float64)
    matrix[:2] *= zoom
    matrix[:2] += np.outer(offset, matrix[3])
    view = np.array(camera.matrix_world.inverted(), dtype=np.float64)
    return SimpleNamespace(window_matrix=matrix, view_matrix=view, view_perspective="CAMERA")


def make_space(**fields: Any) -> Any:
    standard = {
        "use_local_camera": False,
        "camera": None,
        "use_render_border": False,
        "clip_start": 0.1,
        "clip_end": 50.0,
    }
    borders = {
        "render_border_min_x": 0.0,
        "render_border_min_y": 0.0,
        "render_border_max_x": 1.0,
        "render_border_max_y": 1.0,
    }
    return SimpleNamespace(**{**standard, **borders, **fields})


def project(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return where a projection matrix puts points of camera space, (n, 2), -1 to 1 over the region."""
    clip = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ matrix.T
    return clip[:, :2] / clip[:, 3:]


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
def test_camera_view_shows_what_blenders_matrix_shows(stage: Any, kind: str, fit: str) -> None:
    camera = stage.camera
    camera.data.type, camera.data.sensor_fit = kind, fit
    camera.rotation_euler = (0.5, 0.25, 1.0)
    for (width, height), shift, zoom in itertools.product([(300, 200), (150, 400)], [(0, 0), (0.3, -0.7)], [1.0, 0.6]):
        camera.data.shift_x, camera.data.shift_y = shift
        data = look_through(camera, width, height, zoom, (0.2, -0.1))
        view = read_view(make_region(width, height), data, make_space(), stage)
        assert (view.width, view.height, view.border) == (width, height, None)
        assert view.camera.projection == {"PERSP": "perspective", "ORTHO": "orthographic"}[kind]
        x, y = np.array([0.0, width, width / 3]), np.array([0.0, height, height / 5])
        found = project(data.window_matrix, locate_on_film(view.camera, width, height, x, y))
        expected = np.stack([2 * x / width - 1, 2 * y / height - 1], axis=1)
        scale = 1 + np.abs(data.window_matrix[:2]).max()
        np.testing.assert_allclose(found, expected, rtol=0, atol=FLOAT32_CHAIN * scale)


def test_camera_view_stands_where_the_camera_stands(stage: Any) -> None:
    camera = stage.camera
    camera.location, camera.rotation_euler, camera.scale = (1e6, 2.0, 3.0), (0.5, 0.25, 1.0), (2.0, 3.0, 1.0)
    camera.data.dof.use_dof = True
    data = look_through(camera, WIDTH, HEIGHT)
    view = read_view(make_region(), data, make_space(), stage).camera
    render = extract_camera(update().scene_eval, WarningList())
    np.testing.assert_array_equal(view.world_from_camera, render.world_from_camera)
    assert (view.clip_start, view.clip_end) == (render.clip_start, render.clip_end)
    assert (view.aperture_radius, view.focus_distance) == (render.aperture_radius, render.focus_distance)


def test_picture_through_the_whole_window_is_that_of_a_render(stage: Any) -> None:
    data = look_through(stage.camera, 24, 16)
    view = read_view(make_region(24, 16), data, make_space(), stage)
    scene = extract_scene(update()).scene
    settings = {"pixel_filter": "box", "filter_width": 0.0}
    expected = raytracer.render(scene, 24, 16, 1, **settings)["Combined"]
    seen = raytracer.render(raytracer.Scene(**{**vars(scene), "camera": view.camera}), 24, 16, 1, **settings)[
        "Combined"
    ]
    np.testing.assert_array_equal(seen, expected)


@pytest.mark.parametrize("view_perspective", ["PERSP", "ORTHO"])
def test_free_view_sees_points_where_blender_puts_them(stage: Any, view_perspective: str) -> None:
    view_matrix = np.array([[0.0, 1.0, 0.0, -2.0], [0.0, 0.0, 1.0, 1.0], [1.0, 0.0, 0.0, -9.0], [0.0, 0.0, 0.0, 1.0]])
    if view_perspective == "PERSP":
        window = np.array([[1.4, 0, 0.1, 0], [0, 2.1, -0.2, 0], [0, 0, -1.01, -0.2], [0, 0, -1, 0]])
    else:
        window = np.array([[0.1, 0, 0, 0.3], [0, 0.15, 0, -0.2], [0, 0, -0.002, 0], [0, 0, 0, 1.0]])
    data = SimpleNamespace(window_matrix=window, view_matrix=view_matrix, view_perspective=view_perspective)
    space = make_space()
    camera = read_view(make_region(), data, space, stage).camera
    x, y = np.array([10.0, 250.0]), np.array([20.0, 130.0])
    points = locate_on_film(camera, WIDTH, HEIGHT, x, y)
    world = points @ camera.world_from_camera[:3, :3].T + camera.world_from_camera[:3, 3]
    seen = project(window, np.concatenate([world, np.ones((2, 1))], axis=1) @ view_matrix[:3].T)
    np.testing.assert_allclose(
        seen, np.stack([2 * x / WIDTH - 1, 2 * y / HEIGHT - 1], axis=1), atol=1e3 * FLOAT32_CHAIN
    )
    start = np.array([0.0, 0.0, -camera.clip_start, 1.0]) @ camera.world_from_camera.T @ view_matrix.T
    expected = -space.clip_start if view_perspective == "PERSP" else space.clip_end / 2
    assert start[2] == pytest.approx(expected)
    assert camera.clip_end - camera.clip_start == pytest.approx(49.9 if view_perspective == "PERSP" else 50.0)


def test_window_of_an_asymmetric_frustum() -> None:
    matrix = np.array([[2.0, 0, 0.5, 0], [0, 4.0, -0.25, 0], [0, 0, -1, -0.2], [0, 0, -1, 0]])
    window = read_window(matrix)
    assert (window.left, window.right, window.bottom, window.top) == (-0.25, 0.75, -0.3125, 0.1875)
    assert window.is_perspective


def test_border_of_a_camera_lies_in_its_frame(stage: Any) -> None:
    stage.render.use_border = True
    render = stage.render
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.5, 1.0
    # The frame of 24 x 16 stands in the middle half of a region of twice its size.
    view = read_view(make_region(48, 32), look_through(stage.camera, 24, 16, zoom=0.5), make_space(), stage)
    assert view.border == (12 + 6, 8 + 8, 12 + 18, 8 + 16)


def test_border_of_a_free_view_is_the_regions(stage: Any) -> None:
    data = look_through(stage.camera, WIDTH, HEIGHT)
    data.view_perspective = "ORTHO"
    space = make_space(use_render_border=True, render_border_min_x=0.1, render_border_max_y=0.5)
    stage.render.use_border = True  # another view's
    assert read_view(make_region(), data, space, stage).border == (30, 0, 300, 100)
    space.render_border_min_x = 1.0
    with pytest.raises(EmptyBorderError):
        read_view(make_region(), data, space, stage)


def add_object(stage: Any, name: str, x: float, materials: int = 1) -> Any:
    mesh = bpy.data.meshes.new(name)
    corners = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.5)]
    mesh.from_pydata(corners, [], [(0, 1, 2), (0, 2, 3)])
    for number in range(materials):
        mesh.materials.append(make_emission(f"{name} {number}", (0.1 * number, 0.5, 0.5)))
    mesh.polygons[1].material_index = materials - 1
    mesh.uv_layers.new(name="UV")
    found = bpy.data.objects.new(name, mesh)
    found.location = (x, 0.0, 1.0)
    stage.collection.objects.link(found)
    return found


def describe(extraction: Any) -> bytes:
    """Return all of an extraction as bytes; what is equal need not be the same object."""
    scene = extraction.scene
    parts = [*scene.meshes, *scene.materials, *scene.lights, *scene.spheres, scene.instances, scene.world]
    whole = [pickle.dumps(pickle.loads(pickle.dumps(part))) for part in parts]
    polygons = [rows.tobytes() for rows in extraction.polygons]
    return pickle.dumps(
        (whole, polygons, [tuple(key) for key in extraction.objects], list(map(str, extraction.warnings)))
    )


def announce(*changed: Any, shapes: tuple[Any, ...] = (), kinds: tuple[str, ...] = ("OBJECT",)) -> Changes:
    """Return Changes as Blender would announce them of original data-blocks."""
    ids = frozenset(data.session_uid for data in (*changed, *shapes))
    return Changes(ids, frozenset(data.session_uid for data in shapes), frozenset(kinds))


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the names of the objects whose meshes are read from now on."""
    names: list[str] = []
    extract = mesh_table.extract_geometry

    def extract_and_note(mesh: Any, name: str, *rest: Any) -> Any:
        names.append(name)
        return extract(mesh, name, *rest)

    monkeypatch.setattr(mesh_table, "extract_geometry", extract_and_note)
    return names


def test_what_did_not_change_is_not_read_again(stage: Any, reads: list[str]) -> None:
    for number in range(5):
        add_object(stage, f"Tile {number}", float(number), materials=2)
    kept = Kept()
    first = extract_scene(update(), kept=kept)
    assert len(reads) == 7
    reads.clear()
    bpy.data.objects["Tile 3"].location.z = 2.0
    depsgraph = update()
    kept.changes = announce()
    moved = extract_scene(depsgraph, kept=kept)
    assert reads == []
    assert describe(moved) == describe(extract_scene(depsgraph))
    assert all(one is other for one, other in zip(moved.scene.meshes, first.scene.meshes, strict=True))
    assert all(one is other for one, other in zip(moved.scene.materials, first.scene.materials, strict=True))


def change_shape(stage: Any) -> Changes:
    mesh = bpy.data.meshes["Tile 1"]
    mesh.vertices[0].co.z = 3.0
    mesh.update()
    return announce(shapes=(mesh, bpy.data.objects["Tile 1"]))


def change_material(stage: Any) -> Changes:
    material = bpy.data.materials["Tile 2 1"]
    find_node_tree(material).nodes["Emission"].inputs["Strength"].default_value = 3.0
    return announce(material, kinds=("MATERIAL", "NODETREE"))


def read_attribute(stage: Any) -> Changes:
    """Let a material ask for an attribute that it did not read before."""
    material = bpy.data.materials["Tile 2 1"]
    tree = find_node_tree(material)
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs["UV"], tree.nodes["Emission"].inputs["Color"])
    return announce(material, kinds=("MATERIAL", "NODETREE"))


def assign_material(stage: Any) -> Changes:
    found = bpy.data.objects["Tile 2"]
    found.data.materials[0] = bpy.data.materials["Tile 4 1"]
    return announce(found, shapes=(found.data,))


def remove_first(stage: Any) -> Changes:
    """Change the numbers of all meshes and materials."""
    bpy.data.objects.remove(bpy.data.objects["Red"])
    return announce(kinds=("SCENE", "COLLECTION"))


def add_another(stage: Any) -> Changes:
    found = add_object(stage, "Another", 7.0)
    return announce(found, shapes=(found.data,), kinds=("OBJECT", "MESH", "SCENE", "COLLECTION"))


def hide_from_camera(stage: Any) -> Changes:
    bpy.data.objects["Tile 0"].visible_camera = False
    return announce(bpy.data.objects["Tile 0"])


def hide_wholly(stage: Any) -> Changes:
    bpy.data.objects["Tile 0"].hide_viewport = True
    return announce(bpy.data.objects["Tile 0"], kinds=("OBJECT", "SCENE"))


def share_mesh(stage: Any) -> Changes:
    found = bpy.data.objects.new("Twin", bpy.data.meshes["Tile 3"])
    stage.collection.objects.link(found)
    return announce(found, kinds=("OBJECT", "SCENE"))


def color_vertices(stage: Any) -> Changes:
    mesh = bpy.data.meshes["Tile 2"]
    mesh.uv_layers["UV"].uv[0].vector = (0.25, 0.75)
    mesh.update()
    return announce(shapes=(mesh,))


CHANGES = (
    change_shape,
    change_material,
    read_attribute,
    assign_material,
    remove_first,
    add_another,
    hide_from_camera,
    hide_wholly,
    share_mesh,
    color_vertices,
)


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("announced", [True, False])
def test_after_a_change_all_is_as_if_read_anew(stage: Any, change: Any, announced: bool) -> None:
    for number in range(5):
        add_object(stage, f"Tile {number}", float(number), materials=2)
    if change is color_vertices:
        read_attribute(stage)
    kept = Kept()
    before = extract_scene(update(), kept=kept)
    changes = change(stage)
    depsgraph = update()
    kept.changes = changes if announced else None
    after = extract_scene(depsgraph, kept=kept)
    assert describe(after) == describe(extract_scene(depsgraph))
    assert describe(after) != describe(before)


def test_changes_one_after_the_other_leave_nothing_behind(stage: Any) -> None:
    for number in range(5):
        add_object(stage, f"Tile {number}", float(number), materials=2)
    kept = Kept()
    extract_scene(update(), kept=kept)
    for change in CHANGES:
        changes = change(stage)
        depsgraph = update()
        kept.changes = changes
        assert describe(extract_scene(depsgraph, kept=kept)) == describe(extract_scene(depsgraph)), change.__name__
    assert len(kept.meshes) == len(
        {tile.data for tile in stage.objects if tile.type == "MESH" and not tile.hide_viewport}
    )


def test_material_changes_read_no_mesh(stage: Any, reads: list[str]) -> None:
    add_object(stage, "Tile 2", 0.0, materials=2)
    kept = Kept()
    extract_scene(update(), kept=kept)
    reads.clear()
    changes = change_material(stage)
    depsgraph = update()
    kept.changes = changes
    extract_scene(depsgraph, kept=kept)
    assert reads == []


def test_unannounced_but_unchanged_meshes_stay_the_same_records(stage: Any) -> None:
    kept = Kept()
    first = extract_scene(update(), kept=kept)
    again = extract_scene(update(), kept=kept)
    assert all(one is other for one, other in zip(again.scene.meshes, first.scene.meshes, strict=True))


def test_warnings_are_told_again_for_what_is_not_read_again(stage: Any) -> None:
    tile = add_object(stage, "Tile", 0.0)
    tile.is_shadow_catcher = True
    tile.data.vertices[0].co.x = float("nan")
    kept = Kept()
    first = extract_scene(update(), kept=kept)
    assert len(first.warnings) >= 2
    kept.changes = announce()
    assert extract_scene(update(), kept=kept).warnings == first.warnings


def test_a_mesh_that_is_edited_is_read_as_it_is(stage: Any) -> None:
    tile = add_object(stage, "Tile", 0.0)
    bpy.context.view_layer.objects.active = tile
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.transform.translate(value=(0.0, 0.0, 2.0))
    edited = extract_scene(update())
    bpy.ops.object.mode_set(mode="OBJECT")
    for tag in ("positions", "triangles"):
        np.testing.assert_array_equal(
            getattr(edited.scene.meshes[-1], tag), getattr(extract_scene(update()).scene.meshes[-1], tag)
        )
    assert edited.scene.meshes[-1].positions[:, 2].min() == 2.0


class Watch:
    """Looks at a session as a region would."""

    def __init__(self, stage: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        self.session = Session()
        self.stage = stage
        self.space = make_space()
        self.extractions = 0
        monkeypatch.setattr(session_module, "extract_scene", self._extract)

    def _extract(self, depsgraph: Any, space: Any, kept: Kept) -> Any:
        self.extractions += 1
        return extract_scene(depsgraph, kept=kept)  # without a window there is no space to ask

    def update(self) -> None:
        self.session.update(update(), self.space)

    def look(self) -> None:
        data = look_through(self.stage.camera, 24, 16)
        self.session.look(make_region(24, 16), data, self.space, update(), 1)

    def wait(self) -> np.ndarray:
        """Return the last picture of what was asked, row 0 at the top."""
        live, end = self.session._live, time.perf_counter() + PATIENCE
        while live.report is None or live.report.job != live._job or not live.report.is_finished:
            assert time.perf_counter() < end
            time.sleep(0.002)
        picture = self.session.read_picture()
        assert picture is not None
        return picture.pixels[::-1].copy()


@pytest.fixture
def watch(stage: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Watch]:
    stage.reference_raytracer.viewport_samples = 2
    one = Watch(stage, monkeypatch)
    yield one
    one.session.close()


def render_stage() -> np.ndarray:
    from addon.properties import settings_keywords

    scene = bpy.context.scene
    settings = settings_keywords(scene) | {"samples": 2, "workers": 1}
    return raytracer.render(extract_scene(update()).scene, 24, 16, **settings)["Combined"]


def test_session_shows_the_picture_of_a_render(watch: Watch) -> None:
    watch.update()
    watch.look()
    np.testing.assert_array_equal(watch.wait(), render_stage())
    assert watch.session.status == "Sample 2/2"


def test_session_follows_changes(watch: Watch, stage: Any) -> None:
    watch.update()
    watch.look()
    before = watch.wait()
    bpy.data.objects["Red"].location.y = 4.0
    watch.update()
    watch.look()
    after = watch.wait()
    np.testing.assert_array_equal(after, render_stage())
    assert (after != before).any()
    stage.render.film_transparent = True
    watch.look()
    np.testing.assert_array_equal(watch.wait(), render_stage())


def test_session_follows_settings_that_a_script_changes(watch: Watch, stage: Any) -> None:
    watch.update()
    depsgraph = update()
    data = look_through(stage.camera, 24, 16)
    watch.session.look(make_region(24, 16), data, watch.space, depsgraph, 1)
    job = watch.session._live._job
    stage.reference_raytracer.seed = 5
    watch.session.look(make_region(24, 16), data, watch.space, depsgraph, 1)
    assert watch.session._live._job == job + 1
    np.testing.assert_array_equal(watch.wait(), render_stage())


def test_session_draws_on_where_nothing_changed(watch: Watch) -> None:
    watch.update()
    watch.look()
    job = watch.session._live._job
    watch.look()
    watch.update()
    watch.look()
    assert watch.session._live._job == job


def test_session_extracts_nothing_for_a_camera(watch: Watch, stage: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    watch.update()
    watch.look()
    job = watch.session._live._job
    monkeypatch.setattr(session_module, "read_changes", lambda depsgraph: Changes(kinds=frozenset({"CAMERA"})))
    stage.camera.location.x = 3.0
    watch.update()
    watch.look()
    assert watch.extractions == 1
    assert watch.session._live._job == job + 1
    np.testing.assert_array_equal(watch.wait(), render_stage())


def test_session_reads_all_again_when_it_cannot_trust(watch: Watch, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_module, "read_changes", lambda depsgraph: Changes())
    watch.update()
    bpy.data.meshes["Red"].vertices[0].co.z = 1.0  # unannounced, as after undo
    bpy.data.meshes["Red"].update()
    watch.session.distrust()
    watch.update()
    watch.look()
    np.testing.assert_array_equal(watch.wait(), render_stage())


def test_session_says_what_is_wrong_and_goes_on_afterwards(watch: Watch, stage: Any) -> None:
    watch.update()
    stage.camera.scale = (0.0, 1.0, 1.0)
    update()
    data = SimpleNamespace(
        window_matrix=np.diag([1.0, 1.0, -1.0, 1.0]), view_matrix=np.eye(4), view_perspective="CAMERA"
    )
    watch.session.look(make_region(24, 16), data, watch.space, update(), 1)
    assert watch.session.status.startswith("Error: Camera 'Camera' has a scale of [0.0, 1.0, 1.0]")
    stage.camera.scale = (1.0, 1.0, 1.0)
    watch.look()
    np.testing.assert_array_equal(watch.wait(), render_stage())


def test_session_explains_what_should_not_happen(
    watch: Watch, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise KeyError("gone")

    with monkeypatch.context() as broken:
        broken.setattr(session_module, "extract_scene", fail)
        watch.update()
    assert watch.session.status == "Error: internal error, KeyError: 'gone'"
    assert "Traceback" in capsys.readouterr().err
    watch.update()
    watch.look()
    np.testing.assert_array_equal(watch.wait(), render_stage())


def test_session_takes_another_process_for_one_that_ended(watch: Watch) -> None:
    watch.update()
    watch.look()
    watch.wait()
    watch.session._live._process.kill()
    end = time.perf_counter() + PATIENCE
    while watch.session.status.startswith("Sample"):
        assert time.perf_counter() < end
    assert watch.session.status.startswith("Error: the render process ended unexpectedly")
    watch.update()
    watch.look()
    np.testing.assert_array_equal(watch.wait(), render_stage())


def test_target_has_the_viewports_samples_and_the_renders_settings(stage: Any) -> None:
    settings = stage.reference_raytracer
    settings.samples, settings.viewport_samples, settings.seed, settings.max_bounces = 7, 5, 3, 2
    view = read_view(make_region(), look_through(stage.camera, WIDTH, HEIGHT), make_space(), stage)
    target = make_target(view, stage, 2)
    assert (target.samples, target.pixel_size, target.width, target.height) == (5, 2, WIDTH, HEIGHT)
    assert (target.settings["seed"], target.settings["max_bounces"]) == (3, 2)


def make_picture(width: int, height: int, value: float, samples: int = 1) -> Picture:
    return Picture(np.full((height, width, 4), value, np.float32), 0, 0, width, height, samples, 8)


def test_large_pictures_reach_the_screen_in_bands(monkeypatch: pytest.MonkeyPatch) -> None:
    from addon.viewport import drawing

    monkeypatch.setattr(drawing, "make_texture", lambda pixels: pixels.copy())
    monkeypatch.setattr(drawing, "UPLOAD_SECONDS", 0.0)
    canvas, height = Canvas(), 3 * BAND_PIXELS // 1024 + 5
    canvas.take(make_picture(1024, height, 1.0))
    steps = 0
    while canvas.is_busy:
        assert canvas._shown is None
        canvas.upload()
        steps += 1
        if steps == 2:
            canvas.take(make_picture(1024, height, 2.0, samples=2))  # more samples of the same: go on with those
    assert steps == 4
    assert [band[0, 0, 0] for band in canvas._shown.bands] == [1.0, 1.0, 2.0, 2.0]
    assert sum(len(band) for band in canvas._shown.bands) == height
    canvas.take(make_picture(1024, height, 3.0))
    canvas.upload()
    canvas.take(make_picture(64, 8, 4.0))  # other pixels: begin anew
    canvas.upload()
    assert not canvas.is_busy
    assert canvas._shown.picture.pixels.shape == (8, 64, 4)
