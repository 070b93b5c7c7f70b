"""Shader nodes that read, compute and mix, in our engine and in Cycles of the same Blender: each configuration shines
from a small plane."""

from typing import Any

import pytest

from tests.addon.against_cycles.node_fixtures import Make, add_node
from tests.addon.against_cycles.node_sources import (
    CENTRED,
    COLOR,
    GENERATED,
    GLOWING,
    PACKED_NORMALS,
    SMOOTH,
    STEEP,
    X,
    Y,
    assert_agreement,
    attribute,
    list_items,
    make,
    part,
    stretch,
)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]


COORDINATES = {
    **{f"coordinate {name}": make("ShaderNodeTexCoord", name) for name in ("Generated", "UV", "Object", "Camera")},
    "coordinate Window": make("ShaderNodeTexCoord", "Window"),
    **{f"geometry {name}": make("ShaderNodeNewGeometry", name) for name in ("Position", "True Normal", "Incoming")},
    **{f"geometry {name}": make("ShaderNodeNewGeometry", name) for name in ("Parametric", "Backfacing")},
    **{
        f"attribute {name} {output}": attribute(name, output)
        for name in ("UVMap", "Second", "Col", "number", "face", "missing", "")
        for output in ("Color", "Vector", "Fac", "Alpha")
    },
    "color attribute": make("ShaderNodeVertexColor", "Color"),
    "color attribute by name": make("ShaderNodeVertexColor", "Alpha", layer_name="Col"),
    "color attribute that is missing": make("ShaderNodeVertexColor", "Alpha", layer_name="missing"),
    "uv map": make("ShaderNodeUVMap"),
    "uv map that is missing": make("ShaderNodeUVMap", uv_map="missing"),
    "uv map by name": make("ShaderNodeUVMap", uv_map="Second"),
    **{f"object {name}": make("ShaderNodeObjectInfo", name) for name in ("Location", "Color", "Alpha", "Random")},
    **{f"object {name}": make("ShaderNodeObjectInfo", name) for name in ("Object Index", "Material Index")},
    **{
        f"camera {name}": make("ShaderNodeCameraData", name)
        for name in ("View Vector", "View Z Depth", "View Distance")
    },
    **{
        f"path {name}": make("ShaderNodeLightPath", name)
        for name in ("Is Camera Ray", "Is Shadow Ray", "Is Diffuse Ray", "Is Glossy Ray", "Is Singular Ray")
    },
    **{
        f"path {name}": make("ShaderNodeLightPath", name)
        for name in ("Is Reflection Ray", "Is Transmission Ray", "Ray Length", "Ray Depth", "Transparent Depth")
    },
}
SHADING_NORMALS = {
    "coordinate Normal": make("ShaderNodeTexCoord", "Normal"),
    "coordinate Reflection": make("ShaderNodeTexCoord", "Reflection"),
    "geometry Normal": make("ShaderNodeNewGeometry", "Normal"),
    "fresnel": make("ShaderNodeFresnel"),
    "fresnel of a normal": make(
        "ShaderNodeFresnel", inputs={"IOR": 1.2, "Normal": make("ShaderNodeTexCoord", "Normal")}
    ),
    "fresnel below 1": make("ShaderNodeFresnel", inputs={"IOR": 0.8}),
    **{
        f"layer weight {output} {blend}": make("ShaderNodeLayerWeight", output, {"Blend": blend})
        for output in ("Fresnel", "Facing")
        for blend in (0.0, 0.3, 0.5, 0.8)
    },
    "tangent": make("ShaderNodeTangent", direction_type="UV_MAP"),
    "tangent by name": make("ShaderNodeTangent", direction_type="UV_MAP", uv_map="Second"),
    **{f"tangent around {axis}": make("ShaderNodeTangent", direction_type="RADIAL", axis=axis) for axis in "XYZ"},
    **{
        f"normal map {space} {strength}": make(
            "ShaderNodeNormalMap", inputs={"Color": COLOR, "Strength": strength}, space=space
        )
        for space in ("TANGENT", "OBJECT", "WORLD", "BLENDER_OBJECT", "BLENDER_WORLD")
        for strength in (1.0, 0.6, 1.5)
    },
    "normal map by name": make("ShaderNodeNormalMap", inputs={"Color": COLOR}, uv_map="Second"),
}


def test_what_nodes_read_agrees(empty_scene: Any, record_property: Any) -> None:
    assert_agreement(COORDINATES, SMOOTH, record_property)


def test_colors_stored_in_bytes_agree(empty_scene: Any, record_property: Any) -> None:
    """Since Blender 5.2 Cycles rounds them once more, to less than a twentieth of a step of 1/255."""
    configurations = {output: attribute("Bytes", output) for output in ("Color", "Vector", "Fac", "Alpha")}
    configurations["color attribute"] = make("ShaderNodeVertexColor", "Color", layer_name="Bytes")
    assert_agreement(configurations, 1.0 / 255.0 / 20.0, record_property)


@pytest.mark.parametrize("behind", [False, True])
def test_what_depends_on_shading_normals_agrees(empty_scene: Any, record_property: Any, behind: bool) -> None:
    assert_agreement(SHADING_NORMALS, PACKED_NORMALS, record_property, behind=behind)


def test_math_agrees(empty_scene: Any, record_property: Any) -> None:
    """All operations, over arguments of either sign; steps of floor and its kin fall beside the pixels' centres."""
    first, second = stretch(X, (1.7,) * 3, (0.037,) * 3), stretch(Y, (1.3,) * 3, (0.043,) * 3)
    operations = list_items("ShaderNodeMath", "operation")
    configurations = {
        f"{operation} {kind}": make(
            "ShaderNodeMath",
            inputs={"Value": first, "Value_001": right, "Value_002": 0.3},
            operation=operation,
            use_clamp=clamped,
        )
        for operation in operations
        for kind, right, clamped in (("of two", second, False), ("with constant", 0.7, True), ("with zero", 0.0, False))
    }
    configurations |= {f"{name} of a constant": make("ShaderNodeMath", operation=name) for name in operations}
    assert_agreement(configurations, STEEP, record_property)


def test_vector_math_agrees(empty_scene: Any, record_property: Any) -> None:
    first, second = stretch(CENTRED, (1.7, 1.1, 0.9), (0.037, 0.05, 0.02)), stretch(COLOR, (2.0,) * 3, (-0.7,) * 3)
    numbers = ("DOT_PRODUCT", "DISTANCE", "LENGTH")
    configurations = {
        f"{operation} {kind}": make(
            "ShaderNodeVectorMath",
            "Value" if operation in numbers else "Vector",
            {"Vector": first, "Vector_001": right, "Vector_002": (0.5, -0.2, 0.1), "Scale": 0.8},
            operation=operation,
        )
        for operation in list_items("ShaderNodeVectorMath", "operation")
        for kind, right in (("of two", second), ("with constant", (0.3, -0.6, 0.9)), ("with zero", (0.0, 0.0, 0.0)))
        # Versions differ on a mirror without a normal.
        if not (operation in ("REFLECT", "REFRACT") and kind == "with zero")
    }
    assert_agreement(configurations, STEEP, record_property)


MIXING = {
    **{
        f"color {blend} {factor} {clamped}": make(
            "ShaderNodeMix",
            "Result_Color",
            {"Factor_Float": factor, "A_Color": COLOR, "B_Color": stretch(CENTRED, (0.7,) * 3, (0.4,) * 3)},
            data_type="RGBA",
            blend_type=blend,
            clamp_factor=clamped,
            clamp_result=clamped,
        )
        for blend in list_items("ShaderNodeMix", "blend_type")
        for factor, clamped in ((0.7, False), (1.0, True), (0.0, False), (1.3, True))
    },
    **{
        f"old {blend}": make(
            "ShaderNodeMixRGB",
            inputs={"Fac": 0.6, "Color1": COLOR, "Color2": (0.2, 0.7, 0.4, 1.0)},
            blend_type=blend,
            use_clamp=True,
        )
        for blend in list_items("ShaderNodeMixRGB", "blend_type")
    },
    **{
        f"number {clamped}": make(
            "ShaderNodeMix",
            "Result_Float",
            {"Factor_Float": stretch(X, (1.5,) * 3, (0.5,) * 3), "A_Float": Y, "B_Float": 2.0},
            data_type="FLOAT",
            clamp_factor=clamped,
        )
        for clamped in (False, True)
    },
    **{
        f"vector {mode} {clamped}": make(
            "ShaderNodeMix",
            "Result_Vector",
            {"Factor_Float": X, "Factor_Vector": CENTRED, "A_Vector": COLOR, "B_Vector": (1.0, -1.0, 0.5)},
            data_type="VECTOR",
            factor_mode=mode,
            clamp_factor=clamped,
        )
        for mode in ("UNIFORM", "NON_UNIFORM")
        for clamped in (False, True)
    },
}


def test_mix_agrees(empty_scene: Any, record_property: Any) -> None:
    assert_agreement(MIXING, STEEP, record_property)


ADJUSTMENTS = {
    **{
        f"combine {mode}": make(
            "ShaderNodeCombineColor",
            inputs={
                "Red": stretch(X, (0.4,) * 3, (0.5,) * 3),
                "Green": stretch(Y, (0.4,) * 3, (0.5,) * 3),
                "Blue": 0.4,
            },
            mode=mode,
        )
        for mode in ("RGB", "HSV", "HSL")
    },
    **{
        f"separate {mode} {output}": make("ShaderNodeSeparateColor", output, {"Color": COLOR}, mode=mode)
        for mode in ("RGB", "HSV", "HSL")
        for output in ("Red", "Green", "Blue")
    },
    "combine xyz": make("ShaderNodeCombineXYZ", inputs={"X": X, "Y": 0.5, "Z": Y}),
    "hue": make(
        "ShaderNodeHueSaturation", inputs={"Hue": 0.7, "Saturation": 1.4, "Value": 0.8, "Fac": 0.9, "Color": COLOR}
    ),
    "hue from 0": make("ShaderNodeHueSaturation", inputs={"Hue": 0.0, "Saturation": 0.5, "Color": COLOR}),
    "brightness": make("ShaderNodeBrightContrast", inputs={"Bright": -0.2, "Contrast": 0.6, "Color": COLOR}),
    "gamma": make("ShaderNodeGamma", inputs={"Gamma": 2.2, "Color": CENTRED}),
    "gamma 0": make("ShaderNodeGamma", inputs={"Gamma": 0.0, "Color": COLOR}),
    "invert": make("ShaderNodeInvert", inputs={"Fac": 0.7, "Color": COLOR}),
    "grey": make("ShaderNodeRGBToBW", inputs={"Color": COLOR}),
    "color to number": make("ShaderNodeMath", inputs={"Value": COLOR}, operation="ADD"),
    "vector to number": make("ShaderNodeMath", inputs={"Value": CENTRED}, operation="ADD"),
    "number to color": make("ShaderNodeInvert", inputs={"Color": X}),
    "ramp of a vector": make("ShaderNodeValToRGB", inputs={"Fac": CENTRED}),
    "clamp": make("ShaderNodeClamp", inputs={"Value": X, "Min": -0.3, "Max": 0.4}),
    "clamp to a range": make("ShaderNodeClamp", inputs={"Value": X, "Min": 0.4, "Max": -0.3}, clamp_type="RANGE"),
    **{
        f"range {kind} {clamped} {low}": make(
            "ShaderNodeMapRange",
            "Result",
            {"Value": X, "From Min": low, "From Max": 0.613, "To Min": 0.2, "To Max": -0.9, "Steps": 3.0},
            interpolation_type=kind,
            clamp=clamped,
        )
        for kind in ("LINEAR", "STEPPED", "SMOOTHSTEP", "SMOOTHERSTEP")
        for clamped in (False, True)
        for low in (-0.5, 0.8, 0.613)
    },
    **{
        f"vector range {kind} {clamped}": make(
            "ShaderNodeMapRange",
            "Vector",
            {"Vector": CENTRED, "From_Min_FLOAT3": (-0.513, 0.817, 0.1), "To_Max_FLOAT3": (0.5, 1.5, -1.0)},
            data_type="FLOAT_VECTOR",
            interpolation_type=kind,
            clamp=clamped,
        )
        for kind in ("LINEAR", "STEPPED", "SMOOTHSTEP", "SMOOTHERSTEP")
        for clamped in (False, True)
    },
    **{
        f"mapping {kind}": make(
            "ShaderNodeMapping",
            inputs={
                "Vector": CENTRED,
                "Location": (0.2, -0.3, 0.4),
                "Rotation": (0.3, 0.5, -0.7),
                "Scale": (1.5, 0.7, 2),
            },
            vector_type=kind,
        )
        for kind in list_items("ShaderNodeMapping", "vector_type")
    },
    **{
        f"rotate {kind} {inverted}": make(
            "ShaderNodeVectorRotate",
            inputs={"Vector": CENTRED, "Center": (0.1, 0.2, 0.3), **inputs},
            rotation_type=kind,
            invert=inverted,
        )
        for kind, inputs in (
            ("AXIS_ANGLE", {"Axis": (0.3, -0.5, 0.7), "Angle": 0.8}),
            ("X_AXIS", {"Angle": 0.8}),
            ("Y_AXIS", {"Angle": 0.8}),
            ("Z_AXIS", {"Angle": 0.8}),
            ("EULER_XYZ", {"Rotation": (0.4, -0.6, 0.9)}),
        )
        for inverted in (False, True)
    },
    **{
        f"transform {kind} {start} {end}": make(
            "ShaderNodeVectorTransform",
            inputs={"Vector": COLOR},
            vector_type=kind,
            convert_from=start,
            convert_to=end,
        )
        for kind in ("POINT", "VECTOR", "NORMAL")
        for start in ("WORLD", "OBJECT", "CAMERA")
        for end in ("WORLD", "OBJECT", "CAMERA")
    },
    "normal": make("ShaderNodeNormal", "Normal"),
    "dot with a normal": make("ShaderNodeNormal", "Dot", {"Normal": CENTRED}),
}


def test_glowing_bodies_agree(empty_scene: Any, record_property: Any) -> None:
    """Cycles' colors come from a fit of Planck's; below its coldest and above its hottest both stay as they are."""
    bodies = {
        f"{low} to {low + reach} K": make(
            "ShaderNodeBlackbody",
            inputs={"Temperature": part(stretch(GENERATED, (reach, 0, 0), (low, 0, 0)), "X")},
        )
        for low, reach in ((500, 1500), (2000, 4000), (6000, 7000))
    }
    assert_agreement(bodies, GLOWING, record_property)


def test_adjustments_agree(empty_scene: Any, record_property: Any) -> None:
    assert_agreement(ADJUSTMENTS, STEEP, record_property)


def with_ramp(interpolation: str, mode: str = "RGB", hues: str = "NEAR") -> Make:
    def build(tree: Any) -> Any:
        node = add_node(tree, "ShaderNodeValToRGB", {"Fac": part(GENERATED, "X")(tree)})
        ramp = node.color_ramp
        ramp.color_mode, ramp.interpolation, ramp.hue_interpolation = mode, interpolation, hues
        ramp.elements[0].color, ramp.elements[0].position = (0.9, 0.2, 0.1, 1.0), 0.1
        ramp.elements[1].color, ramp.elements[1].position = (0.1, 0.3, 0.8, 0.5), 0.8
        ramp.elements.new(0.45).color = (0.3, 0.9, 0.4, 0.7)
        return node.outputs["Color"]

    return build


def with_curves(kind: str, identifier: str, extend: str) -> Make:
    def build(tree: Any) -> Any:
        node = add_node(tree, kind, {identifier: stretch(GENERATED, (1.4,) * 3, (-0.2,) * 3)(tree)})
        node.mapping.extend = extend
        for number, curve in enumerate(node.mapping.curves):
            curve.points.new(0.3, 0.5 + 0.1 * number)
            curve.points[0].location = (curve.points[0].location[0], 0.1)
        node.mapping.update()
        return node.outputs[0]

    return build


STEP = part(stretch(GENERATED, (0.05,) * 3, (0.31,) * 3), "X")


def with_ramp_step(tree: Any) -> Any:
    """A ramp that changes within a 128th, which the place of each entry of its table decides."""
    node = add_node(tree, "ShaderNodeValToRGB", {"Fac": STEP(tree)})
    node.color_ramp.elements.new(0.33).color = (1.0, 0.2, 0.7, 1.0)
    node.color_ramp.elements.new(0.337).color = (0.1, 0.9, 0.2, 1.0)
    return node.outputs["Color"]


def with_curve_step(tree: Any) -> Any:
    """The same of a curve."""
    node = add_node(tree, "ShaderNodeFloatCurve", {"Value": STEP(tree)})
    points = node.mapping.curves[0].points
    points.new(0.33, 0.9)
    points.new(0.337, 0.1)
    for point in points:
        point.handle_type = "VECTOR"
    node.mapping.update()
    return node.outputs[0]


RAMPS = {
    "ramp with a step": with_ramp_step,
    "curve with a step": with_curve_step,
    **{f"ramp {kind}": with_ramp(kind) for kind in ("LINEAR", "EASE", "CONSTANT", "B_SPLINE", "CARDINAL")},
    **{f"ramp {mode} {hues}": with_ramp("LINEAR", mode, hues) for mode in ("HSV", "HSL") for hues in ("NEAR", "CW")},
    **{
        f"{kind} {extend}": with_curves(f"ShaderNode{kind}", identifier, extend)
        for kind, identifier in (("RGBCurve", "Color"), ("VectorCurve", "Vector"), ("FloatCurve", "Value"))
        for extend in ("HORIZONTAL", "EXTRAPOLATED")
    },
}


def test_ramps_and_curves_agree(empty_scene: Any, record_property: Any) -> None:
    """Curves go on beyond their ends with the slope of their table's last step, a difference of float32 numbers."""
    assert_agreement(RAMPS, 1e-3, record_property)
