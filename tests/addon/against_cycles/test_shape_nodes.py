"""Nodes that read the shape that is hit, particles, and what needs data of its own: Wireframe, Geometry's Tangent and
Pointiness, Point Info, Particle Info, Wavelength and IES Texture, against Cycles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bmesh
import bpy
import numpy as np
import pytest

from tests.addon.against_cycles.node_fixtures import (
    CELL,
    LOWEST,
    add_node,
    make_material,
    render_centres,
    render_cycles,
)
from tests.addon.against_cycles.node_sources import (
    CENTRED,
    PACKED_NORMALS,
    STEEP,
    X,
    assert_agreement,
    make,
    stretch,
)
from tests.addon.against_cycles.test_instances import COLUMNS, WAYS, shown
from tests.addon.against_cycles.test_light_nodes import set_nodes
from tests.addon.against_cycles.test_pictures import LAMPS, add_lamp, assert_pictures_agree, make_stage
from tests.addon.against_cycles.test_points import OUTPUTS, add_camera, add_cloud, agree

__all__ = ["shown"]  # a fixture
pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

# Points on an outline may be on another part for Cycles, which casts in float32.
OUTLINE_SHARE = 0.005
# Cycles holds values, and the color v - LOWEST that shines, in float32.
TOLERANCE = 16 * 4 * float(np.finfo(np.float32).eps)

# Blender's matrix from XYZ is that of its color configuration, rounded otherwise than the standard's.
WORKING_SPACE = 2e-4


def make_ies(kind: int = 1, horizontal: tuple[float, ...] = (0, 90, 180), vertical: tuple[float, ...] = ()) -> str:
    """Return the text of an IES file whose intensities have no symmetry but that which its angles ask for."""
    vertical = vertical or tuple(np.linspace(0.0, 180.0, 7))
    values = 500.0 + 300.0 * np.sin(1.3 * np.arange(len(horizontal) * len(vertical)) ** 1.1)
    sizes = f"1 1000 2.0 {len(vertical)} {len(horizontal)} {kind} 2 0 0 0"
    lines = (sizes, "1.0 0.9 50", *(" ".join(map(str, row)) for row in (vertical, horizontal, values)))
    return "\n".join(("IESNA:LM-63-2002", "[TEST] none", "TILT=NONE", *lines, ""))


LUMINAIRES = {
    "half": make_ies(),
    "quarter": make_ies(horizontal=(0, 45, 90)),
    "whole": make_ies(horizontal=(0, 70, 200, 360)),
    "without the last": make_ies(horizontal=(0, 90, 180, 270)),
    "turned": make_ies(horizontal=(90, 180, 270)),
    "round": make_ies(horizontal=(0,), vertical=(0, 20, 50, 90)),
    "upwards": make_ies(vertical=(90, 120, 180)),
    "type A": make_ies(3, (-90, -30, 20, 90), (-90, -20, 40, 90)),
    "type A half": make_ies(3, (0, 30, 90), (-60, -20, 40, 80)),
    "type B": make_ies(2, (-90, -30, 20, 90), (-90, -20, 40, 90)),
    "type B half": make_ies(2, (0, 30, 90), (0, 40, 90)),
    "commas": make_ies().replace(" ", ","),
    "tilted": make_ies().replace("TILT=NONE", "TILT=INCLUDE\n1\n3\n0 45 90\n1 .9 .8"),
}


def read_luminaire(text: str, strength: float = 0.02) -> Callable[[Any], Any]:
    def build(tree: Any) -> Any:
        data = bpy.data.texts.new("Luminaire")
        data.write(text)
        inputs = {"Vector": CENTRED(tree), "Strength": strength}
        return add_node(tree, "ShaderNodeTexIES", inputs, mode="INTERNAL", ies=data).outputs[0]

    return build


def test_luminaires_agree(empty_scene: Any, record_property: Any) -> None:
    """Of all three types, whole and mirrored; the directions fill the sphere."""
    configurations = {name: read_luminaire(text) for name, text in LUMINAIRES.items()}
    assert_agreement(configurations, STEEP, record_property)


def test_a_light_with_a_luminaire_agrees() -> None:
    scene = make_stage()
    text = bpy.data.texts.new("Luminaire")
    text.write(make_ies(vertical=(0, 20, 50, 90)))

    def build(tree: Any) -> Any:
        return add_node(tree, "ShaderNodeTexIES", {"Strength": 0.05}, mode="INTERNAL", ies=text).outputs[0]

    set_nodes(add_lamp(*LAMPS["point"]).data, build, "Strength")
    assert_pictures_agree(scene, samples=16)


def test_wavelengths_agree(empty_scene: Any, record_property: Any) -> None:
    """Beyond what the eye sees on both sides as well."""
    configurations = {
        f"from {start}": make("ShaderNodeWavelength", inputs={"Wavelength": stretch(X, (60.0,) * 3, (start,) * 3)})
        for start in (330.0, 440.0, 550.0, 660.0, 770.0)
    }
    assert_agreement(configurations, WORKING_SPACE, record_property)


def test_wires_agree(empty_scene: Any, record_property: Any) -> None:
    """Metres and pixels; a pixel's centre on the border of a wire may fall on either side."""
    configurations = {
        f"{size} {'pixels' if pixels else 'metres'}": make(
            "ShaderNodeWireframe", inputs={"Size": size}, use_pixel_size=pixels
        )
        for size, pixels in ((0.05, False), (0.1, False), (0.0, False), (1.5, True), (2.7, True))
    }
    assert_agreement(configurations, STEEP, record_property, share=0.99)


def test_the_tangent_of_the_geometry_agrees(empty_scene: Any, record_property: Any) -> None:
    assert_agreement({"tangent": make("ShaderNodeNewGeometry", "Tangent")}, PACKED_NORMALS, record_property)


def add_bumpy_shape(scene: Any, modifier: str) -> None:
    """Add shapes with pits and peaks, whose parts meet at doubled vertices."""
    mesh, shape = bpy.data.meshes.new("Shape"), bmesh.new()
    bmesh.ops.create_icosphere(shape, subdivisions=2, radius=1.5)
    bmesh.ops.create_grid(shape, x_segments=3, y_segments=3, size=2.0)
    random = np.random.default_rng(3)
    for vertex in shape.verts:
        vertex.co += 0.2 * vertex.normal * random.normal()
    bmesh.ops.split_edges(shape, edges=shape.edges[:40])
    shape.to_mesh(mesh)
    shape.free()
    mesh.materials.append(make_material("Points", make("ShaderNodeNewGeometry", "Pointiness")))
    shown = bpy.data.objects.new("Shape", mesh)
    shown.scale = (1.0, 0.8, 1.2)
    if modifier:
        shown.modifiers.new("Modifier", modifier).levels = 2  # as it renders
    scene.collection.objects.link(shown)


@pytest.mark.parametrize("modifier", ["", "SUBSURF"])
def test_pointiness_is_that_of_cycles(empty_scene: Any, modifier: str) -> None:
    add_bumpy_shape(empty_scene, modifier)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", 4.2, (0.0, 0.0, 10.0)
    empty_scene.collection.objects.link(camera)
    empty_scene.camera = camera
    ours, warnings = render_centres(64, 64)
    assert not warnings
    assert np.ptp(ours[ours > 0]) > 0.05
    differs = np.abs(ours - render_cycles(64, 64)).max(axis=2) > STEEP
    assert differs.mean() <= OUTLINE_SHARE


@pytest.mark.parametrize("output", ["Position", "Radius", "Random"])
def test_point_info_is_that_of_cycles(empty_scene: Any, output: str) -> None:
    for row in range(len(OUTPUTS)):
        add_cloud(empty_scene, row, "FLOAT", make("ShaderNodePointInfo", output))
    add_camera(empty_scene)
    assert np.ptp(agree()) > 0.1 or output == "Radius"


@pytest.mark.parametrize(
    "output", ["Index", "Random", "Age", "Lifetime", "Size", "Location", "Velocity", "Angular Velocity"]
)
def test_particle_info_is_that_of_cycles(empty_scene: Any, shown: Any, output: str) -> None:
    """Of instances that stand for particles, and of what is none; scaled to stay in the range of what is shown."""
    reader = stretch(make("ShaderNodeParticleInfo", output), (0.01,) * 3, (0.5,) * 3)
    shown.material_slots[0].material = make_material("Particle", reader)
    WAYS["particles"](empty_scene, shown)
    settings = bpy.data.particles[0]
    settings.physics_type, settings.normal_factor, settings.use_rotations = "NEWTON", 2.0, True
    settings.angular_velocity_mode, settings.angular_velocity_factor = "GLOBAL_Z", 0.01
    empty_scene.frame_set(1)
    empty_scene.frame_set(3)
    size = COLUMNS * CELL
    ours, warnings = render_centres(size, size)
    assert not warnings
    middle = np.s_[CELL // 2 :: CELL, CELL // 2 :: CELL]
    np.testing.assert_allclose(ours[middle], render_cycles(size, size)[middle], atol=TOLERANCE)
    assert len(np.unique(ours[middle].round(6))) > 1 or output in ("Lifetime", "Size", "Age")
    assert (ours[middle] > 0.1 + LOWEST).all()
