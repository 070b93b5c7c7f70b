"""Comparison with Cycles, by pictures and passes.

In: a scene. Out: how far apart both engines' pixels are: `rendering` and `exr` get them, `metrics` and `flip` measure.
"""
