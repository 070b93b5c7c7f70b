"""Noise taken out of a finished picture by OpenImageDenoise, as Blender's compositor offers it.

Blender has no other door to it, and renders nothing else while an engine renders; so a Blender process of its own does
it: `process` holds that process, `compositor` is the scene of nodes in it.
"""
