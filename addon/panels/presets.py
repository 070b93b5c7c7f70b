"""Presets of the panel Sampling, in Blender's own menu; those that come along are in `presets/`, in `HOME`."""

# ruff: noqa: N801, RUF012  (Blender prescribes the form of class names and attributes)

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from ..properties import ENGINE

HOME = str(Path(__file__).parents[1])
FOLDER = "reference_raytracer/sampling"
# The settings that a preset holds.
SETTINGS = ("samples", "viewport_samples", "clamp_direct", "clamp_indirect", "filter_glossy")


class RAYTRACER_PT_sampling_presets(PresetPanel, bpy.types.Panel):
    """The menu at the panel's head."""

    bl_label = "Sampling Presets"
    preset_subdir = FOLDER
    preset_operator = "script.execute_preset"
    preset_add_operator = "raytracer.sampling_preset_add"
    COMPAT_ENGINES = {ENGINE}


class RAYTRACER_OT_sampling_preset_add(AddPresetBase, bpy.types.Operator):
    """Add or remove a preset of the numbers of samples, clamping and glossy filter"""

    bl_idname = "raytracer.sampling_preset_add"
    bl_label = "Add Sampling Preset"
    preset_menu = "RAYTRACER_PT_sampling_presets"
    preset_defines = ["settings = bpy.context.scene.reference_raytracer"]
    preset_values = [f"settings.{name}" for name in SETTINGS]
    preset_subdir = FOLDER


CLASSES: tuple[Any, ...] = (RAYTRACER_PT_sampling_presets, RAYTRACER_OT_sampling_preset_add)
