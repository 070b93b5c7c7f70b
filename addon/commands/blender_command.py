"""`blender --command raytracer ...`: the commands of `python -m addon` inside the Blender application.

    blender --command raytracer render scene.blend -o image.png
    blender --command raytracer compare scene.blend --with cycles

The exit code is 0 only on success; an error is one line on standard error.
"""

from __future__ import annotations

from typing import Any

import bpy

NAME = "raytracer"

_handle: Any = None


def run(argv: list[str]) -> int:
    """Run a command (Blender's callback); return the exit code."""
    from .command_line import INSTALLED_COMMANDS, main

    try:
        return main(argv, f"blender --command {NAME}", INSTALLED_COMMANDS)
    except SystemExit as error:  # what argparse does for --help and wrong arguments
        return error.code if isinstance(error.code, int) else 1


def register() -> None:
    """Add the command."""
    global _handle
    _handle = bpy.utils.register_cli_command(NAME, run)


def unregister() -> None:
    """Take it out."""
    bpy.utils.unregister_cli_command(_handle)
