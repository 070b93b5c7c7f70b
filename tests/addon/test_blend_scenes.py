"""The stored example scenes: small, complete, and what their scripts build. The oracle is a fresh build."""

from typing import Any

import bpy
import pytest

import addon
from addon.extract.scene import extract_scene
from addon.versions import find_node_tree
from blend_scenes import building
from blend_scenes.make_all import build_scene, list_scenes

pytestmark = pytest.mark.blender

SCENES = list_scenes()
LARGEST_FILE = 1_500_000  # bytes; a repository keeps every version of a binary file
TRIANGLES_OF_TERRAIN = 2 * 2 * 4**8  # two faces of two triangles, each divided into four, eight times
# Inputs that newer Blenders give new nodes another value; in older files they stay as they were.
OTHER_DEFAULTS = {"Filter Width", "Subsurface Scale"}
SPHERES = {"plane_and_spheres": 4, "spheres_point_cloud": 3000 + 28 + 700}


@pytest.fixture(autouse=True)
def _leave_no_scene_behind():
    yield
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


def open_stored(name: str) -> bpy.types.Scene:
    bpy.ops.wm.open_mainfile(filepath=str(building.SCENES / f"{name}.blend"))
    return bpy.context.scene


def count_geometry() -> dict[str, int]:
    """Evaluate the open scene; count what a renderer is given."""
    counts = {"triangles": 0, "meshes": 0, "instances": 0, "spheres": 0}
    meshes = set()
    for placed in bpy.context.evaluated_depsgraph_get().object_instances:
        data = placed.object.data
        if placed.object.type == "POINTCLOUD":
            counts["spheres"] += len(data.points)
        elif placed.object.type == "MESH":
            data.calc_loop_triangles()
            meshes.add(data.as_pointer())
            counts["triangles"] += len(data.loop_triangles)
            counts["instances"] += placed.is_instance
    return counts | {"meshes": len(meshes)}


def show(value: Any) -> str:
    """Return numbers in so many digits as are the same wherever they are computed."""
    values = [value] if isinstance(value, float) else value
    return " ".join(f"{number + 0.0:.4g}" if abs(number) > 1e-4 else "0" for number in values)


def list_numbers(thing: Any) -> list[Any]:
    """Return the numbers and colors that a light, a camera or its depth of field is set to."""
    kinds = [item for item in thing.bl_rna.properties if item.type == "FLOAT" and not item.is_readonly]
    return [list(found) if item.is_array else found for item in kinds for found in (getattr(thing, item.identifier),)]


def describe_nodes(owner: Any) -> list[str]:
    """Return the nodes of a material or of a world, with the numbers in their inputs."""
    tree = find_node_tree(owner)
    nodes = tree.nodes if tree else []
    told = {node: [socket for socket in node.inputs if socket.name not in OTHER_DEFAULTS] for node in nodes}
    return sorted(f"{node.bl_idname}: {', '.join(map(describe_input, sockets))}" for node, sockets in told.items())


def describe_input(socket: Any) -> str:
    if socket.is_linked:
        return f"{socket.name} from {socket.links[0].from_node.bl_idname}"
    value = getattr(socket, "default_value", None)
    numbers = value if hasattr(value, "__len__") and not isinstance(value, str) else [value]
    return f"{socket.name} {show(numbers)}" if isinstance(numbers[0], float) else socket.name


def describe_scene() -> dict[str, object]:
    """Return what must be equal of a stored and of a fresh scene."""
    scene = bpy.context.scene
    bpy.context.view_layer.update()
    camera = scene.camera.data
    return {
        "objects": {thing.name: (thing.type, [slot.name for slot in thing.material_slots]) for thing in scene.objects},
        "places": {thing.name: show([value for row in thing.matrix_world for value in row]) for thing in scene.objects},
        "collections": sorted(collection.name for collection in bpy.data.collections),
        "lights": {light.name: (light.type, *map(show, list_numbers(light))) for light in bpy.data.lights},
        "materials": {material.name: describe_nodes(material) for material in bpy.data.materials},
        "worlds": {world.name: describe_nodes(world) for world in bpy.data.worlds},
        "camera": (scene.camera.name, *map(show, list_numbers(camera)), *map(show, list_numbers(camera.dof))),
        "size": (scene.render.resolution_x, scene.render.resolution_y),
        "view transform": scene.view_settings.view_transform,
        "geometry": count_geometry(),
    }


def test_scene_files_are_those_of_the_scripts():
    assert sorted(path.stem for path in building.SCENES.glob("*.blend")) == SCENES


@pytest.mark.parametrize("name", SCENES)
def test_stored_scene_equals_its_script(name):
    build_scene(name)
    fresh = describe_scene()
    open_stored(name)
    assert describe_scene() == fresh


@pytest.mark.parametrize("name", SCENES)
def test_stored_scene_is_small_and_from_the_oldest_blender(name):
    assert (building.SCENES / f"{name}.blend").stat().st_size < LARGEST_FILE
    open_stored(name)
    assert bpy.data.version[:2] == building.SAVED_WITH


@pytest.mark.parametrize("name", SCENES)
def test_stored_scene_misses_nothing(name):
    scene = open_stored(name)
    assert scene.camera is not None
    assert scene.world is not None
    assert not bpy.data.libraries
    assert all(font.filepath == "<builtin>" for font in bpy.data.fonts)
    assert not [image.name for image in bpy.data.images if image.source == "FILE" and not image.packed_file]
    for thing in scene.objects:
        assert thing.type == "EMPTY" or thing.data is not None, thing.name
        assert all(slot.material for slot in thing.material_slots), thing.name
        assert all(modifier.show_render for modifier in thing.modifiers), thing.name
    for tree in bpy.data.node_groups:
        assert all(node.bl_idname != "NodeUndefined" for node in tree.nodes), tree.name


@pytest.mark.parametrize("name", SCENES)
def test_stored_scene_is_shown_as_it_is(name):
    open_stored(name)
    assert not extract_scene(bpy.context.evaluated_depsgraph_get()).warnings


@pytest.mark.parametrize("name", SCENES)
def test_stored_scene_opens_with_the_engine_and_through_the_camera(name):
    addon.register()
    try:
        assert open_stored(name).render.engine == addon.properties.ENGINE
    finally:
        addon.unregister()
    views = [area.spaces.active for screen in bpy.data.screens for area in screen.areas if area.type == "VIEW_3D"]
    assert {view.region_3d.view_perspective for view in views} == {"CAMERA"}
    assert {view.shading.type for view in views} == {"SOLID"}


def test_settings_of_the_engine_wait_in_the_file_for_the_addon():
    addon.register()
    try:
        scene = open_stored("facing_mirrors")
        assert scene.reference_raytracer.glossy_bounces == scene.cycles.glossy_bounces == 12
    finally:
        addon.unregister()


@pytest.mark.parametrize(("name", "count"), SPHERES.items())
def test_point_clouds_are_true_spheres(name, count):
    open_stored(name)
    assert count_geometry()["spheres"] == count


def test_forest_instances_its_trees():
    open_stored("forest")
    counts = count_geometry()
    assert counts["instances"] >= 1000
    assert counts["meshes"] == 4  # the ground and three trees


def test_terrain_has_the_triangles_of_its_modifiers():
    open_stored("terrain")
    lake = 2
    assert count_geometry()["triangles"] == TRIANGLES_OF_TERRAIN + lake


def test_lights_shows_every_kind_and_every_area_shape():
    open_stored("lights")
    assert {light.type for light in bpy.data.lights} == {"POINT", "SUN", "SPOT", "AREA"}
    shapes = {light.shape for light in bpy.data.lights if light.type == "AREA"}
    assert shapes == {"SQUARE", "RECTANGLE", "DISK", "ELLIPSE"}
    assert {light.spot_blend for light in bpy.data.lights if light.type == "SPOT"} == {0.0, 1.0}


def test_newer_blender_refuses_to_save_a_scene(monkeypatch, tmp_path):
    newer = (building.SAVED_WITH[0], building.SAVED_WITH[1] + 1)
    if bpy.app.version[:2] == building.SAVED_WITH:
        monkeypatch.setattr(building, "SAVED_WITH", newer)
    with pytest.raises(SystemExit, match=r"saved with Blender 4\.\d"):
        building.save_scene(tmp_path / "scene.blend")
    assert not list(tmp_path.iterdir())
