"""Meshes that materials displace: moved after the materials are known, and kept while nothing of it changes."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

import raytracer
from raytracer.shading.displacement import Displacement, displace

# Attributes of a mesh that is to be displaced, which it loses with it.
VERTEX_NORMAL, SMOOTH = "vertex normal", "smooth face"


class Displaced(NamedTuple):
    """A displaced mesh, and what it was made of."""

    made_of: tuple[Any, ...]
    mesh: raytracer.Mesh


def displace_meshes(
    meshes: Sequence[raytracer.Mesh],
    instances: raytracer.Instances,
    displacements: Mapping[int, Displacement],
    kept: Sequence[Displaced],
) -> tuple[list[raytracer.Mesh], list[Displaced]]:
    """Return the meshes with those moved that have a material of `displacements`, and what to keep of that.

    As in Cycles a mesh that is shown several times moves as its first instance says.
    """
    moved, known = list(meshes), []
    for number, mesh in enumerate(meshes):
        used = {material: displacements[material] for material in np.unique(mesh.material) if material in displacements}
        places = np.flatnonzero(instances.mesh == number)
        if not used or not len(places):
            continue
        shown = select_instance(instances, int(places[0]))
        found = find_displaced(kept, mesh, used, shown) or displace_mesh(mesh, used, shown)
        known.append(found)
        moved[number] = found.mesh
    return moved, known


def select_instance(instances: raytracer.Instances, row: int) -> raytracer.Instances:
    """Return one of the instances, of the only mesh that there is."""
    return raytracer.Instances(
        [0],
        instances.world_from_object[row : row + 1],
        pass_index=instances.pass_index[row : row + 1],
        random=None if instances.random is None else instances.random[row : row + 1],
        color=None if instances.color is None else instances.color[row : row + 1],
        properties={name: values[row : row + 1] for name, values in instances.properties.items()},
    )


def describe(mesh: raytracer.Mesh, used: Mapping[int, Displacement], shown: raytracer.Instances) -> tuple[Any, ...]:
    """Return all that a displaced mesh depends on; records that did not change are the same records."""
    values = (shown.world_from_object, shown.random, shown.color, *shown.properties.values())
    return mesh, tuple(used.items()), tuple(None if value is None else value.tobytes() for value in values)


def find_displaced(
    kept: Sequence[Displaced], mesh: raytracer.Mesh, used: Mapping[int, Displacement], shown: raytracer.Instances
) -> Displaced | None:
    """Return what an earlier extraction made of the same mesh, displacements and instance, or None."""
    wanted = describe(mesh, used, shown)
    return next((each for each in kept if each.made_of[0] is mesh and is_same(each.made_of, wanted)), None)


def is_same(one: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    programs = zip(one[1], other[1], strict=False)
    return (
        len(one[1]) == len(other[1])
        and one[2] == other[2]
        and all(a[0] == b[0] and a[1].program is b[1].program for a, b in programs)
    )


def displace_mesh(mesh: raytracer.Mesh, used: Mapping[int, Displacement], shown: raytracer.Instances) -> Displaced:
    """Return a mesh moved."""
    attributes = dict(mesh.attributes)
    normals, smooth = attributes.pop(VERTEX_NORMAL), attributes.pop(SMOOTH)
    materials = [raytracer.Material(()) for _ in range(int(np.max(mesh.material)) + 1)]
    scene = raytracer.Scene(
        meshes=[dataclasses.replace(mesh, attributes=attributes)], instances=shown, materials=materials
    )
    return Displaced(describe(mesh, used, shown), displace(scene, used, normals, smooth[:, 0, 0] > 0))
