"""Textures, images and bumps in our engine and in Cycles of the same Blender: each configuration shines from a quad."""

from functools import partial
from typing import Any

import bpy
import numpy as np
import pytest

from addon.versions import VERSION
from tests.addon.against_cycles.node_fixtures import Make, add_node
from tests.addon.against_cycles.node_sources import (
    CENTRED,
    COLOR,
    GENERATED,
    PACKED_NORMALS,
    STEEP,
    WIDE,
    X,
    assert_agreement,
    list_items,
    make,
    part,
    stretch,
)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]


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
    "white noise of its own vector": make("ShaderNodeTexWhiteNoise", "Color", {"Vector": (0.3, 0.4, 0.5)}),
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


def texture_of_group(tree: Any, reads_alpha: bool) -> Any:
    """Return the color of an Image Texture in a group that also hands on its alpha, which is read or not."""
    group = bpy.data.node_groups.new("Group", "ShaderNodeTree")
    output = group.nodes.new("NodeGroupOutput")
    for name, kind in (("Color", "NodeSocketColor"), ("Alpha", "NodeSocketFloat")):
        group.interface.new_socket(name, in_out="OUTPUT", socket_type=kind)
    image = texture()(group).node
    for number in (0, 1):
        group.links.new(image.outputs[number], output.inputs[number])
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    if not reads_alpha:
        return node.outputs["Color"]
    inputs = {"Value": node.outputs["Color"], "Value_001": node.outputs["Alpha"]}
    return add_node(tree, "ShaderNodeMath", inputs, operation="ADD").outputs[0]


def texture_beside(tree: Any, mutes_link: bool) -> Any:
    """Return the color of an Image Texture whose alpha feeds a node that leads nowhere."""
    color = texture()(tree)
    add_node(tree, "ShaderNodeMath", {"Value": color.node.outputs["Alpha"]})
    if mutes_link:
        tree.links[-1].is_muted = True
    return color


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
    **{f"of a group {read}": partial(texture_of_group, reads_alpha=read) for read in (False, True)},
    **{f"beside {muted}": partial(texture_beside, mutes_link=muted) for muted in (False, True)},
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


@pytest.mark.parametrize("behind", [False, True])
def test_bump_agrees(empty_scene: Any, record_property: Any, behind: bool) -> None:
    assert_agreement(BUMPS, PACKED_NORMALS, record_property, behind=behind)


VORONOIS = {
    f"voronoi {dimensions} {feature} {metric} {detail} {smoothness} {output}": make(
        "ShaderNodeTexVoronoi",
        output,
        {
            "Vector": CENTRED,
            "W": X,
            "Scale": 2.3,
            "Detail": detail,
            "Roughness": 0.6,
            "Lacunarity": 2.1,
            "Exponent": 1.5,
            "Randomness": 0.8,
            **({"Smoothness": smoothness} if feature == "SMOOTH_F1" else {}),
        },
        voronoi_dimensions=dimensions,
        feature=feature,
        distance=metric,
        normalize=detail > 0,
    )
    for dimensions in ("1D", "2D", "3D", "4D")
    for feature, metric, detail, outputs in (
        ("F1", "EUCLIDEAN", 0.0, ("Distance", "Color", "Position", "W")),
        ("F1", "MANHATTAN", 1.4, ("Distance", "Color", "Position")),
        ("F2", "CHEBYCHEV", 1.0, ("Distance", "Color")),
        ("F1", "MINKOWSKI", 0.0, ("Distance",)),
        ("SMOOTH_F1", "EUCLIDEAN", 1.4, ("Distance", "Color", "Position")),
        ("SMOOTH_F1", "MANHATTAN", 0.0, ("Distance", "Color", "W")),
        ("DISTANCE_TO_EDGE", "EUCLIDEAN", 0.0, ("Distance",)),
        ("DISTANCE_TO_EDGE", "EUCLIDEAN", 1.4, ("Distance",)),
        ("N_SPHERE_RADIUS", "EUCLIDEAN", 0.0, ("Radius",)),
    )
    for smoothness in ((0.7, 0.0) if feature == "SMOOTH_F1" and detail == 0 else (0.7,))
    for output in outputs
    if (dimensions in ("1D", "4D") or output != "W") and (dimensions != "1D" or output != "Position")
}


def test_voronoi_cells_agree(empty_scene: Any, record_property: Any) -> None:
    assert_agreement(VORONOIS, STEEP, record_property)


GABORS = {
    f"gabor {dimensions} {anisotropy} {output}": make(
        "ShaderNodeTexGabor",
        output,
        {
            "Vector": CENTRED,
            "Scale": 2.3,
            "Frequency": 1.7,
            "Anisotropy": anisotropy,
            "Orientation 2D": 0.6,
            "Orientation 3D": (0.3, -0.8, 0.4),
        },
        gabor_type=dimensions,
    )
    for dimensions in ("2D", "3D")
    for anisotropy in (0.0, 0.6, 1.0)
    for output in ("Value", "Phase", "Intensity")
}


@pytest.mark.skipif(VERSION < (4, 3), reason="Gabor came with Blender 4.3")
def test_gabor_noise_agrees(empty_scene: Any, record_property: Any) -> None:
    """A phase jumps from 1 to 0 where the last digits decide."""
    assert_agreement(GABORS, STEEP, record_property)


TILINGS = {
    f"tiling {sides} {roundness} {output} {normalize}": make(
        "ShaderNodeRadialTiling",
        output,
        {"Vector": CENTRED, "Sides": sides, "Roundness": roundness},
        normalize=normalize,
    )
    for sides in (2.4, 2.9, 3.0, 5.0, 5.7)
    for roundness in (0.0, 0.3, 1.0)
    for output in ("Segment Coordinates", "Segment ID", "Segment Width", "Segment Rotation")
    for normalize in ((True, False) if output == "Segment Coordinates" else (True,))
}


@pytest.mark.skipif(VERSION < (5, 0), reason="Radial Tiling came with Blender 5.0")
def test_radial_tiling_agrees(empty_scene: Any, record_property: Any) -> None:
    assert_agreement(TILINGS, STEEP, record_property)
