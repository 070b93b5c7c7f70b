"""Shader node graphs as plain data: programs of steps, and the images they read.

A program is a node graph after extraction: its nodes in an order in which each follows what it reads, groups inlined,
constants folded, dead branches dropped. A step names an operation of `shading.evaluate.OPERATIONS`; its inputs are
constants or registers, the outputs of earlier steps. Nothing here computes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from raytracer.arrays.checks import require_choice, require_finite
from raytracer.scene.fields import make_records, require_text

# How an image's stored numbers become scene linear ones: as they are, or by the curve of sRGB.
ENCODINGS = ("linear", "srgb")
# Of UDIM tiles: the one at the origin, and the last that Blender has.
FIRST_TILE, LAST_TILE = 1001, 2000


@dataclass(frozen=True)
class Register:
    """The output, by its socket's identifier, of the step with a number."""

    step: int
    output: str


Value = float | np.ndarray | Register


def make_value(value: Any, label: str) -> Value:
    """Return a constant as float or read-only (3,) float64, a register as it is.

    Raises
    ------
    ValueError
        If the value is neither.
    """
    if isinstance(value, Register):
        return value
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.empty((0, 0))
    if array.shape not in ((), (3,)):
        raise ValueError(f"{label}: expected a number, three numbers or a Register, got {type(value).__name__}")
    require_finite(array, label)
    if array.ndim == 0:
        return float(array)
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False)
class Image:
    """Pixels of an image texture, row 0 at the bottom.

    pixels : (h, w, 4) uint8 (255 is 1) or float32, as they are interpolated: alpha premultiplied where it shall be
    encoding : one of ENCODINGS, undone after interpolation
    """

    pixels: Any
    encoding: str = "linear"
    name: str = ""

    def __post_init__(self) -> None:
        require_text(self.name, "Image: name")
        label = f"Image {self.name!r}"
        pixels = np.asarray(self.pixels)
        if pixels.ndim != 3 or pixels.shape[2] != 4 or 0 in pixels.shape or pixels.dtype not in (np.uint8, np.float32):
            raise ValueError(f"{label}: pixels: expected (h, w, 4) uint8 or float32, got {pixels.shape} {pixels.dtype}")
        require_choice(self.encoding, ENCODINGS, f"{label}: encoding")
        pixels = np.ascontiguousarray(pixels).view()
        pixels.flags.writeable = False
        if pixels.dtype != np.uint8:
            require_finite(pixels, f"{label}: pixels")
        object.__setattr__(self, "pixels", pixels)


@dataclass(frozen=True, eq=False)
class TiledImage:
    """An image for each of some squares of texture space, as by the UDIM convention.

    numbers : (n,) int64, 1001 + i + 10 j for the square [i, i + 1) x [j, j + 1), 0 <= i < 10; each occurs once
    tiles : n Images, of any sizes, each stretched over its own square
    """

    numbers: Any
    tiles: Sequence[Image]
    name: str = ""

    def __post_init__(self) -> None:
        require_text(self.name, "TiledImage: name")
        label = f"TiledImage {self.name!r}"
        object.__setattr__(self, "tiles", make_records(self.tiles, Image, f"{label}: tiles"))
        numbers = np.array(self.numbers)
        if numbers.shape != (len(self.tiles),) or numbers.dtype.kind not in "iu" or not len(numbers):
            raise ValueError(f"{label}: numbers: expected a whole number for each tile, and one tile at least")
        if numbers.min() < FIRST_TILE or numbers.max() > LAST_TILE or len(np.unique(numbers)) < len(numbers):
            raise ValueError(f"{label}: numbers: expected different ones from {FIRST_TILE} to {LAST_TILE}")
        numbers = numbers.astype(np.int64)
        numbers.flags.writeable = False
        object.__setattr__(self, "numbers", numbers)


@dataclass(frozen=True, eq=False)
class Step:
    """One computation.

    operation : a key of `shading.evaluate.OPERATIONS`
    inputs : constants or Registers, in the operation's order
    settings : what is fixed, by name: text, numbers, arrays, an Image or TiledImage, or a Program that the step runs
        itself
    """

    operation: str
    inputs: Sequence[Value] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_text(self.operation, "Step: operation")
        label = f"Step {self.operation!r}"
        if not isinstance(self.inputs, Sequence) or not isinstance(self.settings, Mapping):
            raise ValueError(f"{label}: expected a sequence of inputs and a table of settings")
        object.__setattr__(self, "inputs", tuple(make_value(value, f"{label}: inputs") for value in self.inputs))
        object.__setattr__(self, "settings", dict(self.settings))


@dataclass(frozen=True, eq=False)
class Program:
    """Steps, each after those whose registers it reads.

    result : what a program that a step runs gives it; None for a material's, whose closures name their registers
    """

    steps: Sequence[Step] = ()
    result: Value | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "steps", make_records(self.steps, Step, "Program: steps"))
        for number, step in enumerate(self.steps):
            for value in step.inputs:
                require_step(value, number, f"Program: step {number} ({step.operation})")
        if self.result is not None:
            object.__setattr__(self, "result", make_value(self.result, "Program: result"))
        check_register(self.result, self, "Program: result")


@dataclass(frozen=True, eq=False)
class Aovs:
    """What shaders write to passes that a scene names itself (arbitrary output variables).

    A program of their own, so that a picture keeps its bits whatever is written beside it.

    values : by name of the pass, a number, a color, or a Register of `program`
    program : None where all are constant
    """

    values: Mapping[str, Value] = field(default_factory=dict)
    program: Program | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.values, Mapping):
            raise ValueError(f"Aovs: values: expected a table, got {type(self.values).__name__}")
        check_program(self.program, "Aovs: program")
        values = {}
        for name, value in self.values.items():
            require_text(name, "Aovs: values")
            values[name] = make_value(value, f"Aovs: {name!r}")
            check_register(values[name], self.program, f"Aovs: {name!r}")
        object.__setattr__(self, "values", values)


def check_aovs(value: Any, label: str) -> None:
    """Raise ValueError if `value` is neither an Aovs nor None."""
    if value is not None and not isinstance(value, Aovs):
        raise ValueError(f"{label}: expected an Aovs or None, got {type(value).__name__}")


def check_program(value: Any, label: str) -> None:
    """Raise ValueError if `value` is neither a Program nor None."""
    if value is not None and not isinstance(value, Program):
        raise ValueError(f"{label}: expected a Program or None, got {type(value).__name__}")


def check_register(value: Any, program: Program | None, label: str) -> None:
    """Raise ValueError if `value` is a Register of a step that `program` does not have."""
    require_step(value, len(program.steps) if program is not None else 0, label)


def require_step(value: Any, count: int, label: str) -> None:
    """Raise ValueError if `value` is a Register other than of one of the first `count` steps."""
    if not isinstance(value, Register):
        return
    if type(value.step) is not int or not isinstance(value.output, str) or not 0 <= value.step < count:
        raise ValueError(f"{label}: expected a register of one of the {count} steps before it, got {value}")
