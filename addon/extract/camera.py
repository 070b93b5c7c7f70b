"""Blender's camera to raytracer.Camera.

Cycles' reading of a camera is followed (`intern/cycles/blender/camera.cpp`): scale is removed from the matrix column by
column, any object may serve as camera, a spot light's cone sets the lens.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

import raytracer
from raytracer.film.camera import measure_film_extent

from .warnings import WarningList

PROJECTIONS = {"PERSP": "perspective", "ORTHO": "orthographic", "PANO": "panorama"}
PANORAMAS = {
    "EQUIRECTANGULAR": "equirectangular",
    "EQUIANGULAR_CUBEMAP_FACE": "cube_face",
    "MIRRORBALL": "mirror_ball",
    "FISHEYE_EQUIDISTANT": "fisheye_equidistant",
    "FISHEYE_EQUISOLID": "fisheye_equisolid",
    "FISHEYE_LENS_POLYNOMIAL": "fisheye_polynomial",
    "CENTRAL_CYLINDRICAL": "cylinder",
}

# Cycles' clipping range, and sensor, for objects that are no cameras.
OBJECT_CLIP_START, OBJECT_CLIP_END = 1e-5, 1e5
SPOT_HALF_SENSOR, NEW_CONE, OBJECT_LENS = 16.0, math.radians(45.0), 50.0
MILLIMETRES = 1000.0
# Cycles' limits.
SMALLEST_FSTOP, SMALLEST_FOCUS = 1e-5, 1e-5


def find_camera(depsgraph: Any, seen_from: Any = None) -> Any:
    """Return the evaluated object that a scene is seen from: its camera, or another one; None without any."""
    camera = seen_from or depsgraph.scene_eval.camera
    return camera and camera.evaluated_get(depsgraph)


def extract_camera(scene: Any, warnings: WarningList, seen_from: Any = None) -> raytracer.Camera:
    """Return the active camera of an evaluated scene, or the object that it is seen from in its place.

    Raises
    ------
    ValueError
        If the scene has no camera, or its matrix has no inverse.
    """
    camera = seen_from or scene.camera
    if camera is None:
        raise ValueError(f"Scene '{scene.name}' has no camera: add one, or set one in the scene's properties")
    return read_camera(camera, scene.render, warnings)


def read_camera(camera: Any, render: Any, warnings: WarningList) -> raytracer.Camera:
    """Return an evaluated object as camera of pictures with the pixels of `render`, a scene's RenderSettings.

    Raises
    ------
    ValueError
        If its matrix has no inverse.
    """
    world_from_camera = remove_scale(np.array(camera.matrix_world, dtype=np.float64), camera.name)
    pixel_aspect = render.pixel_aspect_x / render.pixel_aspect_y
    if camera.type != "CAMERA":
        return make_object_camera(camera, world_from_camera, pixel_aspect)
    lens = camera.data
    if lens.type not in PROJECTIONS:
        warnings.add(f"camera type {lens.type} is not supported, rendered as perspective", camera.name)
    return raytracer.Camera(
        world_from_camera,
        projection=PROJECTIONS.get(lens.type, "perspective"),
        focal_length=lens.lens,
        sensor_width=lens.sensor_width,
        sensor_height=lens.sensor_height,
        sensor_fit=lens.sensor_fit.lower(),
        ortho_scale=lens.ortho_scale,
        shift_x=lens.shift_x,
        shift_y=lens.shift_y,
        clip_start=lens.clip_start,
        clip_end=max(lens.clip_end, lens.clip_start),
        pixel_aspect=pixel_aspect,
        panorama=read_panorama(lens) if lens.type == "PANO" else None,
        **(read_aperture(lens, world_from_camera) if lens.dof.use_dof else {}),
    )


def read_panorama(lens: Any) -> raytracer.Panorama:
    """Return how a panoramic camera maps directions to its picture."""
    return raytracer.Panorama(
        PANORAMAS[lens.panorama_type],
        longitude=(lens.longitude_min, lens.longitude_max),
        latitude=(lens.latitude_min, lens.latitude_max),
        field_of_view=lens.fisheye_fov,
        lens=lens.fisheye_lens,
        polynomial=tuple(getattr(lens, f"fisheye_polynomial_k{power}") for power in range(5)),
        cylinder=read_cylinder(lens),
    )


def read_cylinder(lens: Any) -> tuple[float, float, float, float]:
    """Return the longitudes at left and right, and the heights on a cylinder of radius 1, of a central cylinder."""
    if not hasattr(lens, "central_cylindrical_radius"):  # came after 4.2
        return -math.pi, math.pi, -1.0, 1.0
    low, high, radius = (
        getattr(lens, f"central_cylindrical_{name}") for name in ("range_v_min", "range_v_max", "radius")
    )
    left, right = lens.central_cylindrical_range_u_min, lens.central_cylindrical_range_u_max
    return left, right, low / radius, high / radius


def read_aperture(lens: Any, world_from_camera: NDArray[np.float64]) -> dict[str, Any]:
    """Return the Camera's fields for depth of field.

    The aperture's radius is focal length / (2 f-stop); 1 m / (2 f-stop) for an orthographic camera.
    """
    dof = lens.dof
    focal_length = lens.lens / MILLIMETRES if lens.type != "ORTHO" else 1.0
    return {
        "aperture_radius": focal_length / (2.0 * max(dof.aperture_fstop, SMALLEST_FSTOP)),
        "focus_distance": max(find_focus(dof, world_from_camera), SMALLEST_FOCUS),
        "aperture_blades": dof.aperture_blades,
        "aperture_rotation": dof.aperture_rotation,
        "aperture_ratio": dof.aperture_ratio,
    }


def find_focus(dof: Any, world_from_camera: NDArray[np.float64]) -> float:
    """Return the distance of focus along the view axis: of an object, of one of its bones, or as it is set."""
    target = dof.focus_object
    if target is None:
        return float(dof.focus_distance)
    matrix = np.array(target.matrix_world, dtype=np.float64)
    bone = target.pose.bones.get(dof.focus_subtarget) if target.pose and dof.focus_subtarget else None
    if bone is not None:
        matrix = matrix @ np.array(bone.matrix, dtype=np.float64)
    return float(abs(world_from_camera[:3, 2] @ (world_from_camera[:3, 3] - matrix[:3, 3])))


def make_object_camera(view: Any, world_from_camera: NDArray[np.float64], pixel_aspect: float) -> raytracer.Camera:
    """Return the camera that looks along the -z axis of an object that is none; a spot light shows its cone, other
    lights that of a new one, for Blender keeps an angle in every light and shows it to Python in spots alone.

    The half of 180 degrees in float32 is more than a right angle, of a tangent below 0: no lens, for Cycles either.
    """
    cone = getattr(view.data, "spot_size", NEW_CONE) if view.type == "LIGHT" else 0.0
    focal_length = SPOT_HALF_SENSOR / math.tan(cone / 2) if cone else OBJECT_LENS
    if focal_length <= 0:
        focal_length = OBJECT_LENS
    return raytracer.Camera(
        world_from_camera,
        focal_length=focal_length,
        clip_start=OBJECT_CLIP_START,
        clip_end=OBJECT_CLIP_END,
        pixel_aspect=pixel_aspect,
    )


def remove_scale(matrix: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Return (4, 4) `matrix` with each of its three axes scaled to unit length, in float64.

    Raises
    ------
    ValueError
        If an axis has no length or is not finite.
    """
    if not np.isfinite(matrix).all():
        raise ValueError(
            f"Camera '{name}' has a matrix with NaN or infinite numbers and sees nothing so: look at its location, "
            "rotation and scale, and at what drives them"
        )
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    if not (lengths > 0).all():
        scale = ", ".join(f"{length:.3g}" for length in lengths)
        raise ValueError(
            f"Camera '{name}' has a scale of ({scale}) and sees nothing so: set the scale of the object, "
            "and of its parents, to 1 along all axes"
        )
    unscaled = matrix.copy()
    unscaled[:3, :3] /= lengths
    unscaled[3] = (0.0, 0.0, 0.0, 1.0)
    return unscaled


def make_camera_motion(cameras: list[Any]) -> raytracer.CameraMotion | None:
    """Return the motion of cameras, one for each step; None where they are all the same."""
    if not cameras:
        return None
    matrices = np.array([camera.world_from_camera for camera in cameras])
    ends = cameras[0], cameras[len(cameras) // 2], cameras[-1]
    extents = np.array([measure_film_extent(camera) for camera in ends])
    zooms = ends[1].projection == "perspective" and bool((extents != extents[1]).any())
    if (matrices == matrices[0]).all() and not zooms:
        return None
    return raytracer.CameraMotion(matrices, extents / extents[1] if zooms else None)
