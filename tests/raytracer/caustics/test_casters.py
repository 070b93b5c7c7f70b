"""What casts caustics: smooth meshes of one clear glass, if they are asked to."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import raytracer
from raytracer import Closure, Material
from raytracer.caustics.casters import find_bending_eta, find_casters
from tests.raytracer.caustics.glass_scenes import make_glass, make_pane

CLEAR = {
    "glass": make_glass(ior=1.3),
    "refraction": make_glass("refraction", ior=1.3),
    "principled": make_glass("principled", ior=1.3, transmission=1.0),
    "beside a mirror": Material([Closure("glass", roughness=0.0, ior=1.3), Closure("glossy", roughness=0.2)]),
}
OTHER = {
    "diffuse": Material([Closure("diffuse")]),
    "rough": Material([Closure("glass", roughness=0.1)]),
    "two": Material([Closure("glass", roughness=0.0), Closure("refraction", roughness=0.0)]),
    "transparent": Material([Closure("glass", roughness=0.0), Closure("transparent")]),
    "alpha": Material([Closure("principled", roughness=0.0, transmission=1.0, alpha=0.5)]),
    "opaque": Material([Closure("principled", roughness=0.0)]),
}


@pytest.mark.parametrize("name", CLEAR)
def test_clear_glass_bends(name):
    assert find_bending_eta(CLEAR[name]) == 1.3


@pytest.mark.parametrize("name", OTHER)
def test_other_materials_do_not(name):
    assert np.isnan(find_bending_eta(OTHER[name]))


def test_casters_are_smooth_clear_and_asked_for():
    pane = make_pane(0.0, 1.0)
    meshes = [pane, raytracer.Mesh(pane.positions, pane.triangles), pane.with_material(1)]
    instances = raytracer.Instances([0, 1, 2, 0], [np.eye(4)] * 4, caustics_caster=[True, True, True, False])
    scene = raytracer.Scene(meshes=meshes, instances=instances, materials=[CLEAR["glass"], OTHER["rough"]])
    assert_array_equal(find_casters(scene), [True, False, False, False])
    assert not find_casters(raytracer.Scene(meshes=meshes, materials=scene.materials)).any()
