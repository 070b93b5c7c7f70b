"""Comparisons: with Cycles by pictures and passes, with Blender's ray_cast by hits.

In: a scene. Out: numbers, pictures of differences, verdicts. `window` shows them in Blender; `child` computes them in a
process of its own.
"""
