"""Voxels of Blender's volumes, which Python cannot read everywhere: `bpy` says a grid's name and matrix, no values.

Geometry nodes can: Blender writes the volume to a file, and a Blender process of its own samples it there at each
voxel. So nothing is added to the user's file, whose render may run in a thread. `process` holds that process,
`sampling` is the scene of nodes in it.
"""
