"""The point of a scene that is closest to a point: boxes cull, triangles and spheres are measured with bounds.

`distances` measures, `forest` holds the boxes, `search` walks them.
"""
