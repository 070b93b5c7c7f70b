"""Features follow from a scene's content: each flag is raised by what it names, and by nothing else."""

import dataclasses

import numpy as np
import pytest

from raytracer import (
    AreaLight,
    Closure,
    Instances,
    Material,
    Mesh,
    PointLight,
    Scene,
    Spheres,
    SpotLight,
    SunLight,
    World,
)
from raytracer.integrator.features import Features, derive_features
from raytracer.scene.materials import DEFAULT_MATERIAL
from tests import meshes

QUAD = meshes.make_quad()
EMPTY = (np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32))


def raised(scene):
    features = derive_features(scene)
    return {field.name for field in dataclasses.fields(Features) if getattr(features, field.name)}


def with_closures(*closures):
    return Scene(materials=[Material(closures)])


@pytest.mark.parametrize(
    ("scene", "flags"),
    [
        (Scene(), set()),
        (Scene(meshes=[Mesh(*QUAD)]), {"meshes"}),
        (Scene(meshes=[Mesh(*EMPTY)]), set()),
        (Scene(meshes=[Mesh(*QUAD, normals=np.ones((4, 3)))]), {"meshes", "smooth_normals"}),
        (Scene(meshes=[Mesh(*QUAD, uvs=np.ones((4, 2)))]), {"meshes", "uvs"}),
        (Scene(spheres=Spheres([(0, 0, 0)], [1])), {"spheres"}),
        (Scene(spheres=Spheres(np.zeros((0, 3)), [])), set()),
        (Scene(spheres=Spheres([(0, 0, 0)], [1], holdout=True)), {"spheres", "holdout"}),
        (Scene(meshes=[Mesh(*QUAD)], instances=Instances([0], [np.eye(4)], holdout=[True])), {"meshes", "holdout"}),
        (Scene(spheres=Spheres([(0, 0, 0)], [1], shadow_catcher=True)), {"spheres", "shadow_catchers"}),
        (Scene(meshes=[Mesh(*QUAD)], instances=Instances([0], [np.eye(4)])), {"meshes"}),
        (Scene(lights=[PointLight((0, 0, 0), 1)]), {"point_lights"}),
        (Scene(lights=[SpotLight((0, 0, 0), 1)]), {"spot_lights"}),
        (Scene(lights=[SunLight((0, 0, 1), 1)]), {"sun_lights"}),
        (Scene(lights=[AreaLight((0, 0, 0), (1, 0, 0), (0, 1, 0), 1)]), {"area_lights"}),
        (Scene(world=World(0.5)), {"world"}),
        (Scene(world=World(0)), set()),
        (with_closures(), set()),
        (with_closures(Closure("diffuse")), {"diffuse"}),
        (with_closures(Closure("diffuse", color=0)), set()),
        (with_closures(Closure("principled", metallic=1)), {"mirrors", "rough"}),
        (with_closures(Closure("principled", transmission=1)), {"mirrors", "rough"}),
        (with_closures(Closure("emission", color=1)), {"emission"}),
        (with_closures(Closure("emission", color=0)), set()),
        (with_closures(Closure("emission", color=1, weight=0)), set()),
        (with_closures(Closure("glossy", roughness=0)), {"mirrors"}),
        (with_closures(Closure("glossy", roughness=0.1)), {"mirrors", "rough"}),
        (with_closures(Closure("glossy", weight=0)), set()),
        (with_closures(Closure("glass", roughness=0)), {"mirrors"}),
        (with_closures(Closure("refraction", roughness=0)), {"mirrors"}),
        (with_closures(Closure("transparent")), {"transparency"}),
        (with_closures(Closure("principled")), {"diffuse", "mirrors", "rough"}),
        (with_closures(Closure("principled", alpha=0.5)), {"diffuse", "mirrors", "rough", "transparency"}),
        (with_closures(Closure("principled", emission=1)), {"diffuse", "mirrors", "rough", "emission"}),
    ],
)
def test_features_are_those_of_the_content(scene, flags):
    default = {"diffuse"} if scene.materials == (DEFAULT_MATERIAL,) else set()
    assert raised(scene) == flags | default
