"""The lens of a panoramic camera: Blender's panel, which the engine joins, shows it to Cycles alone."""

# ruff: noqa: N801, RUF012  (Blender prescribes the form of class names and attributes)

from __future__ import annotations

from typing import Any

import bpy

from .shared import EnginePanel, split

# What kinds of panoramas ask for, in groups of names and labels; the others ask for nothing.
FIELDS = {
    "EQUIRECTANGULAR": (
        (("latitude_min", "Latitude Min"), ("latitude_max", "Max")),
        (("longitude_min", "Longitude Min"), ("longitude_max", "Max")),
    ),
    "FISHEYE_EQUIDISTANT": ((("fisheye_fov", "Field of View"),),),
    "FISHEYE_EQUISOLID": ((("fisheye_lens", "Lens"), ("fisheye_fov", "Field of View")),),
    "FISHEYE_LENS_POLYNOMIAL": (
        (("fisheye_fov", "Field of View"),),
        tuple((f"fisheye_polynomial_k{power}", f"K{power}") for power in range(5)),
    ),
    "CENTRAL_CYLINDRICAL": (
        (("central_cylindrical_range_v_min", "Height Min"), ("central_cylindrical_range_v_max", "Max")),
        (("central_cylindrical_range_u_min", "Longitude Min"), ("central_cylindrical_range_u_max", "Max")),
        (("central_cylindrical_radius", "Cylinder Radius"),),
    ),
}


class RAYTRACER_CAMERA_PT_panorama(EnginePanel, bpy.types.Panel):
    """Which panorama, and how far it looks; below Blender's own lens."""

    bl_label = "Panorama"
    bl_context = "data"
    bl_parent_id = "DATA_PT_lens"
    bl_options = {"HIDE_HEADER"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        camera = context.camera
        return camera is not None and camera.type == "PANO" and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        column, camera = split(self), context.camera
        column.prop(camera, "panorama_type")
        for fields in FIELDS.get(camera.panorama_type, ()):
            group = column.column(align=True)
            for name, label in fields:
                group.prop(camera, name, text=label)


CLASSES = (RAYTRACER_CAMERA_PT_panorama,)
