"""Stereoscopy: the views of a frame, and where each looks from. A frame without it has one view, without a name.

References
----------
Blender, source/blender/blenkernel/intern/camera.cc: BKE_camera_multiview_render, BKE_camera_multiview_model_matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import raytracer

from ..extract.camera import read_camera, remove_scale
from ..extract.warnings import Warning, WarningList


def list_views(scene: Any) -> tuple[str, ...]:
    """Return the names of the views that a frame of a scene has; ('',) without stereoscopy."""
    if not scene.render.use_multiview:
        return ("",)
    known = {"left", "right"} if scene.render.views_format == "STEREO_3D" else None
    return tuple(view.name for view in scene.render.views if view.use and (known is None or view.name in known))


def count_pictures(scene: Any) -> int:
    """Return how many view layers a frame of `scene` has, each of their stereo views counted."""
    return sum(view_layer.use for view_layer in scene.view_layers) * len(list_views(scene))


def find_view(engine: Any, scene: Any) -> str:
    """Return the stereo view that is being rendered; '' without stereoscopy."""
    return engine.active_view_get() if scene.render.use_multiview else ""


def look_from_view(engine: Any, view: str, scene: Any, traced: raytracer.Scene) -> raytracer.Scene:
    """Return the scene to trace with the camera of a view in place of its own."""
    if not view:
        return traced
    engine.active_view_set(view)
    middle = engine.camera_override or scene.camera
    seen_from = find_camera(scene, view, middle)
    camera = read_camera(seen_from, scene.render, WarningList()) if seen_from != middle else traced.camera
    assert camera is not None
    if seen_from.type == "CAMERA":
        panorama = camera.panorama
        turns = panorama is not None and engine.use_spherical_stereo(seen_from)
        matrix = np.array(engine.camera_model_matrix(seen_from, use_spherical_stereo=turns), dtype=np.float64)
        shift = float(engine.camera_shift_x(seen_from))
        camera = replace(camera, world_from_camera=remove_scale(matrix, seen_from.name), shift_x=shift)
        if panorama is not None and turns:
            camera = replace(camera, panorama=replace(panorama, **read_eye(seen_from.data.stereo, view)))
    return replace(traced, camera=camera)


def read_eye(stereo: Any, view: str) -> dict[str, Any]:
    """Return the fields of a Panorama whose eye turns with the direction it looks in; views but of two eyes have none.

    References: intern/cycles/blender/camera.cpp, scene/camera.cpp (kcam->interocular_offset).
    """
    fields: dict[str, Any] = {"eye_offset": {"left": -0.5, "right": 0.5}.get(view, 0.0) * stereo.interocular_distance}
    if stereo.convergence_mode != "PARALLEL":
        fields["convergence"] = stereo.convergence_distance
    if stereo.use_pole_merge:
        fields["pole_merge"] = (stereo.pole_merge_angle_from, stereo.pole_merge_angle_to)
    return fields


def find_camera(scene: Any, view: str, middle: Any = None) -> Any:
    """Return the camera of a view: `middle`, or else the scene's; of several cameras, the one whose name ends with the
    view's suffix where that one's ends with another's."""
    camera, views = middle or scene.camera, scene.render.views
    if scene.render.views_format != "MULTIVIEW":
        return camera
    for other in views:
        if other.camera_suffix and camera.name.endswith(other.camera_suffix):
            name = camera.name.removesuffix(other.camera_suffix) + views[view].camera_suffix
            return scene.objects.get(name, camera)
    return camera


def find_unsupported(scene: Any, passes: Sequence[str]) -> list[Warning]:
    """Return warnings of what a view layer with these passes does not show in stereo: eyes that turn with the direction
    they look in but for panoramas, and motion."""
    camera, warnings = scene.camera, []
    if not scene.render.use_multiview:
        return []
    if "Vector" in passes:
        warnings.append(Warning("The Vector pass is not supported with stereoscopy: it is 0"))
    is_plain = camera is not None and camera.type == "CAMERA" and camera.data.type == "PERSP"
    if is_plain and camera.data.stereo.use_spherical_stereo:
        text = "Spherical Stereo is supported for panoramas only: both eyes keep their places"
        warnings.append(Warning(text, camera.name))
    return warnings
