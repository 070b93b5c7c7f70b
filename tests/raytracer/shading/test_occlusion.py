"""Ambient Occlusion: rays that programs cast, in closed form, and the same whatever else is traced with them."""

from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.casting.rays import make_rays
from raytracer.integrator.bounces import classify_rays
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.sampling.sampler import Sampler
from raytracer.sampling.sobol import SobolSamples
from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL
from raytracer.scene.lights import World
from raytracer.scene.materials import Closure, Material
from raytracer.scene.programs import Program, Register, Step
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Instances, Mesh, Spheres
from raytracer.shading.occlusion import find_open
from raytracer.shading.probes import Probe, ProgramCaster
from raytracer.surfaces.surface import make_surface
from tests.forbidding import forbid

COUNT, SAMPLES = 4096, 4
# Shares of independent rays would be off by so many standard errors once in 16,000 tests; ours are stratified.
SIGMAS = 4.0
FAR = 1e3
UP = (0.0, 0.0, 1.0)


def make_square(corner, first, second):
    """A square from a corner, along two sides."""
    corners = [
        np.add(corner, np.multiply(a, first) + np.multiply(b, second)) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))
    ]
    return Mesh(corners, [[0, 1, 2], [0, 2, 3]])


def make_wall(at, height=FAR):
    """A wall over y, from the floor upwards, where x = `at`."""
    return make_square((at, -FAR, 0.0), (0, 2 * FAR, 0), (0, 0, height))


FLOOR = make_square((-FAR, -FAR, 0.0), (2 * FAR, 0, 0), (0, 2 * FAR, 0))


def make_glow(distance=FAR, normal=UP, samples=SAMPLES, inside=False, only_local=False, output="AO"):
    """A material that shines with what is open around a point."""
    settings = {"samples": samples, "inside": inside, "only_local": only_local}
    steps = [Step("AMBIENT_OCCLUSION", (np.array((0.2, 0.6, 1.0)), distance, np.array(normal)), settings)]
    if output == "AO":
        steps.append(Step("number to vector", (Register(0, "AO"),)))
    color = Register(len(steps) - 1, "Value" if output == "AO" else output)
    return Material([Closure("emission", color=color)], program=Program(steps))


def make_scene(material, *meshes, **fields):
    black = Material([Closure("diffuse", color=0.0)])
    meshes = [replace(mesh, material=np.full(len(mesh.triangles), min(i, 1))) for i, mesh in enumerate(meshes)]
    return Scene(meshes=meshes, materials=[material, black], **fields)


def look_down(scene, count=COUNT, rows=slice(None), missing=0):
    """Trace rays straight down to the origin, one sample of as many pixels, the first `missing` up; returns their
    radiance (n, 3)."""
    integrator = prepare(scene, raytracer.build(scene), Settings())
    samples = SobolSamples(np.arange(count, dtype=np.uint32), 3, 7).select(rows)
    directions = np.where(np.arange(count)[:, np.newaxis] < missing, UP, (0.0, 0.0, -1.0))
    rays = make_rays(np.tile((0.0, 0.0, 0.5), (count, 1)), directions).select(rows)
    return trace(integrator, rays, samples)["Combined"][:, :3]


def assert_open(seen, share, samples=SAMPLES):
    error = np.sqrt(share * (1.0 - share) / (len(seen) * samples))
    assert abs(seen.mean() - share) <= SIGMAS * error


# Closed forms ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("height", [0.5, 2.0, FAR])
def test_a_wall_beside_a_floor_hides_its_form_factor(height):
    """Of the light from above an endless wall of height h, at a distance d, takes (1 - d / sqrt(d^2 + h^2)) / 2."""
    hidden = (1.0 - 1.0 / np.hypot(1.0, height)) / 2.0
    assert_open(look_down(make_scene(make_glow(), FLOOR, make_wall(1.0, height))), 1.0 - hidden)


@pytest.mark.parametrize("distance", [1.25, 2.0])
def test_what_is_farther_than_the_distance_hides_nothing(distance):
    """Seen from above, rays are even over a disk: those that meet an endless wall at d within R fill the segment beyond
    c = d / R, (acos c - c sqrt(1 - c^2)) / pi of it."""
    c = 1.0 / distance
    hidden = (np.arccos(c) - c * np.sqrt(1.0 - c * c)) / np.pi
    assert_open(look_down(make_scene(make_glow(distance), FLOOR, make_wall(1.0))), 1.0 - hidden)
    assert (look_down(make_scene(make_glow(0.99), FLOOR, make_wall(1.0)), count=256) == 1.0).all()


def test_inside_looks_through_the_object():
    """Below a slab's top its bottom, h down, is within R of the rays whose cosine is at least h / R: 1 - (h / R)^2."""
    bottom = replace(FLOOR, positions=FLOOR.positions - (0.0, 0.0, 0.3))
    scene = make_scene(make_glow(0.5, inside=True), FLOOR, bottom)
    assert_open(look_down(scene), (0.3 / 0.5) ** 2)
    assert (look_down(make_scene(make_glow(0.5), FLOOR, bottom), count=256) == 1.0).all()


def test_rays_go_around_the_normal_that_is_given():
    """A wall a hair's breadth away fills the half space around a level normal, below the floor too, or none of it."""
    wall = make_square((1e-6, -FAR, -FAR), (0, 2 * FAR, 0), (0, 0, 2 * FAR))
    for side, share in ((2.0, 0.0), (-2.0, 1.0)):
        scene = make_scene(make_glow(10.0, normal=(side, 0.0, 0.0)), FLOOR, wall)
        assert (look_down(scene, count=256) == share).all()


def test_only_local_counts_the_points_own_object():
    """A wall of the floor's own mesh hides what it does, behind a nearer wall that is another object."""
    wall = make_wall(1.0)
    own = Mesh(np.concatenate([FLOOR.positions, wall.positions]), np.concatenate([FLOOR.triangles, wall.triangles + 4]))
    for local, c in ((True, 1.0 / 2.0), (False, 0.5 / 2.0)):
        hidden = (np.arccos(c) - c * np.sqrt(1.0 - c * c)) / np.pi
        scene = make_scene(make_glow(2.0, only_local=local), own, make_wall(0.5))
        assert_open(look_down(scene), 1.0 - hidden)


def test_a_ball_hides_itself_from_inside_only():
    """Rays into a ball are within R of its other side where 2 r cos <= R, which is (R / 2 r)^2 of them."""
    for inside, share in ((False, 1.0), (True, 1.0 - (1.2 / 2.0) ** 2)):
        # The ball's normal is up at its highest point.
        material = make_glow(1.2, inside=inside)
        ball = Spheres(np.array([(0.0, 0.0, -1.0)]), np.ones(1), material=0)
        assert_open(look_down(Scene(spheres=ball, materials=[material])), share)


# What it comes with ---------------------------------------------------------------------------------------------------


def test_the_color_is_dimmed():
    scene = make_scene(make_glow(output="Color"), FLOOR, make_wall(1.0))
    plain = make_scene(make_glow(), FLOOR, make_wall(1.0))
    np.testing.assert_allclose(look_down(scene), look_down(plain) * (0.2, 0.6, 1.0), rtol=1e-15)


def test_rays_are_the_samples_own_and_fill_one_sequence():
    """Four rays of sample 0 and four of sample 1 are the eight of a sample 0; batches change nothing."""
    cast = []
    scene = make_scene(make_glow(), FLOOR)
    integrator = prepare(scene, raytracer.build(scene), Settings())
    down = make_rays(np.array([(0.0, 0.0, 0.5)] * 2), np.array([(0.0, 0.0, -1.0)] * 2))
    surface = make_surface(integrator.tables, down, integrator.cast(down, classify_rays(np.zeros(2, np.uint8))))

    def keep(rays, objects):
        cast.append(rays.directions)
        return np.zeros(len(rays), dtype=np.bool_)

    def list_rays(samples, count):
        cast.clear()
        own = SobolSamples(np.zeros(len(samples), np.uint32), np.array(samples, np.uint32), 0)
        caster = ProgramCaster(keep, integrator.cast_inside, integrator.cast)
        probe = Probe(surface.select(slice(0, len(samples))), caster, Sampler(own, None, 5), 1, np.ones(len(samples)))
        normal = np.tile(UP, (len(samples), 1))
        assert (find_open(probe, normal, np.ones(len(samples)), count, own=False) == 1.0).all()
        return np.stack(cast, axis=1).reshape(-1, 3)

    np.testing.assert_array_equal(list_rays([0, 1], 4), list_rays([0], 8))


def test_the_picture_does_not_depend_on_what_is_traced_together():
    scene = make_scene(make_glow(), FLOOR, make_wall(1.0))
    alone = look_down(scene, rows=slice(100, 200))
    np.testing.assert_array_equal(alone, look_down(scene)[100:200])
    np.testing.assert_array_equal(alone, look_down(scene, missing=50)[100:200])


def test_objects_hidden_from_shadow_rays_hide_nothing():
    wall, poses = make_wall(1.0), np.tile(np.eye(4), (2, 1, 1))
    scene = make_scene(make_glow(), FLOOR, wall)
    seen_by = np.array([SEEN_BY_ALL, SEEN_BY_ALL - SEEN_BY["shadow"]])
    hidden = replace(scene, instances=Instances(np.arange(2), poses, seen_by=seen_by))
    assert (look_down(hidden, count=256) == 1.0).all()


def test_lights_and_the_world_are_open():
    """As in Cycles: what is aimed at, and what hits nothing, asks no rays."""
    lid = make_square((-1.0, -1.0, 2.0), (0, 2, 0), (2, 0, 0))
    white = Material([Closure("diffuse", color=1.0)])

    def light(lamp):
        floor, above = (replace(mesh, material=np.full(2, i)) for i, mesh in enumerate((FLOOR, lid)))
        return look_down(Scene(meshes=[floor, above], materials=[white, lamp]), count=256)

    plain = Material([Closure("emission", color=1.0)])
    np.testing.assert_allclose(light(make_glow()), light(plain), rtol=1e-12)
    steps = make_glow().program
    world = World(Register(1, "Value"), program=steps)
    assert (look_down(Scene(world=world, materials=[white]), count=16) == 1.0).all()


def test_without_such_programs_no_ray_is_prepared(monkeypatch):
    forbid(monkeypatch, "make_program_caster", "Probe")
    plain = Material([Closure("emission", color=1.0)])
    assert (look_down(make_scene(plain, FLOOR), count=16) == 1.0).all()
    with pytest.raises(AssertionError, match="does not need"):
        look_down(make_scene(make_glow(), FLOOR), count=16)
