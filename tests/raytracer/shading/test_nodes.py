"""Programs of materials: what reaches closures, lights and shadows."""

import dataclasses

import numpy as np
import pytest

import raytracer
from raytracer import (
    Camera,
    Closure,
    Image,
    Instances,
    Material,
    Mesh,
    PointLight,
    Program,
    Register,
    Scene,
    Settings,
    Spheres,
    Step,
)
from raytracer.casting.rays import Rays
from raytracer.integrator.features import derive_features
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.sampling.sobol import SobolSamples
from raytracer.shading.evaluate import OPERATIONS
from tests import meshes

UP = np.array([0.0, 0.0, 1.0])


def add(first, second):
    return Step("MATH", (first, second, 0.0), {"operation": "ADD"})


def read(name="uv"):
    return Step("ATTRIBUTE Vector", (), {"name": name})


# Scenes --------------------------------------------------------------------------------------------------------------

CAMERA = Camera(np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]]), projection="orthographic")


def quad(**fields):
    return Mesh(*meshes.make_quad(), **fields)


def uvs():
    return np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def see(scene, points, passes=("Combined",), **settings):
    """Return what rays straight down see at points (n, 2) of the plane z = 0."""
    points = np.asarray(points, dtype=float)
    origins = np.column_stack([points, np.full(len(points), 5.0)])
    count = len(points)
    rays = Rays(origins, np.tile(-UP, (count, 1)), np.zeros(count), np.full(count, np.inf))
    integrator = prepare(scene, raytracer.build(scene), Settings(passes=passes, **settings), (100, 100))
    return trace(integrator, rays, SobolSamples(np.arange(count, dtype=np.uint32), 0, 0))


def shine(steps, color, **fields):
    return Material([Closure("emission", color=color, **fields)], program=Program(steps))


PLACES = np.array([(-0.3, 0.1), (0.4, -0.2), (0.05, 0.45), (-0.45, -0.45)])


def test_a_vertex_attribute_is_interpolated():
    scene = Scene([quad(uvs=uvs())], materials=[shine([read()], Register(0, "Vector"))])
    found = see(scene, PLACES)["Combined"][:, :3]
    np.testing.assert_allclose(found, np.column_stack([PLACES + 0.5, np.zeros(4)]), atol=1e-12)


def test_a_corner_attribute_and_a_missing_one():
    corners = np.repeat(np.array([0.25, 0.75])[:, None, None], 3, axis=1)  # one value per triangle
    scene = Scene(
        [quad(attributes={"face": corners})],
        materials=[shine([read("face"), read("none"), add_vectors(0, 1)], Register(2, "Vector"))],
    )
    found = see(scene, [(0.3, -0.3), (-0.3, 0.3)])["Combined"][:, 0]
    np.testing.assert_allclose(sorted(found), (0.25, 0.75))


def add_vectors(first, second):
    inputs = (Register(first, "Vector"), Register(second, "Vector"), np.zeros(3), 1.0)
    return Step("VECT_MATH Vector", inputs, {"operation": "ADD"})


def test_attributes_of_different_width_on_different_meshes():
    step = Step("ATTRIBUTE Fac", (), {"name": "a"})
    alpha = Step("ATTRIBUTE Alpha", (), {"name": "a"})
    values = (np.full((4, 1), 0.5), np.tile((0.5, 1.0), (4, 1)), np.tile((0.0, 0.3, 0.9), (4, 1)))
    values = (*values, np.tile((0.6, 0.6, 0.6, 0.25), (4, 1)))
    ready = [quad(attributes={"a": value}) for value in values]
    moves = np.tile(np.eye(4), (4, 1, 1))
    moves[:, 0, 3] = (0, 2, 4, 6)
    for chosen, wanted in ((step, (0.5, 0.5, 0.4, 0.6)), (alpha, (1.0, 1.0, 1.0, 0.25))):
        output = OPERATIONS[chosen.operation].outputs[0]
        spread = Step("number to vector", (Register(0, output),))
        scene = Scene(
            ready, instances=Instances(range(4), moves), materials=[shine([chosen, spread], Register(1, "Value"))]
        )
        found = see(scene, [(0, 0.1), (2, 0.1), (4, 0.1), (6, 0.1)])["Combined"][:, 0]
        np.testing.assert_allclose(found, wanted)


def test_image_and_instance_values_reach_the_picture_and_a_saved_scene_gives_the_same(tmp_path):
    pixels = np.random.default_rng(3).integers(0, 256, (4, 4, 4)).astype(np.uint8)
    settings = {"interpolation": "Closest", "extension": "REPEAT", "projection": "FLAT", "projection_blend": 0.0}
    steps = [
        read(),
        Step("TEX_IMAGE", (Register(0, "Vector"),), {"image": Image(pixels), **settings, "unassociate": False}),
        Step("OBJECT_INFO Color"),
        add_colors(1, 2),
    ]
    scene = Scene(
        [quad(uvs=uvs())],
        instances=Instances([0], [np.eye(4)], color=[(0.5, 0.25, 0.125, 1.0)]),
        materials=[shine(steps, Register(3, "Vector"))],
        camera=CAMERA,
    )
    column, row = ((PLACES + 0.5) * 4).astype(int).T
    wanted = pixels[row, column, :3] / 255.0 + (0.5, 0.25, 0.125)
    np.testing.assert_allclose(see(scene, PLACES)["Combined"][:, :3], wanted)
    raytracer.save(scene, tmp_path / "scene.npz")
    loaded = raytracer.load(tmp_path / "scene.npz")
    np.testing.assert_array_equal(see(loaded, PLACES)["Combined"], see(scene, PLACES)["Combined"])
    assert loaded.materials[0].program.steps[1].settings["image"].pixels.dtype == np.uint8


@pytest.mark.parametrize(("output", "wanted"), [("Vector", (0.5, 0.25, 0.0)), ("Fac", 0.25), ("Alpha", 0.125)])
def test_property_of_an_instance_is_split_and_0_on_those_that_lack_it(output, wanted):
    """Color, mean of red, green and blue, and alpha."""
    value = (0.5, 0.25, 0.0, 0.125)
    steps = [Step(f"OBJECT_PROPERTY {output}", (), {"name": "OBJECT a"})]
    if output != "Vector":
        steps.append(Step("number to vector", (Register(0, output),)))
    shown = Register(len(steps) - 1, "Vector" if output == "Vector" else "Value")
    scene = Scene(
        [quad()],
        instances=Instances([0], [np.eye(4)], properties={"OBJECT a": [value]}),
        materials=[shine(steps, shown)],
        camera=CAMERA,
    )
    np.testing.assert_array_equal(see(scene, PLACES)["Combined"][:, :3], np.broadcast_to(wanted, (len(PLACES), 3)))
    without = dataclasses.replace(scene, instances=Instances([0], [np.eye(4)]))
    assert not see(without, PLACES)["Combined"][:, :3].any()


def add_colors(first, second):
    inputs = (Register(first, "Color"), Register(second, "Color"), np.zeros(3), 1.0)
    return Step("VECT_MATH Vector", inputs, {"operation": "ADD"})


def test_each_sphere_of_each_group_has_its_own_value_of_an_attribute():
    centres = np.array([(0, 0, 0), (3, 0, 0), (6, 0, 0), (9, 0, 0), (12, 0, 0)], dtype=float)
    groups = [
        Spheres(centres[:2], [1, 1], attributes={"a": [(0.25,), (0.5,)]}),
        Spheres(centres[2:3], [1]),
        Spheres(centres[3:], [1, 1], attributes={"a": [(0.1, 0.2, 0.3), (0.4, 0.5, 0.6)], "b": np.ones((2, 1))}),
    ]
    shown = [shine([read("a")], Register(0, "Vector"))]
    scene = Scene([quad(attributes={"a": np.full((4, 1), 0.75)})], spheres=groups, materials=shown)
    seen = see(scene, [*centres[:, :2], (0.0, 0.0)])["Combined"][:5, :3]
    wanted = [(0.25,) * 3, (0.5,) * 3, (0,) * 3, (0.1, 0.2, 0.3), (0.4, 0.5, 0.6)]
    np.testing.assert_allclose(seen, wanted, atol=1e-12)


def test_spheres_have_position_and_normal_but_no_attributes():
    steps = [Step("NEW_GEOMETRY Normal"), read("uv"), add_vectors_of("Normal", "Vector")]
    scene = Scene(spheres=Spheres([(0, 0, 0)], [1.0]), materials=[shine(steps, Register(2, "Vector"))])
    np.testing.assert_allclose(see(scene, [(0, 0)])["Combined"][0, :3], UP, atol=1e-12)


def add_vectors_of(first, second):
    inputs = (Register(0, first), Register(1, second), np.zeros(3), 1.0)
    return Step("VECT_MATH Vector", inputs, {"operation": "ADD"})


def test_values_out_of_range_are_cut_as_constants_are():
    """A roughness of 2 is one of 1, a color of -1 is black; light of -1 takes light away."""
    lamp = PointLight((0, 0, 3), 100.0)
    steps = [Step("OBJECT_INFO Random"), Step("MATH", (Register(0, "Random"), 2.0, 0.0), {"operation": "ADD"})]
    materials = (
        Material([Closure("glossy", color=0.8, roughness=Register(1, "Value"))], program=Program(steps)),
        Material([Closure("glossy", color=0.8, roughness=1.0)]),
    )
    seen = [see(Scene([quad()], lights=[lamp], materials=[item]), PLACES)["Combined"] for item in materials]
    np.testing.assert_array_equal(*seen)
    down = [Step("OBJECT_INFO Location"), subtract_one()]
    taking = Scene([quad()], materials=[shine(down, Register(1, "Vector"))])
    assert (see(taking, PLACES)["Combined"][:, :3] == -1).all()
    black = Material([Closure("diffuse", color=Register(1, "Vector"))], program=Program(down))
    assert (see(Scene([quad()], lights=[lamp], materials=[black]), PLACES)["Combined"][:, :3] == 0).all()


def subtract_one():
    return Step("VECT_MATH Vector", (Register(0, "Location"), np.ones(3), np.zeros(3), 1.0), {"operation": "SUBTRACT"})


def test_computed_weights_share_out_like_constant_ones():
    steps = [Step("OBJECT_INFO Random"), add(Register(0, "Random"), 0.25), add(Register(0, "Random"), 0.75)]
    computed = Material(
        [
            Closure("emission", color=(1, 0, 0), weight=Register(1, "Value")),
            Closure("transparent", color=1.0, weight=Register(2, "Value")),
        ],
        program=Program(steps),
    )
    constant = Material(
        [Closure("emission", color=(1, 0, 0), weight=0.25), Closure("transparent", color=1.0, weight=0.75)]
    )
    floor = Material([Closure("emission", color=(0, 0, 1))])
    low = np.eye(4)
    low[2, 3] = -1.0

    def make(material):
        below = quad(material=1)
        return Scene([quad(), below], instances=Instances([0, 1], [np.eye(4), low]), materials=[material, floor])

    found = see(make(computed), PLACES)["Combined"][:, :3]
    np.testing.assert_allclose(found, see(make(constant), PLACES)["Combined"][:, :3])
    np.testing.assert_allclose(found, np.tile((0.25, 0.0, 0.75), (4, 1)))


def test_computed_transparency_lets_shadow_rays_through():
    """A lamp shines through a pane whose alpha is the u coordinate: the floor has 1 - u of the light."""
    pane = quad(uvs=uvs(), material=1)
    separate = Step("SEPXYZ", (Register(0, "Vector"),))
    clear = Material(
        [Closure("principled", color=0.0, specular=0.0, alpha=Register(1, "X"))], program=Program([read(), separate])
    )
    high = np.eye(4)
    high[2, 3] = 1.0
    sun = raytracer.SunLight((0, 0, 1), 1.0)
    scenes = [
        Scene(
            [quad(material=0), pane],
            instances=Instances([0, 1], [np.eye(4), place]),
            materials=[WHITE, clear],
            lights=[sun],
        )
        for place in (high, lift(99.0, aside=9.0))
    ]
    # Seen from below the pane: the rays start between it and the floor.
    count = len(PLACES)
    origins = np.column_stack([PLACES, np.full(count, 0.5)])
    rays = Rays(origins, np.tile(-UP, (count, 1)), np.zeros(count), np.full(count, np.inf))
    samples = SobolSamples(np.arange(count, dtype=np.uint32), 0, 0)
    shaded, open_ = (
        trace(prepare(scene, raytracer.build(scene), Settings()), rays, samples)["Combined"][:, 0] for scene in scenes
    )
    np.testing.assert_allclose(shaded / open_, 1.0 - (PLACES[:, 0] + 0.5), atol=1e-9)


WHITE = Material([Closure("diffuse", color=1.0)])


def lift(height, aside=0.0):
    matrix = np.eye(4)
    matrix[2, 3], matrix[0, 3] = height, aside
    return matrix


def test_a_bent_normal_is_that_of_a_turned_plane():
    """A Lambertian plane whose normal leans towards a distant lamp is lit as if it stood so, up to the fading."""
    lean = np.array([np.sin(0.3), 0.0, np.cos(0.3)])
    sun = raytracer.SunLight(lean, 1.0)
    bent = Material([Closure("diffuse", color=0.5, normal=lean)])
    seen = see(Scene([quad()], materials=[bent], lights=[sun]), PLACES)["Combined"][:, 0]
    tangent = np.tan(0.3) ** 2
    fading = 2.0 / (1.0 + np.sqrt(1.0 + tangent * tangent / 8.0))
    np.testing.assert_allclose(seen, 0.5 * fading / np.pi, rtol=1e-9)


def test_bent_normals_reach_the_normal_pass_and_the_diffuse_color_pass():
    lean = np.array([0.6, 0.0, 0.8])
    material = Material([Closure("diffuse", color=(0.5, 0.25, 0.125), normal=lean)])
    found = see(Scene([quad()], materials=[material]), PLACES, passes=("Normal", "Diffuse Color"))
    np.testing.assert_allclose(found["Normal"], np.tile(lean, (4, 1)), rtol=1e-12)
    np.testing.assert_allclose(found["Diffuse Color"], np.tile((0.5, 0.25, 0.125), (4, 1)))


def test_bump_of_a_linear_height_is_the_slope():
    """Height h = x over distance d raises the plane to z = d x: the normal is (-d, 0, 1), made unit."""
    separate = Step("SEPXYZ", (Register(0, "Position"),))
    height = Program([Step("NEW_GEOMETRY Position"), separate], Register(1, "X"))
    steps = [
        Step("NEW_GEOMETRY Normal"),
        Step("BUMP", (1.0, 0.5, 0.1, Register(0, "Normal")), {"height": height, "invert": False}),
    ]
    material = Material([Closure("diffuse", normal=Register(1, "Normal"))], program=Program(steps))
    found = see(Scene([quad()], materials=[material], camera=CAMERA), PLACES, passes=("Normal",))["Normal"]
    wanted = np.array((-0.5, 0.0, 1.0)) / np.sqrt(1.25)
    np.testing.assert_allclose(found, np.tile(wanted, (4, 1)), atol=1e-9)


@pytest.mark.parametrize(("source", "slope"), [("NEW_GEOMETRY Position", -0.5), ("ATTRIBUTE Vector", 0.5)])
def test_a_bump_of_attributes_is_sunk_in_on_back_faces(source, slope):
    """Seen from behind, a height of the attribute u is the surface z = -d u, one of the position x still z = d x."""
    vertices, triangles = meshes.make_quad()
    reversed_ = Mesh(vertices, triangles[:, ::-1], uvs=uvs())
    read_source = Step(source, (), {"name": "uv"} if source.startswith("ATTRIBUTE") else {})
    output = OPERATIONS[source].outputs[0]
    height = Program([read_source, Step("SEPXYZ", (Register(0, output),))], Register(1, "X"))
    steps = [
        Step("NEW_GEOMETRY Normal"),
        Step("BUMP", (1.0, 0.5, 0.1, Register(0, "Normal")), {"height": height, "invert": False}),
    ]
    material = Material([Closure("diffuse", normal=Register(1, "Normal"))], program=Program(steps))
    found = see(Scene([reversed_], materials=[material], camera=CAMERA), PLACES, passes=("Normal",))["Normal"]
    wanted = np.array((slope, 0.0, 1.0)) / np.sqrt(1.25)
    np.testing.assert_allclose(found, np.tile(wanted, (4, 1)), atol=1e-9)


# Light ---------------------------------------------------------------------------------------------------------------


def test_a_textured_lamp_gives_the_mean_of_what_its_parts_give():
    """A plane over a point shines with u: lit by the whole, the point gets what an integral over the plane says."""
    lamp = quad(uvs=uvs(), material=1)
    separate = Step("SEPXYZ", (Register(0, "Vector"),))
    spread = Step("number to vector", (Register(1, "X"),))
    glow = shine([read(), separate, spread], Register(2, "Value"))
    floor = Mesh(meshes.make_quad()[0] * 0.01, meshes.make_quad()[1])
    scene = Scene([floor, lamp], instances=Instances([0, 1], [np.eye(4), lift(0.7)]), materials=[WHITE, glow])
    count = 4096
    origins = np.tile((0.0, 0.001, 0.1), (count, 1))
    rays = Rays(origins, np.tile(-UP, (count, 1)), np.zeros(count), np.full(count, np.inf))
    integrator = prepare(scene, raytracer.build(scene), Settings())
    found = trace(integrator, rays, SobolSamples(np.arange(count, dtype=np.uint32), 0, 0))["Combined"][:, 0]
    grid = (np.arange(400) + 0.5) / 400 - 0.5
    x, y = np.meshgrid(grid, grid)
    square = x**2 + (y - 0.001) ** 2 + 0.49
    wanted = ((x + 0.5) * 0.49 / square**2).mean() / np.pi
    error = found.std() / np.sqrt(count)
    assert abs(found.mean() - wanted) < 4.0 * error
    assert error < 0.02 * wanted


def test_how_the_ray_came_is_told_to_programs():
    """Seen by the camera a plane is red; what a mirror shows of it is not."""
    steps = [Step("LIGHT_PATH Is Camera Ray"), Step("COMBXYZ", (Register(0, "Is Camera Ray"), 0.5, 0.0))]
    glow = shine(steps, Register(1, "Vector"))
    mirror = Material([Closure("glossy", color=1.0, roughness=0.0)])
    scene = Scene(
        [quad(material=0), quad(material=1)],
        instances=Instances([0, 1], [np.eye(4), lift(6.0)]),
        materials=[mirror, glow],
    )
    np.testing.assert_allclose(see(scene, PLACES)["Combined"][:, :3], np.tile((0.0, 0.5, 0.0), (4, 1)))
    direct = dataclasses.replace(scene, instances=Instances([1], [np.eye(4)]))
    np.testing.assert_allclose(see(direct, PLACES)["Combined"][:, :3], np.tile((1.0, 0.5, 0.0), (4, 1)))


# What a scene without programs pays ----------------------------------------------------------------------------------


def test_constant_materials_evaluate_nothing(monkeypatch):
    def fail(*arguments):
        raise AssertionError("no program shall run")

    for name in ("raytracer.shading.materials.compute_columns", "raytracer.integrator.prepare.make_site_tables"):
        monkeypatch.setattr(name, fail)
    scene = Scene([quad(uvs=uvs())], materials=[WHITE], lights=[PointLight((0, 0, 3), 1.0)])
    assert not derive_features(scene).programs
    integrator = prepare(scene, raytracer.build(scene), Settings())
    assert integrator.materials.computed is None
    assert not integrator.tables.with_barycentric
    see(scene, PLACES)


def test_features_of_computed_parameters_may_be_there():
    def features(**fields):
        steps = Program([Step("OBJECT_INFO Random"), Step("LIGHT_PATH Ray Length")])
        return derive_features(Scene(materials=[Material([Closure(**fields)], program=steps)]))

    value = Register(0, "Random")
    assert features(kind="emission", color=value).emission
    assert features(kind="principled", alpha=value).transparency
    assert features(kind="glossy", roughness=value).rough
    assert features(kind="transparent", weight=value).transparency
    assert features(kind="diffuse", color=value).programs
    assert not features(kind="diffuse", color=value).specular


def test_a_site_tells_materials_apart():
    """Two programs on one mesh: each triangle shows its own."""
    first, second = (
        shine([Step("COMBXYZ", (value, 0.0, 0.0)), read()], Register(0, "Vector")) for value in (0.25, 0.75)
    )
    scene = Scene([quad(uvs=uvs(), material=np.array([0, 1], np.int32))], materials=[first, second])
    found = see(scene, [(0.3, -0.3), (-0.3, 0.3)])["Combined"][:, 0]
    np.testing.assert_allclose(sorted(found), (0.25, 0.75))


def test_a_material_that_reads_the_camera_needs_one():
    scene = Scene([quad()], materials=[shine([Step("TEX_COORD Camera")], Register(0, "Camera"))])
    with pytest.raises(ValueError, match="Scene: camera: expected a Camera"):
        see(scene, PLACES)
