"""Rendered shading in the viewport.

In: what Blender tells of regions and changes. Out: pictures in the regions, drawn by a process that Blender never waits
for.
"""
