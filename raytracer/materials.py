"""Materials at the points that rays hit: sums of Blender's shader nodes.

A material is a sum of closures (`scene.Closure`). At each hit every closure becomes what it is made of: radiance that
shines, light that passes straight through, a diffuse share, and microfacet lobes (`closures`). All work on arrays of
hits, grouped by kind of closure; parameters are arrays with one row per hit, so that they may vary over a surface.
Imports `closures`, `rays`, `scene`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.closures import SCATTERING, Closures, Points, Shading, pack_closures
from raytracer.microfacet import Microfacets
from raytracer.rays import Floats, Integers, Surface
from raytracer.scene import CLOSURE_KINDS, Closure, Scene


@dataclass(frozen=True, eq=False)
class MaterialTable:
    """All materials of a scene; slot s of a material is its closure number s.

    kinds : tuple of (materials,) int64 per slot, index into CLOSURE_KINDS, -1 = the material has no such closure
    parameters : tuple of Closures per slot, one row per material
    radiance : (materials, 3) float64, that the material's surface shines with
    transparency : (materials, 3) float64, share of light that passes straight through
    pass_index : (materials,) int32
    """

    kinds: tuple[NDArray[np.int64], ...]
    parameters: tuple[Closures, ...]
    radiance: Floats
    transparency: Floats
    pass_index: Integers


def make_material_table(scene: Scene) -> MaterialTable:
    """Pack the closures of a scene's materials; closures without weight are left out."""
    kept = [[item for item in material.closures if item.weight > 0] for material in scene.materials]
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
    )


def _sum_colors(kept: list[list[Closure]], part: Callable[[Closure], Any]) -> Floats:
    return np.array([sum((item.weight * part(item) for item in items), start=np.zeros(3)) for items in kept])


def _radiance_of(closure: Closure) -> Any:
    if closure.kind == "principled":
        return closure.alpha * closure.emission
    return closure.color if closure.kind == "emission" else np.zeros(3)


def _transparency_of(closure: Closure) -> Any:
    if closure.kind == "principled":
        return np.full(3, 1.0 - closure.alpha)
    return closure.color if closure.kind == "transparent" else np.zeros(3)


def make_shading(table: MaterialTable, surface: Surface) -> Shading:
    """Return the Shading at n points of a surface."""
    sign = np.where(surface.front, 1.0, -1.0)[:, np.newaxis]
    lobes: list[Microfacets] = []
    shading = Shading(
        normal=sign * surface.shading_normal,
        geometric_normal=sign * surface.geometric_normal,
        outgoing=surface.outgoing,
        radiance=table.radiance[surface.material],
        transparency=table.transparency[surface.material],
        diffuse=np.zeros((len(surface), 3)),
        lobes=(),
    )
    for kinds, parameters in zip(table.kinds, table.parameters, strict=True):
        kind_of_hit = kinds[surface.material]
        for kind, add_closures in SCATTERING.items():
            rows = np.flatnonzero(kind_of_hit == CLOSURE_KINDS.index(kind))
            if len(rows):
                points = Points(rows, surface.front[rows], shading)
                lobes.extend(add_closures(parameters.select(surface.material[rows]), points))
    return dataclasses.replace(shading, lobes=tuple(lobe for lobe in lobes if len(lobe)))
