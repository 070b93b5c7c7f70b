"""The engine's panels, by tab, and the built-in ones that it joins while it is registered.

render, last_render, view_layer, scene_data : own panels; built_in : Blender's; presets : of sampling; shared : what
they have in common. Those of comparisons and of the ray inspector are with them. Imports bpy.
"""

from __future__ import annotations

import bpy

from . import built_in, last_render, presets, render, scene_data, view_layer

# In the order of each tab.
CLASSES = (*presets.CLASSES, *render.CLASSES, *last_render.CLASSES, *view_layer.CLASSES, *scene_data.CLASSES)

register_classes, unregister_classes = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    """Add the panels and join the built-in ones."""
    presets.register_path()
    register_classes()
    built_in.join()


def unregister() -> None:
    """Leave the built-in panels and take the own ones out."""
    built_in.leave()
    unregister_classes()
    presets.unregister_path()
