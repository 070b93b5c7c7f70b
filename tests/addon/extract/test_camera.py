"""Primary rays against Blender's own camera: the view frame and the projection matrix, which are float32."""

import itertools
from typing import Any

import bpy
import numpy as np
import pytest

from addon.extract.camera import extract_camera
from addon.extract.scene import extract_scene
from addon.extract.warnings import WarningList
from raytracer.film.camera import primary_rays
from raytracer.scene.camera import Camera

pytestmark = pytest.mark.blender

# The matrix and the frame come from float32 chains of about 8 operations.
FLOAT32_CHAIN = 8 * np.finfo(np.float32).eps

SIZES = [(640, 480), (480, 640), (500, 500), (1000, 37)]
ASPECTS = [(1.0, 1.0), (1.5, 1.0), (1.0, 2.25)]
FITS = ["AUTO", "HORIZONTAL", "VERTICAL"]
SHIFTS = [(0.0, 0.0), (0.3, -0.7)]


@pytest.fixture
def blender_camera():
    """A camera object of its own in the current scene, away from the origin and turned."""
    data = bpy.data.cameras.new("test camera")
    camera = bpy.data.objects.new("test camera", data)
    bpy.context.scene.collection.objects.link(camera)
    camera.location = (1.0, 2.0, 3.0)
    camera.rotation_euler = (0.5, 0.25, 1.0)
    data.sensor_width, data.sensor_height, data.lens, data.ortho_scale = 30.0, 20.0, 35.0, 7.0
    data.clip_start, data.clip_end = 0.25, 50.0
    yield camera
    bpy.data.objects.remove(camera)
    bpy.data.cameras.remove(data)


def set_up(camera, kind, fit, aspect, shift) -> Camera:
    """Give both cameras the same settings."""
    data, render = camera.data, bpy.context.scene.render
    data.type, data.sensor_fit = kind, fit
    data.shift_x, data.shift_y = shift
    render.pixel_aspect_x, render.pixel_aspect_y = aspect
    return Camera(
        world_from_camera=np.eye(4),
        projection={"PERSP": "perspective", "ORTHO": "orthographic"}[kind],
        focal_length=data.lens,
        sensor_width=data.sensor_width,
        sensor_height=data.sensor_height,
        sensor_fit=fit.lower(),
        ortho_scale=data.ortho_scale,
        shift_x=data.shift_x,
        shift_y=data.shift_y,
        clip_start=data.clip_start,
        clip_end=data.clip_end,
        pixel_aspect=render.pixel_aspect_x / render.pixel_aspect_y,
    )


def corner_points(camera: Camera, width: int, height: int, depth: float) -> np.ndarray:
    """(4, 3) points at `depth` in camera space, counter-clockwise from the lower left corner of the picture."""
    x, y = np.array([0.0, width, width, 0.0]), np.array([0.0, 0.0, height, height])
    rays = primary_rays(camera, width, height, x, y)
    return rays.origins + depth * rays.directions


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize("fit", FITS)
def test_corners_project_to_the_corners_of_blenders_picture(blender_camera, kind, fit):
    for (width, height), aspect, shift in itertools.product(SIZES, ASPECTS, SHIFTS):
        camera = set_up(blender_camera, kind, fit, aspect, shift)
        projection = np.array(
            blender_camera.calc_matrix_camera(
                bpy.context.evaluated_depsgraph_get(), x=width, y=height, scale_x=aspect[0], scale_y=aspect[1]
            ),
            dtype=np.float64,
        )
        for depth, plane in ((camera.clip_start, -1.0), (camera.clip_end, 1.0)):
            points = np.concatenate([corner_points(camera, width, height, depth), np.ones((4, 1))], axis=1)
            clip = points @ projection.T
            # Terms of about this size cancel in the projection, each rounded to float32.
            size = (np.abs(points) @ np.abs(projection).T)[:, :3] / clip[:, 3:]
            expected = [[-1, -1, plane], [1, -1, plane], [1, 1, plane], [-1, 1, plane]]
            assert (np.abs(clip[:, :3] / clip[:, 3:] - expected) <= FLOAT32_CHAIN * size).all()


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize("fit", FITS)
def test_corners_lie_on_blenders_view_frame(blender_camera, kind, fit):
    render = bpy.context.scene.render
    before = render.resolution_x, render.resolution_y
    for (width, height), aspect, shift in itertools.product(SIZES, ASPECTS, SHIFTS):
        camera = set_up(blender_camera, kind, fit, aspect, shift)
        render.resolution_x, render.resolution_y = width, height
        frame = np.array(blender_camera.data.view_frame(scene=bpy.context.scene), dtype=np.float64)
        # Blender lists upper right, lower right, lower left, upper left.
        frame = frame[[2, 1, 0, 3]]
        points = corner_points(camera, width, height, -frame[0, 2])
        assert np.allclose(points, frame, rtol=0, atol=FLOAT32_CHAIN * np.abs(frame).max())
    render.resolution_x, render.resolution_y = before


def test_panorama_is_read_with_its_lens(scene_with_camera: Any) -> None:
    lens = scene_with_camera.camera.data
    lens.type, lens.panorama_type, lens.shift_x = "PANO", "FISHEYE_EQUISOLID", 0.25
    lens.fisheye_fov, lens.fisheye_lens, lens.longitude_min = 2.0, 12.0, -1.5
    warnings = WarningList()
    camera = extract_camera(scene_with_camera, warnings)
    assert not warnings._records
    assert (camera.projection, camera.shift_x) == ("panorama", 0.25)
    panorama = camera.panorama
    assert panorama is not None
    assert (panorama.kind, panorama.field_of_view, panorama.lens) == ("fisheye_equisolid", 2.0, 12.0)
    assert panorama.longitude == (-1.5, np.float32(np.pi))
    lens.type = "PERSP"
    assert extract_camera(scene_with_camera, warnings).panorama is None


@pytest.mark.parametrize("kind", ["SPOT", "POINT", "SUN", "AREA"])
def test_a_light_as_camera_has_blenders_view(scene_with_camera: Any, kind: str) -> None:
    light = bpy.data.lights.new("Light", kind)
    if kind == "SPOT":
        light.spot_size = 1.0
    holder = bpy.data.objects.new("Light", light)
    scene_with_camera.collection.objects.link(holder)
    scene_with_camera.camera = holder
    depsgraph = bpy.context.evaluated_depsgraph_get()
    expected = holder.calc_matrix_camera(depsgraph, x=200, y=100)[0][0]
    camera = extract_camera(depsgraph.scene_eval, WarningList())
    assert 2.0 * camera.focal_length / camera.sensor_width == pytest.approx(expected, rel=1e-5)


def test_a_spot_light_of_180_degrees_as_camera_has_cycles_view(scene_with_camera: Any) -> None:
    """Half of its cone has, in float32, a tangent below 0: Cycles then keeps the lens of objects that are no lights."""
    light = bpy.data.lights.new("Light", "SPOT")
    light.spot_size = np.pi
    scene_with_camera.camera = bpy.data.objects.new("Light", light)
    scene_with_camera.collection.objects.link(scene_with_camera.camera)
    assert extract_camera(scene_with_camera, WarningList()).focal_length == 50.0


def test_a_camera_at_no_place_is_told_so(scene_with_camera: Any) -> None:
    scene_with_camera.camera.location.x = np.nan
    with pytest.raises(ValueError, match="Camera 'Camera' has a matrix with NaN or infinite numbers"):
        extract_camera(bpy.context.evaluated_depsgraph_get().scene_eval, WarningList())


@pytest.mark.parametrize("scale", [0.0, np.nan])
def test_a_camera_without_scale_ends_only_what_is_seen_through_it(shown: Any, scale: float) -> None:
    """It ended views and bakes that do not look through it, too."""
    bpy.context.scene.camera.scale = (scale, scale, scale)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    areas = [area for screen in bpy.data.screens for area in screen.areas if area.type == "VIEW_3D"]
    seen = [extract_scene(depsgraph, space=areas[0].spaces.active), extract_scene(depsgraph, needs_camera=False)]
    for extraction in seen:
        assert len(extraction.scene.meshes) == 1
        assert not extraction.warnings
    with pytest.raises(ValueError, match="Camera 'Camera' has a"):
        extract_scene(depsgraph)


@pytest.mark.parametrize(("transparent", "glass"), [(True, True), (True, False), (False, True)])
def test_glass_that_shall_be_transparent_is_named(scene_with_camera: Any, transparent: bool, glass: bool) -> None:
    scene_with_camera.render.film_transparent = transparent
    scene_with_camera.cycles.film_transparent_glass = glass
    found = extract_scene(bpy.context.evaluated_depsgraph_get()).warnings
    assert ["Transparent Glass" in warning.text for warning in found] == [True] * (transparent and glass)
