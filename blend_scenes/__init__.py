"""Small scenes, each showing one thing; `python -m blend_scenes.make_all` rebuilds them."""

import bpy  # noqa: F401 - first: only then does Python find the bmesh of Blender's wheel
