"""The Blender side of the Reference Ray Tracer: a render engine, its panels and a command line.

The package itself imports nothing, so that `python -m addon --help` answers without Blender; `register` brings the
modules in, and so does the first use of `ray_cast`. Inside the package imports are relative: Blender installs it under
a name of its own.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .scripting.ray_cast import ray_cast

__all__ = ["ray_cast", "register", "unregister"]


def __getattr__(name: str) -> Any:
    """Bring in `ray_cast`, and with it NumPy and the ray tracer, when it is first asked for."""
    if name == "ray_cast":
        from .scripting.ray_cast import ray_cast

        return ray_cast
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def register() -> None:
    """Add the render engine, its settings, its panels and its command to Blender."""
    from . import registration
    from .commands import blender_command

    registration.register(blender_command)


def unregister() -> None:
    """Take out everything that `register` added."""
    from . import registration

    registration.unregister()
