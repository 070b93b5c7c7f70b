"""Image sequences: which of its frames an image texture shows, and that frame's file, loaded for reading.

In the background Blender loads no frame of a sequence by itself: its pixels cannot be asked for. Each frame is loaded
as an image of its own, for as long as it is read.

References
----------
Blender, source/blender/blenkernel/intern/image.cc (BKE_image_user_frame_get): frames, start, offset, cyclic.
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
