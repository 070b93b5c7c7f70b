"""Character: a doll of one skinned mesh, posed by an armature, its clothes painted as vertex colors."""

from __future__ import annotations

import math
from collections.abc import Sequence

import bpy
from mathutils import Matrix, Vector

from blend_scenes import building

# Bones: from, to, parent. Left is +x; the doll looks along -y.
BONES = {
    "Spine": ((0, 0, 0.95), (0, 0, 1.25), None),
    "Chest": ((0, 0, 1.25), (0, 0, 1.52), "Spine"),
    "Head": ((0, 0, 1.52), (0, 0, 1.95), "Chest"),
    "Arm.L": ((0.17, 0, 1.45), (0.47, 0, 1.45), "Chest"),
    "Forearm.L": ((0.47, 0, 1.45), (0.78, 0, 1.45), "Arm.L"),
    "Thigh.L": ((0.1, 0, 0.95), (0.1, 0, 0.52), "Spine"),
    "Shin.L": ((0.1, 0, 0.52), (0.1, 0, 0.08), "Thigh.L"),
    "Arm.R": ((-0.17, 0, 1.45), (-0.47, 0, 1.45), "Chest"),
    "Forearm.R": ((-0.47, 0, 1.45), (-0.78, 0, 1.45), "Arm.R"),
    "Thigh.R": ((-0.1, 0, 0.95), (-0.1, 0, 0.52), "Spine"),
    "Shin.R": ((-0.1, 0, 0.52), (-0.1, 0, 0.08), "Thigh.R"),
}
# Turns of bones in degrees, about world axes as they are at rest.
POSE = {
    "Spine": (0, 4, 0),
    "Chest": (0, 6, 10),
    "Head": (0, -8, 8),
    "Arm.L": (0, -38, 0),
    "Forearm.L": (0, -62, 20),
    "Arm.R": (0, -58, 0),
    "Forearm.R": (-40, -10, 0),
    "Thigh.L": (-34, 0, 0),
    "Shin.L": (48, 0, 0),
    "Thigh.R": (14, 0, 0),
    "Shin.R": (10, 0, 0),
}
TRUNK = ((0.9, 0.14), (1.0, 0.16), (1.2, 0.14), (1.42, 0.18), (1.5, 0.1), (1.58, 0.06))  # height, radius
ARM = ((0.1, 0.08), (0.3, 0.07), (0.47, 0.06), (0.7, 0.05), (0.82, 0.055))  # distance from the middle, radius
LEG = ((0.98, 0.1), (0.75, 0.095), (0.52, 0.075), (0.3, 0.07), (0.05, 0.06))  # height, radius
RINGS, SIDES = 28, 16
SKIN, HAIR = (0.75, 0.45, 0.32), (0.12, 0.05, 0.03)
SHIRT, STRIPE, TROUSERS, SHOES = (0.75, 0.72, 0.62), (0.55, 0.06, 0.05), (0.05, 0.09, 0.22), (0.15, 0.07, 0.03)


class Body:
    """The mesh under construction: vertices, faces, and for each vertex its bones and its color at rest."""

    def __init__(self) -> None:
        self.vertices: list[Vector] = []
        self.faces: list[tuple[int, ...]] = []
        self.bones: list[Sequence[str]] = []

    def add_tube(self, sections: Sequence[tuple[float, float, float, float]], bones: Sequence[str]) -> None:
        """Add a tube with rounded ends along points (x, y, z, radius)."""
        path = [resample(sections, ring / (RINGS - 1)) for ring in range(RINGS)]
        axis = (path[-1][0] - path[0][0]).normalized()
        side = axis.orthogonal().normalized()
        first = len(self.vertices)
        for ring, (centre, radius) in enumerate(path):
            end = min(ring, RINGS - 1 - ring) / 3
            radius *= math.sqrt(1 - (1 - min(end, 1.0)) ** 2) if end < 1 else 1.0
            for step in range(SIDES):
                spoke = Matrix.Rotation(math.tau * step / SIDES, 3, axis) @ side
                self.vertices.append(centre + max(radius, 0.004) * spoke)
                self.bones.append(bones)
        for ring in range(RINGS - 1):
            for step in range(SIDES):
                low, next_ = first + ring * SIDES, (step + 1) % SIDES
                self.faces.append((low + step, low + next_, low + SIDES + next_, low + SIDES + step))
        self.faces.append(tuple(range(first + SIDES - 1, first - 1, -1)))
        self.faces.append(tuple(range(first + (RINGS - 1) * SIDES, first + RINGS * SIDES)))

    def add_mesh(self, mesh: bpy.types.Mesh, place: Vector, bones: Sequence[str]) -> None:
        """Add a copy of a mesh that one bone carries."""
        first = len(self.vertices)
        self.vertices += [place + vertex.co for vertex in mesh.vertices]
        self.bones += [bones] * len(mesh.vertices)
        self.faces += [tuple(first + index for index in face.vertices) for face in mesh.polygons]
        bpy.data.meshes.remove(mesh)


def resample(sections: Sequence[tuple[float, float, float, float]], share: float) -> tuple[Vector, float]:
    """Return the point and the radius at a share of the way along sections."""
    place = share * (len(sections) - 1)
    index = min(int(place), len(sections) - 2)
    mixed = Vector(sections[index]).lerp(Vector(sections[index + 1]), place - index)
    return mixed.to_3d(), mixed[3]


def weigh_bones(point: Vector, bones: Sequence[str]) -> dict[str, float]:
    """Return the weights of a point's bones: they fall with the fourth power of the distance from each."""
    weights = {}
    for name in bones:
        start, end = (Vector(corner) for corner in BONES[name][:2])
        along = max(0.0, min(1.0, (point - start).dot(end - start) / (end - start).length_squared))
        weights[name] = 1.0 / max((point - start.lerp(end, along)).length, 0.02) ** 4
    total = sum(weights.values())
    return {name: weight / total for name, weight in weights.items()}


def paint(point: Vector, bones: Sequence[str]) -> tuple[float, float, float]:
    """Return the color of a point at rest: face, hair, striped shirt, trousers, shoes."""
    if len(bones) == 1:
        is_hair = bones[0] == "Head" and (point.z > 1.8 - 0.5 * point.y or point.y > 0.05)
        return HAIR if is_hair else SHOES if "Shin" in bones[0] else SKIN
    if "Thigh" in bones[0]:
        return SHOES if point.z < 0.16 else TROUSERS
    if "Arm" in bones[0]:
        return SKIN if abs(point.x) > 0.66 else STRIPE if int(abs(point.x) * 14) % 2 else SHIRT
    if point.z > 1.51:
        return SKIN
    return TROUSERS if point.z < 0.99 else STRIPE if int(point.z * 14) % 2 else SHIRT


def make_body() -> tuple[bpy.types.Mesh, list[dict[str, float]]]:
    """Return the doll's mesh with the color attribute "Clothes", and the weights of each vertex."""
    body = Body()
    body.add_tube([(0, 0, z, radius) for z, radius in TRUNK], ("Spine", "Chest", "Head"))
    body.add_mesh(building.make_sphere("Head", 0.17, 32), Vector((0, 0, 1.75)), ("Head",))
    for side, name in ((1, "L"), (-1, "R")):
        arm = [(side * x, 0, 1.45, radius) for x, radius in ARM]
        body.add_tube(arm, (f"Arm.{name}", f"Forearm.{name}", "Chest"))
        leg = [(side * 0.1, 0, z, radius) for z, radius in LEG]
        body.add_tube(leg, (f"Thigh.{name}", f"Shin.{name}", "Spine"))
        hand = building.make_sphere("Hand", 0.065, 16)
        body.add_mesh(hand, Vector((side * 0.84, 0, 1.45)), (f"Forearm.{name}",))
        shoe = building.make_sphere("Shoe", 0.085, 16)
        for vertex in shoe.vertices:
            vertex.co.y = 1.5 * vertex.co.y - 0.05
            vertex.co.z *= 0.7
        body.add_mesh(shoe, Vector((side * 0.1, 0, 0.06)), (f"Shin.{name}",))
    mesh = building.new_mesh("Doll", body.vertices, body.faces, smooth=True)
    colors = mesh.color_attributes.new("Clothes", "BYTE_COLOR", "POINT")
    for entry, vertex, bones in zip(colors.data, body.vertices, body.bones, strict=True):
        entry.color = (*paint(vertex, bones), 1.0)
    return mesh, [weigh_bones(point, bones) for point, bones in zip(body.vertices, body.bones, strict=True)]


def make_armature() -> bpy.types.Object:
    """Return the armature, at rest."""
    rig = building.link_object("Rig", bpy.data.armatures.new("Rig"))
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    for name, (start, end, parent) in BONES.items():
        bone = rig.data.edit_bones.new(name)
        bone.head, bone.tail = start, end
        bone.parent = rig.data.edit_bones[parent] if parent else None
    bpy.ops.object.mode_set(mode="OBJECT")
    return rig


def pose(rig: bpy.types.Object) -> None:
    """Turn the bones."""
    for name, angles in POSE.items():
        bone = rig.pose.bones[name]
        rest = rig.data.bones[name].matrix_local.to_3x3()
        turn = Matrix.Identity(3)
        for angle, axis in zip(angles, "XYZ", strict=True):
            turn = Matrix.Rotation(math.radians(angle), 3, axis) @ turn
        bone.rotation_mode = "QUATERNION"
        bone.rotation_quaternion = (rest.inverted() @ turn @ rest).to_quaternion()


def make_clothes() -> bpy.types.Material:
    """A material that the mesh's colors fill."""
    material = building.make_principled("Clothes", (0.8, 0.8, 0.8), roughness=0.6)
    tree = material.node_tree
    colors = tree.nodes.new("ShaderNodeVertexColor")
    colors.layer_name = "Clothes"
    tree.links.new(colors.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    return material


def build() -> None:
    """Fill the scene: the doll strides and waves on a stage."""
    building.start_scene(520, 440)
    building.set_world((0.75, 0.85, 1.0), 0.4)
    paper = building.make_shader("Paper", "Diffuse", (0.6, 0.52, 0.42))
    building.link_object("Sweep", building.make_backdrop("Sweep", 20, 3, 6, 2), materials=[paper])
    mesh, weights = make_body()
    doll, rig = building.link_object("Doll", mesh, materials=[make_clothes()]), make_armature()
    for name in BONES:
        group = doll.vertex_groups.new(name=name)
        for index, shares in enumerate(weights):
            if name in shares:
                group.add([index], shares[name], "REPLACE")
    building.add_modifier(doll, "ARMATURE", "Rig", object=rig)
    building.subdivide(doll, 1)
    pose(rig)
    building.add_light("Key", "AREA", 230, (-2.2, -2.8, 3.2), (0, 0, 1.1), (1.0, 0.93, 0.85), shape="SQUARE", size=1.2)
    building.add_light("Rim", "SPOT", 260, (2.2, 1.6, 3.0), (0, 0, 1.2), (0.7, 0.85, 1.0), spot_size=0.9)
    building.add_camera((0.9, -4.9, 1.5), (0.05, 0, 0.99), 50)


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "character.blend")
