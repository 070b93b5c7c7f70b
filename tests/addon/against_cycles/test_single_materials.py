"""Single materials and lamps against Cycles: a ball on a plane, picture by picture.

Both renderers make independent batches; the means of tiles of 8 x 8 pixels must agree within SIGMAS standard errors of
their difference, estimated from the batches. Known differences, and who is right, are in the parameters' comments.
"""

import numpy as np
import pytest

import raytracer
from raytracer.rendering.render import render
from raytracer.scene.materials import Closure, Material

bpy = pytest.importorskip("bpy", reason="needs Blender's Python module")
pytestmark = [pytest.mark.blender, pytest.mark.slow]

SIZE, TILE, BATCHES, SAMPLES = 32, 8, 8, 32
# 16 tiles x 3 channels x 25 pictures, t distribution of 14 degrees of freedom: 1 % for the whole file.
SIGMAS = 7.5
# Both films are float32, sampled within a pixel by different points.
FLOAT_ERROR = 1e-4
CAMERA = ((0.0, -5.0, 2.6), (1.2, 0.0, 0.0))  # position, rotation

NODES = {
    "diffuse": "ShaderNodeBsdfDiffuse",
    "glossy": "ShaderNodeBsdfAnisotropic",
    "glass": "ShaderNodeBsdfGlass",
    "refraction": "ShaderNodeBsdfRefraction",
    "transparent": "ShaderNodeBsdfTransparent",
    "emission": "ShaderNodeEmission",
    "principled": "ShaderNodeBsdfPrincipled",
}
SOCKETS = {
    "roughness": "Roughness",
    "ior": "IOR",
    "metallic": "Metallic",
    "transmission": "Transmission Weight",
    "specular": "Specular IOR Level",
    "alpha": "Alpha",
}


def make_node_material(closure):
    """One node that stands for a Closure."""
    material = bpy.data.materials.new("material")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    node = tree.nodes.new(NODES[closure.kind])
    if closure.kind == "refraction":
        node.distribution = "GGX"
    principled = closure.kind == "principled"
    node.inputs["Base Color" if principled else "Color"].default_value = (*closure.color, 1.0)
    for name, socket in SOCKETS.items():
        if socket in node.inputs:
            node.inputs[socket].default_value = 0.0 if closure.kind == "diffuse" else getattr(closure, name)
    if principled:
        node.inputs["Specular Tint"].default_value = (*closure.specular_tint, 1.0)
        node.inputs["Emission Color"].default_value = (*closure.emission, 1.0)
        node.inputs["Emission Strength"].default_value = 1.0
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(node.outputs[0], output.inputs[0])
    return material


def make_ball(rings=24):
    """Return vertices and triangles of a unit ball at (0, 0, 1), and its vertex normals."""
    polar, turn = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1), indexing="ij")
    normals = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1)
    row, column = np.meshgrid(np.arange(rings), np.arange(2 * rings), indexing="ij")
    corner = (row * (2 * rings + 1) + column).ravel()
    below = corner + 2 * rings + 1
    triangles = np.concatenate([np.stack([corner, below, below + 1], 1), np.stack([corner, below + 1, corner + 1], 1)])
    positions = normals.reshape(-1, 3).astype(np.float32).astype(float) + np.array([0, 0, 1.0])
    corners = positions[triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return positions, triangles[area > 1e-6], normals.reshape(-1, 3)


PLANE = np.array([[-4.0, -4, 0], [4, -4, 0], [4, 4, 0], [-4, 4, 0]])


def add_object(name, positions, triangles, material, normals=None):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(positions.tolist(), [], triangles.tolist())
    if normals is not None:
        mesh.polygons.foreach_set("use_smooth", [True] * len(triangles))
        mesh.normals_split_custom_set_from_vertices(normals.tolist())
    mesh.materials.append(make_node_material(material))
    item = bpy.data.objects.new(name, mesh)
    # Cycles moves shadow rays on smooth meshes by default, against the terminator; we do not.
    item.cycles.shadow_terminator_geometry_offset = item.cycles.shadow_terminator_offset = 0.0
    bpy.context.collection.objects.link(item)
    return mesh


def setup_cycles(bounces, world):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    settings = scene.cycles
    settings.samples = SAMPLES
    settings.use_adaptive_sampling = settings.use_denoising = False
    settings.max_bounces = settings.glossy_bounces = settings.transmission_bounces = bounces
    settings.diffuse_bounces = 0
    settings.transparent_max_bounces = 64
    settings.sample_clamp_direct = settings.sample_clamp_indirect = settings.blur_glossy = 0.0
    settings.light_sampling_threshold = 0.0
    settings.pixel_filter_type, settings.filter_width = "BOX", 1.0
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs[0].default_value = (*world, 1.0)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location, camera.rotation_euler = CAMERA
    scene.collection.objects.link(camera)
    scene.camera = camera
    bpy.context.view_layer.update()
    return scene


def render_cycles(scene, path, seed):
    scene.cycles.seed = seed
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    pixels = np.empty(SIZE * SIZE * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(SIZE, SIZE, -1)[::-1, :, :3].astype(float)


def average_tiles(picture):
    return picture.reshape(SIZE // TILE, TILE, SIZE // TILE, TILE, 3).mean(axis=(1, 3))


def assert_same(tmp_path, closure, lamp, light, world=(0.1, 0.15, 0.2), plane_color=0.8, bounces=4):
    scene = setup_cycles(bounces, world)
    plane = Closure("diffuse", color=plane_color)
    positions, triangles, normals = make_ball()
    add_object("plane", PLANE, np.array([[0, 1, 2], [0, 2, 3]]), plane)
    ball = add_object("ball", positions, triangles, closure, normals)
    corner_normals = np.array([corner.vector for corner in ball.corner_normals], dtype=float).reshape(-1, 3, 3)
    if light is not None:
        add_lamp(lamp, light)
    theirs = np.stack([average_tiles(render_cycles(scene, tmp_path / "cycles.exr", seed)) for seed in range(BATCHES)])
    ours_scene = raytracer.Scene(
        meshes=[
            raytracer.Mesh(PLANE, [[0, 1, 2], [0, 2, 3]]),
            raytracer.Mesh(positions, triangles, normals=corner_normals, material=1),
        ],
        materials=[Material((plane,)), Material((closure,))],
        lights=[light] if light is not None else [],
        world=raytracer.World(world),
        camera=raytracer.Camera(np.array(scene.camera.matrix_world, dtype=float)),
    )
    pictures = [
        render(ours_scene, SIZE, SIZE, samples=SAMPLES, seed=seed, pixel_filter="box", max_bounces=bounces)["Combined"]
        for seed in range(BATCHES)
    ]
    ours = np.stack([average_tiles(picture[..., :3].astype(float)) for picture in pictures])
    error = np.sqrt((ours.var(axis=0, ddof=1) + theirs.var(axis=0, ddof=1)) / BATCHES)
    difference = np.abs(ours.mean(axis=0) - theirs.mean(axis=0))
    assert (difference <= SIGMAS * error + FLOAT_ERROR * (1 + theirs.mean(axis=0))).all()


def add_lamp(kind, light):
    data = bpy.data.lights.new("lamp", kind)
    item = bpy.data.objects.new("lamp", data)
    bpy.context.collection.objects.link(item)
    if kind == "SUN":
        data.energy, data.color, data.angle = 1.0, light.strength.tolist(), light.angle
        item.rotation_mode = "QUATERNION"
        from mathutils import Vector

        item.rotation_quaternion = Vector(light.direction).to_track_quat("Z", "Y")
        return
    data.energy, data.color = 1000.0, (light.power / 1000.0).tolist()
    item.location = light.position
    if kind == "AREA":
        data.shape = "RECTANGLE" if light.shape == "rectangle" else "ELLIPSE"
        data.size, data.size_y, data.spread = light.axis_u[0], light.axis_v[1], light.spread
        return
    data.shadow_soft_size, data.use_soft_falloff = light.radius, light.soft_falloff
    if kind == "SPOT":
        data.spot_size, data.spot_blend = light.spot_size, light.spot_blend
        item.scale = np.diag(light.world_from_light)


MATERIALS = {
    "diffuse": Closure("diffuse", color=(0.8, 0.3, 0.2)),
    "mirror": Closure("glossy", color=(0.9, 0.8, 0.7), roughness=0.0),
    "glossy": Closure("glossy", color=(0.9, 0.5, 0.2), roughness=0.3),
    "rough glossy": Closure("glossy", color=(0.9, 0.5, 0.2), roughness=0.9),
    "glass": Closure("glass", color=(0.9, 1.0, 0.8), roughness=0.0, ior=1.5),
    "rough glass": Closure("glass", color=(0.9, 1.0, 0.8), roughness=0.5, ior=1.5),
    "refraction": Closure("refraction", color=(0.9, 1.0, 0.8), roughness=0.3, ior=1.4),
    "transparent": Closure("transparent", color=(0.9, 0.5, 0.2)),
    "emission": Closure("emission", color=(0.9, 0.5, 0.2)),
    "plastic": Closure("principled", color=(0.8, 0.3, 0.2), roughness=0.5),
    "metal": Closure("principled", color=(0.8, 0.5, 0.2), metallic=1.0, roughness=0.4, specular_tint=(0.5, 0.7, 1)),
    "principled glass": Closure("principled", color=(0.8, 0.9, 0.2), transmission=1.0, roughness=0.3),
    "all": Closure(
        "principled", color=(0.8, 0.5, 0.2), metallic=0.3, transmission=0.4, roughness=0.4, alpha=0.7, emission=0.1
    ),
}


@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize("lamp", ["POINT", "SUN"])
def test_material_looks_as_in_cycles(tmp_path, name, lamp):
    """The plane is black.

    With a grey one Cycles, without diffuse bounces, still lets some of the ball's diffuse reflection of it through on
    rays sampled as glossy, and drops glossy light on rays sampled as diffuse: up to 0.01. We keep the two apart.
    """
    light = {
        "POINT": raytracer.PointLight((2, -3, 4), (600, 500, 400), radius=0.5, soft_falloff=False),
        "SUN": raytracer.SunLight((1, -1, 2), (2, 1.5, 1), angle=0.2),
    }[lamp]
    assert_same(tmp_path, MATERIALS[name], lamp, light, plane_color=0.0)


LAMPS = {
    "point": ("POINT", raytracer.PointLight((2, -3, 4), 600)),
    "soft point": ("POINT", raytracer.PointLight((2, -3, 4), 600, radius=0.7)),
    "ball": ("POINT", raytracer.PointLight((2, -3, 4), 600, radius=0.7, soft_falloff=False)),
    "spot": (
        "SPOT",
        raytracer.SpotLight((0.5, 0, 4), (500, 300, 100), world_from_light=np.diag([2.0, 1, 1]), spot_blend=0.5),
    ),
    "ball spot": ("SPOT", raytracer.SpotLight((0.5, 0, 4), 500, radius=0.4, soft_falloff=False, spot_size=1.0)),
    "sun": ("SUN", raytracer.SunLight((1, -1, 2), (2, 3, 4))),
    "wide sun": ("SUN", raytracer.SunLight((1, -1, 2), (2, 3, 4), angle=1.5)),
    "rectangle": ("AREA", raytracer.AreaLight((0, 0, 3), (1, 0, 0), (0, 2, 0), 100)),
    "ellipse": ("AREA", raytracer.AreaLight((0, 0, 3), (1, 0, 0), (0, 2, 0), 100, shape="ellipse")),
    "spread": ("AREA", raytracer.AreaLight((0, 0, 3), (1, 0, 0), (0, 2, 0), 100, spread=1.5)),
    "spread ellipse": ("AREA", raytracer.AreaLight((0, 0, 3), (1, 0, 0), (0, 2, 0), 100, "ellipse", spread=1.0)),
}


@pytest.mark.parametrize("name", LAMPS)
def test_lamp_lights_as_in_cycles(tmp_path, name):
    assert_same(tmp_path, MATERIALS["diffuse"], *LAMPS[name])
