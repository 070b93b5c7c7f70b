"""The ray inspector: pick a pixel, see its rays as lines in the 3D view and the lecture's quantities in the sidebar.

session : what was inspected last, as plain records; describe : those as lines of text; segments : as colored lines;
drawing : the lines in the 3D view; picking : from the mouse to a ray; operators, panels : what the user touches.
Nothing of Blender's data is kept, so undo cannot leave anything dangling; a new file clears it.
"""

from .registration import register, unregister

__all__ = ["register", "unregister"]
