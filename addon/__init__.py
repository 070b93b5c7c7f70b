"""The Blender side of the Reference Ray Tracer: a render engine, its panels and a command line.

The package itself imports nothing, so that `python -m addon --help` answers without Blender; `register` brings the
modules in, and so does the first use of `ray_cast`, `scan` and the like. Inside the package imports are relative:
Blender installs it under a name of its own.
"""

# As in `typing`, which takes longer to import than all that happens before `python -m addon` minds Ctrl-C.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from .scripting.queries import closest_point, inside, visible
    from .scripting.ray_cast import ray_cast, ray_cast_layers
    from .scripting.scan import scan, scan_frames

__all__ = [
    "closest_point",
    "inside",
    "ray_cast",
    "ray_cast_layers",
    "register",
    "scan",
    "scan_frames",
    "unregister",
    "visible",
]
# What scripts call, and the module of `scripting` that each is in.
FUNCTIONS = {
    "ray_cast": "ray_cast",
    "ray_cast_layers": "ray_cast",
    "closest_point": "queries",
    "inside": "queries",
    "visible": "queries",
    "scan": "scan",
    "scan_frames": "scan",
}


def __getattr__(name: str) -> object:
    """Bring in what scripts call, and with it NumPy and the ray tracer, when it is first asked for."""
    if name in FUNCTIONS:
        from importlib import import_module

        return getattr(import_module(f".scripting.{FUNCTIONS[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def register() -> None:
    """Add the render engine, its settings, its panels and its command to Blender."""
    _forget_replaced_modules()
    from . import registration
    from .commands import blender_command

    registration.register(blender_command)


def _forget_replaced_modules() -> None:
    """Forget the modules of a ray tracer that an update of the extension has replaced: Blender forgets the add-on's own
    and not those of its wheel, each build of which has another version."""
    import sys
    from importlib import import_module
    from pathlib import Path

    loaded = import_module("raytracer")
    installed = sorted(path.name for path in Path(str(loaded.__file__)).parents[1].glob("raytracer-*.dist-info"))
    if vars(loaded).get("_installed", installed) != installed:
        for name in [name for name in sys.modules if name.split(".")[0] == "raytracer"]:
            del sys.modules[name]
    vars(import_module("raytracer"))["_installed"] = installed


def unregister() -> None:
    """Take out everything that `register` added."""
    from . import registration

    registration.unregister()
