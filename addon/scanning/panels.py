"""The sidebar tab "Scan" of the 3D view; it is there with any render engine."""

# ruff: noqa: N801  (Blender prescribes the form of class names and attributes)

from __future__ import annotations

from typing import Any

import bpy

from ..together import make_registrars


class _ScanPanel:
    """A panel of the tab."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Scan"

    def make_column(self, context: Any) -> tuple[Any, Any]:
        """Return a column with names on the left, and the settings."""
        layout = self.layout  # type: ignore[attr-defined]
        layout.use_property_split, layout.use_property_decorate = True, False
        return layout.column(), context.scene.reference_raytracer_scan


class VIEW3D_PT_raytracer_scan(_ScanPanel, bpy.types.Panel):
    """Where the scanner stands, and the button."""

    bl_label = "Range Scan"

    def draw(self, context: Any) -> None:
        column, settings = self.make_column(context)
        column.prop(settings, "scanner")
        column.prop(settings, "visibility")
        column.prop(settings, "collection")
        column.separator()
        column.prop(settings, "animation")
        text = "Scan Animation" if settings.animation else "Scan"
        column.operator("raytracer.scan", text=text, icon="OUTLINER_DATA_POINTCLOUD")


class VIEW3D_PT_raytracer_scan_pattern(_ScanPanel, bpy.types.Panel):
    """The rays of the scanner."""

    bl_label = "Pattern"
    bl_parent_id = "VIEW3D_PT_raytracer_scan"

    def draw(self, context: Any) -> None:
        column, settings = self.make_column(context)
        column.prop(settings, "field")
        angles = column.column(align=True)
        angles.prop(settings, "lowest", text="Elevation Min")
        angles.prop(settings, "highest", text="Max")
        counts = column.column(align=True)
        counts.prop(settings, "columns")
        counts.prop(settings, "rows")
        column.label(text=f"{settings.columns * settings.rows:,} rays")


class VIEW3D_PT_raytracer_scan_returns(_ScanPanel, bpy.types.Panel):
    """What the scanner measures."""

    bl_label = "Range"
    bl_parent_id = "VIEW3D_PT_raytracer_scan"

    def draw(self, context: Any) -> None:
        column, settings = self.make_column(context)
        limits = column.column(align=True)
        limits.prop(settings, "near")
        limits.prop(settings, "distance")
        column.prop(settings, "echoes")
        column.prop(settings, "noise")
        seed = column.column()
        seed.active = settings.noise > 0
        seed.prop(settings, "seed")
        column.prop(settings, "radius")


CLASSES = (VIEW3D_PT_raytracer_scan, VIEW3D_PT_raytracer_scan_pattern, VIEW3D_PT_raytracer_scan_returns)

register, unregister = make_registrars(CLASSES)
