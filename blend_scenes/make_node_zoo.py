"""Node zoo: two dozen balls, each colored by another graph of shader nodes; the script's table names them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from blend_scenes import building

COLUMNS = 6
Socket = bpy.types.NodeSocket


class Graph:
    """The node tree of a material under construction."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self.tree = tree

    def add(self, kind: str, inputs: dict[str | int, Any] | None = None, output: str | int = 0, **settings: Any) -> Any:
        """Add the node ShaderNode`kind`; set its properties, and its inputs by name or number to constants or sockets.

        Returns one of its outputs.
        """
        node = self.tree.nodes.new(f"ShaderNode{kind}")
        for name, value in settings.items():
            setattr(node, name, value)
        for key, value in (inputs or {}).items():
            if isinstance(value, Socket):
                self.tree.links.new(value, node.inputs[key])
            else:
                node.inputs[key].default_value = value
        return node.outputs[output]

    def mix(self, share: Any, first: Any, second: Any, **settings: Any) -> Socket:
        """Return a mix of two colors."""
        node = self.add("Mix", data_type="RGBA", **settings).node
        sockets = [socket for socket in node.inputs if socket.enabled]
        for socket, value in zip(sockets, (share, first, second), strict=True):
            if isinstance(value, Socket):
                self.tree.links.new(value, socket)
            else:
                socket.default_value = value
        return next(socket for socket in node.outputs if socket.enabled)

    def ramp(self, share: Socket, *stops: tuple[float, tuple[float, float, float]]) -> Socket:
        """Return the colors that a Color Ramp gives to a number."""
        output = self.add("ValToRGB", {"Fac": share}, "Color")
        elements = output.node.color_ramp.elements
        while len(elements) < len(stops):
            elements.new(0.5)
        for element, (position, color) in zip(elements, stops, strict=True):
            element.position, element.color = position, (*color, 1.0)
        return output


RED, BLUE, CREAM, INK = (0.8, 0.07, 0.05, 1), (0.05, 0.15, 0.6, 1), (0.85, 0.78, 0.6, 1), (0.03, 0.03, 0.06, 1)


def make_curves(graph: Graph) -> Socket:
    color = graph.add("RGBCurve", {"Color": graph.add("TexCoord", output="Generated")}, "Color")
    curve = color.node.mapping.curves[0]
    curve.points.new(0.35, 0.9)
    curve.points.new(0.65, 0.1)
    color.node.mapping.update()
    return color


def make_bands(graph: Graph) -> Socket:
    height = graph.add("SeparateXYZ", {0: graph.add("TexCoord", output="Generated")}, "Z")
    wave = graph.add("Math", {0: graph.add("Math", {0: height, 1: 40.0}, operation="MULTIPLY")}, operation="SINE")
    return graph.mix(graph.add("Math", {0: wave, 1: 0.0}, operation="GREATER_THAN"), CREAM, INK)


def make_group(graph: Graph) -> Socket:
    """A group with a color in and out, used twice, one in the other's input."""
    group = bpy.data.node_groups.get("Wash") or bpy.data.node_groups.new("Wash", "ShaderNodeTree")
    if not group.nodes:
        for direction in ("INPUT", "OUTPUT"):
            group.interface.new_socket("Color", in_out=direction, socket_type="NodeSocketColor")
        source, result = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
        turned = Graph(group).add("HueSaturation", {"Hue": 0.66, "Color": source.outputs[0]})
        group.links.new(turned, result.inputs[0])
    color = graph.add("TexChecker", {"Color1": RED, "Color2": CREAM, "Scale": 6.0}, "Color")
    for _ in range(2):
        node = graph.tree.nodes.new("ShaderNodeGroup")
        node.node_tree = group
        graph.tree.links.new(color, node.inputs[0])
        color = node.outputs[0]
    return color


GENERATED = {"output": "Generated"}
COLORS: dict[str, Callable[[Graph], Socket]] = {
    "Checker": lambda g: g.add("TexChecker", {"Color1": RED, "Color2": CREAM, "Scale": 8.0}, "Color"),
    "Brick": lambda g: g.add("TexBrick", {"Color1": RED, "Color2": (0.5, 0.1, 0.05, 1), "Scale": 6.0}, "Color"),
    "Noise": lambda g: g.ramp(
        g.add("TexNoise", {"Scale": 4.0, "Detail": 5.0}, "Fac"), (0.38, (0.02, 0.1, 0.3)), (0.62, (0.9, 0.85, 0.7))
    ),
    "Wave": lambda g: g.add("TexWave", {"Scale": 3.0, "Distortion": 4.0}, "Color"),
    "Magic": lambda g: g.add("TexMagic", {"Scale": 3.0}, "Color", turbulence_depth=3),
    "Gradient": lambda g: g.ramp(
        g.add("TexGradient", {0: g.add("TexCoord", output="Generated")}, "Fac"),
        *((0.1, (0.7, 0.05, 0.05)), (0.5, (0.85, 0.75, 0.1)), (0.9, (0.05, 0.3, 0.5))),
    ),
    "White noise": lambda g: g.add(
        "TexWhiteNoise",
        {0: g.add("VectorMath", {0: g.add("TexCoord", **GENERATED), 1: (0.1, 0.1, 0.1)}, operation="SNAP")},
        "Color",
    ),
    "Mapping": lambda g: g.add(
        "TexChecker",
        {0: g.add("Mapping", {0: g.add("TexCoord", **GENERATED), "Rotation": (0.5, 0.6, 0.0), "Scale": (3, 9, 3)})},
        "Color",
    ),
    "Curves": make_curves,
    "Math": make_bands,
    "Vector math": lambda g: g.add(
        "VectorMath", {0: g.add("NewGeometry", output="Normal"), 1: (0.3, 0.6, 0.9)}, operation="ABSOLUTE"
    ),
    "Separate and combine": lambda g: g.add(
        "CombineColor",
        {
            "Red": g.add("SeparateXYZ", {0: g.add("TexCoord", **GENERATED)}, "Z"),
            "Green": 0.9,
            "Blue": 0.7,
        },
        mode="HSV",
    ),
    "Layer weight": lambda g: g.mix(g.add("LayerWeight", {"Blend": 0.4}, "Facing"), BLUE, CREAM),
    "Fresnel": lambda g: g.mix(g.add("Fresnel", {"IOR": 1.8}), INK, RED),
    "Overlay": lambda g: g.mix(
        0.8, g.add("TexNoise", {"Scale": 6.0}, "Color"), (0.9, 0.5, 0.1, 1), blend_type="OVERLAY"
    ),
    "Hue and saturation": lambda g: g.add(
        "HueSaturation", {"Hue": 0.8, "Saturation": 1.6, "Color": g.add("TexMagic", {"Scale": 2.0}, "Color")}
    ),
    "Invert and gamma": lambda g: g.add(
        "Gamma", {0: g.add("Invert", {"Color": g.add("TexWave", {"Scale": 2.0}, "Color")}), 1: 2.2}
    ),
    "Brightness": lambda g: g.add(
        "BrightContrast", {0: g.add("TexNoise", {"Scale": 3.0}, "Color"), "Bright": 0.1, "Contrast": 2.0}
    ),
    "Map range": lambda g: g.mix(
        g.add(
            "MapRange",
            {0: g.add("SeparateXYZ", {0: g.add("TexCoord", **GENERATED)}, "Z"), "From Min": 0.3, "From Max": 0.7},
            interpolation_type="SMOOTHSTEP",
        ),
        *(BLUE, (0.8, 0.8, 0.85, 1)),
    ),
    "Object info": lambda g: g.add("HueSaturation", {"Hue": g.add("ObjectInfo", output="Random"), "Color": RED}),
    "Groups": make_group,
    "Camera data": lambda g: g.ramp(
        g.add("Math", {0: g.add("CameraData", output="View Distance"), 1: 1.0}, operation="FRACT"),
        *((0.3, (0.9, 0.9, 0.8)), (0.7, (0.4, 0.1, 0.4))),
    ),
    "Reflection": lambda g: g.add("TexChecker", {0: g.add("TexCoord", output="Reflection"), "Scale": 4.0}, "Color"),
    "Bump": lambda g: (0.75, 0.55, 0.2, 1),
}


def make_material(name: str, color: Callable[[Graph], Any]) -> bpy.types.Material:
    """Return a Principled material of a graph's color; that of "Bump" has dents."""
    material = building.make_principled(name, (0.8, 0.8, 0.8), roughness=0.4)
    graph, principled = Graph(material.node_tree), material.node_tree.nodes["Principled BSDF"]
    found = color(graph)
    if isinstance(found, Socket):
        material.node_tree.links.new(found, principled.inputs["Base Color"])
    else:
        principled.inputs["Base Color"].default_value = found
        height = graph.add("TexNoise", {"Scale": 12.0}, "Fac")
        bump = graph.add("Bump", {"Strength": 0.8, "Distance": 0.1, "Height": height})
        material.node_tree.links.new(bump, principled.inputs["Normal"])
    return material


def build() -> None:
    """Fill the scene: rows of balls on steps, so that each is seen."""
    building.start_scene(640, 440)
    building.set_world((0.8, 0.88, 1.0), 0.5)
    ground = building.make_shader("Paper", "Diffuse", (0.7, 0.7, 0.68))
    sweep = building.make_backdrop("Sweep", 30, 6, 9, 3)
    building.link_object("Sweep", sweep, materials=[ground])
    mesh = building.make_sphere("Ball", 0.5, 32)
    for number, (name, color) in enumerate(COLORS.items()):
        row, column = divmod(number, COLUMNS)
        place = (1.15 * (column - (COLUMNS - 1) / 2), 0.75 * row, 0.5 + 0.95 * row)
        ball = mesh.copy()
        ball.name = name
        building.link_object(name, ball, place, rotation=(0, 0, 20), materials=[make_material(name, color)])
        if row:
            box = building.make_box(f"Step {number}", 1.15, 0.75, 0.95 * row)
            building.link_object(f"Step {number}", box, (place[0], place[1], 0), materials=[ground])
    building.add_light(
        "Softbox", "AREA", 1300, (-4.5, -6.0, 6.5), (0, 1, 1.6), (1, 0.95, 0.88), shape="SQUARE", size=2.5
    )
    building.add_camera((0.0, -10.5, 3.6), (0.0, 1.0, 1.75), 46)


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "node_zoo.blend")
