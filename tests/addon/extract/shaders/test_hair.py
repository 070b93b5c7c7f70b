"""Hair shaders to closures: what each parametrization of Principled Hair, and the Hair BSDF, become."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from raytracer.bsdfs.hair import absorb_by_color, absorb_by_melanin
from raytracer.scene.programs import Register
from tests.addon.extract.shaders.shader_trees import extract_closure, extract_material, texts

pytestmark = pytest.mark.blender


def add_hair(tree: Any, kind: str = "ShaderNodeBsdfHairPrincipled", **settings: Any) -> Any:
    """Add a shader and link it; settings : properties in lower case, then inputs by name."""
    node = tree.nodes.new(kind)
    for name, value in settings.items():
        if name.islower():
            setattr(node, name, value)
        else:
            node.inputs[name.replace("_", " ")].default_value = value
    tree.links.new(node.outputs[0], tree.nodes[0].inputs[0])
    return node


def test_color_is_absorption_by_the_roughness_around_the_strand(tree: Any) -> None:
    add_hair(tree, Color=(0.25, 0.5, 1, 1), Radial_Roughness=0.4, Roughness=0.2, Coat=0.5, IOR=1.4, Offset=0.1)
    closure = extract_closure()
    assert_allclose(closure.absorption, absorb_by_color(np.array([0.25, 0.5, 1]), np.float32(0.4)), rtol=1e-6)
    assert_allclose([closure.roughness, closure.radial_roughness, closure.coat_weight], [0.2, 0.4, 0.5], rtol=1e-6)
    assert_allclose([closure.ior, closure.tilt], [1.4, 0.1], rtol=1e-6)
    steps = extract_material().program.steps
    assert {steps[each.step].operation for each in (closure.tangent, closure.across)} == {
        "STRAND Along",
        "STRAND Across",
    }
    assert not texts()


def test_absorption_may_be_given(tree: Any) -> None:
    add_hair(tree, parametrization="ABSORPTION", Absorption_Coefficient=(0.5, 1, 2))
    assert_allclose(extract_closure().absorption, (0.5, 1, 2))


def test_melanin_and_tint_absorb_together(tree: Any) -> None:
    add_hair(tree, parametrization="MELANIN", Melanin=0.5, Melanin_Redness=0.25, Tint=(0.5, 1, 1, 1))
    expected = absorb_by_melanin(0.5, 0.25) + absorb_by_color(np.array([0.5, 1, 1]), np.float32(0.3))
    assert_allclose(extract_closure().absorption, expected, rtol=1e-6)


def test_roughness_varies_by_the_strands_number(tree: Any) -> None:
    add_hair(tree, Random_Roughness=0.5)
    closure = extract_closure()
    assert isinstance(closure.roughness, Register)
    assert "STRAND Random" in {step.operation for step in extract_material().program.steps}


def test_hair_follows_strands_or_its_own_tangent(tree: Any) -> None:
    node = add_hair(tree, "ShaderNodeBsdfHair", component="Transmission", RoughnessU=0.3, RoughnessV=0.4, Offset=0.2)
    closure = extract_closure()
    assert closure.kind == "hair_transmission"
    assert_allclose([closure.roughness, closure.radial_roughness], [0.3, 0.4], rtol=1e-6)
    assert isinstance(closure.tilt, Register), "on surfaces it has none"
    tree.links.new(tree.nodes.new("ShaderNodeTangent").outputs[0], node.inputs["Tangent"])
    assert extract_closure().tilt == pytest.approx(0.2)


def test_huang_is_read_with_its_lobes_and_is_as_rough_around(tree: Any) -> None:
    gains = {"Reflection": 0.5, "Transmission": 2.0, "Secondary_Reflection": 0.0}
    add_hair(tree, model="HUANG", Roughness=0.4, Aspect_Ratio=1.0, Color=(0.5, 0.2, 0.1, 1.0), **gains)
    closure = extract_closure()
    assert closure.kind == "hair_huang"
    assert_allclose(closure.gains, [0.5, 2.0, 0.0])
    assert closure.roughness == pytest.approx(0.4)
    assert (closure.aspect, closure.axis, closure.alpha) == (1.0, None, 1.0), "round strands have no axis"
    assert_allclose(closure.absorption, absorb_by_color(np.array([0.5, 0.2, 0.1]), np.float32(0.4)), rtol=1e-6)
    assert not texts()


def test_elliptic_strands_have_an_axis_and_end_before_their_width(tree: Any) -> None:
    node = add_hair(tree, model="HUANG", Aspect_Ratio=0.5)
    closure = extract_closure()
    assert closure.aspect == 0.5
    assert [isinstance(value, Register) for value in (closure.axis, closure.alpha)] == [True, True]
    tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"], node.inputs["Reflection"])
    assert isinstance(extract_closure().gains, Register)
