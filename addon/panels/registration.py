"""Adds the panels to Blender, joins the built-in ones, and takes all of that out."""

from __future__ import annotations

from .. import versions
from ..together import make_registrars
from . import (
    bake,
    built_in,
    camera,
    curves,
    last_render,
    linking,
    motion_blur,
    presets,
    render,
    resume,
    scene_data,
    subdivision,
    view_layer,
)

# In the order of each tab.
CLASSES = (
    *(*presets.CLASSES, *render.CLASSES, *bake.CLASSES, *last_render.CLASSES, *view_layer.CLASSES, *scene_data.CLASSES),
    *(*linking.CLASSES, *camera.CLASSES, *motion_blur.CLASSES, *curves.CLASSES, *subdivision.CLASSES, *resume.CLASSES),
)

register_classes, unregister_classes = make_registrars(CLASSES)


def register() -> None:
    """Add the panels and join the built-in ones."""
    register_classes()
    versions.register_presets(presets.HOME)
    last_render.register()
    resume.register()
    built_in.join()


def unregister() -> None:
    """Leave the built-in panels and take the own ones out."""
    built_in.leave()
    resume.unregister()
    last_render.unregister()
    versions.unregister_presets(presets.HOME)
    unregister_classes()
