"""Materials at the points that rays hit: sums of Blender's shader nodes.

A material is a sum of closures (`scene.materials.Closure`). At each hit every closure becomes what it is made of:
emitted radiance, transparency, a diffuse share, and microfacet lobes (`closures`). All work
on arrays of hits, grouped by kind of closure; parameters are arrays with one row per hit, and programs fill those that
vary over a surface (`computed`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import (
    add_rows,
    any_column,
    find_sign,
    lay_columns,
    make_zeros,
    mean_column,
    put_rows,
    repeat_column,
    take_rows,
)
from raytracer.arrays.types import Booleans, Floats, Integers
from raytracer.arrays.vectors import normalize
from raytracer.bsdfs.closure_nodes import SCATTERING
from raytracer.bsdfs.closures import Closures, Lobes, Points, Shading, TiltedDiffuse, pack_closures
from raytracer.bsdfs.portals import Portals
from raytracer.bsdfs.subsurface import Subsurface
from raytracer.scene.materials import CLOSURE_KINDS, CLOSURE_VECTORS, Closure
from raytracer.scene.scene import Scene
from raytracer.shading.computed import (
    Columns,
    ComputedMaterials,
    Recipes,
    bend_normals,
    compute_columns,
    make_computed_materials,
)
from raytracer.shading.light_path import LightPath, describe_shadow_rays
from raytracer.shading.site_tables import SiteTables
from raytracer.surfaces.surface import Surface


@dataclass(frozen=True, eq=False)
class MaterialTable:
    """All materials of a scene; slot s of a material is its closure number s.

    kinds : tuple of (materials,) int64 per slot, index into CLOSURE_KINDS, -1 = the material has no such closure
    parameters : tuple of Closures per slot, one row per material
    radiance : (materials, 3) float64, that the material's surface shines with; NaN where a program computes it
    transparency : (materials, 3) float64, share of light that passes straight through; NaN likewise
    pass_index : (materials,) int32
    stops_light : (materials,) bool, True where nothing passes through to cast light
    holdout : (materials, 3) float64, share that is a hole in the picture, NaN where a program computes it; None where
        no material has one
    fades_bumps : (materials,) bool, as of Material; None where all do
    computed : None where all materials are constant
    """

    kinds: tuple[NDArray[np.int64], ...]
    parameters: tuple[Closures, ...]
    radiance: Floats
    transparency: Floats
    pass_index: Integers
    stops_light: Booleans
    computed: ComputedMaterials | None = None
    holdout: Floats | None = None
    fades_bumps: Booleans | None = None


# Of a batch, no points.
NO_ROWS = np.zeros(0, np.intp)


def has_weight(closure: Closure) -> bool:
    """False for a closure that a constant weight of 0 switches off."""
    return "weight" in closure.registers or closure.weight > 0


def make_material_table(scene: Scene, sites: SiteTables | None = None) -> MaterialTable:
    """Pack the closures of a scene's materials; closures without weight are left out.

    sites : what programs read; None where no parameter is computed
    """
    kept = [[item for item in material.closures if has_weight(item)] for material in scene.materials]
    slots = range(max(map(len, kept)))
    columns = [[items[slot] if slot < len(items) else None for items in kept] for slot in slots]
    return MaterialTable(
        kinds=tuple(
            np.array([-1 if item is None else CLOSURE_KINDS.index(item.kind) for item in column]) for column in columns
        ),
        parameters=tuple(pack_closures([item or Closure("transparent") for item in column]) for column in columns),
        radiance=_sum_colors(kept, _radiance_of),
        transparency=_sum_colors(kept, _transparency_of),
        pass_index=np.array([material.pass_index for material in scene.materials], dtype=np.int32),
        stops_light=np.array([not material.transparent_shadow for material in scene.materials], dtype=np.bool_),
        computed=None if sites is None else make_computed_materials(kept, scene, sites),
        holdout=_sum_colors(kept, _holdout_of)
        if any(item.kind == "holdout" for items in kept for item in items)
        else None,
        fades_bumps=None
        if all(material.fades_bumps for material in scene.materials)
        else np.array([material.fades_bumps for material in scene.materials]),
    )


def _sum_colors(kept: list[list[Closure]], part: Callable[[str, Closures], Floats]) -> Floats:
    """Return (materials, 3) the sums of one part of the closures' light."""
    sums = [[part(item.kind, pack_closures([item])).sum(axis=0) for item in items] for items in kept]
    return lay_columns(np.array([sum(values, start=np.zeros(3)) for values in sums]))


def _radiance_of(kind: str, closures: Closures) -> Floats:
    """(k, 3) what closures of one kind shine with."""
    weight = closures.weight[:, np.newaxis]
    if kind == "principled":
        return weight * closures.alpha[:, np.newaxis] * closures.emission
    return weight * closures.color if kind == "emission" else np.zeros_like(closures.color)


def _transparency_of(kind: str, closures: Closures) -> Floats:
    """(k, 3) the share of light that closures of one kind let straight through."""
    weight = closures.weight[:, np.newaxis]
    if kind in ("principled", "hair_huang"):
        return repeat_column(closures.weight * (1.0 - closures.alpha))
    return weight * closures.color if kind == "transparent" else np.zeros_like(closures.color)


def _holdout_of(kind: str, closures: Closures) -> Floats:
    """(k, 3) the share of the surface that closures of one kind make a hole of."""
    weight = repeat_column(closures.weight)
    return weight if kind == "holdout" else 0.0 * weight


def _select_parameters(table: MaterialTable, slot: int, material: Integers, rows: Any, columns: Columns) -> Closures:
    """Return the parameters of a slot at `rows` of a batch: its materials', with what programs have computed."""
    closures = table.parameters[slot].select(material[rows])
    changed = {}
    for (other, name), column in columns.items():
        if other == slot and name not in CLOSURE_VECTORS:
            changed[name] = take_rows(column, rows)
    return dataclasses.replace(closures, computed=changed) if changed else closures


def _sum_parts(
    table: MaterialTable,
    recipes: Recipes | None,
    surface: Surface,
    path: LightPath | None,
    constant: Floats,
    part: Callable[[str, Closures], Floats],
    known: Columns | None = None,
) -> Floats:
    """Return one part of the light (n, 3) of n points: `constant` by material, or summed where programs compute it."""
    if not constant.any():
        return make_zeros(len(surface))
    total = take_rows(constant, surface.material)
    if table.computed is None:
        return total
    rows = np.flatnonzero(any_column(np.isnan(total)))
    if not len(rows):
        return total
    columns = known
    if columns is None:
        assert recipes is not None
        columns = compute_columns(table.computed, recipes, surface, path)
    put_rows(total, rows, 0.0)
    for slot, kinds in enumerate(table.kinds):
        kind_of_hit = kinds[surface.material[rows]]
        for kind in np.unique(kind_of_hit[kind_of_hit >= 0]):
            some = rows[kind_of_hit == kind]
            closures = _select_parameters(table, slot, surface.material, some, columns)
            add_rows(total, some, part(CLOSURE_KINDS[kind], closures))
    return total


def find_radiance(table: MaterialTable, surface: Surface, path: LightPath | None = None) -> Floats:
    """Return what n points of a surface shine with, (n, 3)."""
    recipes = table.computed.radiance if table.computed else None
    return _sum_parts(table, recipes, surface, path, table.radiance, _radiance_of)


def find_transparency(
    table: MaterialTable, surface: Surface, unstopped: Booleans | bool = False, path: LightPath | None = None
) -> Floats:
    """Return the share of light (n, 3) that shadow rays bring straight through n points of a surface.

    unstopped : (n,) or one for all, True for light that passes even materials that stop it
    path : how the shadow rays came, for programs that ask
    """
    recipes = table.computed.transparency if table.computed else None
    if table.computed and path is None:
        path = describe_shadow_rays(np.zeros(len(surface)))
    share = _sum_parts(table, recipes, surface, path, table.transparency, _transparency_of)
    stopped = table.stops_light[surface.material] & np.logical_not(unstopped)
    return np.where(stopped[:, np.newaxis], 0.0, share)


def make_shading(table: MaterialTable, surface: Surface, path: LightPath | None = None) -> Shading:
    """Return the Shading at n points of a surface; path : how the rays came, for programs that ask."""
    columns: Columns = {}
    if table.computed is not None:
        surface = bend_normals(table.computed, surface, path)
        columns = compute_columns(table.computed, table.computed.everything, surface, path)
    sign = find_sign(surface.front)[:, np.newaxis]
    lobes: list[Lobes] = []
    tilted: list[TiltedDiffuse] = []
    subsurface: list[Subsurface] = []
    portals: list[Portals] = []
    shading = Shading(
        normal=sign * surface.shading_normal,
        geometric_normal=sign * surface.geometric_normal,
        outgoing=surface.outgoing,
        radiance=_sum_parts(table, None, surface, path, table.radiance, _radiance_of, columns),
        transparency=_sum_parts(table, None, surface, path, table.transparency, _transparency_of, columns),
        diffuse=make_zeros(len(surface)),
        lobes=(),
        holdout=None
        if table.holdout is None
        else mean_column(_sum_parts(table, None, surface, path, table.holdout, _holdout_of, columns)),
        fades_bumps=None if table.fades_bumps is None else table.fades_bumps[surface.material],
    )
    for slot, kinds in enumerate(table.kinds):
        kind_of_hit = kinds[surface.material]
        present = set(kinds.tolist())
        for kind, add_closures in SCATTERING.items():
            number = CLOSURE_KINDS.index(kind)
            rows = np.flatnonzero(kind_of_hit == number) if number in present else NO_ROWS
            if len(rows):
                vectors = _own_vectors(columns, slot, rows, shading)
                points = Points(rows, surface.front[rows], shading, vectors, tilted, subsurface, portals)
                lobes.extend(add_closures(_select_parameters(table, slot, surface.material, rows, columns), points))
    return dataclasses.replace(
        shading,
        lobes=tuple(lobe for lobe in lobes if len(lobe)),
        tilted=tuple(part for part in tilted if len(part.hit)),
        subsurface=tuple(part for part in subsurface if len(part)),
        portals=tuple(part for part in portals if len(part)),
    )


def _own_vectors(columns: Columns, slot: int, rows: Any, shading: Shading) -> dict[str, Floats]:
    """Return the vectors (k, 3) that closures at `rows` have of their own, by name: directions are unit; normals are
    the surface's, positions NaN, and others 0, where they have none."""
    vectors = {}
    for name in CLOSURE_VECTORS:
        column = columns.get((slot, name))
        if column is None:
            continue
        own = take_rows(column, rows)
        if name == "position":
            vectors[name] = own
            continue
        own = normalize(np.where(np.isnan(own), 0.0, own))
        if name in ("tangent", "direction", "axis"):
            vectors[name] = own
        else:
            vectors[name] = np.where(any_column(own != 0)[:, np.newaxis], own, take_rows(shading.normal, rows))
    return vectors
