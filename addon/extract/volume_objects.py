"""Volumes that are made of voxels: Volume objects and domains of smoke, as boxes that hold grids.

A grid is 0 around its voxels, so that all that a medium made of its values does lies within a box one voxel larger. (In
Cycles the border goes closer round the voxels, and leaves out those below the volume's clipping: what a medium does
where its grids are 0 may reach farther here.)

References
----------
Blender, intern/cycles/blender/volume.cpp, scene/volume.cpp, scene/object.cpp (object_volume_density),
blender/geometry.cpp (determine_geom_type).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

import raytracer

from ..voxels.process import VoxelError, VoxelReader
from .meshes import Geometry
from .warnings import WarningList

# Corners of the two triangles of each side of a box whose corners are numbered 4 x + 2 y + z; seen from outside they
# run counterclockwise.
BOX = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
TRIANGLES = [triangle for a, b, c, d in BOX for triangle in ((a, b, c), (a, c, d))]
# Properties of a domain that hold voxels, by what materials call them, and numbers of a value.
DOMAIN_GRIDS = {
    "density": ("density_grid", 1),
    "color": ("color_grid", 4),
    "flame": ("flame_grid", 1),
    "heat": ("heat_grid", 1),
    "temperature": ("temperature_grid", 1),
    "velocity": ("velocity_grid", 3),
}
# Those that are as coarse as the simulation, where its noise adds detail to the others.
COARSE = ("heat", "velocity")


def find_domain(shown: Any) -> Any:
    """Return the settings of an evaluated object's domain of smoke or fire, or None."""
    if shown.type != "MESH":
        return None
    found = (modifier for modifier in shown.modifiers if modifier.type == "FLUID" and modifier.fluid_type == "DOMAIN")
    settings = next((modifier.domain_settings for modifier in found), None)
    return settings if settings is not None and settings.domain_type == "GAS" else None


def is_volume(shown: Any) -> bool:
    """True for an evaluated object that Cycles renders as voxels."""
    return shown.type == "VOLUME" or find_domain(shown) is not None


def list_grids(shown: Any, name: str, warnings: WarningList) -> frozenset[str]:
    """Return the names of the grids that an object has."""
    if shown.type != "VOLUME":
        return frozenset(DOMAIN_GRIDS)
    grids = shown.data.grids
    if not grids.load():
        warnings.add(f"its volume cannot be read, it is left out: {grids.error_message}", name)
    return frozenset(grid.name for grid in grids)


def read_geometry(
    shown: Any,
    name: str,
    wanted: Collection[str],
    interpolation: str,
    reader: VoxelReader,
    warnings: WarningList,
    last: Geometry | None = None,
) -> Geometry | None:
    """Return the box of an evaluated object with its grids `wanted`, `last` if it is the same, or None without any.

    interpolation : between voxels, one of raytracer's
    """
    if not wanted:
        warnings.add("its material reads none of its grids: nothing of it is shown, as in Cycles", name)
        return None
    try:
        domain = find_domain(shown)
        found = reader.read(shown.data, sorted(wanted)) if domain is None else read_domain(domain, shown, wanted)
    except VoxelError as error:
        warnings.add(f"its volume cannot be read, it is left out: {error}", name)
        return None
    if missing := sorted(set(wanted) - found.keys() if shown.type == "VOLUME" else ()):
        warnings.add(f"grids of other types than numbers and vectors count as empty: {', '.join(missing)}", name)
    grids = {key: raytracer.Grid(values, matrix, interpolation) for key, (values, matrix) in found.items()}
    if not grids:
        return None
    if last is not None and is_same(last, name, grids):
        return last
    positions = find_box(grids.values())
    mesh = raytracer.Mesh(positions, TRIANGLES, name=name, grids=grids)
    return Geometry(mesh, np.repeat(np.arange(6, dtype=np.int32), 2), None, (0,))


def find_box(grids: Iterable[raytracer.Grid]) -> NDArray[np.float64]:
    """Return the corners (8, 3) of the box, along the axes of object space, of all places where a grid is not 0."""
    corners = []
    for grid in grids:
        places = np.array(list(product(*((-1.0, float(count)) for count in grid.values.shape[:3]))))  # (8, 3)
        matrix = grid.object_from_index
        corners.append((matrix[:3, :3] * places[:, np.newaxis]).sum(axis=2) + matrix[:3, 3])
    ends = np.concatenate(corners)
    return np.array(list(product(*zip(ends.min(axis=0), ends.max(axis=0), strict=True))))


def is_same(last: Geometry, name: str, grids: Mapping[str, raytracer.Grid]) -> bool:
    """True where a Geometry was made of these grids."""
    before = last.mesh.grids
    return last.mesh.name == name and before.keys() == grids.keys() and all(
        np.array_equal(grid.values, before[key].values)
        and np.array_equal(grid.object_from_index, before[key].object_from_index)
        and grid.interpolation == before[key].interpolation
        for key, grid in grids.items()
    )  # fmt: skip


def read_domain(
    domain: Any, shown: Any, wanted: Collection[str]
) -> dict[str, tuple[NDArray[np.float32], NDArray[np.float64]]]:
    """Return by name the grids of a domain that hold something: values and matrix from index to object space.

    Blender's simulation has a value for the middle of each of its cells, of which there are as many as fill the texture
    space of the domain's mesh.
    """
    found = {}
    for name in sorted(set(wanted) & DOMAIN_GRIDS.keys()):
        field, width = DOMAIN_GRIDS[name]
        finer = domain.noise_scale if domain.use_noise and name not in COARSE else 1
        size = np.array(domain.domain_resolution) * finer
        stored = getattr(domain, field)
        if not len(stored) or len(stored) != width * np.prod(size):
            continue
        flat = np.empty(len(stored), dtype=np.float32)
        stored.foreach_get(flat)
        values = np.swapaxes(flat.reshape(*size[::-1], width), 0, 2)  # x runs fastest
        found[name] = np.ascontiguousarray(values if width > 1 else values[..., 0]), find_cells(shown.data, size)
    return found


def find_cells(mesh: Any, size: NDArray[Any]) -> NDArray[np.float64]:
    """Return the matrix (4, 4) from the numbers of cells, which fill a mesh's texture space, to the mesh's space."""
    extent = 2.0 * np.array(mesh.texspace_size, dtype=np.float64)
    low = np.array(mesh.texspace_location, dtype=np.float64) - extent / 2.0
    matrix = np.diag([*(extent / size), 1.0])
    matrix[:3, 3] = low + 0.5 * extent / size
    return matrix
