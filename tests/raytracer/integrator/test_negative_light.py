"""Light below 0: every estimator is odd in the light, so that a source of -L gives the picture of L with the sign
turned, bit for bit; and closed forms."""

import numpy as np
import pytest

import raytracer
from raytracer.scene.programs import Program, Register, Step
from tests.raytracer.integrator.test_interreflection import BOX, look_around

COUNT = 4_000
GREYS = np.array([0.2, 0.5, 0.8])
FLOOR = raytracer.Mesh([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2), (0, 2, 3)])
LAMP = raytracer.Mesh([(-1, -1, 3), (1, -1, 3), (1, 1, 3.5), (-1, 1, 3)], [(0, 1, 2), (0, 2, 3)], material=1)
BALL = raytracer.Spheres([(1, 1, 2)], [0.5], material=1)
GLOSS = raytracer.Closure("glossy", color=0.5, roughness=0.3)
SURFACE = raytracer.Material((raytracer.Closure("diffuse", color=GREYS), GLOSS))


def times(step, factor):
    """Return the steps of a vector that is the output of `step` times a factor, and its register."""
    scaled = Step(
        "VECT_MATH Vector", (Register(0, "Position"), np.zeros(3), np.zeros(3), factor), {"operation": "SCALE"}
    )
    return Program((step, scaled)), Register(1, "Vector")


def shine(sign):
    return raytracer.Material((raytracer.Closure("emission", color=sign * np.array([3.0, 2.0, 0.5])),))


def shine_unevenly(sign):
    """Both signs at once: the position, from -1 to 1 along x."""
    program, light = times(Step("NEW_GEOMETRY Position"), sign)
    return raytracer.Material((raytracer.Closure("emission", color=light),), program=program)


def vary_world(sign):
    program, light = times(Step("NEW_GEOMETRY Position"), sign)
    return raytracer.World(light, program)


TILT = np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]])
SOURCES = {
    "point": lambda sign: {"lights": [raytracer.PointLight((0, 0, 3), sign * 90.0)]},
    "ball": lambda sign: {"lights": [raytracer.PointLight((0, 0, 3), sign * 90.0, 0.4, soft_falloff=False)]},
    "spot": lambda sign: {"lights": [raytracer.SpotLight((0, 0, 3), sign * 90.0, 0.2, world_from_light=TILT)]},
    "sun": lambda sign: {"lights": [raytracer.SunLight((0, 1, 2), sign * 2.0, 0.3)]},
    "area": lambda sign: {"lights": [raytracer.AreaLight((0, 0, 3), (1, 0, 0), (0, 1, 0), sign * 90.0)]},
    "mesh": lambda sign: {"meshes": [FLOOR, LAMP], "materials": [SURFACE, shine(sign)]},
    "sphere": lambda sign: {"spheres": [BALL], "materials": [SURFACE, shine(sign)]},
    "computed mesh": lambda sign: {"meshes": [FLOOR, LAMP], "materials": [SURFACE, shine_unevenly(sign)]},
    "even world": lambda sign: {"world": raytracer.World(sign * GREYS)},
    "computed world": lambda sign: {"world": vary_world(sign)},
}


@pytest.mark.parametrize("settings", [{"integrator": "direct"}, {}, {"clamp_direct": 0.3, "clamp_indirect": 0.2}])
@pytest.mark.parametrize("name", SOURCES)
def test_light_below_0_is_the_same_picture_with_the_sign_turned(name, settings):
    seen = []
    for sign in (1.0, -1.0):
        scene = raytracer.Scene(**{"meshes": [FLOOR], "materials": [SURFACE], **SOURCES[name](sign)})
        seen.append(look_around(scene, origin=(0.3, 0.2, 1.0), count=COUNT, **settings))
    assert np.abs(seen[0]).max() > 0.1
    np.testing.assert_array_equal(seen[1], -seen[0])


def test_a_furnace_that_takes_light_is_a_geometric_series():
    """In a closed box whose walls shine with -1 and reflect a, L = -1 / (1 - a)."""
    walls = raytracer.Material((raytracer.Closure("diffuse", color=GREYS), raytracer.Closure("emission", color=-1.0)))
    seen = look_around(raytracer.Scene(meshes=[BOX], materials=[walls]), count=20_000, max_bounces=60)
    error = seen.std(axis=0) / np.sqrt(len(seen))
    assert (np.abs(seen.mean(axis=0) + 1.0 / (1.0 - GREYS)) <= 4.0 * error + 1e-6).all()


def test_a_lamp_and_its_opposite_leave_nothing():
    """Without extent both lamps are aimed at alike: what one brings the other takes, but for rounding of the sum."""
    lights = [raytracer.PointLight((0, 0, 3), power) for power in (90.0, -90.0)]
    scene = raytracer.Scene(meshes=[FLOOR], materials=[SURFACE], lights=lights)
    assert np.abs(look_around(scene, count=COUNT)).max() < 1e-12


def test_only_light_may_be_below_0():
    with pytest.raises(ValueError, match="'diffuse': color: expected numbers from 0"):
        raytracer.Closure("diffuse", color=-1.0)
    with pytest.raises(ValueError, match="'emission': specular_tint: expected numbers from 0"):
        raytracer.Closure("emission", specular_tint=-1.0)
    assert (raytracer.Closure("emission", color=-1.0).color == -1.0).all()
    assert (raytracer.Closure("principled", emission=-1.0).emission == -1.0).all()
