"""The ray inspector's operators, names, texts and lines; the window itself is in tests/windows."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

import addon
import raytracer
from addon.engine.output import measure_picture
from addon.inspector import describe, drawing, names, operators, picking, segments, session
from addon.versions import find_node_tree
from raytracer.integrator.inspect_ray import make_inspector
from raytracer.integrator.settings import Settings
from raytracer.integrator.traced_rays import CAMERA, REFLECTED
from tests.addon.engine.engine_fixtures import make_stage

LAMP_HEIGHT, ROOF_HEIGHT = 8.0, 6.0


@pytest.fixture
def room(empty_scene: Any) -> Iterator[Any]:
    """A mirror under a roof that keeps a lamp's light from the left half; the camera looks straight down, 1 pixel a
    metre."""
    addon.register()
    make_stage(empty_scene)
    mirror = add_square("Mirror", 0.0, (-12, 12), make_glossy())
    mirror.data.materials.append(None)
    mirror.data.polygons[1].material_index = 1
    add_square("Roof", ROOF_HEIGHT, (-12, -2), None)
    lamp = bpy.data.lights.new("Bulb", "POINT")
    lamp.energy, lamp.shadow_soft_size = 1000.0, 0.0
    holder = bpy.data.objects.new("Ceiling lamp", lamp)
    holder.location = (-6.0, 0.0, LAMP_HEIGHT)
    empty_scene.collection.objects.link(holder)
    bpy.data.objects["Roof"].visible_camera = False
    yield empty_scene
    addon.unregister()


def add_square(name: str, z: float, x: tuple[float, float], material: Any) -> Any:
    """Add two rectangles at a height, split at y = 0: polygon 0 has y < 0."""
    mesh = bpy.data.meshes.new(name)
    corners = [(x[side], y, z) for y in (-8.0, 0.0, 8.0) for side in (0, 1)]
    mesh.from_pydata(corners, [], [(0, 1, 3, 2), (2, 3, 5, 4)])
    if material:
        mesh.materials.append(material)
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def make_glossy() -> Any:
    material = bpy.data.materials.new("Polish")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    nodes, links = find_node_tree(material).nodes, find_node_tree(material).links
    nodes.clear()
    glossy, output = nodes.new("ShaderNodeBsdfAnisotropic"), nodes.new("ShaderNodeOutputMaterial")
    glossy.inputs["Roughness"].default_value = 0.0
    links.new(glossy.outputs[0], output.inputs["Surface"])
    return material


def inspect(x: int, y: int) -> session.Inspected:
    assert bpy.ops.raytracer.inspect_pixel(x=x, y=y) == {"FINISHED"}
    inspected = session.find_inspected()
    assert inspected is not None
    return inspected


def test_pixel_has_its_objects_polygons_and_materials(room: Any) -> None:
    inspected = inspect(16, 3)  # 4.5 m right of the middle, 4.5 m below
    assert inspected.place == "Pixel 16, 3 of 24 x 16"
    ray, reflected = inspected.tree
    assert (ray.kind, reflected.kind) == (CAMERA, REFLECTED)
    assert ray.hit is not None
    np.testing.assert_array_equal(ray.hit.position, [4.5, -4.5, 0.0])
    lines = dict(describe.describe_hit(ray, ray.hit, inspected.names))
    assert (lines["Object"], lines["Polygon"], lines["Material"]) == (("Mirror",), ("0",), ("Polish",))
    assert lines["Point (m)"] == ("4.5000", "-4.5000", "0.0000")
    assert describe.title_ray(reflected, inspected.names) == "Reflected: nothing"
    assert describe.describe_dark(ray, inspected.names) == "Ceiling lamp: no light this way"


def test_a_strand_has_no_formula_of_the_lecture() -> None:
    """It was said to be a miss, by rounding, for there is no such formula."""
    strand = raytracer.Curves([(0, -1, 0), (0, 1, 0)], [0.5, 0.5], [0, 2], material=0)
    materials = [raytracer.Material((raytracer.Closure("diffuse"),), name="Locks")]
    scene = raytracer.Scene(curves=[strand], materials=materials)
    (ray,) = make_inspector(scene, raytracer.build(scene), Settings()).inspect_ray([0, 0, 5], [0, 0, -1])
    assert ray.hit is not None
    named = names.Names(objects={0: "Hair"}, polygons={(0, 0): 0}, materials={0: "Locks"}, lights={})
    lines = dict(describe.describe_hit(ray, ray.hit, named))
    assert (lines["Object"], lines["Segment"], lines["Error of t"][0][:7]) == (("Hair",), ("0",), "at most")
    assert not any("Lecture" in name or "Cramer" in name for name in lines)


def test_shadow_names_the_lamp_and_what_blocks_it(room: Any) -> None:
    inspected = inspect(3, 12)
    (ray, *_) = inspected.tree
    assert ray.hit is not None
    assert dict(describe.describe_hit(ray, ray.hit, inspected.names))["Polygon"] == ("1",)
    sentences = [describe.describe_shadow(shadow, inspected.names) for shadow in ray.shadows]
    assert sentences == ["Ceiling lamp: blocked by Roof"]
    (ray, *_) = inspect(22, 12).tree
    assert [describe.describe_shadow(shadow, inspected.names) for shadow in ray.shadows] == ["Ceiling lamp: visible"]


def test_list_rows_follow_the_tree(room: Any) -> None:
    inspect(16, 3)
    state = bpy.context.window_manager.reference_raytracer
    assert [(row.number, row.depth, row.name) for row in state.rays] == [
        (0, 0, "Camera: Mirror"),
        (1, 1, "Reflected: nothing"),
    ]


def test_clearing_and_loading_forget_rays_and_lines(room: Any) -> None:
    for forget in (bpy.ops.raytracer.clear_rays, lambda: bpy.ops.wm.read_homefile(use_factory_startup=True)):
        inspect(16, 3) if bpy.data.objects.get("Mirror") else None
        assert drawing.is_drawing()
        forget()
        assert not drawing.is_drawing()
        assert session.find_inspected() is None
        assert not bpy.context.window_manager.reference_raytracer.rays


def test_unregister_takes_lines_and_handlers_out(empty_scene: Any) -> None:
    before = list(bpy.app.handlers.load_post)
    addon.register()
    session.keep(session.Inspected([], session.Names({}, {}, {}, {}), ""))
    assert drawing.is_drawing()
    addon.unregister()
    assert not drawing.is_drawing()
    assert list(bpy.app.handlers.load_post) == before
    assert not hasattr(bpy.types.WindowManager, "reference_raytracer")


def test_undo_leaves_the_records_usable(room: Any) -> None:
    inspected = inspect(16, 3)
    bpy.ops.ed.undo_push(message="before")
    bpy.data.objects.remove(bpy.data.objects["Mirror"])
    bpy.ops.ed.undo_push(message="removed")
    bpy.ops.ed.undo()
    assert describe.title_ray(inspected.tree[0], inspected.names) == "Camera: Mirror"
    inspect(16, 3)


def test_inspecting_changes_nothing_in_the_scene(room: Any, tmp_path: Path) -> None:
    room.render.engine = "CYCLES"
    before = describe_scene(room)
    inspect(16, 3)
    assert describe_scene(room) == before


def describe_scene(scene: Any) -> dict[str, str]:
    values = {}
    for owner in (scene.render, scene.reference_raytracer, scene.view_layers[0], scene.cycles):
        for item in owner.bl_rna.properties:
            if item.type != "POINTER" and item.type != "COLLECTION":
                values[f"{owner.bl_rna.identifier}.{item.identifier}"] = repr(getattr(owner, item.identifier))
    return values


@pytest.mark.parametrize(("x", "y"), [(24, 0), (0, 16)])
def test_pixel_outside_of_the_picture_is_an_error(room: Any, x: int, y: int) -> None:
    with pytest.raises(RuntimeError, match="lies outside of the picture of 24 x 16"):
        bpy.ops.raytracer.inspect_pixel(x=x, y=y)


def test_the_picture_has_the_pixels_that_blender_gives_it(room: Any) -> None:
    render = room.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = 100, 200, 29
    assert session.find_resolution(room) == measure_picture(render) == (29, 58)


def test_scene_without_a_camera_is_an_error(room: Any) -> None:
    room.camera = None
    with pytest.raises(RuntimeError, match="has no camera"):
        bpy.ops.raytracer.inspect_pixel(x=0, y=0)


def test_ray_of_a_3d_view_needs_no_camera_and_sees_what_the_view_shows(room: Any) -> None:
    room.camera = None
    areas = [area for screen in bpy.data.screens for area in screen.areas if area.type == "VIEW_3D"]
    space = areas[0].spaces.active
    depsgraph = bpy.context.evaluated_depsgraph_get()
    inspected = session.inspect_ray(depsgraph, (4.5, -4.5, 9.0), (0, 0, -1), "Ray of the 3D view", "View", space)
    rows = bpy.context.window_manager.reference_raytracer.rays
    assert [row.name for row in rows] == ["View: Mirror", "Reflected: nothing"]
    assert inspected.tree[0].hit is not None
    space.show_object_viewport_mesh = False
    hidden = session.inspect_ray(depsgraph, (4.5, -4.5, 9.0), (0, 0, -1), "Ray of the 3D view", "View", space)
    assert hidden.tree[0].hit is None


def test_lines_end_at_hits_lamps_and_blockers(room: Any) -> None:
    tree = inspect(3, 12).tree
    lines = segments.make_segments(tree)
    assert len(lines.ends) == len(lines.colors) == len(lines.ray)
    camera, normal, shadow = lines.ends[lines.ray == 0]
    np.testing.assert_allclose(camera[:, 2], [10.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(normal[1] - normal[0], [0, 0, 10.0 * segments.NORMAL_SHARE], atol=1e-6)
    np.testing.assert_allclose(shadow[1, 2], ROOF_HEIGHT, atol=1e-6)
    np.testing.assert_array_equal(lines.colors[2, 0], np.float32(segments.LINE_COLORS["blocked"]))


@pytest.mark.parametrize(
    ("mouse", "crop", "size", "pixel"),
    [
        ((0.5, 0.25), False, (24, 16), (12, 4)),
        ((0.999, 0.999), False, (6, 4), (23, 15)),  # an image of another size shows the whole picture
        ((0.5, 0.25), True, (12, 8), (6 + 6, 4 + 2)),  # cropped to the border
        ((1.0, 0.5), False, (24, 16), None),
        ((0.5, -0.01), False, (24, 16), None),
    ],
)
def test_mouse_in_the_image_finds_the_pixel_of_the_picture(
    mouse: tuple[float, float], crop: bool, size: tuple[int, int], pixel: tuple[int, int] | None
) -> None:
    region = SimpleNamespace(view2d=SimpleNamespace(region_to_view=lambda x, y: mouse))
    area = SimpleNamespace(spaces=SimpleNamespace(active=SimpleNamespace(image=SimpleNamespace(size=size))))
    settings = SimpleNamespace(
        use_border=crop, use_crop_to_border=crop,
        border_min_x=0.25, border_max_x=0.75, border_min_y=0.25, border_max_y=0.75,
    )  # fmt: skip
    assert picking.find_pixel(picking.Place(area, region, 0, 0), (24, 16), settings) == pixel


def test_rays_that_end_nowhere_are_as_long_as_the_cameras(room: Any) -> None:
    lines = segments.make_segments(inspect(16, 3).tree)
    missed = lines.ends[lines.ray == 1][0]
    np.testing.assert_allclose(np.linalg.norm(missed[1] - missed[0]), 10.0, rtol=1e-5)
    assert (lines.colors[lines.ray == 1][0][:, 3] == (1.0, np.float32(segments.FADED))).all()


def test_an_error_while_picking_gives_cursor_and_status_line_back(room: Any) -> None:
    told: list[object] = []

    def fail(context: Any, event: Any) -> None:
        raise RuntimeError("unforeseen")

    context = SimpleNamespace(
        window=SimpleNamespace(cursor_modal_restore=lambda: told.append("cursor")),
        workspace=SimpleNamespace(status_text_set=told.append),
    )
    kind = operators.RAYTRACER_OT_inspect_pixel
    operator = SimpleNamespace(_pick=fail, _end=lambda *arguments: kind._end(operator, *arguments))
    with pytest.raises(RuntimeError, match="unforeseen"):
        kind.modal(operator, context, SimpleNamespace(type="LEFTMOUSE", value="PRESS"))
    assert told == ["cursor", None]
