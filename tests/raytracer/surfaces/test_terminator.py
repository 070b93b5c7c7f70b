"""Offsets of the shadow terminator: heights and cosines in closed form, and scenes that have none."""

import numpy as np
import pytest

import raytracer
from raytracer.bsdfs.terminator import fall_faster
from raytracer.casting.rays import make_rays
from raytracer.integrator.integrator import find_lift
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.sampling.sobol import SobolSamples
from raytracer.surfaces.surface import make_surface
from raytracer.surfaces.terminator import find_smooth_offset, lift_points
from tests.meshes import make_icosphere

UP = np.array([[0.0, 0.0, 1.0]])


def make_ball(detail=2, smooth=True, matrix=None, **offsets):
    positions, triangles = make_icosphere(detail)
    mesh = raytracer.Mesh(positions, triangles, normals=positions if smooth else None)
    given = {name: [value] for name, value in offsets.items()}
    instances = raytracer.Instances([0], [np.eye(4) if matrix is None else matrix], **given)
    return raytracer.Scene(meshes=[mesh], instances=instances, lights=[raytracer.SunLight((1.0, 0.3, 0.2), 3.0)])


def look(scene, **settings):
    rng = np.random.default_rng(3)
    spots = rng.uniform(-0.9, 0.9, size=(800, 2))
    rays = make_rays(np.column_stack([spots, np.full(800, 5.0)]), np.repeat(-UP, 800, axis=0))
    samples = SobolSamples(np.arange(800, dtype=np.uint32), 0, 0)
    settings = Settings(passes=("Combined",), **settings)
    return trace(prepare(scene, raytracer.build(scene), settings), rays, samples)["Combined"][:, :3]


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e4])
def test_points_are_lifted_onto_the_sphere_whose_normals_they_have(scale):
    """The parabola through two corners of a sphere with their normals; h is exact to the second order of the size."""
    matrix = np.diag([scale, scale, scale, 1.0])
    scene = make_ball(4, matrix=matrix, terminator_geometry=0.1)
    caster = raytracer.build(scene)
    integrator = prepare(scene, caster, Settings())
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(500, 3))
    rays = make_rays(np.zeros((500, 3)), directions * scale)
    hits = caster.closest_hit(rays.origins, rays.directions)
    surface = make_surface(integrator.tables, rays, hits)
    lifted = surface.position + find_smooth_offset(integrator.tables, surface, surface.geometric_normal)
    sunk = scale - np.linalg.norm(surface.position, axis=1)
    left = scale - np.linalg.norm(lifted, axis=1)
    # The envelope is at most the whole height that the sphere rises, twice the parabola's half.
    assert sunk.min() > 0
    assert (np.abs(left) <= 1.05 * sunk).all()
    assert np.abs(left).mean() < 0.75 * sunk.mean()
    inward = find_smooth_offset(integrator.tables, surface, -surface.geometric_normal)
    assert (np.sum(inward * surface.geometric_normal, axis=1) <= 0).all()


def test_only_grazing_rays_are_lifted():
    scene = make_ball(terminator_geometry=0.2)
    caster = raytracer.build(scene)
    integrator = prepare(scene, caster, Settings())
    rays = make_rays([[0.1, 0.2, 5.0]], -UP)
    surface = make_surface(integrator.tables, rays, caster.closest_hit(rays.origins, rays.directions))
    normal = surface.shading_normal
    across = np.cross(normal, [[1.0, 0.0, 0.0]])
    across /= np.linalg.norm(across)
    sizes = []
    for cosine in (0.9, 0.41, 0.3, 0.1, 0.0, -0.1, -0.9):
        light = cosine * normal + np.sqrt(1 - cosine**2) * across
        lifted = lift_points(integrator.tables, integrator.terminator, surface, slice(None), normal, normal, light)
        sizes.append(np.linalg.norm(lifted.offset) if len(lifted.rows) else 0.0)
    assert sizes[:2] == [0.0, 0.0]
    # In full at 0; half gone where both cosines are 0.15, of a cutoff of 0.2; on the other side likewise.
    full = sizes[4]
    np.testing.assert_allclose(sizes[3], full, rtol=1e-12)
    assert full > 0
    assert sizes[-1] == 0.0


def test_lifted_shadow_rays_light_what_flat_triangles_hide():
    """No point of the flat mesh is lit beyond its own horizon; some of the lifted are, as far as their normals see."""
    plain, lifted = look(make_ball()), look(make_ball(terminator_geometry=0.5))
    assert (lifted >= plain - 1e-12).all()
    assert (lifted > plain + 1e-3).any()


def test_diffuse_light_falls_faster_by_the_shading_offset():
    cosine = np.cos(np.array([0.0, 0.5, 1.0, 1.3, 1.6, 2.0]))
    frequency = np.full(6, 1.0 / (1.0 - 0.5 * 0.4))
    expected = np.maximum(np.cos(np.array([0.0, 0.5, 1.0, 1.3, 1.6, 2.0]) * 1.25), 0.0)
    np.testing.assert_allclose(fall_faster(cosine, frequency) * cosine, np.where(cosine > 0, expected, 0.0), atol=1e-15)


@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_scenes_without_offsets_pay_nothing(integrator):
    """Neither flat meshes nor offsets of 0 change a bit, nor have a stage."""
    plain = look(make_ball(smooth=False), integrator=integrator)
    offset = look(make_ball(smooth=False, terminator_geometry=0.5, terminator_shading=0.0), integrator=integrator)
    np.testing.assert_array_equal(plain, offset)
    np.testing.assert_array_equal(
        look(make_ball(), integrator=integrator), look(make_ball(terminator_geometry=0.0), integrator=integrator)
    )
    for scene in (make_ball(), make_ball(smooth=False, terminator_geometry=0.5), make_ball(terminator_geometry=0.0)):
        assert find_lift(prepare(scene, raytracer.build(scene), Settings())) is None


def test_offsets_are_from_0_to_1():
    with pytest.raises(ValueError, match="terminator_geometry: expected"):
        make_ball(terminator_geometry=1.5)
