"""The passes as Blender knows them: one table, used where passes are declared, written, drawn and asked for.

The ray tracer's side of the same names is `raytracer.film.passes.PASSES`; what a Blender version calls a pass is in
`versions`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
from bpy.props import BoolProperty

from raytracer.film.passes import AOV_COLOR, AOV_VALUE, LIGHT_GROUP, MOST_MATTES, matte_pass, select_mattes
from raytracer.film.passes import find_pass as find_traced

from .versions import blender_pass_name


@dataclass(frozen=True)
class BlenderPass:
    """How Blender stores a pass.

    channels : one letter for each channel, as in the names of an EXR file's channels
    kind : 'COLOR', 'VECTOR' or 'VALUE', the type of the compositor's socket
    option : the view layer's property that switches the pass on; of Cycles' own properties, with its place before it
    """

    channels: str
    kind: str
    option: str

    @property
    def is_own(self) -> bool:
        """True where it is this add-on that gives view layers the option."""
        return self.option.startswith("raytracer_")


# One of Cycles' properties switches all that denoisers take on.
DENOISING_DATA = "cycles.denoising_store_passes"

PASSES = {
    "Combined": BlenderPass("RGBA", "COLOR", "use_pass_combined"),
    "Depth": BlenderPass("Z", "VALUE", "use_pass_z"),
    "Position": BlenderPass("XYZ", "VECTOR", "use_pass_position"),
    "Vector": BlenderPass("XYZW", "VECTOR", "use_pass_vector"),
    "Normal": BlenderPass("XYZ", "VECTOR", "use_pass_normal"),
    "UV": BlenderPass("UVA", "VECTOR", "use_pass_uv"),
    "Object Index": BlenderPass("X", "VALUE", "use_pass_object_index"),
    "Material Index": BlenderPass("X", "VALUE", "use_pass_material_index"),
    "Diffuse Color": BlenderPass("RGB", "COLOR", "use_pass_diffuse_color"),
    "Diffuse Direct": BlenderPass("RGB", "COLOR", "use_pass_diffuse_direct"),
    "Diffuse Indirect": BlenderPass("RGB", "COLOR", "use_pass_diffuse_indirect"),
    "Glossy Color": BlenderPass("RGB", "COLOR", "use_pass_glossy_color"),
    "Glossy Direct": BlenderPass("RGB", "COLOR", "use_pass_glossy_direct"),
    "Glossy Indirect": BlenderPass("RGB", "COLOR", "use_pass_glossy_indirect"),
    "Transmission Color": BlenderPass("RGB", "COLOR", "use_pass_transmission_color"),
    "Transmission Direct": BlenderPass("RGB", "COLOR", "use_pass_transmission_direct"),
    "Transmission Indirect": BlenderPass("RGB", "COLOR", "use_pass_transmission_indirect"),
    "Volume Direct": BlenderPass("RGB", "COLOR", "cycles.use_pass_volume_direct"),
    "Volume Indirect": BlenderPass("RGB", "COLOR", "cycles.use_pass_volume_indirect"),
    "Environment": BlenderPass("RGB", "COLOR", "use_pass_environment"),
    "Mist": BlenderPass("Z", "VALUE", "use_pass_mist"),
    "Emission": BlenderPass("RGB", "COLOR", "use_pass_emit"),
    "Ambient Occlusion": BlenderPass("RGB", "COLOR", "use_pass_ambient_occlusion"),
    "Shadow Catcher": BlenderPass("RGB", "COLOR", "cycles.use_pass_shadow_catcher"),
    "Shadow": BlenderPass("RGB", "COLOR", "use_pass_shadow"),
    "Denoising Normal": BlenderPass("XYZ", "VECTOR", DENOISING_DATA),
    "Denoising Albedo": BlenderPass("RGB", "COLOR", DENOISING_DATA),
    "Denoising Depth": BlenderPass("Z", "VALUE", DENOISING_DATA),
    "Error": BlenderPass("X", "VALUE", "raytracer_use_pass_error"),
    "Sample Count": BlenderPass("X", "VALUE", "raytracer_use_pass_sample_count"),
}


# What switches the kinds of Cryptomatte on; each has a pass for two of its levels.
MATTE_OPTIONS = {
    "Object": "use_pass_cryptomatte_object",
    "Material": "use_pass_cryptomatte_material",
    "Asset": "use_pass_cryptomatte_asset",
}
MOST_LEVELS = 2 * MOST_MATTES

# What begins the ray tracer's names of passes that a view layer names itself, and how Blender stores them.
NAMED = {
    AOV_VALUE: BlenderPass("X", "VALUE", ""),
    AOV_COLOR: BlenderPass("RGBA", "COLOR", ""),
    LIGHT_GROUP: BlenderPass("RGB", "COLOR", ""),
}
AOV_TYPES = {"VALUE": AOV_VALUE, "COLOR": AOV_COLOR}


def find_owner(view_layer: Any, option: str) -> tuple[Any, str]:
    """Return what has the property that an option names, and what that calls it; None where Cycles is switched off."""
    *place, name = option.split(".")
    owner = view_layer
    for part in place:
        owner = getattr(owner, part, None)
    return owner, name


def is_on(view_layer: Any, option: str) -> bool:
    """True where a view layer has an option, and it is switched on."""
    owner, name = find_owner(view_layer, option)
    return bool(getattr(owner, name, False))


def switch(view_layer: Any, option: str, on: bool) -> None:
    """Switch an option of a view layer on or off, where there is one."""
    owner, name = find_owner(view_layer, option)
    if owner is not None:
        setattr(owner, name, on)


def list_options() -> tuple[str, ...]:
    """Return the options of all passes, each once."""
    return tuple(dict.fromkeys(stored.option for stored in PASSES.values()))


def find_pass(name: str) -> BlenderPass:
    """Return how Blender stores a pass, of Cryptomatte too, and those that a view layer names."""
    kind = find_traced(name).matte
    if kind:
        return BlenderPass("rgba", "COLOR", MATTE_OPTIONS[kind])
    return PASSES.get(name) or next(stored for start, stored in NAMED.items() if name.startswith(start))


def list_mattes(view_layer: Any) -> tuple[str, ...]:
    """Return the names of the passes of Cryptomatte that a view layer asks for."""
    count = (min(view_layer.pass_cryptomatte_depth, MOST_LEVELS) + 1) // 2
    kinds = [kind for kind, option in MATTE_OPTIONS.items() if getattr(view_layer, option)]
    return tuple(matte_pass(kind, number) for kind in kinds for number in range(count))


def list_named(view_layer: Any) -> tuple[str, ...]:
    """Return the names of the passes that a view layer names itself."""
    aovs = (AOV_TYPES[aov.type] + aov.name for aov in view_layer.aovs if aov.is_valid and aov.name)
    return (*aovs, *(LIGHT_GROUP + group.name for group in view_layer.lightgroups if group.name))


def enabled_passes(view_layer: Any) -> tuple[str, ...]:
    """Return the names, of `film.passes`, that a view layer asks for; Combined is always among them."""
    plain = (name for name, stored in PASSES.items() if name == "Combined" or is_on(view_layer, stored.option))
    return (*plain, *list_mattes(view_layer), *list_named(view_layer))


def enable_passes(view_layer: Any, names: tuple[str, ...]) -> None:
    """Switch on exactly the passes `names` in a view layer, Combined always; of Cryptomatte also those before.

    What the view layer names itself stays as it is.
    """
    wanted = {PASSES[name].option for name in ("Combined", *names) if name in PASSES}
    for option in list_options():
        switch(view_layer, option, option in wanted)
    slots = select_mattes(names)
    for kind, option in MATTE_OPTIONS.items():
        setattr(view_layer, option, kind in slots)
    if slots:
        view_layer.pass_cryptomatte_depth = max(slots.values())


def declare_passes(engine: Any, scene: Any, view_layer: Any) -> None:
    """Tell Blender which passes a render of `view_layer` will hold."""
    for name in enabled_passes(view_layer):
        stored = find_pass(name)
        engine.register_pass(
            scene, view_layer, blender_pass_name(name), len(stored.channels), stored.channels, stored.kind
        )


DESCRIPTIONS = {
    "Error": "Standard error of each pixel of Combined: the root mean square of its red, green and blue",
    "Sample Count": "Number of samples of each pixel",
}


def register() -> None:
    """Give view layers the options of the passes that Blender does not know."""
    for name, stored in PASSES.items():
        if stored.is_own:
            chosen = BoolProperty(name=name, description=DESCRIPTIONS[name], default=False, update=_announce)
            setattr(bpy.types.ViewLayer, stored.option, chosen)


def unregister() -> None:
    """Take them away."""
    for stored in PASSES.values():
        if stored.is_own:
            delattr(bpy.types.ViewLayer, stored.option)


def _announce(view_layer: Any, context: Any) -> None:
    """Let the compositor have a socket for what is switched on."""
    view_layer.update_render_passes()
