"""Programs that differ in the images they read alone: run together, for all points of their materials.

Programs are like where the steps that are needed are of the same operations, constants and settings, but for the pixels
of Image Textures. Constants must be the same, not just of the same shape: a number for all points is not always
computed as one for each of them is (a power of 2 is a product), and pictures keep their bits.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from raytracer.scene.programs import Image, Program, Register, Step
from raytracer.textures.image_set import ImageSet

# The operation whose images may differ.
READS_IMAGE = "TEX_IMAGE"


def describe_program(program: Program, needed: Iterable[int]) -> Hashable:
    """Return what like programs have in common: of the steps with the numbers `needed`."""
    return tuple((number, describe_step(program.steps[number])) for number in needed)


def describe_step(step: Step) -> Hashable:
    """Return what a step does, but for the pixels of an Image Texture."""
    settings = tuple((name, _describe(step.settings[name], step.operation)) for name in sorted(step.settings))
    return step.operation, tuple(describe_value(value) for value in step.inputs), settings


def describe_value(value: Any) -> Hashable:
    """Return what tells a register, constant or plain setting from others; other objects are themselves alone."""
    if isinstance(value, np.ndarray) and value.dtype != object:
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, float):
        return "float", value.hex()
    if isinstance(value, (Register, str, bool, int)) or value is None:
        return type(value).__name__, value
    return "object", id(value)


def _describe(value: Any, operation: str) -> Hashable:
    if isinstance(value, Program):
        return describe_program(value, range(len(value.steps))), describe_value(value.result)
    if isinstance(value, Image) and operation == READS_IMAGE:
        return "image", value.pixels.dtype.str, value.encoding
    return describe_value(value)


def merge_programs(programs: Sequence[Program], materials: Sequence[int], needed: Iterable[int]) -> Program:
    """Return a program that does what each of like programs does at the points of its material."""
    first, wanted = programs[0], set(needed)
    steps = [
        _merge_steps([program.steps[number] for program in programs], materials) if number in wanted else step
        for number, step in enumerate(first.steps)
    ]
    return replace(first, steps=steps)


def _merge_steps(steps: Sequence[Step], materials: Sequence[int]) -> Step:
    """Return the step that does what each of like steps does."""
    settings = dict(steps[0].settings)
    for name, value in settings.items():
        values = [step.settings[name] for step in steps]
        if isinstance(value, Program):
            settings[name] = merge_programs(values, materials, range(len(value.steps)))
        elif isinstance(value, Image) and any(other is not value for other in values):
            settings[name] = _gather_images(values, materials)
    return replace(steps[0], settings=settings)


def _gather_images(images: Sequence[Image], materials: Sequence[int]) -> ImageSet:
    """Return the images that materials read, each once."""
    different = list({id(image): image for image in images}.values())
    numbers = {id(image): number for number, image in enumerate(different)}
    row = np.zeros(max(materials) + 1, dtype=np.int64)
    row[list(materials)] = [numbers[id(image)] for image in images]
    return ImageSet(tuple(different), row)
