"""The passes as Blender knows them: one table, used where passes are declared, written, drawn and asked for.

The ray tracer's side of the same names is `raytracer.film.passes.PASSES`; what a Blender version calls a pass is in
`versions`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
from bpy.props import BoolProperty

from .versions import blender_pass_name


@dataclass(frozen=True)
class BlenderPass:
    """How Blender stores a pass.

    channels : one letter for each channel, as in the names of an EXR file's channels
    kind : 'COLOR', 'VECTOR' or 'VALUE', the type of the compositor's socket
    option : the view layer's property that switches the pass on
    """

    channels: str
    kind: str
    option: str

    @property
    def is_own(self) -> bool:
        """True where it is this add-on that gives view layers the option."""
        return self.option.startswith("raytracer_")


PASSES = {
    "Combined": BlenderPass("RGBA", "COLOR", "use_pass_combined"),
    "Depth": BlenderPass("Z", "VALUE", "use_pass_z"),
    "Position": BlenderPass("XYZ", "VECTOR", "use_pass_position"),
    "Normal": BlenderPass("XYZ", "VECTOR", "use_pass_normal"),
    "UV": BlenderPass("UVA", "VECTOR", "use_pass_uv"),
    "Object Index": BlenderPass("X", "VALUE", "use_pass_object_index"),
    "Material Index": BlenderPass("X", "VALUE", "use_pass_material_index"),
    "Diffuse Color": BlenderPass("RGB", "COLOR", "use_pass_diffuse_color"),
    "Emission": BlenderPass("RGB", "COLOR", "use_pass_emit"),
    "Shadow": BlenderPass("RGB", "COLOR", "use_pass_shadow"),
    "Error": BlenderPass("X", "VALUE", "raytracer_use_pass_error"),
    "Sample Count": BlenderPass("X", "VALUE", "raytracer_use_pass_sample_count"),
}


def enabled_passes(view_layer: Any) -> tuple[str, ...]:
    """Return the names, as keys of `PASSES`, that a view layer asks for; Combined is always among them."""
    return tuple(
        name for name, stored in PASSES.items() if name == "Combined" or getattr(view_layer, stored.option, False)
    )


def enable_passes(view_layer: Any, names: tuple[str, ...]) -> None:
    """Switch on exactly the passes `names` (keys of `PASSES`) in a view layer, Combined always."""
    for name, stored in PASSES.items():
        setattr(view_layer, stored.option, name in names or name == "Combined")


def declare_passes(engine: Any, scene: Any, view_layer: Any) -> None:
    """Tell Blender which passes a render of `view_layer` will hold."""
    for name in enabled_passes(view_layer):
        stored = PASSES[name]
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
