"""What the scene scripts share: an empty scene, meshes, materials, lights, a camera, and saving.

Everything here is ordinary Blender Python that runs in Blender 4.2 to 5.2; nothing belongs to the add-on, so that the
files open, and render, in a Blender without it. May import bpy, bmesh, mathutils and the standard library.
"""

from __future__ import annotations

import itertools
import math
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bmesh
import bpy
from mathutils import Matrix, Vector

SCENES = Path(__file__).parent
SAVED_WITH = (4, 2)  # the oldest supported Blender: later ones open its files, the reverse fails
ENGINE = "REFERENCE_RAYTRACER"

Point = Sequence[float]
Color = tuple[float, float, float]


def start_scene(width: int = 640, height: int = 400, view_transform: str = "AgX") -> bpy.types.Scene:
    """Replace the open file by an empty one and return its scene.

    Cycles' settings are its own defaults, which are this project's engine's as well, but for what is no part of the
    picture: the number of samples is fixed, and nothing is denoised.
    """
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.image_settings.file_format = "PNG"
    scene.view_settings.view_transform = view_transform
    cycles = scene.cycles
    cycles.samples = 64
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    return scene


def allow_bounces(kind: str, count: int) -> None:
    """Raise the limit of glossy bounces, or of another kind, for both engines; the add-on need not be there to find its
    setting later."""
    scene, name = bpy.context.scene, f"{kind}_bounces"
    setattr(scene.cycles, name, count)
    scene["reference_raytracer"] = {name: count}


def save_scene(path: Path) -> None:
    """Save the open file, compressed, to `path`: with this project's engine, every 3D view through the camera.

    It is written in a temporary folder first: a .blend records the path of its first saving, which should not be that
    of somebody's working copy.

    Raises
    ------
    SystemExit
        If this Blender is newer than the oldest supported one, which could not open the file.
    """
    if bpy.app.version[:2] != SAVED_WITH:
        raise SystemExit(
            f"the scenes are saved with Blender {SAVED_WITH[0]}.{SAVED_WITH[1]}, this is {bpy.app.version_string}"
        )
    look_through_camera()
    with tempfile.TemporaryDirectory(prefix="scene-") as folder, choose_engine(bpy.context.scene):
        draft = Path(folder) / path.name
        bpy.ops.wm.save_as_mainfile(filepath=str(draft), compress=True)
        shutil.move(draft, path)


def look_through_camera() -> None:
    """Let every 3D view of the file show what the camera sees, in Solid shading."""
    for space in (area.spaces.active for screen in bpy.data.screens for area in screen.areas):
        if space.type == "VIEW_3D":
            space.region_3d.view_perspective = "CAMERA"
            space.shading.type = "SOLID"


@contextmanager
def choose_engine(scene: bpy.types.Scene) -> Iterator[None]:
    """Choose this project's engine, by its name alone: Blender takes no name that no engine has, so one has it here.

    A Blender without the add-on opens such a file, too, and shows the first engine of its own list.
    """

    class Namesake(bpy.types.RenderEngine):
        bl_idname = ENGINE
        bl_label = ENGINE

    bpy.utils.register_class(Namesake)
    try:
        scene.render.engine = ENGINE
        yield
    finally:
        bpy.utils.unregister_class(Namesake)


# Objects


def link_object(
    name: str,
    data: bpy.types.ID | None,
    location: Point = (0, 0, 0),
    *,
    rotation: Point = (0, 0, 0),
    scale: float | Point = 1.0,
    materials: Sequence[bpy.types.Material] = (),
    collection: bpy.types.Collection | None = None,
) -> bpy.types.Object:
    """Return a new object that shows `data` (None: an empty); `rotation` is in degrees, in XYZ order."""
    thing = bpy.data.objects.new(name, data)
    thing.location = location
    thing.rotation_euler = [math.radians(angle) for angle in rotation]
    thing.scale = (scale, scale, scale) if isinstance(scale, int | float) else scale
    (collection or bpy.context.scene.collection).objects.link(thing)
    for material in materials:
        data.materials.append(material)
    return thing


def aim(thing: bpy.types.Object, target: Point) -> None:
    """Turn a camera or a light, which look along their -z axis, towards `target`."""
    direction = Vector(target) - thing.location
    thing.rotation_euler = direction.to_track_quat("-Z", "Y").to_euler()


def add_modifier(thing: bpy.types.Object, kind: str, name: str, **settings: Any) -> bpy.types.Modifier:
    """Add a modifier and set its properties by name."""
    modifier = thing.modifiers.new(name, kind)
    for key, value in settings.items():
        setattr(modifier, key, value)
    return modifier


def subdivide(thing: bpy.types.Object, levels: int, kind: str = "CATMULL_CLARK") -> None:
    """Add a subdivision modifier that does in the viewport what it does in the render."""
    add_modifier(thing, "SUBSURF", "Subdivision", subdivision_type=kind, levels=levels, render_levels=levels)


def displace(
    thing: bpy.types.Object, strength: float, kind: str, direction: str = "NORMAL", **texture_settings: Any
) -> None:
    """Add a displacement by one of Blender's procedural textures (which need no file)."""
    texture = bpy.data.textures.new(f"{thing.name} {kind.lower()}", kind)
    for key, value in texture_settings.items():
        setattr(texture, key, value)
    settings = {"texture": texture, "texture_coords": "GLOBAL", "strength": strength, "direction": direction}
    add_modifier(thing, "DISPLACE", f"Displace {kind.lower()}", **settings)


# Meshes


def new_mesh(
    name: str, vertices: Sequence[Point], faces: Sequence[Sequence[int]], smooth: bool = False
) -> bpy.types.Mesh:
    """Return a mesh from its corner points and faces."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    if smooth:
        mesh.shade_smooth()
    return mesh


def make_mesh(name: str, operator: Callable[..., Any], smooth: bool = False, **settings: Any) -> bpy.types.Mesh:
    """Return a mesh made by one of bmesh.ops' create operators."""
    edited = bmesh.new()
    operator(edited, **settings)
    mesh = bpy.data.meshes.new(name)
    edited.to_mesh(mesh)
    edited.free()
    if smooth:
        mesh.shade_smooth()
    return mesh


def make_plane(name: str, width: float, depth: float) -> bpy.types.Mesh:
    """Return a rectangle in the xy plane, centred on the origin, that faces +z."""
    x, y = width / 2, depth / 2
    return new_mesh(name, [(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)], [(0, 1, 2, 3)])


def make_box(name: str, width: float, depth: float, height: float) -> bpy.types.Mesh:
    """Return a box that stands on the xy plane, centred on the z axis."""
    placed = Matrix.Translation((0, 0, height / 2)) @ Matrix.Diagonal((width, depth, height, 1))
    return make_mesh(name, bmesh.ops.create_cube, size=1.0, matrix=placed)


def make_sphere(name: str, radius: float, segments: int = 64) -> bpy.types.Mesh:
    """Return a smooth sphere of `segments` meridians."""
    return make_mesh(
        name, bmesh.ops.create_uvsphere, smooth=True, u_segments=segments, v_segments=segments // 2, radius=radius
    )


def make_cone(name: str, base: float, top: float, height: float, segments: int = 48) -> bpy.types.Mesh:
    """Return a cone, or a cylinder where both radii are equal, that stands on the xy plane."""
    return make_mesh(
        name,
        bmesh.ops.create_cone,
        cap_ends=True,
        segments=segments,
        radius1=base,
        radius2=top,
        depth=height,
        matrix=Matrix.Translation((0, 0, height / 2)),
    )


def make_lathe(name: str, profile: Sequence[tuple[float, float]], segments: int = 64) -> bpy.types.Mesh:
    """Return the smooth surface that (radius, height) points sweep around the z axis, from bottom to top.

    A profile that starts and ends on the axis closes the surface; that is also how a vessel gets its thickness: up the
    outside, down the inside.
    """
    edited = bmesh.new()
    points = [edited.verts.new((radius, 0, height)) for radius, height in profile]
    edges = [edited.edges.new(pair) for pair in itertools.pairwise(points)]
    bmesh.ops.spin(edited, geom=points + edges, axis=(0, 0, 1), cent=(0, 0, 0), steps=segments, angle=math.tau)
    bmesh.ops.remove_doubles(edited, verts=edited.verts, dist=1e-5)
    bmesh.ops.recalc_face_normals(edited, faces=edited.faces)
    mesh = bpy.data.meshes.new(name)
    edited.to_mesh(mesh)
    edited.free()
    mesh.shade_smooth()
    return mesh


def make_backdrop(name: str, width: float, depth: float, height: float, radius: float) -> bpy.types.Mesh:
    """Return a photographer's sweep: a floor that bends into a wall at y = depth, with normals up and to the front."""
    bend = [
        (depth - radius + radius * math.sin(angle), radius - radius * math.cos(angle))
        for angle in (math.pi / 2 * step / 16 for step in range(17))
    ]
    section = [(-8 * depth, 0.0), *bend, (depth, height)]
    vertices = [(side * width / 2, y, z) for y, z in section for side in (-1, 1)]
    faces = [(2 * i, 2 * i + 1, 2 * i + 3, 2 * i + 2) for i in range(len(section) - 1)]
    return new_mesh(name, vertices, faces, smooth=True)


def make_chequers(name: str, size: float, count: int) -> bpy.types.Mesh:
    """Return a square of count x count faces that take the material slots 0 and 1 in turn."""
    mesh = make_mesh(name, bmesh.ops.create_grid, x_segments=count, y_segments=count, size=size / 2)
    for polygon in mesh.polygons:
        column, row = (math.floor((polygon.center[axis] / size + 0.5) * count) for axis in (0, 1))
        polygon.material_index = (column + row) % 2
    return mesh


# Materials and the world


def set_inputs(node: bpy.types.Node, inputs: Mapping[str, Any]) -> None:
    """Set unlinked sockets by the names that Blender shows; a color may come without its alpha."""
    for name, value in inputs.items():
        socket = node.inputs[name]
        socket.default_value = (*value, 1.0) if socket.type == "RGBA" else value


def _open_shader_tree(owner: bpy.types.Material | bpy.types.World) -> bpy.types.NodeTree:
    if owner.node_tree is None:  # always there from Blender 5.0 on
        owner.use_nodes = True
    return owner.node_tree


def make_principled(name: str, color: Color, **inputs: Any) -> bpy.types.Material:
    """Return a Principled material of constants; keywords are sockets: metallic=1, transmission_weight=1, ior=1.3."""
    material = bpy.data.materials.new(name)
    node = _open_shader_tree(material).nodes["Principled BSDF"]
    sockets = {"IOR" if key == "ior" else key.replace("_", " ").title(): value for key, value in inputs.items()}
    set_inputs(node, {"Base Color": color, **sockets})
    material.diffuse_color = (*color, 1.0)
    return material


# Nodes whose names are not built as those of others.
UNLIKE_OTHERS = {"Emission": "ShaderNodeEmission", "Subsurface": "ShaderNodeSubsurfaceScattering"}


def make_shader(name: str, kind: str, color: Color, **inputs: Any) -> bpy.types.Material:
    """Return a material of one closure: kind is Diffuse, Glossy, Glass, Transparent, Emission or Subsurface."""
    material = bpy.data.materials.new(name)
    tree = _open_shader_tree(material)
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    node = tree.nodes.new(UNLIKE_OTHERS.get(kind, f"ShaderNodeBsdf{kind}"))
    sockets = {"IOR" if key == "ior" else key.title(): value for key, value in inputs.items()}
    set_inputs(node, {"Color": color, **sockets})
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    material.diffuse_color = (*color, 1.0)
    return material


def set_world(color: Color, strength: float = 1.0) -> None:
    """Give the scene a world of one color, which is also its fill light."""
    world = bpy.data.worlds.new("Constant sky")
    tree = _open_shader_tree(world)
    set_inputs(tree.nodes["Background"], {"Color": color, "Strength": strength})
    bpy.context.scene.world = world


# Lights and the camera


def add_light(
    name: str, kind: str, energy: float, location: Point, target: Point, color: Color = (1, 1, 1), **settings: Any
) -> bpy.types.Object:
    """Add a POINT, SUN, SPOT or AREA light (watts; for the sun W/m^2) that looks at `target`."""
    light = bpy.data.lights.new(name, kind)
    light.energy, light.color = energy, color
    for key, value in settings.items():
        setattr(light, key, value)
    thing = link_object(name, light, location)
    aim(thing, target)
    return thing


def add_camera(location: Point, target: Point, focal_length: float = 50.0) -> bpy.types.Object:
    """Add the scene's camera; the focal length is in millimetres on a sensor 36 mm wide."""
    camera = bpy.data.cameras.new("Camera")
    camera.lens = focal_length
    thing = link_object("Camera", camera, location)
    aim(thing, target)
    bpy.context.scene.camera = thing
    return thing


# Geometry nodes


class GeometryNodes:
    """A geometry node tree under construction, as the modifier `name` of `thing`."""

    def __init__(self, thing: bpy.types.Object, name: str) -> None:
        self.tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
        for direction in ("INPUT", "OUTPUT"):
            self.tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
        self.source = self.tree.nodes.new("NodeGroupInput").outputs["Geometry"]
        self.result = self.tree.nodes.new("NodeGroupOutput").inputs["Geometry"]
        add_modifier(thing, "NODES", name, node_group=self.tree)

    def add(self, kind: str, inputs: Mapping[str, Any] = {}, **properties: Any) -> bpy.types.Node:
        """Add a node, set its properties, then the inputs it shows: constants or other nodes' outputs."""
        node = self.tree.nodes.new(kind)
        for key, value in properties.items():
            setattr(node, key, value)
        sockets = {socket.name: socket for socket in node.inputs if not socket.is_unavailable}
        for socket_name, value in inputs.items():
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, sockets[socket_name])
            else:
                sockets[socket_name].default_value = value
        return node

    def add_random(self, low: Any, high: Any, data_type: str = "FLOAT") -> bpy.types.NodeSocket:
        """Add a Random Value node and return its output: one number, or FLOAT_VECTOR, for each element."""
        node = self.add("FunctionNodeRandomValue", {"Min": low, "Max": high}, data_type=data_type)
        return next(socket for socket in node.outputs if not socket.is_unavailable)

    def finish(self, output: bpy.types.NodeSocket) -> None:
        """Make `output` the modifier's result."""
        self.tree.links.new(output, self.result)
