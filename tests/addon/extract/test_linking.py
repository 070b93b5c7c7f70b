"""Which sets of objects lights and shining objects light, and are shadowed by: Blender's rules of the collections."""

from typing import Any

import bpy
import pytest

from addon.extract.scene import extract_scene

NAMES = ("A", "B", "C", "D")


@pytest.fixture
def linked() -> Any:
    """Four objects of one triangle, a lamp with the receiver collection that is returned, and one without."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    collection = bpy.context.scene.collection
    for name in NAMES:
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
        collection.objects.link(bpy.data.objects.new(name, mesh))
    for name in ("Lamp", "Other"):
        collection.objects.link(bpy.data.objects.new(name, bpy.data.lights.new(name, "POINT")))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    collection.objects.link(camera)
    bpy.context.scene.camera = camera
    receivers = bpy.data.collections.new("Lit")
    bpy.data.objects["Lamp"].light_linking.receiver_collection = receivers
    return receivers


def link(collection: Any, name: str, state: str = "INCLUDE") -> None:
    collection.objects.link(bpy.data.objects[name])
    collection.collection_objects[-1].light_linking.link_state = state


def find_lit(emitter: str = "Lamp") -> set[str]:
    """Return the names of the objects that a lamp or an object lights."""
    return find_linked(emitter, "light_set", "receivers")


def find_blocking(emitter: str = "Lamp") -> set[str]:
    """Return the names of the objects that shadow the light of a lamp or an object."""
    return find_linked(emitter, "shadow_set", "blockers")


def find_linked(emitter: str, own: str, named: str) -> set[str]:
    extraction = extract_scene(bpy.context.evaluated_depsgraph_get())
    assert not extraction.warnings
    names, instances = [key.name for key in extraction.objects], extraction.scene.instances
    masks = {light.name: getattr(light, named) for light in extraction.scene.lights}
    masks.update(zip(names, getattr(instances, named).tolist(), strict=True))
    sets = zip(names, getattr(instances, own).tolist(), strict=True)
    return {name for name, number in sets if masks[emitter] >> number & 1}


def test_an_empty_collection_changes_nothing(linked: Any) -> None:
    assert find_lit() == set(NAMES)


def test_only_what_is_included_is_lit(linked: Any) -> None:
    link(linked, "A")
    link(linked, "C")
    assert find_lit() == {"A", "C"}
    assert find_lit("Other") == find_lit("B") == set(NAMES)


def test_all_but_what_is_excluded_is_lit(linked: Any) -> None:
    link(linked, "B", "EXCLUDE")
    assert find_lit() == {"A", "C", "D"}


def test_where_some_are_included_the_others_are_dark(linked: Any) -> None:
    link(linked, "A")
    link(linked, "B", "EXCLUDE")
    assert find_lit() == {"A"}


def test_collections_within_have_one_state_for_all_and_objects_the_last_word(linked: Any) -> None:
    inner, innermost = (bpy.data.collections.new(name) for name in ("Inner", "Innermost"))
    linked.children.link(inner)
    inner.children.link(innermost)
    linked.collection_children[0].light_linking.link_state = "INCLUDE"
    link(inner, "A", "EXCLUDE")
    link(innermost, "B")
    link(innermost, "C")
    link(linked, "C", "EXCLUDE")
    assert find_lit() == {"A", "B"}


def test_an_object_that_shines_lights_what_it_is_linked_to(linked: Any) -> None:
    own = bpy.data.collections.new("Own")
    bpy.data.objects["A"].light_linking.receiver_collection = own
    link(own, "D", "EXCLUDE")
    link(linked, "B")
    assert find_lit("A") == {"A", "B", "C"}
    assert find_lit() == {"B"}


def test_an_instancer_lends_its_links_to_what_it_shows(linked: Any) -> None:
    hidden = bpy.data.collections.new("Hidden")
    for name in ("A", "B"):
        bpy.context.scene.collection.objects.unlink(bpy.data.objects[name])
        hidden.objects.link(bpy.data.objects[name])
    empty = bpy.data.objects.new("Empty", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", hidden
    bpy.context.scene.collection.objects.link(empty)
    link(linked, "Empty")
    assert find_lit() == {"A", "B"}


def test_links_that_change_are_read_again(linked: Any) -> None:
    link(linked, "A")
    assert find_lit() == {"A"}
    linked.collection_objects[0].light_linking.link_state = "EXCLUDE"
    assert find_lit() == {"B", "C", "D"}


def test_blockers_are_read_as_receivers_are_and_apart_from_them(linked: Any) -> None:
    blockers = bpy.data.collections.new("In the way")
    bpy.data.objects["Lamp"].light_linking.blocker_collection = blockers
    assert find_blocking() == set(NAMES)
    link(blockers, "B", "EXCLUDE")
    link(linked, "D")
    assert find_blocking() == {"A", "C", "D"}
    assert find_blocking("Other") == find_blocking("A") == set(NAMES)
    assert find_lit() == {"D"}
    link(blockers, "C")
    assert find_blocking() == {"C"}
