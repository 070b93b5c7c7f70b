"""Raycast in our engine and in Cycles of the same Blender: planes that see what is above and beside them."""

from typing import Any

import bpy
import pytest

from blend_scenes import building
from tests.addon.against_cycles.node_fixtures import Make, add_node, make_tilted_plane
from tests.addon.against_cycles.node_sources import assert_agreement

pytestmark = [
    pytest.mark.usefixtures("registered_addon"),
    pytest.mark.skipif(not hasattr(bpy.types, "ShaderNodeRaycast"), reason="Raycast came with Blender 5.2"),
]

# Rays of Cycles start some 1e-4 m away from ours, within the pixel and by its single precision; and of the 64 of each
# plane, one may meet the ball's outline.
BOUND, SHARE = 5e-4, 62 / 63
OUTPUTS = ("Is Hit", "Self Hit", "Hit Distance", "Hit Position", "Hit Normal")


def make(output: str, only_local: bool = False, offset: Any = None, **inputs: Any) -> Make:
    """A Raycast node's output, at the highest 8; offset : of the ray's start from the point; None starts there."""

    def build(tree: Any) -> Any:
        node = add_node(tree, "ShaderNodeRaycast", inputs, only_local=only_local)
        if offset is not None:
            place = tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"]
            moved = add_node(tree, "ShaderNodeVectorMath", {"Vector": place}, operation="ADD")
            moved.inputs[1].default_value = offset
            tree.links.new(moved.outputs[0], node.inputs["Position"])
        return next(socket for socket in node.outputs if socket.identifier == output)

    return build


def make_read(kind: str, name: str, output: str = "Attribute_0") -> Make:
    """An attribute of what lies above."""

    def build(tree: Any) -> Any:
        node = add_node(tree, "ShaderNodeRaycast", {"Direction": (0.1, 0.2, 1.0), "Length": 50.0})
        node.sample_attribute_items.new(kind, name)
        return next(socket for socket in node.outputs if socket.identifier == output)

    return build


def make_bumped(tree: Any) -> Any:
    """The normal of a surface raised by the distance to what is above."""
    node = add_node(tree, "ShaderNodeRaycast", {"Direction": (0.1, 0.2, 1.0), "Length": 50.0})
    bump = add_node(tree, "ShaderNodeBump", {"Height": node.outputs["Hit Distance"], "Distance": 0.1})
    return bump.outputs["Normal"]


WAYS: dict[str, dict[str, Any]] = {
    "normal": {},
    "up": {"Direction": (0.1, 0.2, 1.0), "Length": 50.0},
    "long": {"Direction": (0.3, -0.6, 2.0), "Length": 4.0},
    "near": {"Direction": (0.0, 0.0, 1.0), "Length": 2.5},
    "none": {"Direction": (0.0, 0.0, 1.0), "Length": 0.0},
    "down": {"Direction": (0.1, 0.3, -1.0), "Length": 5.0, "offset": (0.3, 0.2, 1.0)},
    "own": {"Direction": (0.1, 0.3, -1.0), "Length": 5.0, "offset": (0.0, -0.4, 3.7), "only_local": True},
}
CASES = {
    **{f"{way} {output}": make(output, **options) for way, options in WAYS.items() for output in OUTPUTS},
    "number": make_read("FLOAT", "number"),
    "number of a color": make_read("FLOAT", "Col"),
    "vector": make_read("VECTOR", "UVMap"),
    "color": make_read("RGBA", "Col"),
    "alpha": make_read("RGBA", "Col", "Attribute_0_Alpha"),
    "missing": make_read("RGBA", "none"),
    "bump": make_bumped,
}


def add_ceiling() -> None:
    """A smooth ball and a tilted plane above, which the camera does not see."""
    plain = building.make_shader("Plain", "Diffuse", (1, 1, 1))
    plane = make_tilted_plane("Above")
    above = building.link_object("Above", plane, (4, 4, 3), rotation=(20, 10, 0), scale=(20, 20, 2), materials=[plain])
    ball = building.make_sphere("Ball", 0.8, 16)
    hidden = building.link_object("Ball", ball, (2, 3, 1.6), scale=(1, -1, 1), materials=[plain])
    above.visible_camera = hidden.visible_camera = False


def test_what_rays_meet_agrees(empty_scene: Any, record_property: Any) -> None:
    add_ceiling()
    assert_agreement(CASES, BOUND, record_property, share=SHARE)
