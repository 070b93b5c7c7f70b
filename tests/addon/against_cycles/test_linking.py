"""Light and shadow linking against Cycles of the same Blender."""

import bpy
import pytest

from blend_scenes import building
from tests.addon.against_cycles.test_pictures import add_lamp, assert_pictures_agree, make_grey, make_stage

pytestmark = pytest.mark.usefixtures("registered_addon")


def link(emitter, state, *names, kind="receiver"):
    collection = bpy.data.collections.new(emitter.name)
    setattr(emitter.light_linking, f"{kind}_collection", collection)
    for name in names:
        collection.objects.link(bpy.data.objects[name])
        collection.collection_objects[-1].light_linking.link_state = state


def add_box_and_ball(material=None):
    grey = material or make_grey()
    building.link_object("Box", building.make_box("Box", 0.8, 0.8, 0.9), (0.5, 0.4, 0), materials=[grey])
    building.link_object("Ball", building.make_sphere("Ball", 0.5, 32), (-0.7, 0.2, 0.5), materials=[grey])


@pytest.mark.parametrize(("state", "names"), [("INCLUDE", ["Box"]), ("EXCLUDE", ["Plane", "Ball"])])
def test_a_lamp_that_lights_some_objects_agrees(state, names):
    """All objects throw its shadows, and reflect its light on to the others."""
    scene = make_stage()
    add_box_and_ball()
    link(add_lamp("AREA", {"size": 1.0}), state, *names)
    building.add_light("Fill", "POINT", 60, (-2, -2, 3), (0, 0, 0))
    assert_pictures_agree(scene, samples=16, max_bounces=1)


def test_a_lamp_that_rough_mirrors_see_agrees():
    scene = make_stage()
    add_box_and_ball(building.make_shader("Rough", "Glossy", (0.9, 0.9, 0.9), roughness=0.3))
    link(add_lamp("POINT", {"shadow_soft_size": 0.6}), "EXCLUDE", "Ball")
    assert_pictures_agree(scene, samples=16, max_bounces=1)


def test_a_mesh_that_shines_on_some_objects_agrees():
    scene = make_stage()
    add_box_and_ball()
    glow = building.make_shader("Glow", "Emission", (1.0, 0.7, 0.4), strength=8.0)
    shape = building.make_sphere("Lamp", 0.4, 16)
    link(building.link_object("Lamp", shape, (0, -0.4, 1.8), materials=[glow]), "INCLUDE", "Plane")
    building.add_light("Fill", "POINT", 60, (-2, -2, 3), (0, 0, 0))
    assert_pictures_agree(scene, samples=16)


@pytest.mark.parametrize("kind", ["AREA", "SUN", "POINT"])
def test_a_lamp_that_some_objects_do_not_shadow_agrees(kind):
    scene = make_stage()
    add_box_and_ball(building.make_shader("Rough", "Glossy", (0.9, 0.9, 0.9), roughness=0.3))
    size = {"AREA": {"size": 1.0}, "SUN": {"angle": 0.3}, "POINT": {"shadow_soft_size": 0.6}}[kind]
    link(add_lamp(kind, size), "EXCLUDE", "Ball", kind="blocker")
    building.add_light("Fill", "POINT", 60, (-2, -2, 3), (0, 0, 0))
    assert_pictures_agree(scene, samples=16, max_bounces=1)


def test_a_lamp_that_one_object_shadows_agrees():
    """Without multiple importance sampling: with it Cycles loses light behind what shadows nothing."""
    scene = make_stage()
    add_box_and_ball()
    lamp = add_lamp("AREA", {"size": 1.0})
    lamp.data.cycles.use_multiple_importance_sampling = False
    link(lamp, "INCLUDE", "Box", kind="blocker")
    assert_pictures_agree(scene, samples=16, max_bounces=1)


@pytest.mark.parametrize("roughness", [0.0, 0.3, None])
def test_a_mesh_that_some_objects_do_not_shadow_agrees(roughness):
    """The plane mirrors the lamp; a roof between them is no blocker."""
    scene = make_stage()
    material = None if roughness is None else building.make_shader("Mirror", "Glossy", (0.9,) * 3, roughness=roughness)
    bpy.data.objects["Plane"].data.materials[0] = material or make_grey()
    add_box_and_ball()
    glow = building.make_shader("Glow", "Emission", (1.0, 0.7, 0.4), strength=8.0)
    shape = building.make_sphere("Lamp", 0.4, 16)
    lamp = building.link_object("Lamp", shape, (0, -0.4, 1.8), materials=[glow])
    building.link_object("Roof", building.make_plane("Roof", 2, 2), (0, 0, 1.3), materials=[make_grey()])
    link(lamp, "EXCLUDE", "Roof", "Ball", kind="blocker")
    assert_pictures_agree(scene, samples=16)
