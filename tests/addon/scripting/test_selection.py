"""What is cast into: lists of objects, collections, and what viewports, renders and cameras show."""

from __future__ import annotations

from typing import Any

import bpy
import pytest

from addon import ray_cast
from tests.addon.scripting.ray_cast_fixtures import (
    DOWN,
    find_depsgraph,
    forget_casters,  # noqa: F401  (a fixture, found by its name)
    link,
    make_collection_instance,
    make_quad,
)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("forget_casters")]


def name_first(origin: Any = (0.25, 0.5, 9.0), **options: Any) -> str | None:
    """Return the name of what is hit first from above, or None."""
    cast = ray_cast(find_depsgraph(), origin, DOWN, **options)
    return cast.objects[cast.object[0]].name if cast.result[0] else None


@pytest.fixture
def pile(empty_scene: Any) -> dict[str, Any]:
    """Three squares above each other, the upper two in a collection of their own each, one in the other."""
    outer, inner = (bpy.data.collections.new(name) for name in ("Outer", "Inner"))
    empty_scene.collection.children.link(outer)
    outer.children.link(inner)
    places = (("Low", None, 0), ("Middle", outer, 1), ("High", inner, 2))
    return {name: link(name, make_quad(), (0, 0, z), collection) for name, collection, z in places}


def test_only_the_objects_of_a_list_are_hit(pile: dict[str, Any]) -> None:
    assert name_first() == "High"
    assert name_first(objects=[pile["Low"], pile["Middle"]]) == "Middle"
    assert name_first(objects=pile["Low"]) == "Low"
    assert name_first(objects=[]) is None
    assert name_first(objects=(pile["Low"].evaluated_get(find_depsgraph()),)) == "Low"
    assert name_first() == "High"


def test_only_the_objects_of_a_collection_and_those_in_it_are_hit(pile: dict[str, Any]) -> None:
    cast = ray_cast(find_depsgraph(), (0.25, 0.5, 9), DOWN, hits=5, collection=bpy.data.collections["Outer"])
    assert [cast.objects[number].name for number in cast.object[0] if number >= 0] == ["High", "Middle"]
    assert name_first(collection=bpy.data.collections["Inner"], objects=[pile["Low"]]) == "High"


def test_an_object_stands_for_its_instances_and_those_that_it_makes(empty_scene: Any) -> None:
    make_collection_instance()
    source, empty = bpy.data.objects["Source"], bpy.data.objects["Empty"]
    left, right = (-1.75, 1.5, 9), (2.25, 0.5, 9)
    assert [name_first(place, objects=[source]) for place in (left, right)] == ["Source", "Source"]
    assert [name_first(place, objects=[empty]) for place in (left, right)] == [None, "Source"]


def test_renders_show_what_viewports_hide_and_the_other_way(pile: dict[str, Any]) -> None:
    pile["High"].hide_render = True
    pile["Middle"].hide_set(True)  # the eye in the outliner: renders show it, and so does the depsgraph hold it
    assert name_first() == "High"
    cast = ray_cast(find_depsgraph(), (0.25, 0.5, 9), DOWN, visibility="render")
    assert not cast.missing
    assert name_first(visibility="render") == "Middle"
    pile["Low"].hide_viewport = True
    cast = ray_cast(find_depsgraph(), (0.25, 0.5, 9), DOWN, visibility="render")
    assert pile["Low"] in cast.missing
    assert pile["High"] not in cast.missing
    assert ray_cast(find_depsgraph(), (0.25, 0.5, 9), DOWN).missing == ()


def test_collections_that_renders_hide_hide_all_that_is_in_them(pile: dict[str, Any]) -> None:
    bpy.data.collections["Outer"].hide_render = True
    assert name_first(visibility="render") == "Low"
    bpy.context.scene.collection.objects.link(pile["High"])  # one that is shown is enough
    assert name_first(visibility="render") == "High"
    bpy.context.view_layer.layer_collection.children["Outer"].exclude = True
    assert name_first(visibility="render") == "High"


def test_cameras_do_not_see_what_is_hidden_from_their_rays(pile: dict[str, Any]) -> None:
    pile["High"].visible_camera = False
    assert name_first(visibility="camera") == "Middle"
    assert name_first(visibility="render") == name_first() == "High"
    pile["Middle"].hide_render = True
    assert name_first(visibility="camera") == "Low"


def test_an_instancer_is_shown_as_its_settings_say(empty_scene: Any) -> None:
    parent, child = link("Parent", make_quad(2)), link("Child", make_quad(0.1), (0, 0, 5))
    child.parent = parent
    parent.instance_type = "VERTS"
    for shown, expected in ((True, "Parent"), (False, None)):
        parent.show_instancer_for_render = shown
        assert name_first(visibility="render") == expected
        assert name_first() == "Parent"
    assert name_first((2.01, 2.02, 9), visibility="render") == "Child"


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"objects": "Cube"}, "objects: expected a list of bpy.types.Object, got str"),
        ({"objects": [1]}, "objects: expected a list of bpy.types.Object, got one of int"),
        ({"objects": 3}, "objects: expected a list of bpy.types.Object, got int"),
        ({"collection": "A"}, "collection: expected a bpy.types.Collection, got str"),
        ({"visibility": "sun"}, "visibility: expected one of viewport, render, camera, got 'sun'"),
    ],
)
def test_a_selection_that_is_none_is_refused(empty_scene: Any, options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        name_first(**options)


def test_while_rendering_a_handler_can_hit_what_viewports_disable(pile: dict[str, Any], registered_addon: None) -> None:
    """Blender lends the depsgraph of a render to handlers of frame_change_post."""
    scene = bpy.context.scene
    pile["High"].hide_viewport = True
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    scene.render.engine = "REFERENCE_RAYTRACER"
    scene.reference_raytracer.samples = scene.reference_raytracer.workers = 1
    scene.render.resolution_x = scene.render.resolution_y = 8
    hit: dict[str, str] = {}

    def note(_: Any, depsgraph: Any) -> None:
        cast = ray_cast(depsgraph, (0.25, 0.5, 9.0), DOWN, visibility="render")
        hit[depsgraph.mode] = cast.objects[cast.object[0]].name

    bpy.app.handlers.frame_change_post.append(note)
    try:
        bpy.ops.render.render()
    finally:
        bpy.app.handlers.frame_change_post.remove(note)
    assert hit == {"RENDER": "High", "VIEWPORT": "Middle"}
