"""What the tests of the viewport and of what extraction keeps share: two planes, regions, spaces and views."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np

from tests.addon.engine.engine_fixtures import add_plane, make_stage

WIDTH, HEIGHT = 300, 200


def make_two_planes(empty_scene: Any) -> Any:
    """Return the scene with a red plane left of a green one, in a picture of 24 x 16."""
    make_stage(empty_scene)
    add_plane(empty_scene.collection, "Red", (0.75, 0.125, 0.0), (-12.0, 0.0), (-8.0, 8.0))
    add_plane(empty_scene.collection, "Green", (0.0, 0.5, 0.25), (0.0, 12.0), (-8.0, 8.0))
    return empty_scene


def update() -> Any:
    """Return the depsgraph, up to date."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    depsgraph.update()
    return depsgraph


def make_region(width: int = WIDTH, height: int = HEIGHT) -> Any:
    return SimpleNamespace(width=width, height=height)


def look_through(
    camera: Any, width: int, height: int, zoom: float = 1.0, offset: tuple[float, float] = (0.0, 0.0)
) -> Any:
    """Return a region's data in camera view, by Blender's own projection matrix of a camera.

    zoom and offset move the picture as those of a viewport do: x -> zoom x + offset in the region's coordinates.
    """
    depsgraph = update()
    matrix = np.array(camera.calc_matrix_camera(depsgraph, x=width, y=height), dtype=np.float64)
    matrix[:2] *= zoom
    matrix[:2] += np.outer(offset, matrix[3])
    view = np.array(camera.matrix_world.inverted(), dtype=np.float64)
    return SimpleNamespace(window_matrix=matrix, view_matrix=view, view_perspective="CAMERA")


def make_space(**fields: Any) -> Any:
    standard = {
        "use_local_camera": False,
        "camera": None,
        "use_render_border": False,
        "clip_start": 0.1,
        "clip_end": 50.0,
    }
    borders = {
        "render_border_min_x": 0.0,
        "render_border_min_y": 0.0,
        "render_border_max_x": 1.0,
        "render_border_max_y": 1.0,
    }
    return SimpleNamespace(**{**standard, **borders, **fields})


def project(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return where a projection matrix puts points of camera space, (n, 2), -1 to 1 over the region."""
    clip = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ matrix.T
    return clip[:, :2] / clip[:, 3:]
