"""addon.ray_cast against Scene.ray_cast: what it sees and what it returns.

On the scenes of blend_scenes/ differences are judged by exact arithmetic, as in test_against_blender.py. The small
scenes here are cast at far from all edges, where both have to say the same.
"""

from __future__ import annotations

from functools import partial

import bmesh
import bpy
import numpy as np
import pytest
from mathutils import Matrix

from addon import ray_cast
from addon.compare.ray_cast import comparison as comparison_module
from addon.compare.ray_cast.comparison import compare_sides
from addon.compare.ray_cast.rays import aim_rays
from addon.compare.ray_cast.sides import Answers, Sides, key_of
from addon.extract.camera import extract_camera
from addon.extract.warnings import WarningList
from addon.scripting import held, results
from tests.addon.scripting.ray_cast_fixtures import (
    DOWN,
    aim_down,
    assert_same_as_blender,
    find_depsgraph,
    forget_casters,  # noqa: F401  (a fixture, found by its name)
    link,
    make_collection_instance,
    make_quad,
    set_values,
)
from tests.addon.scripting.test_against_blender import SCENES, assert_blender_agrees, mark_large, open_scene

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("forget_casters")]

RAY_VISIBILITY = ("camera", "diffuse", "glossy", "transmission", "shadow", "volume_scatter")


# Scenes of blend_scenes/ --------------------------------------------------------------------------------------------


def make_sides(scene, depsgraph):
    """Return both sides of a comparison; ours has the placements that `ray_cast` answers with."""
    kept, placements = held.find_held(depsgraph)
    keys = [key_of(placement.original.name_full, placement.world_from_object) for placement in placements]
    target_of_key = {key: number for number, key in reversed(list(enumerate(keys)))}
    return Sides(
        caster=kept.caster,
        ray_cast=partial(scene.ray_cast, depsgraph),
        target_of_instance=np.array([target_of_key[key] for key in keys], dtype=np.int64),
        target_of_key=target_of_key,
        polygons=tuple(shape.polygons for shape in dict.fromkeys(kept.shape_of_placement)),
    )


def answer_with_arrays(depsgraph, sides, rays):
    """Return what `ray_cast` says, as one side of a comparison."""
    cast = ray_cast(depsgraph, rays.origins, rays.directions)
    target = np.full(len(cast), -1, dtype=np.int64)
    for ray in np.flatnonzero(cast.result):
        target[ray] = sides.target_of_key[key_of(cast.objects[cast.object[ray]].name_full, cast.matrix[ray])]
    missed = ~cast.result[:, None]
    location, normal = (np.where(missed, np.nan, values) for values in (cast.location, cast.normal))
    hits = sides.caster.closest_hit(rays.origins, rays.directions)
    return Answers(target, cast.index.astype(np.int64), location, normal, 0.0), hits


@pytest.mark.parametrize("path", mark_large(SCENES))
def test_arrays_say_what_scene_ray_cast_says(path, monkeypatch, record_property):
    scene, depsgraph = open_scene(path)
    sides = make_sides(scene, depsgraph)
    monkeypatch.setattr(comparison_module, "cast_ours", partial(answer_with_arrays, depsgraph))
    rays = aim_rays(sides.caster.geometry, extract_camera(depsgraph.scene_eval, WarningList()), 32, 18, 200, seed=3)
    comparison = compare_sides(sides, rays)
    for name, number in comparison.summarise().items():
        record_property(name, number)
    assert_blender_agrees(comparison, sides)


# What Scene.ray_cast sees -------------------------------------------------------------------------------------------


def hide_face_in_edit_mode(thing):
    bpy.context.view_layer.objects.active = thing
    bpy.ops.object.mode_set(mode="EDIT")
    faces = bmesh.from_edit_mesh(thing.data)
    faces.faces.ensure_lookup_table()
    faces.faces[0].hide_set(True)
    bmesh.update_edit_mesh(thing.data)


def hide_layer_collection(name):
    def hide(thing):
        collection = bpy.data.collections.new("Layer")
        bpy.context.scene.collection.children.link(collection)
        bpy.context.scene.collection.objects.unlink(thing)
        collection.objects.link(thing)
        setattr(bpy.context.view_layer.layer_collection.children[0], name, True)

    return hide


CHANGES = {
    "nothing": lambda thing: None,
    "shown as wire": set_values(display_type="WIRE"),
    "shown as bounds": set_values(display_type="BOUNDS"),
    "hidden from all rays": set_values(**{f"visible_{kind}": False for kind in RAY_VISIBILITY}),
    "hidden in renders": set_values(hide_render=True),
    "hidden in viewports": set_values(hide_viewport=True),
    "hidden by its eye": lambda thing: thing.hide_set(True),
    "not selectable": set_values(hide_select=True),
    "mirrored": set_values(scale=(2, 3, -1)),
    "sheared": set_values(rotation_euler=(0.4, 0.3, 0.2), scale=(1, 3, 0.5)),
    "in an excluded collection": hide_layer_collection("exclude"),
    "in a hidden collection": hide_layer_collection("hide_viewport"),
    "in an indirect collection": hide_layer_collection("indirect_only"),
    "hidden faces": lambda thing: thing.data.polygons.foreach_set("hide", [True] * 4),
    "being edited": lambda thing: (
        setattr(bpy.context.view_layer.objects, "active", thing),
        bpy.ops.object.mode_set(mode="EDIT"),
    ),
    "being edited, a face hidden": hide_face_in_edit_mode,
    "subdivided": lambda thing: thing.modifiers.new("Subdivision", "SUBSURF"),
    "a NaN in it": lambda thing: setattr(thing.data.vertices[0], "co", (float("nan"), 0, 0)),
}
if "hide_surface_pick" in bpy.types.Object.bl_rna.properties:  # since Blender 5.0
    CHANGES["not to be picked"] = set_values(hide_surface_pick=True)


@pytest.mark.parametrize("change", CHANGES)
def test_object_is_seen_as_scene_ray_cast_sees_it(empty_scene, change):
    link("Below", make_quad(3), (0.2, 0.1, -2))
    thing = link("Thing", make_quad(1.5, copies=4))
    thing.data.transform(Matrix.Rotation(0.1, 4, "X"))
    find_depsgraph()
    CHANGES[change](thing)
    try:
        cast = assert_same_as_blender()
    finally:
        if bpy.context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
    assert cast.result.any()


def test_object_without_height_is_hit(empty_scene):
    """Its matrix has no inverse, so Blender passes it; in the world it is a triangle like others."""
    bpy.ops.mesh.primitive_cube_add(scale=(1, 1, 0))
    cast = ray_cast(find_depsgraph(), (0.1, 0.3, 5.0), DOWN)
    assert cast.result.all()
    np.testing.assert_array_equal(cast.location, [(0.1, 0.3, 0.0)])
    np.testing.assert_array_equal(np.abs(cast.normal), [(0.0, 0.0, 1.0)])


def make_vertex_instances(kind, **values):
    parent, child = link("Parent", make_quad(3, z=-1)), link("Child", make_quad(0.7), (0.1, 0.2, 1))
    child.parent, parent.instance_type = parent, kind
    set_values(**values)(parent)


def make_geometry_nodes():
    """Cubes at the vertices of a quad, and the quad itself."""
    tree = bpy.data.node_groups.new("Cubes", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    kinds = ("NodeGroupInput", "GeometryNodeInstanceOnPoints", "GeometryNodeMeshCube", "GeometryNodeJoinGeometry")
    given, place, cube, join = (tree.nodes.new(kind) for kind in kinds)
    made = tree.nodes.new("NodeGroupOutput")
    for source, target in ((given, place.inputs["Points"]), (cube, place.inputs["Instance"]), (place, join.inputs[0])):
        tree.links.new(source.outputs[0], target)
    tree.links.new(given.outputs[0], join.inputs[0])
    tree.links.new(join.outputs[0], made.inputs[0])
    link("Nodes", make_quad(2)).modifiers.new("Cubes", "NODES").node_group = tree


def make_background_scene():
    other = bpy.data.scenes.new("Background")
    other.collection.objects.link(bpy.data.objects.new("Behind", make_quad()))
    bpy.context.scene.background_set = other
    link("Front", make_quad(0.5))


def make_coinciding():
    for name in "ABC":
        link(name, make_quad())
    make_collection_instance()


INSTANCES = {
    "collection": make_collection_instance,
    "collection, its source not in renders": partial(make_collection_instance, hide_render=True),
    "collection, its source not in viewports": partial(make_collection_instance, hide_viewport=True),
    "vertices": partial(make_vertex_instances, "VERTS"),
    "vertices, instancer not shown": partial(make_vertex_instances, "VERTS", show_instancer_for_viewport=False),
    "faces": partial(make_vertex_instances, "FACES"),
    "geometry nodes": make_geometry_nodes,
    "background scene": make_background_scene,
    "objects that coincide": make_coinciding,
}


@pytest.mark.parametrize("name", INSTANCES)
def test_instances_are_seen_as_scene_ray_cast_sees_them(empty_scene, name):
    INSTANCES[name]()
    cast = assert_same_as_blender()
    assert cast.result.any() == (name != "collection, its source not in viewports")


ADD = {
    "FONT": lambda: bpy.ops.object.text_add(),
    "CURVE": lambda: bpy.ops.curve.primitive_bezier_circle_add(radius=2),
    "SURFACE": lambda: bpy.ops.surface.primitive_nurbs_surface_sphere_add(radius=2),
    "META": lambda: bpy.ops.object.metaball_add(radius=2),
}


@pytest.mark.parametrize("kind", ADD)
def test_what_becomes_a_mesh_is_seen(empty_scene, kind):
    """Blender 4.2 passes text, curves and surfaces that stand for themselves; ours sees them in every version."""
    ADD[kind]()
    thing = bpy.context.object
    if kind == "FONT":
        thing.data.size = 8
    if kind == "CURVE":
        thing.data.dimensions, thing.data.fill_mode = "2D", "BOTH"
    if bpy.app.version >= (5, 0) or kind == "META":
        cast = assert_same_as_blender()
    else:
        cast = ray_cast(find_depsgraph(), *aim_down())
    assert cast.objects == (thing,)
    assert cast.result.any()


def test_hair_and_point_clouds_are_passed(empty_scene):
    path = next(path for path in SCENES if path.stem == "spheres_point_cloud")
    _, depsgraph = open_scene(path)
    clouds = [item.object.name for item in depsgraph.object_instances if item.object.type == "POINTCLOUD"]
    assert clouds
    link("Hair", bpy.data.hair_curves.new("Hair"))
    cast = ray_cast(find_depsgraph(), *aim_down())
    assert not {thing.name for thing in cast.objects} & {*clouds, "Hair"}


def test_state_is_that_of_the_depsgraph_visibility_that_of_now(empty_scene):
    """As Scene.ray_cast has it: where things stand is evaluated, whether they are hidden is asked."""
    one, other = link("One", make_quad()), link("Other", make_quad(z=-1))
    depsgraph = find_depsgraph()
    one.location.z = 2
    assert_same_as_blender(depsgraph=depsgraph)
    other.hide_set(True)
    assert_same_as_blender(depsgraph=depsgraph)
    one.hide_set(True)
    assert not assert_same_as_blender(depsgraph=depsgraph).result.any()
    depsgraph.update()
    one.hide_set(False)
    assert_same_as_blender()


# Rays ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("distance", [0.0, -1.0, 4.0, 4.999, 5.0, 5.001, np.inf])
@pytest.mark.parametrize("length", [1.0, 3.0, 0.25])
def test_distance_is_in_metres_and_its_end_is_out(empty_scene, distance, length):
    link("Thing", make_quad())
    assert_same_as_blender(np.array([[0.1, 0.2, 5.0]]), np.array([[0.0, 0.0, -length]]), distance=distance)


def test_distance_may_differ_from_ray_to_ray(empty_scene):
    link("Thing", make_quad())
    cast = ray_cast(find_depsgraph(), (0.1, 0.2, 5.0), np.tile(DOWN, (4, 1)), distance=[4.0, 5.0, 6.0, np.nan])
    np.testing.assert_array_equal(cast.result, [False, False, True, False])


@pytest.mark.parametrize("length", [1e-300, 1e-20, 1e300])
def test_direction_of_any_length_is_as_good(empty_scene, length):
    link("Thing", make_quad())
    depsgraph = find_depsgraph()
    for distance, expected in ((4.99, False), (5.01, True), (np.inf, True)):
        cast = ray_cast(depsgraph, (0.1, 0.2, 5.0), (0.0, 0.0, -length), distance)
        assert cast.result.tolist() == [expected]
    np.testing.assert_allclose(cast.location, [(0.1, 0.2, 0.0)], atol=1e-15)


@pytest.mark.parametrize(
    ("origin", "direction"),
    [
        ((0.1, 0.2, -5.0), (0, 0, 1)),
        ((0.1, 0.2, 0.0), DOWN),
        ((0.1, 0.2, 5.0), (0, 0, 0)),
        ((0.1, 0.2, 5.0), (np.nan, 0, -1)),
        ((np.nan, 0.2, 5.0), DOWN),
        ((0.1, 0.2, np.inf), DOWN),
        ((0.1, 0.2, 5.0), (np.inf, 0, -1)),
    ],
    ids=[
        *("from behind", "on the surface", "no direction", "NaN direction", "NaN origin", "infinite origin"),
        "infinite direction",
    ],
)
def test_unusual_rays_get_what_blender_says(empty_scene, origin, direction):
    link("Thing", make_quad())
    assert_same_as_blender(np.array([origin]), np.array([direction], dtype=float))


def test_scene_without_meshes_is_missed(empty_scene):
    cast = assert_same_as_blender()
    assert cast.objects == ()
    assert not cast.result.any()


def test_no_rays_give_no_results(empty_scene):
    link("Thing", make_quad())
    cast = ray_cast(find_depsgraph(), np.zeros((0, 3)), np.zeros((0, 3)))
    assert len(cast) == 0
    assert cast.matrix.shape == (0, 4, 4)


def test_normals_are_the_same_measured_once_or_for_each_hit(empty_scene, monkeypatch):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=2, scale=(1, -1, 0.5))
    many = assert_same_as_blender()
    monkeypatch.setattr(results, "SHARED_TRIANGLES", 0)
    np.testing.assert_array_equal(ray_cast(find_depsgraph(), *aim_down()).normal, many.normal)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros((2, 2)), DOWN), r"^origins: expected shape \(n, 3\) float64, got \(2, 2\)$"),
        ((DOWN, "down"), r"^directions: expected an array \(n, 3\) float64, got .*$"),
        ((np.zeros((2, 3)), np.ones((3, 3))), r"^directions: expected as many rows as origins, 2, got 3$"),
        ((DOWN, DOWN, "far"), r"^distance: expected an array \(\) float64, got str$"),
        ((DOWN, DOWN, [1.0, 2.0]), r"^distance: expected a number or an array \(1,\), got shape \(2,\)$"),
        ((DOWN, DOWN, 1j), r"^distance: expected an array \(\) float64, got complex$"),
    ],
)
def test_bad_input_is_named_in_one_sentence(empty_scene, arguments, message):
    with pytest.raises(ValueError, match=message):
        ray_cast(find_depsgraph(), *arguments)


def test_context_for_a_depsgraph_is_named(empty_scene):
    with pytest.raises(ValueError, match=r"^depsgraph: expected a bpy\.types\.Depsgraph, got Context$"):
        ray_cast(bpy.context, DOWN, DOWN)
