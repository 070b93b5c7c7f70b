"""Participating media: how they turn light (`phases`, `mixtures`), which ones a path is inside (`stack`), and where
light is scattered or gets through (`distances`, `tracking`, `majorants`). Their values come from `shading.media`.
"""
