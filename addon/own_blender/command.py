"""How to run scripts in a Blender of their own: this application, or Python where bpy is a module."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy

CHILD = Path(__file__).with_name("child.py")


def list_command(script: Path) -> list[str]:
    """Return the command that runs a script; its arguments follow."""
    if bpy.app.binary_path:
        return [bpy.app.binary_path, "-b", "--factory-startup", "-noaudio", "-P", str(script), "--"]
    return [sys.executable, str(script)]


def list_orders_command(module: str, folder: Path) -> list[str]:
    """Return the command of a process that carries out orders by a module, 'voxels.sampling' say, in a folder."""
    return [*list_command(CHILD), module, str(folder)]
