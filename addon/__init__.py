"""The Blender side of the Reference Ray Tracer: a render engine, its panels and a command line.

The package itself imports nothing, so that `python -m addon --help` answers without Blender; `register` brings the
modules in, and so does the first use of `ray_cast`. Inside the package imports are relative: Blender installs it under
a name of its own.
"""

import atexit
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .casting import ray_cast

__all__ = ["ray_cast", "register", "unregister"]


def __getattr__(name: str) -> Any:
    """Bring in `ray_cast`, and with it NumPy and the ray tracer, when it is first asked for."""
    if name == "ray_cast":
        from .casting import ray_cast

        return ray_cast
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def register() -> None:
    """Add the render engine, its settings and its panels to Blender."""
    from . import cli, comparing, engine, inspector, panels, properties

    properties.register()
    engine.register()
    panels.register()
    inspector.register()
    comparing.register()
    cli.register()
    atexit.register(_leave)


def unregister() -> None:
    """Take out everything that `register` added."""
    from . import cli, comparing, engine, inspector, panels, properties
    from .casting import held

    atexit.unregister(_leave)
    held.unregister()
    cli.unregister()
    comparing.unregister()
    inspector.unregister()
    panels.unregister()
    engine.unregister()
    properties.unregister()


def _leave() -> None:
    """End what runs, at Python's end. Blender 4.2 crashes and 4.5 hangs there while a render engine is registered; the
    Blender application has already let go of all classes."""
    from .comparing import operators
    from .engine import ReferenceRaytracerEngine

    operators.end_process()
    if ReferenceRaytracerEngine.is_registered:
        unregister()
