"""Scan a scene from its window: an operator and a panel over `scripting.scan`, in the sidebar of the 3D view.

properties : the scanner's settings, kept with the scene; operators, panels : what the user touches.
"""

from .registration import register, unregister

__all__ = ["register", "unregister"]
