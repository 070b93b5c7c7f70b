"""Panoramic cameras against Cycles: where the points of each projection lie, and what nodes call camera and window."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from addon.compare.cycles.rendering import Request, render_both
from addon.engine.statistics import last_render
from addon.properties import ENGINE
from tests.addon.against_cycles.node_fixtures import render_centres, render_cycles
from tests.addon.engine.engine_fixtures import read_image
from tests.addon.extract.shaders.shader_trees import give_nodes

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

WIDTH, HEIGHT = 44, 26
# Cycles computes directions in float32, at up to a hundred times the rounding error near the rim of a lens.
TOLERANCE = 100 * float(np.finfo(np.float32).eps)

WIDE = {"fisheye_fov": math.radians(250), "fisheye_lens": 8.0}
# What this Blender has: the central cylinder came after 4.2.
KNOWN = bpy.types.Camera.bl_rna.properties["panorama_type"].enum_items.keys()
KINDS: dict[str, dict[str, Any]] = {
    "EQUIRECTANGULAR": {},
    "EQUIANGULAR_CUBEMAP_FACE": {},
    "MIRRORBALL": {},
    "FISHEYE_EQUIDISTANT": {"fisheye_fov": math.radians(200)},
    "FISHEYE_EQUISOLID": WIDE,
    "FISHEYE_LENS_POLYNOMIAL": {
        "fisheye_fov": math.radians(170), "fisheye_polynomial_k1": -0.06, "fisheye_polynomial_k3": 2e-5,
    },
    "CENTRAL_CYLINDRICAL": {},
}  # fmt: skip
KINDS = {kind: settings for kind, settings in KINDS.items() if kind in KNOWN}
NARROW = {"longitude_min": -1.0, "longitude_max": 2.0, "latitude_min": -0.3, "latitude_max": 1.4}
CYLINDER = {"central_cylindrical_range_u_min": -1.0, "central_cylindrical_range_v_max": 3.0}
CYLINDER |= {"central_cylindrical_radius": 1.7}
CASES = [
    *((kind, settings, {}) for kind, settings in KINDS.items()),
    ("EQUIRECTANGULAR", NARROW, {}),
    ("EQUIRECTANGULAR", {"shift_x": 0.1, "shift_y": -0.2}, {}),
    ("CENTRAL_CYLINDRICAL", CYLINDER, {}),
    ("FISHEYE_EQUISOLID", {**WIDE, "sensor_fit": "VERTICAL", "shift_x": 0.1}, {}),
    ("FISHEYE_EQUISOLID", {**WIDE, "sensor_fit": "HORIZONTAL"}, {"pixel_aspect_x": 2.0}),
    ("FISHEYE_EQUIDISTANT", {}, {"pixel_aspect_y": 2.0}),
]  # fmt: skip
CASES = [case for case in CASES if case[0] in KNOWN]


@pytest.fixture
def room(empty_scene: Any) -> Any:
    """A box of 6 x 8 x 10 m around a turned camera that stands off its middle."""
    mesh = bpy.data.meshes.new("Room")
    corners = [(3 * x, 4 * y, 5 * z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    mesh.from_pydata(corners, [], [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    shown = bpy.data.objects.new("Room", mesh)
    empty_scene.collection.objects.link(shown)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.location = "PANO", (0.3, -0.4, 0.7)
    camera.rotation_euler = (1.2, 0.1, 0.5)
    empty_scene.collection.objects.link(camera)
    empty_scene.camera = camera
    return empty_scene


def set_up(room: Any, kind: str, lens: dict[str, Any], render: dict[str, Any]) -> None:
    """Give the camera a projection."""
    room.camera.data.panorama_type = kind
    for owner, values in ((room.camera.data, lens), (room.render, render)):
        for name, value in values.items():
            setattr(owner, name, value)


def shine(room: Any, node: str, output: str) -> None:
    """Let the room shine in the coordinates that a node gives, moved to where they are positive."""
    tree = give_nodes(room.objects["Room"], "Coordinates")
    emission, coordinates = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new(node)
    shifted = tree.nodes.new("ShaderNodeVectorMath")
    shifted.inputs[1].default_value = (20.0, 20.0, 20.0)
    surface = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL").inputs["Surface"]
    tree.links.new(coordinates.outputs[output], shifted.inputs[0])
    tree.links.new(shifted.outputs[0], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], surface)


def assert_as_cycles(room: Any, least_shown: float) -> None:
    """Render through the same points of the picture with both engines."""
    cycles = render_cycles(WIDTH, HEIGHT)
    ours, warnings = render_centres(WIDTH, HEIGHT)
    assert not warnings
    shown = cycles.any(axis=2)
    assert shown.mean() > least_shown
    np.testing.assert_allclose(ours[shown], cycles[shown], rtol=TOLERANCE)


@pytest.mark.parametrize(("kind", "lens", "render"), CASES)
def test_panorama_sees_the_points_that_cycles_sees(
    room: Any, kind: str, lens: dict[str, Any], render: dict[str, Any]
) -> None:
    set_up(room, kind, lens, render)
    shine(room, "ShaderNodeNewGeometry", "Position")
    assert_as_cycles(room, 0.2)


@pytest.mark.parametrize("output", ["Camera", "Window", "View Distance", "View Z Depth", "View Vector"])
@pytest.mark.parametrize("kind", list(KINDS))
def test_coordinates_of_camera_and_window_are_those_of_cycles(room: Any, kind: str, output: str) -> None:
    set_up(room, kind, KINDS[kind], {})
    shine(room, "ShaderNodeCameraData" if output.startswith("View") else "ShaderNodeTexCoord", output)
    assert_as_cycles(room, 0.2)


@pytest.mark.parametrize("kind", ["MIRRORBALL", "FISHEYE_EQUIDISTANT", "FISHEYE_EQUISOLID", "FISHEYE_LENS_POLYNOMIAL"])
def test_outside_of_the_lens_the_picture_is_that_of_cycles(room: Any, kind: str) -> None:
    set_up(room, kind, KINDS[kind] | {"fisheye_fov": math.radians(100), "fisheye_lens": 3.0}, {})
    request = Request(WIDTH, HEIGHT, 1, 0, through_centre=True, passes=("Combined", "Depth", "Object Index"))
    ours, cycles = (side.passes for side in render_both(room, room.view_layers[0], request))
    row, column = np.mgrid[0:HEIGHT, 0:WIDTH]
    middle = np.hypot((column + 0.5) / WIDTH - 0.5, (row + 0.5) / HEIGHT - 0.5)
    outside = (cycles["Depth"][0, ..., 0] > 1e9) & (ours["Depth"][0, ..., 0] > 1e9)  # black, far away and opaque
    assert outside[middle > 0.6].all()
    inner = outside & np.roll(outside, 1, axis=0) & np.roll(outside, -1, axis=0)  # ours is sampled all over the pixel
    inner &= np.roll(outside, 1, axis=1) & np.roll(outside, -1, axis=1)
    for name, picture in ours.items():
        np.testing.assert_array_equal(picture[0][inner], cycles[name][0][inner], err_msg=name)


def render_eyes(room: Any, engine: str, folder: Path) -> dict[str, np.ndarray]:
    """Render both eyes through the middle of the pixels, or next to it; return the pictures by suffix."""
    room.render.engine, room.render.filepath = engine, str(folder / engine)
    bpy.ops.render.render(write_still=True, scene=room.name)
    return {eye: read_image(folder / f"{engine}{eye}.exr")[..., :3] for eye in ("_L", "_R")}


EYES: dict[str, dict[str, Any]] = {
    "converging": {"convergence_mode": "OFFAXIS", "convergence_distance": 2.0},
    "parallel": {"convergence_mode": "PARALLEL"},
    "merging": {"convergence_mode": "PARALLEL", "use_pole_merge": True, "pole_merge_angle_from": 0.3},
}


@pytest.mark.parametrize("name", EYES)
def test_eyes_that_turn_see_the_points_that_cycles_sees(room: Any, tmp_path: Path, name: str) -> None:
    set_up(room, "EQUIRECTANGULAR", {}, {"resolution_x": WIDTH, "resolution_y": HEIGHT, "use_multiview": True})
    shine(room, "ShaderNodeNewGeometry", "Position")
    stereo = room.camera.data.stereo
    stereo.use_spherical_stereo, stereo.interocular_distance = True, 0.8
    for setting, value in EYES[name].items():
        setattr(stereo, setting, value)
    image = room.render.image_settings
    image.file_format, image.color_depth, image.views_format = "OPEN_EXR", "32", "INDIVIDUAL"
    room.cycles.samples, room.cycles.filter_width, room.cycles.use_denoising = 1, 0.01, False
    room.reference_raytracer.samples, room.reference_raytracer.filter_width = 1, 0.01
    ours, cycles = (render_eyes(room, engine, tmp_path) for engine in (ENGINE, "CYCLES"))
    last = last_render(room)
    assert last is not None
    assert not last.warnings
    # Cycles' samples lie up to 0.005 pixels, 0.7 mrad, off the middle; on walls 7 m away, of 13 to 25, a thousandth.
    for eye, picture in ours.items():
        np.testing.assert_allclose(picture, cycles[eye], rtol=1e-3)
    assert np.abs(ours["_L"] - ours["_R"]).max() > 0.1
