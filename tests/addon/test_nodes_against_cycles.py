"""Every shader node in our engine and in Cycles of the same Blender: each configuration shines from a small plane.

A bound states the largest difference, as a share of 1 + |value|. Both engines see the same points; what is left is
Cycles' float32, whose coordinates of up to 16 m are off by up to 1e-6 m, in proportion to a node's steepness.
"""

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest

import addon
from addon.versions import VERSION
from tests.addon.node_fixtures import Make, add_node, measure_differences

pytestmark = pytest.mark.blender

# What passes coordinates on, or is about as steep.
SMOOTH = 1e-5
# Functions tens of times as steep as their coordinates.
STEEP = 1e-4
# Cycles fits the colours of glowing bodies by rational functions.
GLOWING = 1e-2
# Cycles keeps a vertex's normal in 32 bits: its tangent plane is off by up to 1e-4.
PACKED_NORMALS = 4e-4


@pytest.fixture(autouse=True, scope="module")
def _registered() -> Any:
    addon.register()
    yield
    addon.unregister()


def make(kind: str, output: int | str = 0, inputs: dict[str, Any] | None = None, **properties: Any) -> Make:
    """Return a function that makes one node; inputs that are functions themselves make what they link to."""

    def build(tree: Any) -> Any:
        sockets = {name: value(tree) if callable(value) else value for name, value in (inputs or {}).items()}
        outputs = add_node(tree, kind, sockets, **properties).outputs
        return outputs[output] if isinstance(output, int) else find(outputs, output)

    return build


def find(sockets: Any, identifier: str) -> Any:
    return next(socket for socket in sockets if socket.identifier == identifier)


def list_items(kind: str, name: str) -> list[str]:
    """Return the values that an enumeration of a node has in this version of Blender."""
    return [item.identifier for item in getattr(bpy.types, kind).bl_rna.properties[name].enum_items]


def attribute(name: str, output: str = "Color") -> Make:
    return make("ShaderNodeAttribute", output, attribute_name=name)


def stretch(source: Make, factor: Any, offset: Any) -> Make:
    """source * factor + offset, vectors."""
    return make(
        "ShaderNodeVectorMath",
        inputs={"Vector": source, "Vector_001": factor, "Vector_002": offset},
        operation="MULTIPLY_ADD",
    )


def part(source: Make, output: str) -> Make:
    return make("ShaderNodeSeparateXYZ", output, {"Vector": source})


GENERATED = make("ShaderNodeTexCoord", "Generated")
CENTRED = stretch(GENERATED, (2.0, 2.0, 2.0), (-1.0, -1.0, -1.0))
WIDE = stretch(GENERATED, (7.0, 5.0, 6.0), (-3.0, -2.0, 1.0))
COLOR = attribute("Col")
X, Y = part(CENTRED, "X"), part(CENTRED, "Y")


def assert_agreement(
    configurations: dict[str, Make], bound: float, record: Callable[[str, object], None], share: float = 1.0
) -> None:
    """Compare all configurations in one picture; `share` of each one's pixels have to be within the bound."""
    scene = bpy.context.scene
    _, pictures, warnings = measure_differences(scene, configurations)
    assert not warnings
    failing, largest = {}, {}
    for name, (ours, cycles) in pictures.items():
        assert np.isfinite(ours).all(), name
        difference = (np.abs(ours - cycles) / (1.0 + np.abs(cycles))).max(axis=2)
        largest[name] = float(np.quantile(difference, share, method="lower"))
        if largest[name] > bound:
            failing[name] = largest[name]
    record("largest_difference", largest)
    assert failing == {}


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


def test_what_depends_on_shading_normals_agrees(empty_scene: Any, record_property: Any) -> None:
    assert_agreement(SHADING_NORMALS, PACKED_NORMALS, record_property)


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
        if kind != "POINT" or VERSION
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
    """Cycles' colours come from a fit of Planck's; below its coldest and above its hottest both stay as they are."""
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


RAMPS = {
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


NOISE_TYPES = ("MULTIFRACTAL", "FBM", "HYBRID_MULTIFRACTAL", "RIDGED_MULTIFRACTAL", "HETERO_TERRAIN")
NOISES = {
    f"noise {dimensions} {kind} {detail} {distortion}": make(
        "ShaderNodeTexNoise",
        "Color",
        {
            "Vector": CENTRED,
            "W": X,
            "Scale": 1.7,
            "Detail": detail,
            "Roughness": 0.6,
            "Lacunarity": 2.1,
            "Offset": 0.3,
            "Gain": 1.2,
            "Distortion": distortion,
        },
        noise_dimensions=dimensions,
        noise_type=kind,
        normalize=distortion == 0,
    )
    for dimensions in ("1D", "2D", "3D", "4D")
    for kind in NOISE_TYPES
    for detail, distortion in ((2.0, 0.0), (1.4, 0.5))
}
PATTERNS = {
    "noise as number": make("ShaderNodeTexNoise", "Fac", {"Vector": CENTRED, "Scale": 1.7, "Distortion": 0.3}),
    "checker": make("ShaderNodeTexChecker", "Color", {"Vector": WIDE, "Scale": 1.1}),
    "checker Generated": make("ShaderNodeTexChecker", "Fac"),
    **{
        f"gradient {kind}": make("ShaderNodeTexGradient", "Color", {"Vector": CENTRED}, gradient_type=kind)
        for kind in list_items("ShaderNodeTexGradient", "gradient_type")
    },
    **{
        f"wave bands {direction} {profile}": make(
            "ShaderNodeTexWave",
            "Color",
            {"Vector": CENTRED, "Scale": 0.3, "Phase Offset": 0.4},
            wave_type="BANDS",
            bands_direction=direction,
            wave_profile=profile,
        )
        for direction in ("X", "Y", "Z", "DIAGONAL")
        for profile in ("SIN", "SAW", "TRI")
    },
    **{
        f"wave rings {direction}": make(
            "ShaderNodeTexWave",
            "Fac",
            {"Vector": CENTRED, "Scale": 0.3, "Distortion": 1.5, "Detail": 1.5, "Detail Scale": 1.2},
            wave_type="RINGS",
            rings_direction=direction,
        )
        for direction in ("X", "Y", "Z", "SPHERICAL")
    },
    **{
        f"magic {depth}": make("ShaderNodeTexMagic", "Color", {"Vector": CENTRED, "Scale": 0.5}, turbulence_depth=depth)
        for depth in range(11)
    },
    "bricks": make("ShaderNodeTexBrick", "Color", {"Vector": WIDE, "Scale": 0.9, "Mortar Size": 0.1}),
    "bricks with bias": make(
        "ShaderNodeTexBrick",
        "Color",
        {"Vector": WIDE, "Scale": 0.7, "Mortar Smooth": 0.8, "Bias": 0.3, "Mortar Size": 0.07, "Mortar": (1, 0, 0, 1)},
        offset=0.3,
        squash=0.7,
        squash_frequency=3,
    ),
    **{
        f"white noise {dimensions}": make(
            "ShaderNodeTexWhiteNoise",
            "Color",
            {
                "Vector": make(
                    "ShaderNodeVectorMath", inputs={"Vector": stretch(WIDE, (1.0,) * 3, (0.01,) * 3)}, operation="FLOOR"
                ),
                "W": 0.3,
            },
            noise_dimensions=dimensions,
        )
        for dimensions in ("1D", "2D", "3D", "4D")
    },
}


def test_patterns_agree(empty_scene: Any, record_property: Any) -> None:
    assert_agreement(PATTERNS, STEEP, record_property)


def test_noise_agrees(empty_scene: Any, record_property: Any) -> None:
    assert_agreement(NOISES, STEEP, record_property)


def make_image(name: str, is_float: bool = False, opaque: bool = False, size: tuple[int, int] = (5, 4)) -> Any:
    """Return an image of random pixels, whose alpha varies."""
    image = bpy.data.images.new(name, *size, alpha=True, float_buffer=is_float)
    pixels = np.random.default_rng(7).random((size[1], size[0], 4)).astype(np.float32)
    if opaque:
        pixels[..., 3] = 1.0
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    image.pack()
    return image


def texture(
    output: str = "Color", vector: Make | None = None, image: dict[str, Any] | None = None, **properties: Any
) -> Make:
    """Return a function that makes an Image Texture; `image` sets what `make_image` and its image take."""

    def build(tree: Any) -> Any:
        wanted = dict(image or {})
        made = make_image(
            "Image", **{name: wanted.pop(name) for name in ("is_float", "opaque", "size") if name in wanted}
        )
        made.colorspace_settings.name = wanted.pop("space", made.colorspace_settings.name)
        for name, value in wanted.items():
            setattr(made, name, value)
        sockets = {} if vector is None else {"Vector": vector(tree)}
        return add_node(tree, "ShaderNodeTexImage", sockets, image=made, **properties).outputs[output]

    return build


OUTSIDE = stretch(GENERATED, (3.1, 2.7, 2.3), (-1.03, -0.87, -0.6))
IMAGES = {
    **{
        f"{interpolation} {extension}": texture(vector=OUTSIDE, interpolation=interpolation, extension=extension)
        for interpolation in ("Linear", "Closest", "Cubic", "Smart")
        for extension in ("REPEAT", "EXTEND", "CLIP", "MIRROR")
    },
    **{
        f"{output} {mode} {space} {'float' if is_float else 'bytes'}": texture(
            output, image={"alpha_mode": mode, "space": space, "is_float": is_float}
        )
        for output in ("Color", "Alpha")
        for mode in ("STRAIGHT", "PREMUL", "CHANNEL_PACKED", "NONE")
        for space in ("sRGB", "Non-Color", "Linear Rec.709")
        for is_float in (False, True)
    },
    **{f"{projection}": texture(vector=GENERATED, projection=projection) for projection in ("SPHERE", "TUBE")},
    **{
        f"box {blend}": texture(vector=GENERATED, projection="BOX", projection_blend=blend) for blend in (0.0, 0.3, 1.0)
    },
    "of one pixel": texture(vector=OUTSIDE, image={"size": (1, 1)}),
    "of uvs": texture(image={"opaque": True}),
    "none": lambda tree: add_node(tree, "ShaderNodeTexImage").outputs["Color"],
}
SPACES = {
    space: texture(image={"space": space, "opaque": True})
    for space in ("Linear Rec.2020", "ACEScg", "ACES2065-1", "Linear DCI-P3 D65", "Linear CIE-XYZ D65", "Display P3")
}


def test_images_agree(empty_scene: Any, record_property: Any) -> None:
    assert_agreement(IMAGES, STEEP, record_property)


def test_color_spaces_of_images_agree(empty_scene: Any, record_property: Any) -> None:
    """Cycles cuts what it has converted to half floats, of 11 bits."""
    assert_agreement(SPACES, 2.0**-9, record_property)


def bump(height: Make, **inputs: Any) -> Make:
    invert = inputs.pop("invert", False)
    return make(
        "ShaderNodeBump",
        inputs={"Height": height, "Distance": 0.3, **{name.replace("_", " "): value for name, value in inputs.items()}},
        invert=invert,
    )


NOISE = make("ShaderNodeTexNoise", "Fac", {"Vector": CENTRED, "Scale": 1.3})
BUMPS = {
    "noise": bump(NOISE),
    "noise inverted": bump(NOISE, invert=True),
    "noise at half strength": bump(NOISE, Strength=0.5),
    "noise twice": bump(NOISE, Normal=bump(make("ShaderNodeTexWave", "Fac", {"Vector": CENTRED, "Scale": 0.2}))),
    "coordinate": bump(part(make("ShaderNodeTexCoord", "Generated"), "X")),
    "position": bump(part(make("ShaderNodeNewGeometry", "Position"), "Y")),
    "uv": bump(part(make("ShaderNodeUVMap"), "Y")),
    "smooth image": bump(texture(interpolation="Cubic", image={"space": "Non-Color", "opaque": True})),
    "color": bump(COLOR),
    "magic": bump(make("ShaderNodeTexMagic", "Fac", {"Vector": CENTRED, "Scale": 0.3})),
    "constant": bump(make("ShaderNodeValue")),
    "nothing": make("ShaderNodeBump"),
    "of a normal map": bump(NOISE, Normal=make("ShaderNodeNormalMap", inputs={"Color": COLOR, "Strength": 0.3})),
}


def test_bump_agrees(empty_scene: Any, record_property: Any) -> None:
    assert_agreement(BUMPS, PACKED_NORMALS, record_property)
