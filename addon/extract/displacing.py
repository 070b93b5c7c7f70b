"""Meshes that materials displace: moved after the materials are known, and kept while nothing of it changes."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

import raytracer
from raytracer.shading.displacement import Displacement, displace

# Attributes of a mesh that is to be displaced, which it loses with it.
VERTEX_NORMAL, SMOOTH = "vertex normal", "smooth face"


class MadeOf(NamedTuple):
    """All that a displaced mesh depends on; records that did not change are the same records.

    instance : the bytes of what its programs can read of the instance that it moves by
    """

    mesh: raytracer.Mesh
    displacements: Mapping[int, Displacement]
    instance: tuple[bytes | None, ...]

    def equals(self, other: MadeOf) -> bool:
        """True where both say the same of one mesh."""
        return (
            self.mesh is other.mesh
            and self.instance == other.instance
            and self.displacements.keys() == other.displacements.keys()
            and all(each.program is other.displacements[key].program for key, each in self.displacements.items())
        )


class Displaced(NamedTuple):
    """A displaced mesh, and what it was made of."""

    made_of: MadeOf
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
        values = (shown.world_from_object, shown.random, shown.color, *shown.properties.values())
        wanted = MadeOf(mesh, used, tuple(None if value is None else value.tobytes() for value in values))
        found = next((each for each in kept if each.made_of.equals(wanted)), None)
        known.append(found or Displaced(wanted, displace_mesh(mesh, used, shown)))
        moved[number] = known[-1].mesh
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


def displace_mesh(mesh: raytracer.Mesh, used: Mapping[int, Displacement], shown: raytracer.Instances) -> raytracer.Mesh:
    """Return a mesh moved, without the attributes that only this needs."""
    attributes = dict(mesh.attributes)
    normals, smooth = attributes.pop(VERTEX_NORMAL), attributes.pop(SMOOTH)
    materials = [raytracer.Material(()) for _ in range(int(np.max(mesh.material)) + 1)]
    scene = raytracer.Scene(
        meshes=[dataclasses.replace(mesh, attributes=attributes)], instances=shown, materials=materials
    )
    return displace(scene, used, normals, smooth[:, 0, 0] > 0)
