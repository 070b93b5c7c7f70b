"""What differs between Blender 4.2 LTS and 5.2 LTS: the one module of the add-on that knows.

Facts come from the bpy wheels 4.2, 4.5, 5.0, 5.1 and 5.2 and from Blender's release notes (Python API, 4.3 to 5.2).
May import bpy, NumPy and the names of passes only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from raytracer.film.passes import find_layer_name

VERSION: tuple[int, int, int] = tuple(bpy.app.version)

# Blender 5.0 spelled the short pass names out; the tracer uses the long ones throughout.
SHORT_PASS_NAMES = {
    "Object Index": "IndexOB",
    "Material Index": "IndexMA",
    "Diffuse Direct": "DiffDir",
    "Diffuse Indirect": "DiffInd",
    "Diffuse Color": "DiffCol",
    "Glossy Direct": "GlossDir",
    "Glossy Indirect": "GlossInd",
    "Glossy Color": "GlossCol",
    "Transmission Direct": "TransDir",
    "Transmission Indirect": "TransInd",
    "Transmission Color": "TransCol",
    "Volume Direct": "VolumeDir",
    "Volume Indirect": "VolumeInd",
    "Emission": "Emit",
    "Environment": "Env",
    "Ambient Occlusion": "AO",
}

# The panel of an object's shading: Cycles' alone in 4.2, where what belongs to it stands with the visibility.
SHADING_PANEL = "OBJECT_PT_shading" if VERSION >= (4, 3) else "OBJECT_PT_visibility"
# Since 5.0 Blender joins nodes through groups and muted nodes: only what it computes before is converted on the way.
CONVERTS_ON_THE_WAY = VERSION < (5, 0)


def blender_pass_name(name: str, version: tuple[int, ...] = VERSION) -> str:
    """Return the name that this version of Blender gives to the tracer's pass `name`: 63 bytes, where letters end."""
    layer = find_layer_name(name)
    known = layer if layer != name or version >= (5, 0) else SHORT_PASS_NAMES.get(name, name)
    return known.encode()[:63].decode(errors="ignore")


def find_node_tree(owner: Any) -> Any:
    """Return the shader nodes in use by a material, world or light, or None where it has or uses none.

    `use_nodes` is deprecated, and always true, for materials and worlds since 5.0 and for lights since 5.1; reading it
    there warns, so the property itself is asked first.
    """
    switch = owner.bl_rna.properties.get("use_nodes")
    if switch is None or getattr(switch, "is_deprecated", False):
        return owner.node_tree
    return owner.node_tree if owner.use_nodes else None


def inline_nodes(owner: Any) -> Any:
    """Return what holds, as `node_tree`, an owner's nodes without zones and groups; None before 5.0, without zones."""
    make = getattr(bpy.types, "InlineShaderNodes", None)
    return None if make is None else getattr(make, f"from_{owner.id_type.lower()}")(owner)


def hands_on_values(target: Any, given: Any, is_pure: bool, version: tuple[int, ...] = VERSION) -> bool:
    """Return True where an input, `target`, takes what an unlinked input of a group says, `given`, not what its node
    computes: never up to 4.5; since 5.0 unless both hide their values, and always if computed before, `is_pure`."""
    return version >= (5, 0) and (is_pure or not (target.hide_value and given.hide_value))


def find_output_node(node_tree: Any) -> Any:
    """Return the active output node, or None. A material may hold one for Cycles and one for EEVEE; this engine follows
    Cycles, so Cycles' comes first."""
    return node_tree.get_output_node("CYCLES") or node_tree.get_output_node("EEVEE")


def find_world(scene: Any, view_layer: Any) -> Any:
    """Return the world to render, or None: a view layer may override the scene's world since 4.4."""
    return getattr(view_layer, "world_override", None) or scene.world


def read_shutter_position(scene: Any) -> str:
    """Return where the frame lies in the time of the shutter: 'START', 'CENTER' or 'END'."""
    return str(scene.render.motion_blur_position)


def read_rolling_shutter(scene: Any) -> float | None:
    """Return for which share of the time each row sees light, of Cycles' rolling shutter; None where it is off."""
    settings = getattr(scene, "cycles", None)
    if settings is None or settings.rolling_shutter_type == "NONE":
        return None
    return float(settings.rolling_shutter_duration)


def register_presets(folder: str) -> None:
    """Let Blender find the presets that come along in a folder; in 4.2.0, which looks for none there, nothing."""
    if hasattr(bpy.utils, "register_preset_path"):  # since 4.3, and in later releases of 4.2
        bpy.utils.register_preset_path(folder)


def unregister_presets(folder: str) -> None:
    """Let Blender forget them."""
    if hasattr(bpy.utils, "unregister_preset_path"):
        bpy.utils.unregister_preset_path(folder)


@dataclass(frozen=True)
class LightSettings:
    """The fields of a light that came after 4.2, at the value that changes nothing where they are missing.

    gain : 2 ** exposure; temperature_color : linear RGB; normalize : power is that of the whole light, not of 1 m^2
    """

    gain: float
    temperature_color: tuple[float, float, float]
    normalize: bool


def read_light_settings(light: Any) -> LightSettings:
    """Return what `exposure`, `use_temperature` and `normalize` (all in by 4.5) say of a light."""
    temperature = light.temperature_color if getattr(light, "use_temperature", False) else (1.0, 1.0, 1.0)
    return LightSettings(
        gain=2.0 ** getattr(light, "exposure", 0.0),
        temperature_color=tuple(temperature[:3]),
        normalize=getattr(light, "normalize", True),
    )


def escape_path(path: str, version: tuple[int, ...] = VERSION) -> str:
    """Return an output path as Blender wants it: since 5.0 braces are templates, and written twice."""
    return path.replace("{", "{{").replace("}", "}}") if version >= (5, 0) else path


def multiplies_alpha(image: Any, version: tuple[int, ...] = VERSION) -> bool:
    """Return True where Cycles multiplies the colors that Blender hands it by their alpha.

    Up to 5.0 those of byte images, since 5.1 those of images that are said to be straight.
    """
    return image.alpha_mode == "STRAIGHT" if version >= (5, 1) else not image.is_float


def returns_lost_light(version: tuple[int, ...] = VERSION) -> bool:
    """Return True where the Diffuse BSDF gives back the light that rough facets lose: since 4.3."""
    return version >= (4, 3)


def has_simple_coats(version: tuple[int, ...] = VERSION) -> bool:
    """Return True where rough coats lose light and dim what is under them as smooth ones would: in 4.2, not in 4.5
    (4.3 and 4.4 are taken for 4.5)."""
    return version < (4, 3)


def lays_films_on_metals(version: tuple[int, ...] = VERSION) -> bool:
    """Return True where the thin film of a Principled BSDF lies on its metallic part as well: since 5.0."""
    return version >= (5, 0)


def count_passages(most: int, version: tuple[int, ...] = VERSION) -> int:
    """Return how many surfaces a path passes straight before its last, where with its shadow ray it may pass `most`:
    before 5.0 one more."""
    return most if version >= (5, 0) else most + 1


def default_shader(version: tuple[int, ...] = VERSION) -> str:
    """Return the kind of closure that Cycles gives what has no material: diffuse in 4.2, principled in 5.0."""
    return "principled" if version >= (5, 0) else "diffuse"


# The kinds of media of formats that are no plain images.
MEDIA = {"OPEN_EXR_MULTILAYER": "MULTI_LAYER_IMAGE", "FFMPEG": "VIDEO"}


def set_image_format(settings: Any, file_format: str) -> None:
    """Set an `ImageFormatSettings.file_format`; since 5.0 its kind of media comes first."""
    if hasattr(settings, "media_type"):
        settings.media_type = MEDIA.get(file_format, "IMAGE")
    settings.file_format = file_format


def read_image_format(settings: Any) -> dict[str, Any]:
    """Return what `set_image_format` changes, and what Blender changes with it, in an order that can be set again: the
    kind of media first, for since 5.0 a movie's format is none of those of an image."""
    names = ("media_type", "file_format", "color_mode", "color_depth", "exr_codec")
    return {name: getattr(settings, name) for name in names if hasattr(settings, name)}


def inverts_by_similarity(version: tuple[int, ...] = VERSION) -> bool:
    """Return True where Random Walk finds the medium of a subsurface color by van de Hulst's similarity: since 5.2."""
    return version >= (5, 2)


def has_half_skies(version: tuple[int, ...] = VERSION) -> bool:
    """Return True where the table of a Sky Texture ends at the horizon, and just past the zenith: before 5.0."""
    return version < (5, 0)


def has_whole_cells(version: tuple[int, ...] = VERSION) -> bool:
    """Return True where Voronoi Texture hashes its cells as whole numbers: since 5.0."""
    return version >= (5, 0)


# From CIE XYZ to linear Rec. 709: as rounded in IEC 61966-2-1, and of the primaries and the white (0.3127, 0.3290).
RGB_FROM_XYZ = (
    ((3.2404542, -1.5371385, -0.4985314), (-0.9692660, 1.8760108, 0.0415560), (0.0556434, -0.2040259, 1.0572252)),
    (
        (3.24096994, -1.53738318, -0.49861076),
        (-0.96924364, 1.87596750, 0.04155506),
        (0.05563008, -0.20397696, 1.05697151),
    ),
)


def find_rgb_from_xyz(version: tuple[int, ...] = VERSION) -> NDArray[np.float64]:
    """Return the matrix (3, 3) from XYZ to the scene's colors: since 5.0 without the standard's rounding."""
    return np.array(RGB_FROM_XYZ[version >= (5, 0)])


def find_working_space() -> str:
    """Return the linear color space that a file's colors are in: its own choice since 5.0."""
    return str(getattr(getattr(bpy.data, "colorspace", None), "working_space", "Linear Rec.709"))


def read_world_bounces(world: Any) -> int | None:
    """Return the bounces after which a world is not sampled as a light, or None without limit, or if it never is; the
    setting is Cycles' own."""
    never = getattr(getattr(world, "cycles", None), "sampling_method", "AUTOMATIC") == "NONE"
    return None if never else read_light_bounces(world)


def read_light_bounces(light: Any) -> int | None:
    """Return the bounces after which a light lights nothing, or None without limit; the setting is Cycles' own."""
    settings = getattr(light, "cycles", None)
    if settings is None or settings.max_bounces >= settings.bl_rna.properties["max_bounces"].default:
        return None
    return int(settings.max_bounces)


def hides_lights_like_objects(version: tuple[int, ...] = VERSION) -> bool:
    """Return True where instancers and indirect-only collections hide lights, too: since 5.0 (taken for 4.2 before)."""
    return version >= (5, 0)


def is_portal(light: Any) -> bool:
    """Return True for an area light that only guides Cycles; the setting is Cycles' own, absent without its add-on."""
    return bool(getattr(getattr(light, "cycles", None), "is_portal", False))


def find_terminator(shown: Any) -> tuple[Any, tuple[str, str]]:
    """Return what has an object's offsets of the shadow terminator, and the names of geometry's and shading's: Cycles'
    own properties before Blender 4.3, which instances of generated objects have none of (None)."""
    names = ("shadow_terminator_geometry_offset", "shadow_terminator_shading_offset")
    if hasattr(shown, names[1]):
        return shown, names
    return getattr(shown, "cycles", None), (names[0], "shadow_terminator_offset")


def read_terminator(shown: Any) -> tuple[float, float]:
    """Return an object's offsets of the shadow terminator, geometry's and shading's."""
    owner, names = find_terminator(shown)
    return getattr(owner, names[0], 0.1), getattr(owner, names[1], 0.0)


def read_caustics(shown: Any) -> tuple[bool, bool]:
    """Return whether an object casts shadow caustics, and whether it receives them; both are Cycles' own."""
    cycles = getattr(shown, "cycles", None)
    return bool(getattr(cycles, "is_caustics_caster", False)), bool(getattr(cycles, "is_caustics_receiver", False))


def makes_caustics(shining: Any) -> bool:
    """Return whether a light, or a world, makes shadow caustics; the setting is Cycles' own."""
    return bool(getattr(getattr(shining, "cycles", None), "is_caustics_light", False))


def is_hidden_from_picking(shown: Any) -> bool:
    """Return True for an object that Scene.ray_cast passes; the setting came with 5.0."""
    return bool(getattr(shown, "hide_surface_pick", False))


def relative_path_options(version: tuple[int, ...] = VERSION) -> set[str]:
    """Return the options of a path's property that may begin with //; Blender 4.5 and later have to be told so."""
    return {"PATH_SUPPORTS_BLEND_RELATIVE"} if version >= (4, 5) else set()


def find_adaptive(source: Any, is_render: bool) -> Any:
    """Return the modifier by which Cycles would subdivide an object as its place in the picture asks, or None: a switch
    of the modifier since Blender 5.0, before that one of the object."""
    last = source.modifiers[-1] if len(source.modifiers) else None
    if last is None or last.type != "SUBSURF" or not (last.show_render if is_render else last.show_viewport):
        return None
    of_object = getattr(getattr(source, "cycles", None), "use_adaptive_subdivision", False)
    return last if getattr(last, "use_adaptive_subdivision", of_object) else None


def open_base(source: Any) -> Any:
    """Return what owns `mesh_base`, the mesh before its last subdivision, and has to outlive it; None before 5.0."""
    return source.evaluated_geometry() if VERSION >= (5, 0) else None


def has_denoiser() -> bool:
    """Return True where Blender has OpenImageDenoise: Cycles tells, where the compositor's node just does nothing."""
    try:
        import _cycles
    except ImportError:
        return False
    return bool(_cycles.with_openimagedenoise)


def make_compositor_tree(scene: Any) -> Any:
    """Return an empty tree of compositor nodes in use by a scene; since 5.0 it is a node group."""
    if not hasattr(scene, "compositing_node_group"):
        scene.use_nodes = True
        scene.node_tree.nodes.clear()
        return scene.node_tree
    scene.compositing_node_group = bpy.data.node_groups.new(scene.name, "CompositorNodeTree")
    scene.compositing_node_group.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    return scene.compositing_node_group


def find_compositor_output(tree: Any) -> Any:
    """Return the socket, of a node made for it, that takes what a scene shows."""
    is_group = bool(tree.interface.items_tree)
    return tree.nodes.new("NodeGroupOutput" if is_group else "CompositorNodeComposite").inputs["Image"]


def set_high_range(denoise: Any) -> None:
    """Let a Denoise node take colors above 1; since 5.0 that is an input."""
    if hasattr(denoise, "use_hdr"):
        denoise.use_hdr = True
    else:
        denoise.inputs["HDR"].default_value = True


def split_bake_primitives(values: NDArray[np.float32]) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Return the triangle (n,) of each pixel of a bake, -1 of none, and the weights (n, 2) of its corners 0 and 1.

    values : (n, 4) up to 4.x, a seed, the triangle (whole, in a float's bits), the weights; (n, 3) in 5.x, these first
    """
    triangle, first = (1, 2) if values.shape[1] == 4 else (2, 0)
    return values.view(np.int32)[:, triangle].copy(), values[:, first : first + 2].copy()


def read_voxel_interpolation(material: Any) -> str:
    """Return how a material, or None, reads between voxels, "linear" or "cubic": Cycles, where it is on, has both."""
    return str(getattr(getattr(material, "cycles", None), "volume_interpolation", "LINEAR")).lower()
