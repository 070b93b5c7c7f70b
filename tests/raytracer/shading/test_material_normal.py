"""A normal that a material computes for the whole of its surface: closed form, and nothing where it has none."""

import dataclasses

import numpy as np
import pytest

import raytracer
from raytracer.scene.materials import Closure, Material
from raytracer.scene.programs import Program, Register, Step
from tests.forbidding import forbid
from tests.raytracer.integrator.test_interreflection import look_around

FLOOR = raytracer.Mesh([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2), (0, 2, 3)])
TILT = np.array((0.6, 0.0, 0.8))


def lean(vector):
    """Return steps that give a vector everywhere, and are no constant to the tracer."""
    zero = Step("VECT_MATH Vector", (Register(0, "Location"), np.zeros(3), np.zeros(3), 0.0), {"operation": "SCALE"})
    add = Step("VECT_MATH Vector", (Register(1, "Vector"), np.asarray(vector), np.zeros(3), 1.0), {"operation": "ADD"})
    return Step("OBJECT_INFO Location"), zero, add


TILTED = Material(
    (Closure("diffuse", color=0.5),), program=Program(lean(TILT)), normal=Register(2, "Vector"), name="Tilted"
)


def see(material):
    sun = raytracer.SunLight((0, 0, 1), np.pi)
    return look_around(raytracer.Scene(meshes=[FLOOR], materials=[material], lights=[sun]), count=500)


def test_light_falls_on_the_normal_of_the_material():
    """Radiance 0.5 cos of the angle between the sun and the normal, where the surface itself faces the sun."""
    seen = see(TILTED)
    lit = seen[seen[:, 0] > 0]
    assert len(lit) > 100
    np.testing.assert_allclose(lit, 0.5 * TILT[2], rtol=1e-12)


def test_the_rest_of_the_program_reads_that_normal():
    steps = (*lean(TILT), Step("NEW_GEOMETRY Normal"))
    shining = Material(
        (Closure("emission", color=Register(3, "Normal")),), program=Program(steps), normal=Register(2, "Vector")
    )
    seen = see(shining)
    np.testing.assert_allclose(seen[seen.any(axis=1)], np.broadcast_to(TILT, seen[seen.any(axis=1)].shape), rtol=1e-12)


def test_a_material_without_one_needs_no_stage_and_keeps_its_picture(monkeypatch):
    plain = dataclasses.replace(TILTED, program=None, normal=None)
    computed = Material((Closure("diffuse", color=Register(2, "Vector")),), program=Program(lean((0.5, 0.5, 0.5))))
    before = see(plain)
    forbid(monkeypatch, "bend_normals")
    np.testing.assert_array_equal(see(plain), before)
    monkeypatch.undo()
    np.testing.assert_array_equal(see(computed), before)


def test_a_normal_that_is_no_step_of_the_program_is_refused():
    with pytest.raises(ValueError, match="Material 'Tilted': normal"):
        dataclasses.replace(TILTED, normal=Register(9, "Vector"))
