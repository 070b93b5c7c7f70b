"""The ray inspector: pick a pixel, see its rays as lines in the 3D view and the lecture's quantities in the sidebar.

session : what was inspected last, as plain records; describe : those as lines of text; segments : as coloured lines;
drawing : the lines in the 3D view; picking : from the mouse to a ray; operators, panels : what the user touches.
Nothing of Blender's data is kept, so undo cannot leave anything dangling; a new file clears it.
"""

from __future__ import annotations

from . import operators, panels, properties, session


def register() -> None:
    """Add operators, their results' properties and panels."""
    properties.register()
    operators.register()
    panels.register()
    session.register()


def unregister() -> None:
    """Take out everything, lines in the 3D view included."""
    session.unregister()
    panels.unregister()
    operators.unregister()
    properties.unregister()
