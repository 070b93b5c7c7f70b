"""Comparisons in Blender's window: with Cycles and with Scene.ray_cast, as operators and panels.

job : a process of its own that computes (`compare.child`), so that nothing of the user's changes and Esc ends it;
session : the outcome; heat_map : its picture; operators, properties, panels : what the user touches.
"""

from .registration import register, unregister

__all__ = ["register", "unregister"]
