"""Bevel: normals around a point against integrals over the surface, and where nothing is rounded off."""

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
from raytracer.scene.materials import Closure, Material
from raytracer.scene.programs import Program, Register, Step
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Mesh, Spheres
from raytracer.shading.bevel import RAREST, evaluate_falloff, round_off, sample_falloff, sum_normals
from raytracer.shading.probes import Probe
from raytracer.surfaces.surface import make_surface
from tests.forbidding import forbid

RADIUS = 0.2
FAR = 10.0
UP, DOWN = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
# Means of this many independent estimates, which are off by so many of their standard errors once in 16,000 tests.
PIXELS, SIGMAS = 32, 4.0


def make_faces(*faces):
    """A mesh of squares: corner, first and second side each; the normal is first x second."""
    corners = [
        np.add(corner, np.multiply(a, first) + np.multiply(b, second))
        for corner, first, second in faces
        for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))
    ]
    triangles = [4 * face + np.array(part) for face in range(len(faces)) for part in ((0, 1, 2), (0, 2, 3))]
    return Mesh(np.array(corners, dtype=float), np.array(triangles))


FLOOR = ((-FAR, -FAR, 0.0), (2 * FAR, 0, 0), (0, 2 * FAR, 0))


def list_block_faces(edge):
    """The top of a block, which ends at x = `edge`, and its side there."""
    return ((-FAR, -FAR, 0.0), (FAR + edge, 0, 0), (0, 2 * FAR, 0)), ((edge, -FAR, 0.0), (0, 0, -FAR), (0, 2 * FAR, 0))


def look(scene, direction=DOWN, count=PIXELS, rarest=np.inf):
    """Where `count` rays from above, or from below, meet the origin: a Probe of these points, and the tables."""
    integrator = prepare(scene, raytracer.build(scene), Settings())
    rays = make_rays(np.tile(-0.05 * np.array(direction), (count, 1)), np.tile(direction, (count, 1)))
    hits = integrator.cast(rays, classify_rays(np.zeros(count, np.uint8)))
    samples = SobolSamples(np.arange(count, dtype=np.uint32), 0, 5)
    surface = make_surface(integrator.tables, rays, hits)
    caster = integrator.program_caster
    return Probe(surface, caster, Sampler(samples, None, 0), 1, np.full(count, rarest)), integrator.tables


def make_bevel(radius=RADIUS, samples=4):
    """A material that shines with (normal + 1) / 2."""
    steps = [
        Step("NEW_GEOMETRY Normal", ()),
        Step("BEVEL", (radius, Register(0, "Normal")), {"samples": samples}),
        Step("VECT_MATH Vector", (Register(1, "Normal"), 0.5, 0.5, 0.0), {"operation": "MULTIPLY_ADD"}),
    ]
    return Material([Closure("emission", color=Register(2, "Vector"))], program=Program(steps))


def make_scene(*meshes, **fields):
    return Scene(meshes=list(meshes), materials=[make_bevel()], **fields)


def measure(scene, samples=256, **options):
    """Means (3,) of the integral of normals around the origin, and their standard errors."""
    probe, tables = look(scene, **options)
    found = sum_normals(probe, tables, np.full(PIXELS, RADIUS), samples) / samples
    return found.mean(axis=0), found.std(axis=0, ddof=1) / np.sqrt(PIXELS)


def assert_close(measured, exact):
    mean, error = measured
    rounding = 1e-12  # of sums of some hundred numbers below 1
    assert (np.abs(mean - exact) <= SIGMAS * error + rounding).all()


def integrate_falloff(inside, height=0.0):
    """The integral of the falloff over the part of a plane, at a height over the middle, that `inside`(x, y) tells."""
    steps = np.linspace(-RADIUS, RADIUS, 2001)
    middle = (steps[1:] + steps[:-1]) / 2
    x, y = np.meshgrid(middle, middle)
    distance = np.sqrt(x**2 + y**2 + height**2)
    return (evaluate_falloff(distance, RADIUS) * inside(x, y)).sum() * (steps[1] - steps[0]) ** 2


# The falloff ----------------------------------------------------------------------------------------------------------


def test_falloff_is_one_over_a_disk():
    assert integrate_falloff(lambda x, y: x == x) == pytest.approx(1.0, abs=1e-5)


def test_distances_have_the_falloffs_density():
    """Of a disk's integral, F(x) lies within x R."""
    number = np.linspace(0.0, 1.0 - 2.0**-32, 1001)
    x = sample_falloff(number)
    assert ((x >= 0) & (x <= 1)).all()
    share = 10 * x**2 - 20 * x**3 + 15 * x**4 - 4 * x**5
    np.testing.assert_allclose(share, number, atol=2.0**-32)


def test_a_distance_has_the_same_bits_among_others():
    number = np.linspace(0.0, 1.0 - 2.0**-32, 1001)
    alone = [sample_falloff(number[row : row + 1])[0] for row in range(len(number))]
    np.testing.assert_array_equal(sample_falloff(number), alone)


# Integrals ------------------------------------------------------------------------------------------------------------


def test_a_flat_surface_keeps_its_normal():
    probe, tables = look(make_scene(make_faces(FLOOR)))
    own = np.tile(UP, (PIXELS, 1))
    np.testing.assert_allclose(round_off(probe, tables, own, np.full(PIXELS, RADIUS), 4), own, atol=1e-15)
    assert_close(measure(make_scene(make_faces(FLOOR))), UP)


@pytest.mark.parametrize("away", [0.01, 0.05, 0.15])
def test_an_edge_takes_part_of_both_faces(away):
    """Of the top there is what lies before the edge, of the side what lies below it."""
    top = integrate_falloff(lambda x, y: x < away)
    side = integrate_falloff(lambda x, y: x < 0, height=away)
    assert_close(measure(make_scene(make_faces(*list_block_faces(away)))), (side, 0.0, top))
    probe, tables = look(make_scene(make_faces(*list_block_faces(away))))
    rounded = round_off(probe, tables, np.tile(UP, (PIXELS, 1)), np.full(PIXELS, RADIUS), 1024)
    exact = np.arctan2(side, top)
    angle = np.arctan2(rounded[:, 0], rounded[:, 2])
    assert abs(angle.mean() - exact) <= SIGMAS * angle.std(ddof=1) / np.sqrt(PIXELS) + 1e-4


def test_surfaces_behind_each_other_count_all():
    """Six sheets below the floor, of the floor's normal and the opposite one in turn."""
    heights = np.linspace(0.02, 0.12, 6)
    sheets = [((-FAR, -FAR, -h), (0, 2 * FAR, 0), (2 * FAR, 0, 0)) for h in heights[::2]]
    sheets += [((-FAR, -FAR, -h), (2 * FAR, 0, 0), (0, 2 * FAR, 0)) for h in heights[1::2]]
    below = [integrate_falloff(lambda x, y: x == x, height=h) for h in heights]
    assert_close(measure(make_scene(make_faces(FLOOR, *sheets))), (0, 0, 1 - sum(below[::2]) + sum(below[1::2])))


def test_smooth_normals_are_averaged():
    floor = make_faces(FLOOR)
    tilted = replace(floor, normals=np.tile((0.6, 0.0, 0.8), (4, 1)))
    assert_close(measure(make_scene(tilted)), (0.6, 0.0, 0.8))


# Where it stands as it is ---------------------------------------------------------------------------------------------


def test_other_objects_do_not_count():
    floor, wall = make_faces(FLOOR), make_faces(((0.02, -FAR, -FAR), (0, 2 * FAR, 0), (0, 0, 2 * FAR)))
    assert_close(measure(make_scene(floor, wall)), UP)


def test_from_below_it_is_turned_around():
    probe, tables = look(make_scene(make_faces(*list_block_faces(0.05))), direction=UP)
    rounded = round_off(probe, tables, np.tile(DOWN, (PIXELS, 1)), np.full(PIXELS, RADIUS), 64)
    assert (rounded[:, 2] < 0).all()
    assert (rounded[:, 0] < 0).all()


def test_it_ends_at_radius_zero_and_behind_blurry_bounces():
    scene = make_scene(make_faces(*list_block_faces(0.05)))
    own = np.tile(UP, (PIXELS, 1))
    for radius, rarest, turned in ((RADIUS, RAREST, True), (0.0, np.inf, False), (RADIUS, 0.99 * RAREST, False)):
        probe, tables = look(scene, rarest=rarest)
        rounded = round_off(probe, tables, own, np.full(PIXELS, radius), 16)
        assert (rounded != own).any() == turned


# What it comes with ---------------------------------------------------------------------------------------------------


def render_origin(scene):
    """What rays straight down to the origin see, (n, 3)."""
    integrator = prepare(scene, raytracer.build(scene), Settings())
    rays = make_rays(np.tile((0.0, 0.0, 0.05), (64, 1)), np.tile(DOWN, (64, 1)))
    return trace(integrator, rays, SobolSamples(np.arange(64, dtype=np.uint32), 0, 5))["Combined"][:, :3]


def test_materials_show_it():
    seen = render_origin(make_scene(make_faces(*list_block_faces(0.02)))).mean(axis=0)
    assert seen[0] > 0.6  # leans towards the side
    assert seen[1] == pytest.approx(0.5, abs=1e-3)
    ball = Scene(spheres=Spheres(np.array([(0.0, 0.0, -1.0)]), np.ones(1), material=0), materials=[make_bevel()])
    np.testing.assert_allclose(render_origin(ball), np.tile((0.5, 0.5, 1.0), (64, 1)), atol=1e-15)


def test_without_such_programs_nothing_is_probed(monkeypatch):
    forbid(monkeypatch, "round_off")
    plain = Material([Closure("emission", color=1.0)])
    assert (render_origin(Scene(meshes=[make_faces(FLOOR)], materials=[plain])) == 1.0).all()
    with pytest.raises(AssertionError, match="does not need"):
        render_origin(make_scene(make_faces(FLOOR)))
