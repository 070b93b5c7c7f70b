"""Commands: `python -m raytracer`, for machines without Blender.

In: files of scenes and films. Out: files of films and pictures.
"""
