"""Parameters of closures that programs compute: which, for which materials, and their values at points.

A material without computed parameters is not in here, and a scene without any has no ComputedMaterials at all.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import put_rows, shorten_rows
from raytracer.arrays.types import Floats, Integers
from raytracer.scene.materials import CLOSURE_COLORS, CLOSURE_RANGES, CLOSURE_VECTORS, Closure, shines
from raytracer.scene.programs import Program, Register, Value
from raytracer.scene.scene import Scene
from raytracer.shading.evaluate import evaluate, find_needed, list_attributes
from raytracer.shading.footprint import measure_footprint
from raytracer.shading.light_path import LightPath
from raytracer.shading.like_programs import describe_program, describe_value, merge_programs
from raytracer.shading.site import Site
from raytracer.shading.site_tables import SiteTables
from raytracer.surfaces.surface import Surface

# What each kind of closure shines with and lets through depends on; `materials` sums it.
RADIANCE_FIELDS = {"principled": ("weight", "alpha", "emission"), "emission": ("weight", "color")}
TRANSPARENCY_FIELDS = {
    **dict.fromkeys(("principled", "hair_huang"), ("weight", "alpha")),
    "transparent": ("weight", "color"),
}

Slot = tuple[int, str]
Columns = dict[Slot, Floats]
# The slot of a material's own normal, before all closures.
NORMAL: Slot = (-1, "normal")


@dataclass(frozen=True, eq=False)
class Recipe:
    """How some parameters of one material, or of several that are like it, are computed.

    values : the register, or the constant direction, of a field of a closure, by (slot, field)
    needed : the program's steps for them
    shining : those of the values that are light
    """

    program: Program
    values: dict[Slot, Value]
    needed: tuple[int, ...]
    shining: frozenset[Slot]


@dataclass(frozen=True, eq=False)
class Recipes:
    """The recipes of a scene's materials; those that differ in their images alone are one.

    number : (materials,) int64, each material's among `recipes`; -1 where nothing is computed
    """

    recipes: tuple[Recipe, ...]
    number: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ComputedMaterials:
    """The recipes of a scene's materials: for everything, for emission and transparency alone, and for the
    normals of those that have their own."""

    tables: SiteTables
    everything: Recipes
    radiance: Recipes
    transparency: Recipes
    normals: Recipes


def list_scene_attributes(scene: Scene) -> set[str]:
    """Return the names of the mesh attributes that the programs of a scene read."""
    return {name for material in scene.materials for program in material.programs for name in list_attributes(program)}


def make_computed_materials(kept: list[list[Closure]], scene: Scene, tables: SiteTables) -> ComputedMaterials:
    """Return the recipes for the closures `kept` of each material, in their slots."""
    programs = [material.program or Program() for material in scene.materials]
    return ComputedMaterials(
        tables=tables,
        everything=_make_recipes(kept, programs, None),
        radiance=_make_recipes(kept, programs, RADIANCE_FIELDS),
        transparency=_make_recipes(kept, programs, TRANSPARENCY_FIELDS),
        normals=_make_normal_recipes(scene),
    )


def _make_normal_recipes(scene: Scene) -> Recipes:
    recipes = {}
    for number, material in enumerate(scene.materials):
        if material.normal is not None and material.program is not None:
            needed = find_needed(material.program, [material.normal])
            recipes[number] = Recipe(material.program, {NORMAL: material.normal}, needed, frozenset())
    return join_recipes(recipes, len(scene.materials))


def bend_normals(computed: ComputedMaterials, surface: Surface, path: LightPath | None) -> Surface:
    """Return the surface with the shading normals that materials have of their own."""
    if not computed.normals.recipes:
        return surface
    bent = compute_columns(computed, computed.normals, surface, path).get(NORMAL)
    if bent is None:
        return surface
    sign = np.where(surface.front, 1.0, -1.0)[:, np.newaxis]
    normal = np.where(np.isnan(bent), surface.shading_normal, sign * bent)
    return replace(surface, shading_normal=normal)


def _make_recipes(
    kept: list[list[Closure]], programs: list[Program], fields: Mapping[str, tuple[str, ...]] | None
) -> Recipes:
    recipes = {}
    for material, closures in enumerate(kept):
        values: dict[Slot, Value] = {}
        for slot, closure in enumerate(closures):
            computed = {**closure.registers, **closure.vectors}
            wanted = computed if fields is None else fields.get(closure.kind, ())
            values |= {(slot, name): value for name, value in computed.items() if name in wanted}
        if values:
            program = programs[material]
            shining = frozenset((slot, name) for slot, name in values if shines(closures[slot].kind, name))
            recipes[material] = Recipe(program, values, find_needed(program, values.values()), shining)
    return join_recipes(recipes, len(kept))


def join_recipes(recipes: dict[int, Recipe], count: int) -> Recipes:
    """Return the recipes of `count` materials, by number, with those that are like each other as one."""
    groups: dict[Hashable, list[int]] = {}
    for material, recipe in recipes.items():
        values = tuple(
            (slot, slot in recipe.shining, describe_value(recipe.values[slot])) for slot in sorted(recipe.values)
        )
        groups.setdefault((describe_program(recipe.program, recipe.needed), values), []).append(material)
    number = np.full(count, -1, dtype=np.int64)
    joined: list[Recipe] = []
    for materials in groups.values():
        number[materials] = len(joined)
        first = recipes[materials[0]]
        program = merge_programs([recipes[material].program for material in materials], materials, first.needed)
        joined.append(replace(first, program=program) if len(materials) > 1 else first)
    return Recipes(tuple(joined), number)


def compute_columns(computed: ComputedMaterials, recipes: Recipes, surface: Surface, path: LightPath | None) -> Columns:
    """Return what the recipes make at n points: by (slot, field) arrays of n rows, NaN at points whose material does
    not compute that field."""
    columns: Columns = {}
    for recipe, points in sort_points(recipes, surface.material):
        rows = shorten_rows(points, len(surface))
        outputs = evaluate(recipe.program, make_site(computed.tables, surface, path, rows), recipe.needed)
        for slot, value in recipe.values.items():
            width = 3 if slot[1] in (*CLOSURE_COLORS, *CLOSURE_VECTORS) else 1
            if slot not in columns:
                columns[slot] = np.full((width, len(surface)), np.nan).T if width > 1 else np.full(len(surface), np.nan)
            found = outputs[value] if isinstance(value, Register) else value
            found = limit(slot[1], found, slot in recipe.shining)
            if width > 1:
                put_rows(columns[slot], rows, np.broadcast_to(found, (len(points), width)))
            else:
                columns[slot][rows] = found
    return columns


def sort_points(recipes: Recipes, material: Integers) -> Iterator[tuple[Recipe, NDArray[np.intp]]]:
    """Yield each recipe of materials (n,), and its points in rising order: sorted once for all."""
    if not recipes.recipes:
        return
    number = recipes.number[material] + 1
    order = np.argsort(number, kind="stable")
    ends = np.cumsum(np.bincount(number, minlength=len(recipes.recipes) + 1))
    for recipe, start, end in zip(recipes.recipes, ends.tolist(), ends[1:].tolist(), strict=False):
        if end > start:
            yield recipe, order[start:end]


def make_site(tables: SiteTables, surface: Surface, path: LightPath | None, points: NDArray[np.intp] | slice) -> Site:
    """Return some of n points of a surface as programs see them."""
    chosen, surface = None if path is None else path.select(points), surface.select(points)
    return Site(surface, tables, chosen, measure_footprint(tables, surface, chosen))


def limit(name: str, values: object, shining: bool = False) -> Floats:
    """Return a field's values cut to its range, as Cycles cuts them, light uncut; what is not finite becomes 0."""
    found = np.asarray(values, dtype=np.float64)
    found = np.where(np.isfinite(found), found, 0.0)
    if shining or name in CLOSURE_VECTORS:
        return found
    low, high = CLOSURE_RANGES.get(name, (0.0, np.inf))
    return np.clip(found, low, high)
