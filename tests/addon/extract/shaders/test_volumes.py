"""Shaders of volumes: what each node says of a medium, and what programs find in space."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from addon import versions
from addon.extract.shaders.images import ImageTable
from addon.extract.shaders.materials import extract_material as read_material
from addon.extract.warnings import WarningList
from raytracer import Register, Volume, VolumeClosure
from tests.addon.against_cycles.node_fixtures import add_node
from tests.addon.extract.shaders.shader_trees import clear_nodes, extract, texts

pytestmark = pytest.mark.blender


def fill(tree: Any, kind: str, values: dict[str, Any] | None = None, **properties: Any) -> Any:
    """Add a node and let it fill the tree's volume."""
    node = add_node(tree, kind, values or {}, **properties)
    tree.links.new(node.outputs[0], tree.nodes[0].inputs["Volume"])
    return node


def extract_volume() -> Volume:
    (material,) = extract().scene.materials
    assert material.volume is not None
    return material.volume


def extract_part() -> VolumeClosure:
    (closure,) = extract_volume().closures
    return closure


def test_scatter(tree: Any) -> None:
    fill(tree, "ShaderNodeVolumeScatter", {"Color": (0.25, 0.5, 1, 1), "Density": 3.0, "Anisotropy": 0.5})
    closure = extract_part()
    assert (closure.kind, closure.density, closure.anisotropy) == ("scatter", 3.0, 0.5)
    assert closure.phase == "henyey_greenstein"
    assert_array_equal(closure.color, (0.25, 0.5, 1))
    assert extract_volume().program is None
    assert not texts()


PHASES = {
    "FOURNIER_FORAND": {"IOR": 1.5, "Backscatter": 0.25},
    "DRAINE": {"Anisotropy": -0.25, "Alpha": 0.125},
    "RAYLEIGH": {},
    "MIE": {"Diameter": 5.0},
}


@pytest.mark.skipif(versions.VERSION < (4, 3), reason="Blender 4.2 has one phase function")
@pytest.mark.parametrize("phase", PHASES)
def test_phases(tree: Any, phase: str) -> None:
    fill(tree, "ShaderNodeVolumeScatter", phase=phase)
    node = tree.nodes[-1]
    for name, value in PHASES[phase].items():
        node.inputs[name].default_value = value
    closure = extract_part()
    assert closure.phase == phase.lower()
    assert {name: getattr(closure, name.lower()) for name in PHASES[phase]} == PHASES[phase]


def test_absorption_and_emission_add_up_with_their_weights(tree: Any) -> None:
    absorption = add_node(tree, "ShaderNodeVolumeAbsorption", {"Color": (1, 0.5, 0.25, 1), "Density": 2.0})
    emission = add_node(tree, "ShaderNodeEmission", {"Color": (1, 0.5, 0.25, 1), "Strength": 4.0})
    mix = fill(tree, "ShaderNodeMixShader", {"Fac": 0.25})
    tree.links.new(absorption.outputs[0], mix.inputs[1])
    tree.links.new(emission.outputs[0], mix.inputs[2])
    parts = {closure.kind: closure for closure in extract_volume().closures}
    assert (parts["absorption"].weight, parts["absorption"].density) == (0.75, 2.0)
    assert parts["emission"].weight == 0.25
    assert_array_equal(parts["emission"].emission, (4, 2, 1))


def test_rays_tell_volumes_nothing_which_is_named(tree: Any) -> None:
    path = tree.nodes.new("ShaderNodeLightPath")
    volume = fill(tree, "ShaderNodeVolumeScatter", {})
    tree.links.new(path.outputs["Is Camera Ray"], volume.inputs["Density"])
    assert extract_part().density == 0.0
    (warning,) = extract().warnings
    assert "Light Path" in warning.text
    assert (warning.object, warning.material) == ("Object", "Material")


@pytest.mark.skipif(versions.VERSION < (5, 0), reason="the node is of Blender 5.0")
def test_coefficients(tree: Any) -> None:
    values = {"Absorption Coefficients": (1, 2, 3), "Scatter Coefficients": (4, 5, 6)}
    fill(tree, "ShaderNodeVolumeCoefficients", {**values, "Emission Coefficients": (7, 8, 9), "Anisotropy": 0.5})
    closure = extract_part()
    assert (closure.kind, closure.anisotropy) == ("coefficients", 0.5)
    assert_array_equal(closure.absorption, (1, 2, 3))
    assert_array_equal(closure.scattering, (4, 5, 6))
    assert_array_equal(closure.emission, (7, 8, 9))


def test_principled(tree: Any) -> None:
    values = {
        "Color": (0.5, 0.25, 1, 1),
        "Density": 2.0,
        "Anisotropy": -0.5,
        "Absorption Color": (0.25, 1, 0, 1),
        "Emission Strength": 2.0,
        "Emission Color": (1, 0.5, 0.25, 1),
        "Blackbody Intensity": 0.5,
        "Blackbody Tint": (1, 0.5, 0.5, 1),
        "Temperature": 3000.0,
    }
    fill(tree, "ShaderNodeVolumePrincipled", values)
    closure = extract_part()
    assert (closure.kind, closure.density, closure.anisotropy) == ("principled", 2.0, -0.5)
    assert (closure.blackbody, closure.temperature) == (0.5, 3000.0)
    assert_array_equal(closure.absorption_color, (0.25, 1, 0))
    assert_array_equal(closure.emission, (2, 1, 0.5))
    assert_array_equal(closure.blackbody_tint, (1, 0.5, 0.5))
    assert extract_volume().program is None, "no grids are there, so that attributes count as 1"


def test_principled_by_grids() -> None:
    """What the attributes' grids hold multiplies density, color and temperature; no other attribute is there."""
    material = bpy.data.materials.new("Smoke")
    tree = clear_nodes(material)
    node = fill(tree, "ShaderNodeVolumePrincipled", {"Density": 3.0, "Blackbody Intensity": 1.0})
    node.inputs["Color Attribute"].default_value = "color"
    info = add_node(tree, "ShaderNodeVolumeInfo", {})
    tree.links.new(info.outputs["Flame"], node.inputs["Emission Strength"])
    record = read_material(material, "", ImageTable(), WarningList(), grids={"density", "temperature"})
    (closure,) = record.volume.closures
    read = {step.settings["name"] for step in record.volume.program.steps if step.operation == "ATTRIBUTE Fac"}
    assert read == {"density", "temperature"}
    assert isinstance(closure.density, Register)
    assert isinstance(closure.temperature, Register)
    assert_array_equal(closure.color, (0.5, 0.5, 0.5))
    assert_array_equal(closure.emission, (0, 0, 0), "there is no flame")
    assert record.only_volume


def test_a_surface_stays_around_its_volume(tree: Any) -> None:
    fill(tree, "ShaderNodeVolumeScatter")
    assert extract().scene.materials[0].only_volume
    glass = add_node(tree, "ShaderNodeBsdfGlass", {})
    tree.links.new(glass.outputs[0], tree.nodes[0].inputs["Surface"])
    (material,) = extract().scene.materials
    assert not material.only_volume
    assert [closure.kind for closure in material.closures] == ["glass"]
    assert material.volume is not None


def test_surfaces_do_nothing_in_a_volume(tree: Any) -> None:
    fill(tree, "ShaderNodeBsdfDiffuse")
    (material,) = extract().scene.materials
    assert material.volume is None
    assert not texts()


def test_generated_coordinates_are_scaled_object_space(tree: Any) -> None:
    node = fill(tree, "ShaderNodeVolumeScatter")
    place = add_node(tree, "ShaderNodeTexCoord", {})
    tree.links.new(place.outputs["Generated"], node.inputs["Color"])
    mesh = bpy.data.objects["Object"].data
    scene = extract().scene
    (closure,) = scene.materials[0].volume.closures
    assert isinstance(closure.color, Register)
    properties = scene.instances.properties
    scale, offset = (properties[f"SPACE {name}"][0, :3] for name in ("Scale", "Offset"))
    corners = np.array([vertex.co for vertex in mesh.vertices])
    low, high = corners.min(axis=0), corners.max(axis=0)
    flat = high == low
    assert_array_equal(np.where(flat, 0.5, low * scale + offset), np.where(flat, 0.5, 0.0))
    assert_array_equal(np.where(flat, 0.5, high * scale + offset), np.where(flat, 0.5, 1.0))


def test_what_only_surfaces_have_is_constant(tree: Any) -> None:
    """Uv coordinates, attributes of vertices, wires and bent normals tell nothing inside of an object."""
    node = fill(tree, "ShaderNodeVolumeScatter")
    place = add_node(tree, "ShaderNodeTexCoord", {})
    wire = add_node(tree, "ShaderNodeWireframe", {})
    tree.links.new(place.outputs["UV"], node.inputs["Color"])
    tree.links.new(wire.outputs[0], node.inputs["Density"])
    closure = extract_part()
    assert_array_equal(closure.color, (0, 0, 0))
    assert closure.density == 0.0


def test_a_world_is_filled(scene_with_camera: Any) -> None:
    world = bpy.data.worlds.new("World")
    scene_with_camera.world = world
    tree = clear_nodes(world, "ShaderNodeOutputWorld")
    node = fill(tree, "ShaderNodeVolumeScatter", {"Density": 0.25})
    record = extract().scene.world
    assert record.volume.closures[0].density == 0.25
    place = add_node(tree, "ShaderNodeTexCoord", {})
    for output in ("Generated", "Object"):
        tree.links.new(place.outputs[output], node.inputs["Color"])
        volume = extract().scene.world.volume
        assert [step.operation for step in volume.program.steps] == ["NEW_GEOMETRY Position"]
    assert not texts()
