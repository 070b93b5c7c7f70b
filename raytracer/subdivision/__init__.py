"""Adaptive subdivision: meshes of polygons diced to triangles as small as a camera asks, on their limit surface.

`cage` holds the polygons, `catmull_clark` refines them, `limit` evaluates what they tend to, `dicing` cuts triangles,
`pixel_size` says how large a pixel is in the world, and `diced` puts a mesh together.
"""
