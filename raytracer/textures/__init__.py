"""Textures as pure functions of points: images, noise, cells, skies.

In: points (n, 3) or directions, and settings. Out: numbers and colors. Knows nothing of surfaces.
"""
