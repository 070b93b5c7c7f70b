"""Blender's evaluated scene to raytracer.Scene: the border that everything crosses on its way in.

In: a depsgraph. Out: an Extraction, with warnings for what is not honored. `scene` puts together what camera, world,
lights, meshes, instances and shaders each read; nothing here imports bpy but by `addon.versions`.
"""
