"""Commands: `python -m addon`, and `blender --command raytracer` in the installed extension.

In: arguments. Out: pictures, numbers, one line for an error. Nothing here imports bpy before a command runs.
"""
