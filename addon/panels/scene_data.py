"""The tabs of light, object, material and world."""

# ruff: noqa: N801, RUF012  (Blender prescribes the form of class names and attributes)

from __future__ import annotations

from typing import Any

import bpy

from .. import versions
from ..extract.parts import RAY_VISIBILITY
from ..extract.world import WORLD_VISIBILITY
from .shared import EnginePanel, split

# Objects that rays can meet.
VISIBLE_TYPES = {"MESH", "CURVE", "SURFACE", "META", "FONT", "POINTCLOUD", "CURVES", "VOLUME", "LIGHT"}
# Those that become meshes.
MESH_TYPES = {"MESH", "CURVE", "SURFACE", "META", "FONT"}


def can_be_seen(thing: Any) -> bool:
    """Return whether rays can meet an object, or what it instances."""
    return thing is not None and (thing.type in VISIBLE_TYPES or thing.instance_type == "COLLECTION")


class RAYTRACER_LIGHT_PT_tracing(EnginePanel, bpy.types.Panel):
    """What EEVEE's panel of a light does not show."""

    bl_label = "Ray Tracing"
    bl_context = "data"
    bl_parent_id = "DATA_PT_EEVEE_light"

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.light is not None and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        column = split(self)
        column.prop(context.light, "use_shadow", text="Cast Shadow")
        if context.light.type == "AREA":
            column.prop(context.light, "spread")
        if hasattr(context.light, "cycles"):  # the settings are Cycles', which can be disabled
            if context.light.type == "AREA":
                column.prop(context.light.cycles, "is_portal", text="Portal")
            column.prop(context.light.cycles, "max_bounces")
            column.prop(context.light.cycles, "is_caustics_light", text="Shadow Caustics")


class RAYTRACER_LIGHT_PT_nodes(EnginePanel, bpy.types.Panel):
    """The shader nodes of a light."""

    bl_label = "Nodes"
    bl_context = "data"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.light is not None and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        draw_nodes(self.layout, context.light)


def draw_nodes(layout: Any, owner: Any, socket: str = "Surface") -> None:
    """Draw the nodes that feed a socket of the output of a light or of a world, as Blender does."""
    layout.use_property_split = True
    tree = versions.find_node_tree(owner)
    if tree is None:
        layout.prop(owner, "use_nodes", icon="NODETREE")
        return
    output = versions.find_output_node(tree)
    if output is None:
        layout.label(text="No output node")
        return
    layout.template_node_view(tree, output, output.inputs[socket])


class RAYTRACER_OBJECT_PT_shadow_catcher(EnginePanel, bpy.types.Panel):
    """Whether an object stands for footage that catches shadows; below Blender's own Holdout."""

    bl_label = "Shadow Catcher"
    bl_context = "object"
    bl_parent_id = "OBJECT_PT_visibility"
    bl_options = {"HIDE_HEADER"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return can_be_seen(context.object) and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        split(self).prop(context.object, "is_shadow_catcher")


class RAYTRACER_OBJECT_PT_ray_visibility(EnginePanel, bpy.types.Panel):
    """Which rays meet an object."""

    bl_label = "Ray Visibility"
    bl_context = "object"
    bl_parent_id = "OBJECT_PT_visibility"

    @classmethod
    def poll(cls, context: Any) -> bool:
        return can_be_seen(context.object) and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        column = split(self).column(align=True)
        for name, label in RAY_VISIBILITY.items():
            if label != "shadow" or context.object.type != "LIGHT":
                column.prop(context.object, name, text=label.capitalize())


def draw_light_group(panel: Any, owner: Any, view_layer: Any) -> None:
    """Draw the group of what shines, and a button that adds it to the view layer where that lacks it."""
    row = split(panel).row(align=True)
    row.prop_search(owner, "lightgroup", view_layer, "lightgroups", text="Light Group", results_are_suggestions=True)
    button = row.column(align=True)
    button.enabled = bool(owner.lightgroup) and owner.lightgroup not in view_layer.lightgroups
    button.operator("scene.view_layer_add_lightgroup", icon="ADD", text="").name = owner.lightgroup


class RAYTRACER_OBJECT_PT_light_group(EnginePanel, bpy.types.Panel):
    """The group of lights that what an object, or a light, shines with belongs to."""

    bl_label = "Light Group"
    bl_context = "object"
    bl_parent_id = versions.SHADING_PANEL
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        draw_light_group(self, context.object, context.view_layer)


class RAYTRACER_OBJECT_PT_caustics(EnginePanel, bpy.types.Panel):
    """Whether light that makes caustics is looked for through an object, or on it."""

    bl_label = "Caustics"
    bl_context = "object"
    bl_parent_id = versions.SHADING_PANEL
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        thing = context.object  # the settings are Cycles', which can be disabled
        is_mesh = thing is not None and thing.type in MESH_TYPES
        return is_mesh and hasattr(thing, "cycles") and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        column = split(self)
        column.prop(context.object.cycles, "is_caustics_caster", text="Cast Shadow Caustics")
        column.prop(context.object.cycles, "is_caustics_receiver", text="Receive Shadow Caustics")


class RAYTRACER_OBJECT_PT_shadow_terminator(EnginePanel, bpy.types.Panel):
    """How far the shadows of coarse smooth meshes are moved, where they would show the facets."""

    bl_label = "Shadow Terminator"
    bl_context = "object"
    bl_parent_id = versions.SHADING_PANEL
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        thing = context.object
        is_mesh = thing is not None and thing.type in MESH_TYPES
        return is_mesh and versions.find_terminator(thing)[0] is not None and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        column = split(self).column(align=True)
        owner, names = versions.find_terminator(context.object)
        for name, label in zip(names, ("Geometry Offset", "Shading Offset"), strict=True):
            column.prop(owner, name, text=label)


class RAYTRACER_MATERIAL_PT_settings(EnginePanel, bpy.types.Panel):
    """What of a material is not in its nodes."""

    bl_label = "Settings"
    bl_context = "material"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        material = context.material
        return material is not None and not material.grease_pencil and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        column = split(self)
        column.prop(context.material, "use_transparent_shadow", text="Transparent Shadows")
        column.prop(context.material, "pass_index")
        column.prop(context.material, "displacement_method", text="Displacement")
        own = getattr(context.material, "cycles", None)  # which can be disabled
        for name in ("use_bump_map_correction", "volume_interpolation"):
            if hasattr(own, name):
                column.prop(own, name)


class RAYTRACER_WORLD_PT_preview(EnginePanel, bpy.types.Panel):
    """A small picture of the world; Blender's own panel is Cycles'."""

    bl_label = "Preview"
    bl_context = "world"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.world is not None and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        self.layout.template_preview(context.world)


class RAYTRACER_WORLD_PT_surface(EnginePanel, bpy.types.Panel):
    """The shader nodes of the world; EEVEE's panel would stand above Preview."""

    bl_label = "Surface"
    bl_context = "world"

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.world is not None and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        self.layout.separator()
        draw_nodes(self.layout, context.world)
        if versions.find_node_tree(context.world) is None:
            self.layout.prop(context.world, "color")


class RAYTRACER_WORLD_PT_volume(EnginePanel, bpy.types.Panel):
    """The shader nodes of what fills all space; EEVEE's panel would stand above Preview."""

    bl_label = "Volume"
    bl_context = "world"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        has_nodes = context.world is not None and versions.find_node_tree(context.world) is not None
        return has_nodes and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        draw_nodes(self.layout, context.world, "Volume")


class RAYTRACER_WORLD_PT_mist(EnginePanel, bpy.types.Panel):
    """The distances of the pass Mist, where a view layer has it; EEVEE's panel would stand above Preview."""

    bl_label = "Mist Pass"
    bl_context = "world"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        has_pass = any(layer.use_pass_mist for layer in context.scene.view_layers)
        return context.world is not None and has_pass and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        column, mist = split(self), context.world.mist_settings
        limits = column.column(align=True)
        limits.prop(mist, "start")
        limits.prop(mist, "depth")
        column.prop(mist, "falloff")


class RAYTRACER_WORLD_PT_occlusion(EnginePanel, bpy.types.Panel):
    """How far the pass Ambient Occlusion, and its bake, look for what is around."""

    bl_label = "Ambient Occlusion"
    bl_context = "world"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.world is not None and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        split(self).prop(context.world.light_settings, "distance")


class RAYTRACER_WORLD_PT_ray_visibility(EnginePanel, bpy.types.Panel):
    """Which rays see the world."""

    bl_label = "Ray Visibility"
    bl_context = "world"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        # The settings are those of Cycles, which can be disabled.
        has_world = hasattr(context.world, "cycles_visibility")
        return has_world and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        column, visibility = split(self).column(align=True), context.world.cycles_visibility
        for name in WORLD_VISIBILITY:
            column.prop(visibility, name)


class RAYTRACER_WORLD_PT_settings(EnginePanel, bpy.types.Panel):
    """How far the light of the world is aimed at."""

    bl_label = "Settings"
    bl_context = "world"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        # The settings are those of Cycles, which can be disabled.
        return hasattr(context.world, "cycles") and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        split(self).prop(context.world.cycles, "max_bounces")


class RAYTRACER_WORLD_PT_light_group(EnginePanel, bpy.types.Panel):
    """The group of lights that the world belongs to."""

    bl_label = "Light Group"
    bl_context = "world"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.world is not None and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        draw_light_group(self, context.world, context.view_layer)


CLASSES = (
    RAYTRACER_LIGHT_PT_tracing,
    RAYTRACER_LIGHT_PT_nodes,
    RAYTRACER_OBJECT_PT_shadow_catcher,
    RAYTRACER_OBJECT_PT_ray_visibility,
    RAYTRACER_OBJECT_PT_light_group,
    RAYTRACER_OBJECT_PT_caustics,
    RAYTRACER_OBJECT_PT_shadow_terminator,
    RAYTRACER_MATERIAL_PT_settings,
    RAYTRACER_WORLD_PT_preview,
    RAYTRACER_WORLD_PT_surface,
    RAYTRACER_WORLD_PT_volume,
    RAYTRACER_WORLD_PT_mist,
    RAYTRACER_WORLD_PT_occlusion,
    RAYTRACER_WORLD_PT_ray_visibility,
    RAYTRACER_WORLD_PT_settings,
    RAYTRACER_WORLD_PT_light_group,
)
