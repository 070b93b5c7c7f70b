"""The render engine: what Blender's render operator touches.

In: F12, previews, animations. Out: passes in the render result, progress, warnings and the numbers of the last render.
"""
