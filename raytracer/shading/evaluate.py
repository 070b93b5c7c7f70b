"""Shader nodes: programs evaluated over arrays of points.

To add a node, write one function on arrays in the module of its kind,

    def apply_gamma(color, gamma):                       # (n, 3) or (3,), and (n,) or ()
        return color ** spread(gamma)

and give it one row in that module's table, under the type that Blender gives the node:

    "GAMMA": Operation(apply_gamma, inputs=("Color", "Gamma"), outputs=("Color",)),

The add-on finds the row by itself: it reads the sockets and properties that the row names; properties that are no plain
values get a reader in `addon/extract/shaders/node_settings.py` (READERS). A node that scatters light, not values, is a
closure: its recipe stands in `bsdfs/closure_nodes.py`. A node whose outputs are
independent of each other (Geometry, Texture Coordinate) has a row for each of them, "TYPE Output", so that what nobody
reads is not computed. What a function reads of the point it takes from the site (`reads_site=True`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from typing import Any

import numpy as np

from raytracer.arrays.checks import require_choice
from raytracer.scene.fields import LARGEST, require_text
from raytracer.scene.media import Volume
from raytracer.scene.programs import Aovs, Program, Register, Step, Value
from raytracer.scene.scene import Scene
from raytracer.shading.nodes import (
    arithmetic,
    blackbody,
    cells,
    color,
    environments,
    images,
    inputs,
    mapping,
    normals,
    patterns,
    photometry,
    ramps,
    raycast,
    shapes,
    strands,
    wavelength,
)
from raytracer.shading.nodes.operation import Array, Operation
from raytracer.shading.site import Site

# What the operations of the Light Path node begin with.
LIGHT_PATH = "LIGHT_PATH "
# The operations that cast rays, of which one draws numbers of its own.
BEVEL = "BEVEL"
CASTING = ("AMBIENT_OCCLUSION", BEVEL, *raycast.OPERATIONS)

OPERATIONS: dict[str, Operation] = {
    **arithmetic.OPERATIONS,
    **blackbody.OPERATIONS,
    **cells.OPERATIONS,
    **color.OPERATIONS,
    **environments.OPERATIONS,
    **images.OPERATIONS,
    **inputs.OPERATIONS,
    **mapping.OPERATIONS,
    **normals.OPERATIONS,
    **patterns.OPERATIONS,
    **photometry.OPERATIONS,
    **ramps.OPERATIONS,
    **raycast.OPERATIONS,
    **shapes.OPERATIONS,
    **strands.OPERATIONS,
    **wavelength.OPERATIONS,
}

Outputs = dict[Register, Any]


def run_step(step: Step, site: Site | None, read: Any) -> tuple[Any, ...]:
    """Return a step's outputs; `read` turns its inputs into arrays. The site may be None for pure operations.

    Raises
    ------
    ValueError
        If the operation cannot do with the step's settings.
    """
    operation = OPERATIONS[step.operation]
    arguments = [read(value) for value in step.inputs]
    if operation.reads_site:
        arguments.insert(0, site)
    settings = {**step.settings, "evaluate": evaluate_result} if operation.runs_programs else step.settings
    with np.errstate(over="ignore", divide="ignore", invalid="ignore", under="ignore"):
        try:
            found = operation.compute(*arguments, **settings)
        except (AttributeError, IndexError, KeyError, TypeError) as error:
            raise ValueError(f"Step {step.operation!r}: settings: {type(error).__name__}, {error}") from error
    return found if isinstance(found, tuple) else (found,)


def fold_step(step: Step) -> dict[str, Value] | None:
    """Return the outputs of a step whose inputs are all constant, as constants; None for others."""
    operation = OPERATIONS[step.operation]
    if operation.reads_site or any(isinstance(value, Register) for value in step.inputs):
        return None
    found = run_step(step, None, np.asarray)
    return {name: make_constant(value) for name, value in zip(operation.outputs, found, strict=True)}


def make_constant(value: Any) -> Value:
    """Return a number or color as a program's constant; what is not finite becomes 0, as far as float32 goes."""
    array = np.nan_to_num(np.asarray(value, dtype=np.float64), posinf=LARGEST, neginf=-LARGEST)
    return float(array) if array.ndim == 0 else array


def check_program_steps(program: Program | None, label: str) -> None:
    """Raise ValueError where a program has a step that cannot be computed.

    What only this room knows: the operations, how many inputs they take, which choices and outputs they have.
    """
    waiting = [] if program is None else [program]
    while waiting:
        program = waiting.pop()
        for number, step in enumerate(program.steps):
            check_step(step, program, f"{label}: step {number} ({step.operation!r})")
            waiting.extend(value for value in step.settings.values() if isinstance(value, Program))
        check_output(program.result, program, f"{label}: result")


def check_step(step: Step, program: Program, label: str) -> None:
    """Raise ValueError where a step of a program cannot be computed."""
    operation = OPERATIONS.get(step.operation)
    if operation is None:
        raise ValueError(f"{label}: expected an operation of raytracer.shading.nodes")
    if len(step.inputs) != len(operation.inputs):
        raise ValueError(f"{label}: expected {len(operation.inputs)} inputs, got {len(step.inputs)}")
    for name, choices in operation.choices.items():
        if name in step.settings:
            require_choice(step.settings[name], tuple(choices), f"{label}: {name}")
    try:
        attributes = operation.attributes(step.settings)
    except KeyError as error:
        raise ValueError(f"{label}: expected a setting {error}") from None
    for name in attributes:
        require_text(name, f"{label}: attribute")
    for value in step.inputs:
        check_output(value, program, label)


def check_output(value: Any, program: Program | None, label: str) -> None:
    """Raise ValueError where a register names an output that its step does not have."""
    if program is not None and isinstance(value, Register):
        outputs = OPERATIONS[program.steps[value.step].operation].outputs
        require_choice(value.output, outputs, f"{label}: output of step {value.step}")


def check_programs(scene: Scene) -> None:
    """Raise ValueError where a program of a scene cannot be computed, naming material or world."""
    for material in scene.materials:
        check_program_steps(material.program, f"Material {material.name!r}: program")
        for closure in material.closures:
            for name, register in closure.registers.items():
                check_output(register, material.program, f"Material {material.name!r}: {closure.kind}: {name}")
        check_aov_steps(material.aovs, f"Material {material.name!r}: aovs")
        check_volume_steps(material.volume, f"Material {material.name!r}: volume")
    if scene.world is not None:
        check_program_steps(scene.world.program, "World: program")
        check_output(scene.world.color, scene.world.program, "World: color")
        check_aov_steps(scene.world.aovs, "World: aovs")
        check_volume_steps(scene.world.volume, "World: volume")


def check_volume_steps(volume: Volume | None, label: str) -> None:
    """Raise ValueError where a parameter of a volume cannot be computed."""
    if volume is None:
        return
    check_program_steps(volume.program, f"{label}: program")
    for closure in volume.closures:
        for name, register in closure.registers.items():
            check_output(register, volume.program, f"{label}: {closure.kind}: {name}")


def check_aov_steps(aovs: Aovs | None, label: str) -> None:
    """Raise ValueError where what shaders write to passes cannot be computed."""
    if aovs is None:
        return
    check_program_steps(aovs.program, label)
    for name, value in aovs.values.items():
        check_output(value, aovs.program, f"{label}: {name}")


def find_needed(program: Program, wanted: Iterable[Any]) -> tuple[int, ...]:
    """Return the numbers of the steps that registers in `wanted` depend on, in order."""
    needed = {value.step for value in wanted if isinstance(value, Register)}
    for number in range(len(program.steps) - 1, -1, -1):
        if number in needed:
            needed.update(value.step for value in program.steps[number].inputs if isinstance(value, Register))
    return tuple(sorted(needed))


def evaluate(program: Program, site: Site, needed: tuple[int, ...]) -> Outputs:
    """Run the steps `needed` (of `find_needed`) at a site; return all their outputs, () or (n,), (3,) or (n, 3)."""
    outputs: Outputs = {}

    def read(value: Value) -> Array:
        return outputs[value] if isinstance(value, Register) else np.asarray(value)

    for number in needed:
        step = program.steps[number]
        for name, found in zip(OPERATIONS[step.operation].outputs, run_step(step, site, read), strict=True):
            outputs[Register(number, name)] = np.asarray(found, dtype=np.float64)
    return outputs


def evaluate_result(program: Program, site: Site) -> Array:
    """Return the result of a program that a step runs, () or (n,)."""
    outputs = evaluate(program, site, find_needed(program, [program.result]))
    return outputs[program.result] if isinstance(program.result, Register) else np.asarray(program.result)


def list_steps(program: Program, needed: tuple[int, ...] | None = None) -> Iterator[Step]:
    """Yield all steps, or those `needed` (of `find_needed`), and those of the programs that they run, each once."""
    steps = program.steps if needed is None else [program.steps[number] for number in needed]
    waiting, known = [steps], {id(program)}
    while waiting:
        for step in waiting.pop():
            yield step
            inner = [value for value in step.settings.values() if isinstance(value, Program) and id(value) not in known]
            known.update(map(id, inner))
            waiting.extend(one.steps for one in inner)


def list_attributes(program: Program) -> set[str]:
    """Return the names of the mesh attributes that a program reads; see `site_tables.make_site_tables`."""
    return {name for step in list_steps(program) for name in OPERATIONS[step.operation].attributes(step.settings)}


def reads_light_path(
    program: Program | None, outputs: Iterable[str] | None = None, needed: tuple[int, ...] | None = None
) -> bool:
    """True where a program asks how the ray came.

    outputs : of the Light Path node, those that count; None for all
    needed : the steps that count, of `find_needed`; None for all
    """
    if program is None:
        return False
    named = None if outputs is None else {LIGHT_PATH + output for output in outputs}
    asked = (step.operation for step in list_steps(program, needed) if step.operation.startswith(LIGHT_PATH))
    return any(named is None or operation in named for operation in asked)


def reads_place(program: Program, needed: tuple[int, ...]) -> bool:
    """True where what the steps `needed` compute differs from point to point, or from direction to direction."""
    steps = list_steps(program, needed)
    return any(OPERATIONS[step.operation].reads_site and not step.operation.startswith(LIGHT_PATH) for step in steps)


def casts_rays(program: Program | None, kinds: Collection[str] = CASTING) -> bool:
    """True where a program casts rays from the points where it is evaluated; kinds : of operations, that count."""
    return program is not None and any(step.operation in kinds for step in list_steps(program))
