"""Parts and their places as records of the scene, in world space: instances, spheres, curves, lights."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import raytracer
from raytracer.scene.lights import Light

from .custom_properties import Color
from .instance_order import Shapes, Traits, order_instances
from .lights import extract_light
from .linking import LinkSets, make_link_sets
from .motion import PlacedPoints
from .parts import ObjectEntry, ObjectKey, Placements
from .strand_motion import PlacedStrands
from .warnings import WarningList

# Rounding that a product of float32 matrices may leave between axes of equal length: a few parts in 2^24.
UNIFORM_SCALE_TOLERANCE = 64 * float(np.finfo(np.float32).eps)


@dataclass(frozen=True)
class Placed:
    """Records of the scene in the order of `Hits.instance`: mesh instances, then groups of spheres, of curves.

    objects : of those, light_objects : of the lights
    instancers, light_instancers : `session_uid` of what shows each
    rows : the placements that the instances are; groups, hair : what the spheres and the curves are
    """

    instances: raytracer.Instances
    spheres: tuple[raytracer.Spheres, ...]
    curves: tuple[raytracer.Curves, ...]
    lights: tuple[Light, ...]
    objects: tuple[ObjectKey, ...]
    light_objects: tuple[ObjectKey, ...]
    instancers: tuple[int, ...]
    light_instancers: tuple[int, ...]
    rows: tuple[int, ...]
    groups: tuple[PlacedPoints, ...]
    hair: tuple[PlacedStrands, ...]


def place_parts(
    placements: Placements,
    warnings: WarningList,
    with_info: bool = False,
    shapes: Shapes | None = None,
) -> Placed:
    """Return instances, spheres, curves and lights in world space; those with a matrix that is not finite are left out.

    with_info : True where a material reads the random number or the color of its object
    shapes : by which mesh instances are numbered; None leaves them in Blender's order, that of `Scene.ray_cast`
    """
    matrices = np.array(placements.world_from_object).reshape(-1, 4, 4)  # (i, 4, 4)
    matrices[:, 3] = (0.0, 0.0, 0.0, 1.0)  # as Cycles: a parent's inverse matrix may hold anything there
    finite = np.isfinite(matrices).all(axis=(1, 2))  # (i,)
    links = make_link_sets(placements.links, warnings)
    meshes: list[int] = []
    spheres, groups, curves, hair, lights = [], [], [], [], []
    sphere_parts, curve_parts, light_parts = [], [], []
    for row, index in enumerate(placements.part):
        part = placements.parts[index]
        if not finite[row]:
            warnings.add("its matrix is NaN or infinite: object left out", part.object.name)
        elif part.mesh is not None:
            meshes.append(row)
        elif part.points is not None and not find_scale(matrices[row, :3, :3])[0]:
            pass  # scaled to nothing: spheres without a size are none
        elif part.points is not None or part.strands is not None:
            info: dict[str, Any] = {"random": placements.random[row], "color": part.color} if with_info else {}
            info |= {"properties": placements.properties[row], **vars(links[index])}
            if part.points is not None:
                spheres.append(replace(place_points(part, matrices[row], warnings), **info))
                groups.append(PlacedPoints(row, part.points, matrices[row]))
                sphere_parts.append(part)
            else:
                curves.append(replace(place_strands(part, matrices[row], warnings), **info))
                assert part.strands is not None
                hair.append(PlacedStrands(row, part.strands, matrices[row]))
                curve_parts.append(part)
        elif (light := _place_light(placements, row, matrices[row], warnings)) is not None:
            lights.append(replace(light, receivers=links[index].receivers, blockers=links[index].blockers))
            light_parts.append(part)
    if shapes is not None and len(meshes) > 1:
        meshes = _sort_rows(placements, meshes, matrices, shapes)
    parts = [placements.parts[placements.part[row]] for row in meshes]
    instances = raytracer.Instances(
        mesh=np.array([part.mesh for part in parts], dtype=np.int32),
        world_from_object=matrices[np.asarray(meshes, dtype=np.intp)],
        pass_index=np.array([part.pass_index for part in parts], dtype=np.int32),
        holdout=np.array([part.holdout for part in parts], dtype=np.bool_),
        shadow_catcher=np.array([part.shadow_catcher for part in parts], dtype=np.bool_),
        seen_by=np.array([part.seen_by for part in parts], dtype=np.int32),
        **_gather_links([links[placements.part[row]] for row in meshes]),
        terminator_geometry=_gather_offset(parts, 0),
        terminator_shading=_gather_offset(parts, 1),
        random=np.array([placements.random[row] for row in meshes]) if with_info else None,
        color=np.array([part.color for part in parts]).reshape(-1, 4) if with_info else None,
        properties=_gather_properties([placements.properties[row] for row in meshes]),
        caustics_caster=_gather_caustics(parts, 0),
        caustics_receiver=_gather_caustics(parts, 1),
        volume_density=_measure_density(parts, matrices[np.asarray(meshes, dtype=np.intp)]),
    )
    parts += [*sphere_parts, *curve_parts]
    return Placed(
        *(instances, tuple(spheres), tuple(curves), tuple(lights)),
        objects=tuple(part.object for part in parts),
        light_objects=tuple(part.object for part in light_parts),
        instancers=tuple(part.instancer for part in parts),
        light_instancers=tuple(part.instancer for part in light_parts),
        rows=tuple(meshes),
        groups=tuple(groups),
        hair=tuple(hair),
    )


def _gather_links(links: list[LinkSets]) -> dict[str, NDArray[Any]]:
    """Return by name the sets (i,) of instances."""
    types = {"light_set": np.int32, "receivers": np.int64, "shadow_set": np.int32, "blockers": np.int64}
    return {name: np.array([getattr(link, name) for link in links], dtype) for name, dtype in types.items()}


def _place_light(placements: Placements, row: int, matrix: NDArray[np.float64], warnings: WarningList) -> Light | None:
    part, properties = placements.parts[placements.part[row]], placements.properties[row]
    return extract_light(part, matrix, placements.random[row], warnings, properties)


def _sort_rows(placements: Placements, rows: list[int], matrices: NDArray[np.float64], shapes: Shapes) -> list[int]:
    """Return the rows of mesh instances in the order of their numbers."""
    traits = Traits(
        part=np.array(placements.part)[rows],
        names=[part.object.name for part in placements.parts],
        meshes=np.array([-1 if part.mesh is None else part.mesh for part in placements.parts]),
        world_from_object=matrices[rows],
        random=np.array(placements.random)[rows],
    )
    return np.asarray(rows)[order_instances(traits, shapes)].tolist()


def _gather_properties(found: list[dict[str, Color]]) -> dict[str, NDArray[np.float64]]:
    """Return by name (i, 4) the properties of instances; 0 for those whose materials do not ask."""
    names = sorted(set[str]().union(*found))
    return {name: np.array([values.get(name, np.zeros(4)) for values in found]) for name in names}


def _gather_offset(parts: list[ObjectEntry], number: int) -> NDArray[np.float64] | None:
    """Return an offset of the shadow terminator of each part; None where all are 0."""
    offset = np.array([part.terminator[number] for part in parts])
    return offset if offset.any() else None


def _gather_caustics(parts: list[ObjectEntry], number: int) -> NDArray[np.bool_] | None:
    """Return whether each part casts shadow caustics, or receives them; None where none does."""
    flags = np.array([part.caustics[number] for part in parts], dtype=np.bool_)
    return flags if flags.any() else None


def _measure_density(parts: list[ObjectEntry], matrices: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the factors (i,) of volumes whose density is by metre of object space, 1 for others; None where all are.

    As in Cycles (scene/object.cpp, object_volume_density): the inverse of how long the diagonal of a cube becomes.
    """
    by_scale = np.array([part.density_by_scale for part in parts], dtype=np.bool_)
    if not by_scale.any():
        return None
    diagonal = np.linalg.norm(matrices[:, :3, :3].sum(axis=2), axis=1) / np.sqrt(3.0)  # (i,)
    return np.divide(1.0, diagonal, out=np.ones(len(parts)), where=by_scale & (diagonal > 0))


def place_points(part: ObjectEntry, world_from_object: NDArray[np.float64], warnings: WarningList) -> raytracer.Spheres:
    """Return a point cloud as true spheres in world space.

    Under non-uniform scale the points would be ellipsoids: they become spheres of the same volume, with a warning.
    """
    assert part.points is not None
    axes = world_from_object[:3, :3]
    scale, is_uniform = find_scale(axes)
    if not is_uniform:
        warnings.add("non-uniform scale: its points are rendered as spheres of equal volume", part.object.name)
    return raytracer.Spheres(
        centres=part.points.centres @ axes.T + world_from_object[:3, 3],
        radii=part.points.radii * scale,
        material=part.material,
        pass_index=part.pass_index,
        holdout=part.holdout,
        shadow_catcher=part.shadow_catcher,
        seen_by=part.seen_by,
        name=part.object.name,
        attributes=part.points.attributes,
    )


def place_strands(part: ObjectEntry, world_from_object: NDArray[np.float64], warnings: WarningList) -> raytracer.Curves:
    """Return strands in world space; under non-uniform scale they stay round, with a warning."""
    strands, axes = part.strands, world_from_object[:3, :3]
    assert strands is not None
    scale, is_uniform = find_scale(axes)
    if not is_uniform:
        warnings.add("non-uniform scale: its strands stay as wide in all directions", part.object.name)
    return raytracer.Curves(
        points=strands.points @ axes.T + world_from_object[:3, 3],
        radii=strands.radii * scale,
        strands=strands.first,
        shape="thick" if strands.thick else "ribbon",
        material=part.material,
        uvs=strands.uvs,
        name=part.object.name,
        attributes=strands.attributes or {},
        strand_attributes=strands.strand_attributes or {},
        pass_index=part.pass_index,
        holdout=part.holdout,
        shadow_catcher=part.shadow_catcher,
        seen_by=part.seen_by,
        world_from_object=world_from_object,
    )


def find_scale(axes: NDArray[np.float64]) -> tuple[float, bool]:
    """Return the scale of a (3, 3) matrix, the third root of its volume, and whether it is that in all directions."""
    scale = abs(np.linalg.det(axes)) ** (1 / 3)
    return scale, bool(np.abs(axes.T @ axes - scale**2 * np.eye(3)).max() <= UNIFORM_SCALE_TOLERANCE * scale**2)
