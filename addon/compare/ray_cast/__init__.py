"""Comparison with Scene.ray_cast, by hits.

In: a scene. Out: who is right, in exact arithmetic: `rays` aims, `sides` casts with both, `judge` decides.
"""
