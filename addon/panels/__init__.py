"""The engine's panels, by tab, and the built-in ones that it joins while it is registered.

render, bake, last_render, view_layer, scene_data, camera : own panels; built_in : Blender's; presets : of sampling;
shared : what they have in common. Those of comparisons and of the ray inspector are with them.
"""

from .registration import CLASSES, register, unregister

__all__ = ["CLASSES", "register", "unregister"]
