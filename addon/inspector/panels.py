"""The sidebar tab "Ray", in the 3D view and the image editor."""

# ruff: noqa: N801  (Blender prescribes the form of class names and attributes)

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import bpy

from raytracer.integrator.traced_rays import CAMERA, PASSED, REFLECTED, REFRACTED, TracedRay

from ..properties import ENGINE
from ..together import make_registrars
from . import session
from .describe import Line, describe_dark, describe_hit, describe_ray, describe_shadow

CATEGORY = "Ray"
# Icons in the colors of the lines.
KIND_ICONS = {
    CAMERA: "OUTLINER_OB_CAMERA",
    REFLECTED: "COLORSET_04_VEC",
    REFRACTED: "COLORSET_03_VEC",
    PASSED: "COLORSET_13_VEC",
}
INDENTATION = 1.5  # of a ray under the one that it comes from, in units of Blender's separator
LIT_ICON, BLOCKED_ICON, DARK_ICON = "COLORSET_09_VEC", "COLORSET_01_VEC", "BLANK1"


class RAYTRACER_UL_rays(bpy.types.UIList):
    """The rays of a tree, each indented under the one that it comes from."""

    def draw_item(
        self, context: Any, layout: Any, data: Any, item: Any, icon: int, active_data: Any, active: str, index: int = 0
    ) -> None:
        """Draw a row."""
        row = layout.row(align=True)
        if item.depth:
            row.separator(factor=INDENTATION * item.depth)
        row.label(text=item.name, icon=KIND_ICONS[item.kind])


class _RayPanel:
    """A panel of the tab."""

    bl_region_type = "UI"
    bl_category = CATEGORY
    bl_label = "Ray Inspector"

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.engine == ENGINE

    def draw(self, context: Any) -> None:
        layout, inspected = self.layout, session.find_inspected()  # type: ignore[attr-defined]
        row = layout.row(align=True)
        row.operator("raytracer.inspect_pixel", text="Pick a Pixel", icon="EYEDROPPER")
        row.operator("raytracer.clear_rays", text="", icon="X")
        if inspected is None:
            layout.label(text="No ray inspected yet")
            return
        state = context.window_manager.reference_raytracer
        layout.label(text=inspected.place)
        layout.template_list("RAYTRACER_UL_rays", "", state, "rays", state, "ray_index", rows=5)


class _ChildPanel(_RayPanel):
    """A part of the panel, about the ray chosen in the list."""

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.engine == ENGINE and find_chosen(context) is not None


class _HitPanel(_ChildPanel):
    bl_label = "Hit"

    def draw(self, context: Any) -> None:
        ray, inspected = find_chosen(context), session.find_inspected()
        assert ray is not None
        assert inspected is not None
        if ray.hit is None:
            self.layout.label(text="The ray hits nothing")  # type: ignore[attr-defined]
        else:
            draw_lines(self.layout, describe_hit(ray, ray.hit, inspected.names))  # type: ignore[attr-defined]


class _LightsPanel(_ChildPanel):
    bl_label = "Lights"

    @classmethod
    def poll(cls, context: Any) -> bool:
        if not super().poll(context):
            return False
        ray = find_chosen(context)
        return ray is not None and ray.hit is not None

    def draw(self, context: Any) -> None:
        ray, inspected = find_chosen(context), session.find_inspected()
        assert ray is not None
        assert inspected is not None
        column = self.layout.column(align=True)  # type: ignore[attr-defined]
        for shadow in ray.shadows:
            icon = BLOCKED_ICON if shadow.is_blocked else LIT_ICON
            column.label(text=describe_shadow(shadow, inspected.names), icon=icon)
        if ray.dark:
            column.label(text=describe_dark(ray, inspected.names), icon=DARK_ICON)
        if not ray.shadows and not ray.dark:
            column.label(text="No light here", icon=DARK_ICON)


class _RayItselfPanel(_ChildPanel):
    bl_label = "Ray"

    def draw(self, context: Any) -> None:
        ray = find_chosen(context)
        assert ray is not None
        draw_lines(self.layout, describe_ray(ray))  # type: ignore[attr-defined]
        if ray.is_cut:
            self.layout.label(text="Rays that contribute little are hidden", icon="INFO")  # type: ignore[attr-defined]


def find_chosen(context: Any) -> TracedRay | None:
    """Return the ray chosen in the list, or None."""
    inspected, state = session.find_inspected(), context.window_manager.reference_raytracer
    if inspected is None or not 0 <= state.ray_index < len(state.rays):
        return None
    return inspected.tree[state.rays[state.ray_index].number]


def draw_lines(layout: Any, lines: Iterable[Line], factor: float = 0.3) -> None:
    """Draw names, over a share `factor` of the width, with one value or three beside each."""
    column = layout.column(align=True)
    for name, values in lines:
        row = column.split(factor=factor)
        label = row.column()
        label.alignment = "RIGHT"
        label.label(text=name)
        cells = row.row(align=True)
        for value in values:
            cells.label(text=value)


def make_panels(space: str, prefix: str) -> tuple[Any, ...]:
    """Return the panels of one kind of editor; a panel belongs to one."""
    parent = f"{prefix}_PT_raytracer_rays"
    common = {"bl_space_type": space}
    first = type(parent, (_RayPanel, bpy.types.Panel), common)
    parts = [("hit", _HitPanel), ("lights", _LightsPanel), ("itself", _RayItselfPanel)]
    children = [
        type(f"{parent}_{name}", (part, bpy.types.Panel), {**common, "bl_parent_id": parent}) for name, part in parts
    ]
    return (first, *children)


CLASSES = (RAYTRACER_UL_rays, *make_panels("VIEW_3D", "VIEW3D"), *make_panels("IMAGE_EDITOR", "IMAGE"))

register, unregister = make_registrars(CLASSES)
