"""The Blender side of the Reference Ray Tracer: a render engine, its panels and a command line.

The package itself imports nothing, so that `python -m addon --help` answers without Blender; `register` brings the
modules in. Inside the package imports are relative: Blender installs it under a name of its own.
"""

import atexit


def register() -> None:
    """Add the render engine, its settings and its panels to Blender."""
    from . import engine, panels, properties

    properties.register()
    engine.register()
    panels.register()
    # Blender 4.2 crashes and 4.5 hangs when Python ends while a render engine is registered.
    atexit.register(unregister)


def unregister() -> None:
    """Take out everything that `register` added."""
    from . import engine, panels, properties

    atexit.unregister(unregister)
    panels.unregister()
    engine.unregister()
    properties.unregister()
