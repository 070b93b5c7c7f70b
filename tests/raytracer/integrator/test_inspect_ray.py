"""The tree of rays of one pixel, against closed forms of mirror, glass and shadow, and against the picture itself."""

from __future__ import annotations

import numpy as np
import pytest

from raytracer import Camera, Closure, Instances, Material, Mesh, PointLight, Scene, Spheres, SunLight, World, build
from raytracer.integrator import inspect_ray as module
from raytracer.integrator.inspect_ray import Inspector, make_inspector
from raytracer.integrator.settings import Settings
from raytracer.integrator.traced_rays import CAMERA, EMITTERS, PASSED, REFLECTED, REFRACTED, WORLD, TracedRay
from raytracer.lecture import Region
from raytracer.rendering.render import render
from raytracer.scene.programs import Program, Register, Step
from tests.meshes import make_quad

UNIT = 2.0**-53
DIFFUSE, MIRROR, GLASS, LIGHT, CLEAR = range(5)
MATERIALS = (
    Material((Closure("diffuse", color=(0.8, 0.4, 0.2)),), name="paint"),
    Material((Closure("glossy", color=(0.9, 0.8, 0.7), roughness=0.0),), name="mirror"),
    Material((Closure("glass", color=1.0, roughness=0.0, ior=1.5),), name="glass"),
    Material((Closure("emission", color=(3.0, 2.0, 1.0)),), name="lamp"),
    Material((Closure("transparent", color=0.5),), name="clear"),
)


def make_floor(material: int = DIFFUSE, height: float = 0.0, size: float = 100.0) -> Mesh:
    """Return a square of a material around the z axis."""
    x = size / 2
    corners = [[-x, -x, height], [x, -x, height], [x, x, height], [-x, x, height]]
    return Mesh(corners, [[0, 1, 2], [0, 2, 3]], material=material)


def look_at(scene: Scene, max_bounces: int = 8, precision: str = "certified") -> Inspector:
    return make_inspector(scene, build(scene, precision), Settings(max_bounces=max_bounces, precision=precision))


def make_scene(*meshes: Mesh, **fields) -> Scene:
    return Scene(meshes=list(meshes), materials=MATERIALS, **fields)


def start_error(ray: TracedRay, slope: float) -> float:
    """Return how far from the closed form a ray may end that starts at the error bound of its parent's hit, going
    `slope` metres aside for each up, and is rounded on its way."""
    return max(slope, 1.0) * ray.hit.position_error + 64 * UNIT


def test_sphere_is_hit_where_the_closed_form_says():
    ball = Spheres([[1.0, 2.0, 3.0]], [0.5], material=DIFFUSE)
    (ray,) = look_at(make_scene(spheres=[ball])).inspect_ray([1.0, 2.0, 13.0], [0.0, 0.0, -2.0])
    assert (ray.kind, ray.parent) == (CAMERA, -1)
    assert abs(ray.hit.distance - 4.75) <= ray.hit.distance_error <= 64 * UNIT * 4.75
    assert ray.hit.lecture_distance == 4.75
    assert ray.hit.barycentric is None
    np.testing.assert_array_equal(ray.hit.geometric_normal, [0.0, 0.0, 1.0])
    np.testing.assert_array_equal(ray.hit.position, [1.0, 2.0, 3.5])
    assert ray.hit.front


def test_barycentric_weights_are_the_lectures_and_tell_edges_and_vertices():
    triangle = Mesh([[0, 0, 0], [4, 0, 0], [0, 4, 0]], [[0, 1, 2]], material=DIFFUSE)
    inspector = look_at(make_scene(triangle))
    for x, y, weights, region in (
        (1.0, 2.0, (0.25, 0.25, 0.5), Region.INSIDE),
        (1.0, 0.0, (0.75, 0.25, 0.0), Region.EDGE),
        (0.0, 4.0, (0.0, 0.0, 1.0), Region.VERTEX),
        (1 / 3, 11 / 3, (0.0, 1 / 12, 11 / 12), Region.EDGE),
    ):
        (ray,) = inspector.inspect_ray([x, y, 1.0], [0.0, 0.0, -1.0])
        np.testing.assert_allclose(ray.hit.barycentric, weights, rtol=0, atol=8 * UNIT)
        assert ray.hit.region == region
        assert (ray.hit.distance, ray.hit.lecture_distance, ray.hit.primitive) == (1.0, 1.0, 0)


def test_precision_without_proof_has_no_error_bound():
    (ray,) = look_at(make_scene(make_floor()), precision="float64").inspect_ray([0.5, 0, 1], [0, 0, -1])
    assert np.isnan(ray.hit.distance_error)


def test_mirror_reflects_at_the_angle_of_incidence():
    scene = make_scene(make_floor(MIRROR), make_floor(DIFFUSE, height=4.0), lights=[PointLight([8, 0, 3], 100.0)])
    first, second = look_at(scene).inspect_ray([-2.0, 0.0, 1.0], np.array([2.0, 0.0, -1.0]) / 5**0.5)
    assert (first.shadows, first.dark) == ([], [0])  # a mirror sends back nothing from the lamp's direction
    assert (second.kind, second.parent) == (REFLECTED, 0)
    np.testing.assert_allclose(second.direction, np.array([2.0, 0.0, 1.0]) / 5**0.5, rtol=0, atol=8 * UNIT)
    # On the diagonal of the floor, where a ray may start on either side of its point; and 8 is rounded.
    error = start_error(first, slope=2.0) + 16 * UNIT
    np.testing.assert_allclose(second.hit.position, [8.0, 0.0, 4.0], rtol=0, atol=error)
    np.testing.assert_array_equal(second.weight, [0.9, 0.8, 0.7])
    np.testing.assert_array_equal(first.color, second.weight * second.color)
    # The lamp, 100 W at a metre's distance straight before the surface: E = P / (4 pi), f = color / pi.
    np.testing.assert_allclose(second.color, 100 / (4 * np.pi) * np.array([0.8, 0.4, 0.2]) / np.pi, rtol=1e-12)


def test_glass_refracts_by_snells_law_and_out_again_parallel():
    upper, lower = make_floor(GLASS), make_floor(GLASS, height=-1.0)
    lower = Mesh(lower.positions, np.asarray(lower.triangles)[:, ::-1], material=GLASS)  # its outside is below
    floor = make_floor(DIFFUSE, height=-2.0)
    sine = 0.6
    tree = look_at(make_scene(upper, lower, floor)).inspect_ray([-0.75, 0.0, 1.0], [sine, 0.0, -0.8])
    inside = next(ray for ray in tree if ray.kind == REFRACTED and ray.parent == 0)
    leaving = next(ray for ray in tree if ray.kind == REFRACTED and tree[ray.parent] is inside)
    assert inside.direction[0] == pytest.approx(sine / 1.5, abs=8 * UNIT)  # n sin = n' sin'
    np.testing.assert_allclose(leaving.direction, [sine, 0.0, -0.8], rtol=0, atol=16 * UNIT)
    inner = sine / 1.5
    offset = inner / (1 - inner**2) ** 0.5  # tan of the inner angle, 1 m thick
    np.testing.assert_allclose(
        inside.hit.position, [offset, 0.0, -1.0], rtol=0, atol=start_error(tree[0], slope=offset)
    )
    assert inside.hit.front is False
    cosine, behind = 0.8, (1 - inner**2) ** 0.5
    across, along = (cosine - 1.5 * behind) / (cosine + 1.5 * behind), (1.5 * cosine - behind) / (1.5 * cosine + behind)
    assert inside.weight[0] == pytest.approx(1 - (across**2 + along**2) / 2, rel=32 * UNIT)
    mirrored = next(ray for ray in tree if ray.kind == REFLECTED and ray.parent == 0)
    assert mirrored.weight[0] + inside.weight[0] == pytest.approx(1.0, abs=8 * UNIT)
    assert mirrored.hit is None


def test_shadow_is_blocked_by_the_object_in_the_way():
    quad = Mesh(*make_quad(1.0), material=DIFFUSE)
    lifted = np.eye(4)
    lifted[2, 3] = 2.0
    placed = Instances(np.array([0, 1]), np.stack([np.eye(4), lifted]))
    lights = [PointLight([0, 0, 5], 100.0), PointLight([50, 0, 50], 100.0), SunLight([0, 0, -1], 1.0)]
    scene = make_scene(make_floor(), quad, instances=placed, lights=lights)
    origin, direction = [0.3, 0.1, 1.0], [0.0, 0.0, -1.0]
    (ray,) = look_at(scene).inspect_ray(origin, direction)
    blocked, seen = ray.shadows
    assert (blocked.source, blocked.is_blocked, blocked.blocker) == (0, True, 1)
    point = blocked.origin + blocked.end * blocked.direction
    assert point[2] == pytest.approx(2.0, abs=64 * UNIT)
    np.testing.assert_allclose(blocked.origin + blocked.reach * blocked.direction, [0, 0, 5], atol=64 * UNIT)
    assert (seen.source, seen.is_blocked, seen.blocker, seen.end) == (1, False, -1, seen.reach)
    assert ray.dark == [2]  # the sun shines from below
    np.testing.assert_array_equal(ray.color, seen.light)
    assert blocked.light.min() > 0


def test_light_that_throws_no_shadows_arrives_through_everything():
    scene = make_scene(make_floor(), make_floor(height=2.0), lights=[PointLight([0, 0, 5], 100.0, cast_shadow=False)])
    (ray,) = look_at(scene).inspect_ray([0.3, 0.1, 1.0], [0.0, 0.0, -1.0])
    assert not ray.shadows[0].is_blocked
    assert ray.color.min() > 0


def test_transparent_pane_dims_light_and_is_passed_and_what_is_behind_it_blocks():
    pane, lamp = make_floor(CLEAR, height=2.0), PointLight([0, 0, 9], 100.0)
    origin, direction = [0.3, 0.1, 3.0], [0.0, 0.0, -1.0]
    first, second = look_at(make_scene(make_floor(), pane, lights=[lamp])).inspect_ray(origin, direction)
    assert (first.kind, second.kind, first.hit.instance, second.hit.instance) == (CAMERA, PASSED, 1, 0)
    np.testing.assert_array_equal(second.shadows[0].share, [0.5] * 3)
    np.testing.assert_array_equal(second.weight, [0.5] * 3)
    wall = make_floor(height=4.0)
    blocked = look_at(make_scene(make_floor(), pane, wall, lights=[lamp])).inspect_ray(origin, direction)[1].shadows[0]
    assert (blocked.is_blocked, blocked.blocker) == (True, 2)
    assert (blocked.origin + blocked.end * blocked.direction)[2] == pytest.approx(
        4.0, abs=2 * second.hit.position_error + 64 * UNIT
    )


def test_lobes_that_reflect_the_same_way_are_one_ray():
    glossy = Closure("glossy", color=1.0, roughness=0.0, weight=0.25)
    scene = Scene(meshes=[make_floor(0)], materials=[Material((glossy, glossy, Closure("diffuse", weight=0.5)))])
    tree = look_at(scene).inspect_ray([0.0, 0.0, 1.0], [0.5, 0.0, -1.0])
    assert [ray.kind for ray in tree] == [CAMERA, REFLECTED]
    np.testing.assert_array_equal(tree[1].weight, [0.5] * 3)


def test_emissive_object_and_world_are_sources_by_name():
    scene = make_scene(make_floor(), make_floor(LIGHT, height=5.0, size=2.0), world=World([0.1, 0.2, 0.3]))
    (ray,) = look_at(scene).inspect_ray([3.0, 0.0, 1.0], [0.0, 0.0, -1.0])
    by_source = {shadow.source: shadow for shadow in ray.shadows}
    assert by_source.keys() == {EMITTERS, WORLD}
    assert by_source[EMITTERS].target == 1
    assert not by_source[EMITTERS].is_blocked
    (up,) = look_at(scene).inspect_ray([0.1, 0.2, 1.0], [0.0, 0.0, 1.0])
    np.testing.assert_array_equal(up.color, [3.0, 2.0, 1.0])
    (miss,) = look_at(scene).inspect_ray([90.0, 0.0, 1.0], [0.0, 0.0, 1.0])
    assert miss.hit is None
    np.testing.assert_allclose(miss.color, [0.1, 0.2, 0.3], rtol=4 * UNIT)


def test_world_that_varies_is_a_source_for_each_way_in_which_it_is_sampled():
    """From directions d comes max(d, 0): both samples of a floor that faces up end in the world."""
    cut = Step("VECT_MATH Vector", (Register(0, "Position"), np.zeros(3), np.zeros(3), 1.0), {"operation": "MAXIMUM"})
    world = World(Register(1, "Vector"), Program((Step("NEW_GEOMETRY Position"), cut)))
    scene = make_scene(make_floor(), world=world, lights=[PointLight((0, 0, 4), 10.0)])
    (ray,) = look_at(scene).inspect_ray([0.0, 0.0, 1.0], [0.0, 0.0, -1.0])
    assert [shadow.source for shadow in ray.shadows] == [0, WORLD, WORLD]
    assert all(shadow.blocker == -1 and shadow.light.any() for shadow in ray.shadows)


def test_limits_cut_the_tree_and_say_so():
    scene = make_scene(make_floor(MIRROR), make_floor(MIRROR, height=1.0))
    tree = look_at(scene, max_bounces=3).inspect_ray([0.1, 0.2, 0.5], [0.0, 0.3, -1.0])
    assert [ray.kind for ray in tree] == [CAMERA, *[REFLECTED] * 4]  # the last only sees what shines
    long = look_at(scene, max_bounces=999).inspect_ray([0.1, 0.2, 0.5], [0.0, 0.001, -1.0])
    assert long[-1].is_cut
    assert 1 / 64 <= 0.9 ** (len(long) - 1) < 1 / 64 / 0.9
    assert not any(ray.is_cut for ray in long[:-1])


def make_hall(material: int) -> Scene:
    """A camera that looks at a ball of a material on a floor, and two lamps without extent."""
    eye = np.array([[1, 0, 0, 0], [0, 0, -1, -6], [0, 1, 0, 1.2], [0, 0, 0, 1]])
    ball = Spheres([[0.2, 0.0, 1.0]], [1.0], material=material)
    lights = [PointLight([3, -4, 5], (300, 200, 100)), SunLight([-1, -1, 2], 0.5)]
    return make_scene(make_floor(), spheres=[ball], lights=lights, camera=Camera(eye))


@pytest.mark.parametrize(("x", "y"), [(20, 15), (22, 18), (14, 3), (4, 25), (17, 9)])
def test_color_of_a_mirror_is_the_pictures(x, y):
    scene = make_hall(MIRROR)
    picture = render(scene, 40, 30, 1, max_bounces=8, pixel_filter="box", filter_width=0.0)["Combined"]
    tree = look_at(scene).inspect_pixel(40, 30, x + 0.5, y + 0.5)
    np.testing.assert_allclose(tree[0].color, picture[29 - y, x, :3], rtol=2**-22, atol=2**-30)  # float32 pixels


def test_color_of_glass_is_the_pictures_mean(monkeypatch):
    monkeypatch.setattr(module, "SMALLEST_SHARE", 0.0)
    scene, batches = make_hall(GLASS), []
    (ray, *rest) = look_at(scene, max_bounces=4).inspect_pixel(40, 30, 18.5, 14.5)
    assert not any(one.is_cut for one in (ray, *rest))
    for seed in range(16):
        film = render(
            scene, 40, 30, 256, max_bounces=4, pixel_filter="box", filter_width=0.0, seed=seed, border=(18, 14, 19, 15)
        )
        batches.append(film["Combined"][0, 0, :3])
    spread = np.std(batches, axis=0, ddof=1) / len(batches) ** 0.5
    assert (np.abs(np.mean(batches, axis=0) - ray.color) <= 5 * spread + 2**-22).all()
    assert ray.color.min() > 0


def test_pixel_needs_a_camera():
    with pytest.raises(ValueError, match="camera"):
        look_at(make_scene(make_floor())).inspect_pixel(4, 4, 0.5, 0.5)
