"""Meshes that are diced: after it is known where they stand, and kept while nothing of it changes."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import raytracer
from raytracer.arrays.types import Floats
from raytracer.scene.camera import Camera
from raytracer.subdivision.diced import DicedMesh, carry_normals, carry_places, carry_vertex_normals, dice_mesh
from raytracer.subdivision.dicing import IsLong
from raytracer.subdivision.pixel_size import View, choose_instances, is_longer, is_wider

from .adaptive import AdaptiveBase, Dicing
from .displacing import VERTEX_NORMAL
from .warnings import WarningList

# A mesh of more triangles is diced more coarsely. With the tree over them, and displaced, 1.1 million took 0.96 GB in
# all: these are about three.
MOST_TRIANGLES = 1 << 22


class DiceKey(NamedTuple):
    """All that a diced mesh depends on, but for records that did not change, which are the same records.

    view, places : of the camera, and of the instances that may decide; empty where metres are asked
    """

    rounds: int
    view: tuple[Any, ...]
    places: bytes


class Diced(NamedTuple):
    """A diced mesh, and what it was made of; coarser : by how much its edges are longer than asked."""

    mesh: raytracer.Mesh
    base: AdaptiveBase
    key: DiceKey
    found: DicedMesh
    coarser: float


def dice_meshes(
    meshes: Sequence[raytracer.Mesh],
    bases: Sequence[AdaptiveBase | None],
    instances: raytracer.Instances,
    dicing: Dicing,
    kept: Sequence[Diced],
    warnings: WarningList,
) -> dict[int, Diced]:
    """Return by number the meshes that have a base, diced as finely as the instance asks that is seen largest."""
    found = {}
    for number, (mesh, base) in enumerate(zip(meshes, bases, strict=True)):
        if base is None:
            continue
        key, is_long = find_limits(mesh, base, instances.world_from_object[instances.mesh == number], dicing)
        last = next((each for each in kept if each.mesh is mesh and each.base is base and each.key == key), None)
        found[number] = last or Diced(mesh, base, key, *dice_within(mesh, base, is_long, dicing.rounds))
        if found[number].coarser > 1.0:
            warn_coarser(found[number], warnings)
    return found


def find_limits(
    mesh: raytracer.Mesh, base: AdaptiveBase, places: Floats, dicing: Dicing
) -> tuple[DiceKey, partial[NDArray[np.bool_]]]:
    """Return what a mesh's dicing depends on, and what tells whether edges are too long, given a size first."""
    if not base.adaptive.in_pixels:
        return DiceKey(dicing.rounds, (), b""), partial(is_longer)
    assert dicing.view is not None
    places = choose_instances(dicing.view, places, mesh.positions)
    return DiceKey(dicing.rounds, describe_view(dicing.view), places.tobytes()), partial(is_wider, dicing.view, places)


def describe_view(view: View) -> tuple[Any, ...]:
    """Return what a view is, for comparing."""
    fields = (getattr(view.camera, field.name) for field in dataclasses.fields(Camera))
    values = tuple(value.tobytes() if isinstance(value, np.ndarray) else value for value in fields)
    return *values, view.width, view.height, view.offscreen


def dice_within(
    mesh: raytracer.Mesh, base: AdaptiveBase, is_long: partial[NDArray[np.bool_]], rounds: int
) -> tuple[DicedMesh, float]:
    """Return a mesh diced, and by which factor its edges had to be longer for it to have no more triangles than
    `MOST_TRIANGLES`."""
    attributes = dict(mesh.attributes)
    normals = attributes.pop(VERTEX_NORMAL, None)
    plain = dataclasses.replace(mesh, attributes=attributes)
    found, coarser = None, 0.5
    while found is None:
        coarser *= 2.0
        found = dice_mesh(plain, base.base, ask(is_long, coarser * base.adaptive.size), rounds, MOST_TRIANGLES)
    if normals is not None:
        carried = carry_vertex_normals(mesh.positions, normals, base.base, found.dice)
        whole = found.mesh.with_material(found.mesh.material, {**found.mesh.attributes, VERTEX_NORMAL: carried})
        found = dataclasses.replace(found, mesh=whole)
    return found, coarser


def ask(is_long: partial[NDArray[np.bool_]], size: float) -> IsLong:
    """Return what tells whether edges are longer than a size."""
    return lambda one, other: is_long(size, one, other)


def warn_coarser(diced: Diced, warnings: WarningList) -> None:
    """Say how coarse a mesh had to stay."""
    asked = diced.base.adaptive
    unit = "pixels" if asked.in_pixels else "m"
    wanted, had = f"{asked.size:.3g}", f"{asked.size * diced.coarser:.3g}"
    warnings.add(
        f"adaptive subdivision to {wanted} {unit} takes more than {MOST_TRIANGLES:,} triangles, "
        f"its edges have up to {had} {unit} instead",
        diced.mesh.name,
    )


def carry_shape(diced: Diced, shape: tuple[Any, Any]) -> tuple[Floats, Floats | None]:
    """Return positions and normals of a diced mesh whose base mesh has another shape: positions and normals there."""
    base = diced.base.base
    positions = np.asarray(shape[0], np.float64)
    normals = None if shape[1] is None else np.asarray(shape[1], np.float64)
    moved = carry_places(positions, base, diced.found.dice)
    there = dataclasses.replace(diced.mesh, positions=positions, normals=normals)
    return moved, carry_normals(there, base, diced.found.dice._replace(positions=moved))
