"""Raycast: what a program's rays meet, against planes whose distances are known."""

import numpy as np
import pytest

import raytracer
from raytracer.casting.rays import make_rays
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.sampling.sobol import SobolSamples
from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL
from raytracer.scene.materials import Closure, Material
from raytracer.scene.programs import Program, Register, Step
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Instances, Mesh

FAR = 10.0
UP, DOWN = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
# A ray leaves a surface of 20 m outside the bound on its error.
ROUNDING = 1e-12
OUTPUTS = ("Is Hit", "Self Hit", "Hit Distance", "Hit Position", "Hit Normal")


def make_square(z, slope=0.0, **fields):
    """A square over x and y at a height that grows with x; its front is above."""
    corners = [(x, y, z + slope * x) for x, y in ((-FAR, -FAR), (FAR, -FAR), (FAR, FAR), (-FAR, FAR))]
    return Mesh(np.array(corners), np.array([(0, 1, 2), (0, 2, 3)]), **fields)


def make_material(output, position=None, direction=UP, reach=5.0, only_local=False, name=None):
    """A material that shines with an output of a Raycast node, 4 higher; position None: the point's own."""
    kind = "MATERIAL_RAYCAST" if name is None else f"MATERIAL_RAYCAST {output}"
    settings = {"only_local": only_local, **({} if name is None else {"name": name})}
    start = Register(0, "Position") if position is None else np.array(position, float)
    steps = [Step("NEW_GEOMETRY Position", ()), Step(kind, (start, np.array(direction, float), reach), settings)]
    if output in ("Is Hit", "Self Hit", "Hit Distance", "Fac", "Alpha"):
        steps.append(Step("number to vector", (Register(1, output),)))
    last = Register(len(steps) - 1, "Value" if len(steps) == 3 else output)
    steps.append(Step("VECT_MATH Vector", (last, np.full(3, 4.0), np.zeros(3), 0.0), {"operation": "ADD"}))
    return Material([Closure("emission", color=Register(len(steps) - 1, "Vector"))], program=Program(steps))


def see(material, *above, direction=DOWN, instances=None):
    """What a ray sees that comes from 0.25 above, or below, to a floor at the origin."""
    black = Material([Closure("diffuse", color=0.0)])
    floor = make_square(0.0)
    above = [Mesh(mesh.positions, mesh.triangles, material=1, attributes=mesh.attributes) for mesh in above]
    scene = Scene(meshes=[floor, *above], instances=instances, materials=[material, black])
    integrator = prepare(scene, raytracer.build(scene), Settings())
    rays = make_rays([(0.3, 0.2, -0.25 * direction[2])], [direction])
    return trace(integrator, rays, SobolSamples(np.zeros(1, np.uint32), 0, 5))["Combined"][0, :3] - 4.0


def test_a_ceiling_is_hit_where_it_is():
    ceiling = make_square(1.0, slope=0.5)
    seen = {output: see(make_material(output, direction=(0.0, 0.0, 2.0)), ceiling) for output in OUTPUTS}
    np.testing.assert_allclose(seen["Is Hit"], 1.0)
    np.testing.assert_allclose(seen["Self Hit"], 0.0, atol=1e-15)
    np.testing.assert_allclose(seen["Hit Distance"], 1.15 / 2, rtol=ROUNDING)
    np.testing.assert_allclose(seen["Hit Position"], (0.3, 0.2, 1.15), rtol=ROUNDING)
    np.testing.assert_allclose(seen["Hit Normal"], np.array((0.5, 0.0, -1.0)) / np.sqrt(1.25), atol=ROUNDING)


@pytest.mark.parametrize("reach", [1.0, 0.0, -1.0])
def test_what_is_missed_is_as_far_as_the_ray_reaches(reach):
    ceiling = make_square(1.5)
    seen = {output: see(make_material(output, reach=reach), ceiling) for output in OUTPUTS}
    np.testing.assert_allclose(seen.pop("Hit Distance"), reach)
    for value in seen.values():
        np.testing.assert_allclose(value, 0.0, atol=1e-15)


def test_a_ray_from_the_surface_leaves_it_on_either_side():
    for direction in (UP, DOWN):
        for seen_from in (UP, DOWN):
            assert see(make_material("Is Hit", direction=direction), direction=seen_from)[0] == 0.0
    along = see(make_material("Is Hit", direction=(1.0, 0.0, 0.0), reach=1.0))
    assert along[0] == 0.0


def test_a_ray_from_elsewhere_meets_the_own_surface():
    for output, value in (("Self Hit", 1.0), ("Hit Distance", 2.0), ("Hit Position", (1.0, 2.0, 0.0))):
        seen = see(make_material(output, position=(1.0, 2.0, 2.0), direction=DOWN), make_square(5.0))
        np.testing.assert_allclose(seen, value, rtol=ROUNDING)


def test_only_local_sees_behind_others():
    ceiling, own = make_square(1.0), {"position": (1.0, 2.0, 3.0), "direction": DOWN}
    for local, value in ((True, 3.0), (False, 2.0)):
        seen = see(make_material("Hit Distance", only_local=local, **own), ceiling)
        np.testing.assert_allclose(seen, value, rtol=ROUNDING)


def test_hidden_objects_are_hit():
    seen_by = np.array([SEEN_BY_ALL, SEEN_BY["transmission"]])
    instances = Instances(np.arange(2), np.tile(np.eye(4), (2, 1, 1)), seen_by=seen_by)
    assert see(make_material("Is Hit"), make_square(1.0), instances=instances)[0] == 1.0


def test_attributes_of_what_is_hit_are_read():
    """A number that is the place's x, and a color with alpha; 0 where nothing is hit."""
    ceiling = make_square(1.0)
    color = np.tile((0.1, 0.2, 0.3, 0.5), (4, 1))
    ceiling = Mesh(ceiling.positions, ceiling.triangles, attributes={"x": ceiling.positions[:, :1], "color": color})
    for output, name, value in (("Fac", "x", 0.3), ("Vector", "color", (0.1, 0.2, 0.3)), ("Alpha", "color", 0.5)):
        np.testing.assert_allclose(see(make_material(output, name=name), ceiling), value, rtol=ROUNDING)
        np.testing.assert_allclose(see(make_material(output, name=name, reach=0.5), ceiling), 0.0, atol=1e-15)


@pytest.mark.parametrize("size", [0.01, 1.0, 100.0])
def test_a_bump_leaves_out_what_is_as_near_as_its_places(size):
    """A wall a thousandth of a pixel away would be met from one of the three places, and not from the others.

    size : of the direction, in which distances are counted
    """
    height = Program(
        [
            Step("NEW_GEOMETRY Position", ()),
            Step(
                "MATERIAL_RAYCAST",
                (Register(0, "Position"), np.array((size, 0.0, 0.0)), 5.0 / size),
                {"only_local": False},
            ),
            Step("MATH", (Register(1, "Hit Distance"), size, 0.0), {"operation": "MULTIPLY", "use_clamp": False}),
        ],
        Register(2, "Value"),
    )
    steps = [
        Step("NEW_GEOMETRY Normal", ()),
        Step(
            "BUMP",
            (1.0, 1.0, 1.0, Register(0, "Normal")),
            {"height": height, "invert": False},
        ),
    ]
    steps.append(
        Step("VECT_MATH Vector", (Register(1, "Normal"), np.full(3, 4.0), np.zeros(3), 0.0), {"operation": "ADD"})
    )
    material = Material([Closure("emission", color=Register(2, "Vector"))], program=Program(steps))
    step = 1e-3 * 0.25  # of bumps where no camera says how large a pixel is
    for away, slope in ((0.5 * step, 0.0), (1000 * step, 1.0)):
        x = 0.3 + away
        wall = Mesh(np.array([(x, -FAR, -FAR), (x, FAR, -FAR), (x, 0.0, FAR)]), np.array([(0, 1, 2)]))
        normal = see(material, wall)
        np.testing.assert_allclose(normal, np.array((slope, 0.0, 1.0)) / np.hypot(slope, 1.0), atol=1e-6)
