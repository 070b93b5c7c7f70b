"""Shader nodes to closures: layers, facets, diffuse shapes and metals, and what is clamped or named."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from addon import versions
from raytracer.scene.programs import Register
from tests.addon.extract.shaders.shader_trees import add, extract_closure, extract_material, texts

pytestmark = pytest.mark.blender


def test_unsupported_inputs_are_named_only_where_used(tree: Any) -> None:
    node = add(tree, "ShaderNodeBsdfPrincipled", Subsurface_Weight=0.5)
    if "Thin Wall" not in node.inputs:
        pytest.skip("Blender 5.2 brings an input that is not supported")
    assert not texts()
    node.inputs["Thin Wall"].default_value = True
    (text,) = texts()
    assert "Thin Wall not supported, left out" in text


def test_thin_films_are_read_where_they_have_a_thickness(tree: Any) -> None:
    node = add(tree, "ShaderNodeBsdfPrincipled", Thin_Film_Thickness=0.0, Thin_Film_IOR=1.5)
    assert extract_closure().film_thickness == 0.0
    node.inputs["Thin Film Thickness"].default_value = 300.0
    closure = extract_closure()
    assert (closure.film_thickness, closure.film_ior) == (300.0, 1.5)
    assert closure.bare_metal == float(not versions.lays_films_on_metals())
    assert not texts()


RADIUS = {"Subsurface_Radius": (1.0, 0.5, 0.25), "Subsurface_Scale": 0.5}


def test_subsurface_of_principled(tree: Any) -> None:
    node = add(tree, "ShaderNodeBsdfPrincipled", Subsurface_Weight=0.75, Subsurface_Anisotropy=0.5, **RADIUS)
    closure = extract_closure()
    assert (closure.subsurface, closure.subsurface_anisotropy, closure.skin) == (0.75, 0.5, 0.0)
    assert closure.similar == versions.inverts_by_similarity()
    assert_array_equal(closure.radius, (0.5, 0.25, 0.125))
    node.subsurface_method = "RANDOM_WALK_SKIN"
    node.inputs["Subsurface IOR"].default_value = 1.25
    closure = extract_closure()
    assert (closure.skin, closure.subsurface_ior, closure.similar) == (1.0, 1.25, 0.0)
    assert not texts()


def test_subsurface_that_is_off_is_not_read(tree: Any) -> None:
    add(tree, "ShaderNodeBsdfPrincipled", Subsurface_Weight=0.0, **RADIUS)
    assert extract_closure().subsurface == 0.0
    assert_array_equal(extract_closure().radius, (1.0, 1.0, 1.0))


def test_subsurface_scattering(tree: Any) -> None:
    values = {"Color": (0.25, 0.5, 1, 1), "Scale": 2.0, "Radius": (1.0, 0.5, 0.25), "IOR": 1.25, "Roughness": 0.5}
    node = add(tree, "ShaderNodeSubsurfaceScattering", **values)
    closure = extract_closure()
    assert (closure.kind, closure.subsurface_ior, closure.roughness) == ("subsurface", 1.25, 0.5)
    assert_array_equal(closure.color, (0.25, 0.5, 1))
    assert_array_equal(closure.radius, (2.0, 1.0, 0.5))
    assert not texts()
    node.falloff = "BURLEY"
    assert extract_closure().kind == "subsurface"
    assert ["Christensen-Burley is not supported, Random Walk is used" in text for text in texts()] == [True]


@pytest.mark.parametrize("version", [(5, 1, 2), (5, 2, 0)])
@pytest.mark.parametrize("method", ["RANDOM_WALK", "RANDOM_WALK_SKIN"])
def test_ranges_of_anisotropy_below_surfaces(
    tree: Any, monkeypatch: pytest.MonkeyPatch, version: tuple[int, ...], method: str
) -> None:
    is_new = version >= (5, 2)
    monkeypatch.setattr(versions, "inverts_by_similarity", lambda: is_new)
    node = add(tree, "ShaderNodeSubsurfaceScattering")
    node.falloff = method
    found = []
    for value in (-1.0, 1.0):
        node.inputs["Anisotropy"].default_value = value
        found.append(extract_closure().subsurface_anisotropy)
    assert found == [-0.99 if is_new else 0.0, 0.99 if is_new and method == "RANDOM_WALK" else 0.9]


def test_a_texture_computes_what_is_below_a_surface(tree: Any) -> None:
    node = add(tree, "ShaderNodeSubsurfaceScattering")
    noise = tree.nodes.new("ShaderNodeTexNoise")
    for name in ("Scale", "Radius", "Anisotropy"):
        tree.links.new(noise.outputs[0], node.inputs[name])
    closure = extract_closure()
    assert isinstance(closure.radius, Register)
    assert isinstance(closure.subsurface_anisotropy, Register)


def test_principled_layers(tree: Any) -> None:
    values = {"Coat_Weight": 0.5, "Coat_Roughness": 0.25, "Coat_IOR": 1.75, "Coat_Tint": (0.5, 0.25, 1, 1)}
    values |= {"Sheen_Weight": 0.75, "Sheen_Roughness": 0.125, "Sheen_Tint": (0.25, 0.5, 1, 1)}
    add(tree, "ShaderNodeBsdfPrincipled", **values)
    closure = extract_closure()
    assert (closure.coat_weight, closure.coat_roughness, closure.coat_ior) == (0.5, 0.25, 1.75)
    assert (closure.sheen_weight, closure.sheen_roughness) == (0.75, 0.125)
    assert_array_equal(closure.coat_tint, (0.5, 0.25, 1))
    assert_array_equal(closure.sheen_tint, (0.25, 0.5, 1))
    assert not texts()


def test_what_bends_the_base_does_not_bend_its_coat(tree: Any) -> None:
    node = add(tree, "ShaderNodeBsdfPrincipled", Coat_Weight=0.5)
    assert extract_closure().coat_normal is None
    bend = tree.nodes.new("ShaderNodeNormalMap")
    bend.inputs["Color"].default_value = (0.75, 0.5, 0.9, 1.0)
    tree.links.new(bend.outputs["Normal"], node.inputs["Normal"])
    closure = extract_closure()
    assert isinstance(closure.normal, Register)
    assert_array_equal(closure.coat_normal, np.zeros(3))


def test_layers_that_are_off_are_not_read(tree: Any) -> None:
    add(tree, "ShaderNodeBsdfPrincipled", Coat_Roughness=0.25, Sheen_Roughness=0.125, Anisotropic_Rotation=0.5)
    closure = extract_closure()
    assert (closure.coat_roughness, closure.sheen_roughness, closure.rotation) == (0.03, 0.5, 0.0)
    assert closure.tangent is None
    assert extract_material().program is None


def test_emission_under_a_coat_is_named(tree: Any) -> None:
    add(tree, "ShaderNodeBsdfPrincipled", Coat_Weight=0.5, Emission_Strength=2.0)
    assert ["do not dim its emission" in text for text in texts()] == [True]


@pytest.mark.parametrize("node", ["Principled", "Anisotropic"])
def test_anisotropy_follows_the_tangent_around_z(tree: Any, node: str) -> None:
    amount, turn = ("Anisotropic", "Anisotropic_Rotation") if node == "Principled" else ("Anisotropy", "Rotation")
    add(tree, f"ShaderNodeBsdf{node}", **{amount: 0.5, turn: 0.25})
    closure, program = extract_closure(), extract_material().program
    assert (closure.anisotropy, closure.rotation) == (0.5, 0.25)
    assert closure.tangent == Register(0, "Tangent")
    assert [step.operation for step in program.steps] == ["TANGENT RADIAL"]
    assert not texts()


@pytest.mark.parametrize(
    ("choice", "distribution", "multiscatter"),
    [("BECKMANN", "beckmann", 0.0), ("GGX", "ggx", 0.0), ("MULTI_GGX", "ggx", 1.0)],
)
def test_distributions(tree: Any, choice: str, distribution: str, multiscatter: float) -> None:
    add(tree, "ShaderNodeBsdfGlass").distribution = choice
    closure = extract_closure()
    assert (closure.distribution, closure.multiscatter) == (distribution, multiscatter)


def test_unknown_distribution_is_named(tree: Any) -> None:
    add(tree, "ShaderNodeBsdfAnisotropic").distribution = "ASHIKHMIN_SHIRLEY"
    assert ["distribution ASHIKHMIN_SHIRLEY is not supported, GGX is used" in text for text in texts()] == [True]


@pytest.mark.parametrize(
    ("node", "properties", "kind", "inputs"),
    [
        ("Translucent", {}, "translucent", {}),
        ("Sheen", {"distribution": "MICROFIBER"}, "sheen", {"Roughness": 0.25}),
        ("Sheen", {"distribution": "ASHIKHMIN"}, "velvet", {"Roughness": 0.25}),
        ("Toon", {"component": "DIFFUSE"}, "toon", {"Size": 0.25, "Smooth": 0.5}),
        ("Toon", {"component": "GLOSSY"}, "glossy_toon", {"Size": 0.25, "Smooth": 0.5}),
    ],
)
def test_kinds_of_diffuse_shaders(
    tree: Any, node: str, properties: dict[str, str], kind: str, inputs: dict[str, float]
) -> None:
    made = add(tree, f"ShaderNodeBsdf{node}", Color=(0.5, 0.25, 0.125, 1), **inputs)
    for name, value in properties.items():
        setattr(made, name, value)
    closure = extract_closure()
    assert closure.kind == kind
    assert_array_equal(closure.color, (0.5, 0.25, 0.125))
    assert {name: getattr(closure, name.lower()) for name in inputs} == inputs
    assert not texts()


def test_rough_diffuse_gives_lost_light_back_since_4_3(tree: Any) -> None:
    add(tree, "ShaderNodeBsdfDiffuse", Roughness=0.5)
    closure = extract_closure()
    assert (closure.diffuse_roughness, closure.multiscatter) == (0.5, float(versions.VERSION >= (4, 3)))


@pytest.mark.skipif(versions.VERSION < (4, 3), reason="there is no Metallic BSDF before Blender 4.3")
def test_metallic_shader(tree: Any) -> None:
    node = add(tree, "ShaderNodeBsdfMetallic", Base_Color=(0.5, 0.25, 0.125, 1), Edge_Tint=(0.25, 1, 0.5, 1))
    closure = extract_closure()
    assert closure.kind == "metal"
    assert_array_equal(closure.specular_tint, (0.25, 1, 0.5))
    node.fresnel_type = "PHYSICAL_CONDUCTOR"
    node.inputs["IOR"].default_value, node.inputs["Extinction"].default_value = (0.5, 0.25, 1), (2, 4, 8)
    closure = extract_closure()
    assert closure.kind == "conductor"
    assert_array_equal(closure.color, (0.5, 0.25, 1))
    assert_array_equal(closure.extinction, (2, 4, 8))
    assert not texts()


def test_values_out_of_range_are_clamped_as_in_cycles(tree: Any) -> None:
    values = {"Metallic": 3.0, "Roughness": -1.0, "IOR": 0.0, "Base_Color": (-1, float("nan"), 2, 1)}
    values |= {"Specular_IOR_Level": 3.0}
    node = add(tree, "ShaderNodeBsdfPrincipled")
    value = {}
    for name, wanted in values.items():
        source = tree.nodes.new("ShaderNodeRGB" if name == "Base_Color" else "ShaderNodeValue")
        source.outputs[0].default_value = wanted
        value[name] = source
        tree.links.new(source.outputs[0], node.inputs[name.replace("_", " ")])
    closure = extract_closure()
    assert (closure.metallic, closure.roughness) == (1.0, 0.0)
    assert closure.ior > 0
    assert closure.specular == 3.0
    assert_array_equal(closure.color, (0, 0, 2))


def test_ray_portals_keep_a_linked_position_of_zero(tree: Any) -> None:
    node = add(tree, "ShaderNodeBsdfRayPortal", Color=(0.5, 0.25, 1.0, 1.0))
    closure = extract_closure()
    assert (closure.kind, closure.position, closure.direction) == ("portal", None, None)
    assert_array_equal(closure.color, (0.5, 0.25, 1.0))
    zero = tree.nodes.new("ShaderNodeCombineXYZ")
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    tree.links.new(zero.outputs[0], node.inputs["Position"])
    tree.links.new(geometry.outputs["Normal"], node.inputs["Direction"])
    closure = extract_closure()
    assert_array_equal(closure.position, (0.0, 0.0, 0.0))
    assert isinstance(closure.direction, Register)
    assert not texts()
