"""The settings of the scanner, kept in the .blend as `Scene.reference_raytracer_scan`."""

from __future__ import annotations

import math
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty

SCANNERS = (
    ("CAMERA", "Camera", "Scan from the scene's camera, around the direction that it looks in", "CAMERA_DATA", 0),
    (
        "ACTIVE",
        "Active Object",
        "Scan from the origin of the active object, around its Z axis, starting from its Y axis; "
        "the object itself is not scanned",
        "OBJECT_ORIGIN",
        1,
    ),
)
SCANNED = (
    (
        "VIEWPORT",
        "Viewport",
        "Scan the meshes in the viewport. Rays pass point clouds, hair and volumes",
    ),
    ("RENDER", "Render", "Scan the meshes that renders show. Objects disabled in the viewport are left out"),
    (
        "CAMERA",
        "Camera",
        "Scan the meshes that cameras see in renders. Objects disabled in the viewport are left out",
    ),
)


def angle(name: str, description: str, default: float, most: float) -> Any:
    """Return an angle of the pattern, shown in degrees."""
    return FloatProperty(
        name=name,
        description=description,
        default=math.radians(default),
        min=-math.radians(most),
        max=math.radians(most),
        subtype="ANGLE",
    )


class ReferenceRaytracerScan(bpy.types.PropertyGroup):
    """The scanner, its pattern and its range."""

    scanner: EnumProperty(  # type: ignore[valid-type]
        name="Scan From", description="Where the scanner stands", items=SCANNERS, default="CAMERA"
    )
    visibility: EnumProperty(  # type: ignore[valid-type]
        name="Visible In", description="Which objects are scanned", items=SCANNED, default="VIEWPORT"
    )
    collection: PointerProperty(  # type: ignore[valid-type]
        name="Collection",
        description="Scan only the objects of this collection, including its children. Leave empty to scan everything",
        type=bpy.types.Collection,
    )
    field: FloatProperty(  # type: ignore[valid-type]
        name="Horizontal Field",
        description="How far the scanner turns, half of it to either side. 360° scans all around",
        default=math.tau,
        min=0.0,
        max=math.tau,
        subtype="ANGLE",
    )
    lowest: angle("Lowest Elevation", "Elevation of the lowest row of rays; the horizon is 0°", -25.0, 90.0)  # type: ignore[valid-type]
    highest: angle("Highest Elevation", "Elevation of the highest row of rays; the horizon is 0°", 15.0, 90.0)  # type: ignore[valid-type]
    columns: IntProperty(  # type: ignore[valid-type]
        name="Columns", description="Number of rays in each row", default=900, min=1, soft_max=4096, max=100_000
    )
    rows: IntProperty(  # type: ignore[valid-type]
        name="Rows", description="Number of rows, the rings of the scanner", default=32, min=1, soft_max=128, max=10_000
    )
    near: FloatProperty(  # type: ignore[valid-type]
        name="Nearest",
        description="Surfaces closer than this are passed through",
        default=0.0,
        min=0.0,
        subtype="DISTANCE",
    )
    distance: FloatProperty(  # type: ignore[valid-type]
        name="Farthest", description="Range of the scanner", default=100.0, min=0.0, soft_max=1000.0, subtype="DISTANCE"
    )
    echoes: IntProperty(  # type: ignore[valid-type]
        name="Echoes",
        description="Number of surfaces that each ray returns. 1 returns the first; more also see what lies behind",
        default=1,
        min=1,
        soft_max=8,
        max=64,
    )
    noise: FloatProperty(  # type: ignore[valid-type]
        name="Noise",
        description="Standard deviation of the measured distance. 0 measures exactly",
        default=0.0,
        min=0.0,
        soft_max=0.1,
        precision=4,
        subtype="DISTANCE",
    )
    seed: IntProperty(name="Seed", description="Change this to get other noise", default=0, min=0)  # type: ignore[valid-type]
    radius: FloatProperty(  # type: ignore[valid-type]
        name="Point Radius",
        description="Size of the points in renders. 0 leaves bare vertices, which renders do not show",
        default=0.01,
        min=0.0,
        soft_max=0.1,
        precision=4,
        subtype="DISTANCE",
    )
    animation: BoolProperty(  # type: ignore[valid-type]
        name="Animation",
        description="Scan every frame of the scene's frame range. Each frame gets points of its own, shown only then",
        default=False,
    )


def register() -> None:
    """Add the settings to scenes."""
    bpy.utils.register_class(ReferenceRaytracerScan)
    bpy.types.Scene.reference_raytracer_scan = PointerProperty(
        type=ReferenceRaytracerScan, name="Scanner", description="Settings of the range scanner"
    )


def unregister() -> None:
    """Take them out."""
    del bpy.types.Scene.reference_raytracer_scan
    bpy.utils.unregister_class(ReferenceRaytracerScan)
