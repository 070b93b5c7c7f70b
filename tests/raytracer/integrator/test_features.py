"""Features follow from a scene's content: each flag is raised by what it names, and by nothing else."""

import dataclasses

import numpy as np
import pytest

from raytracer import (
    Closure,
    Instances,
    Material,
    Mesh,
    PointLight,
    Scene,
    Spheres,
    Volume,
    VolumeClosure,
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
        (Scene(meshes=[Mesh(*QUAD)]), set()),
        (Scene(meshes=[Mesh(*QUAD, normals=np.ones((4, 3)))]), {"smooth_normals"}),
        (Scene(meshes=[Mesh(*QUAD, uvs=np.ones((4, 2)))]), {"uvs"}),
        (Scene(spheres=Spheres([(0, 0, 0)], [1])), set()),
        (Scene(spheres=Spheres([(0, 0, 0)], [1], holdout=True)), {"holdout"}),
        (Scene(meshes=[Mesh(*QUAD)], instances=Instances([0], [np.eye(4)], holdout=[True])), {"holdout"}),
        (Scene(spheres=Spheres([(0, 0, 0)], [1], shadow_catcher=True)), {"shadow_catchers"}),
        (Scene(meshes=[Mesh(*QUAD)], instances=Instances([0], [np.eye(4)])), set()),
        (Scene(lights=[PointLight((0, 0, 0), 1)]), set()),
        (Scene(world=World(0.5)), {"world"}),
        (Scene(world=World(0)), set()),
        (Scene(world=World(0, volume=Volume())), set()),
        (Scene(world=World(0, volume=Volume(VolumeClosure("scatter")))), {"media"}),
        (Scene(materials=Material((), volume=Volume(VolumeClosure("absorption")))), {"media"}),
        (Scene(materials=Material(only_volume=True)), {"media", "transparency"}),
        (with_closures(), set()),
        (with_closures(Closure("diffuse")), {"diffuse"}),
        (with_closures(Closure("diffuse", color=0)), set()),
        (with_closures(Closure("translucent")), {"diffuse", "translucent"}),
        (with_closures(Closure("translucent", color=0)), set()),
        (with_closures(Closure("principled", metallic=1)), {"specular", "rough"}),
        (with_closures(Closure("principled", transmission=1)), {"specular", "rough"}),
        (with_closures(Closure("emission", color=1)), {"emission"}),
        (with_closures(Closure("emission", color=0)), set()),
        (with_closures(Closure("emission", color=1, weight=0)), set()),
        (with_closures(Closure("glossy", roughness=0)), {"specular", "narrow"}),
        (with_closures(Closure("glossy", roughness=0.1)), {"specular", "rough", "narrow"}),
        (with_closures(Closure("glossy", roughness=0.3)), {"specular", "rough"}),
        (with_closures(Closure("glossy", weight=0)), set()),
        (with_closures(Closure("glass", roughness=0)), {"specular", "narrow"}),
        (with_closures(Closure("refraction", roughness=0)), {"specular", "narrow"}),
        (with_closures(Closure("transparent")), {"transparency"}),
        (with_closures(Closure("principled")), {"diffuse", "specular", "rough"}),
        (with_closures(Closure("principled", coat_weight=1)), {"diffuse", "specular", "rough", "narrow"}),
        (with_closures(Closure("principled", alpha=0.5)), {"diffuse", "specular", "rough", "transparency"}),
        (with_closures(Closure("principled", emission=1)), {"diffuse", "specular", "rough", "emission"}),
    ],
)
def test_features_are_those_of_the_content(scene, flags):
    default = {"diffuse"} if scene.materials == (DEFAULT_MATERIAL,) else set()
    assert raised(scene) == flags | default
