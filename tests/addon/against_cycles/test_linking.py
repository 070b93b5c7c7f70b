"""Light linking against Cycles of the same Blender."""

import bpy
import pytest

from blend_scenes import building
from tests.addon.against_cycles.test_pictures import add_lamp, assert_pictures_agree, make_grey, make_stage

pytestmark = pytest.mark.usefixtures("registered_addon")


def link(emitter, state, *names):
    collection = bpy.data.collections.new(emitter.name)
    emitter.light_linking.receiver_collection = collection
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
