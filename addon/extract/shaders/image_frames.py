"""Image sequences and movies: which frame an image texture shows, and that frame, loaded for reading.

In the background Blender loads no frame of a sequence by itself: its pixels cannot be asked for. Each frame is loaded
as an image of its own, for as long as it is read. Of a movie `Image.pixels` gives the frame that was loaded last, and
what loads a frame of one's choice, without a window, is a Texture that is evaluated.

References
----------
Blender, source/blender/blenkernel/intern/image.cc (BKE_image_user_frame_get): frames, start, offset, cyclic;
image_acquire_ibuf: without an ImageUser the last frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy


def find_frame(user: Any, scene_frame: int) -> int:
    """Return the number of the frame that an ImageUser shows at a frame of the scene."""
    if user.frame_duration == 0:
        return 0
    frame = scene_frame - user.frame_start + 1
    if user.use_cyclic:
        frame = (frame - 1) % user.frame_duration + 1
    return int(min(max(frame, 0), user.frame_duration) + user.frame_offset)


def find_path(image: Any, user: Any, scene_frame: int) -> str:
    """Return the path of the file that an evaluated image texture shows of a sequence; its user is told the frame."""
    user.frame_current = find_frame(user, scene_frame)
    return str(image.filepath_from_user(image_user=user))


@contextmanager
def open_frame(image: Any, path: str) -> Iterator[Any]:
    """Give a file as an image with the settings of the sequence that it belongs to, or None where it is missing."""
    try:
        loaded = bpy.data.images.load(path, check_existing=False)
    except RuntimeError:  # Blender's word for a file that cannot be read
        yield None
        return
    try:
        loaded.colorspace_settings.name = image.colorspace_settings.name
        loaded.alpha_mode = image.alpha_mode
        yield loaded
    finally:
        bpy.data.images.remove(loaded)


@contextmanager
def open_movie(image: Any, frame: int) -> Iterator[Any]:
    """Give a copy of a movie that has one of its frames loaded, those before the first and after the last as these."""
    copy, texture = image.original.copy(), bpy.data.textures.new("Frame", type="IMAGE")
    try:
        texture.image, texture.image_user.frame_current = copy, frame
        texture.evaluate((0.0, 0.0, 0.0))
        yield copy
    finally:
        bpy.data.textures.remove(texture)
        bpy.data.images.remove(copy)
