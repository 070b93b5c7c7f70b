"""Which stages a scene needs: composed once, from its content and the passes asked for.

What a scene lacks has no stage, no table and costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans
from raytracer.casting.caster import Caster
from raytracer.casting.ray_visibility import Cast, RayCaster, make_cast
from raytracer.casting.subset_caster import PartCaster
from raytracer.integrator.features import Features, derive_features
from raytracer.integrator.light_sources import (
    LightSource,
    emitter_source,
    leave_out,
    light_source,
    set_chances,
    world_sources,
)
from raytracer.integrator.settings import Settings
from raytracer.integrator.shadow_rays import Visibility, opaque_visibility, transparent_visibility
from raytracer.lights.emitters import Emitters, make_emitters
from raytracer.lights.environment import Environment, make_environment
from raytracer.lights.light_linking import LightLinks
from raytracer.lights.lights import has_extent
from raytracer.scene.fields import ALL_SETS, SEEN_BY, SEEN_BY_ALL
from raytracer.scene.lights import Light
from raytracer.scene.scene import Scene
from raytracer.shading.computed import list_scene_attributes
from raytracer.shading.materials import MaterialTable, find_radiance, make_material_table
from raytracer.shading.occlusion import Block, make_block
from raytracer.shading.site_tables import make_site_tables
from raytracer.surfaces.surface_tables import SurfaceTables, make_surface_tables

# Passes that need light; the others are known at the first surface.
LIGHT_PASSES = frozenset(("Combined", "Diffuse Color", "Emission", "Shadow"))
# Numbered dimensions of a wave: which way to go on, and where within it; the sources of light follow, the rays of
# programs, and last the chance to be cut short.
CHOICE, WAY, FIRST_SOURCE = range(3)
# What programs of materials that ask for the picture's size get where there is none.
DEFAULT_FRAME = (1000, 1000)


@dataclass(frozen=True, eq=False)
class Integrator:
    """The stages that a scene and its settings need.

    sources : one for each source of light that surfaces are lit by
    visible_lights : lights that a reflected ray can meet
    emitters : None where nothing shines
    background : the world, or None where it is black
    cast : finds what rays hit of what they see
    visibility : how shadow rays fare
    block : tells which rays of programs are blocked; None where no program casts any
    holdout : (instances + groups,) bool, or None where nothing punches holes
    links : which objects are lit by what, or None where all are by all
    is_catcher : (instances + groups,) bool, or None where nothing catches shadows
    alone : the stages of the scene without all but its shadow catchers, or None
    pass_index : (instances + groups,) int32
    needs_light : False where all passes are known at the first surface
    goes_on : True where rays can go on from a surface
    interreflects : True where diffuse reflection is followed
    shines : True where a ray that goes on can meet something that shines
    dimensions : numbered dimensions of a wave
    """

    cast: Cast
    settings: Settings
    tables: SurfaceTables
    materials: MaterialTable
    sources: tuple[LightSource, ...]
    visible_lights: tuple[Light, ...]
    emitters: Emitters | None
    background: Environment | None
    visibility: Visibility
    block: Block | None
    holdout: Booleans | None
    pass_index: NDArray[np.int32]
    needs_light: bool
    goes_on: bool
    interreflects: bool
    shines: bool
    dimensions: int
    links: LightLinks | None = None
    is_catcher: Booleans | None = None
    alone: Integrator | None = None


def prepare(
    scene: Scene,
    caster: Caster,
    settings: Settings,
    frame: tuple[int, int] = DEFAULT_FRAME,
    take_part: Callable[[Booleans], RayCaster] | None = None,
) -> Integrator:
    """Compose the stages that `scene` needs for the passes in `settings`.

    frame : size of the full picture, pixels
    take_part : returns the caster of some instances and groups of spheres; None: a PartCaster
    """
    features = derive_features(scene)
    needs_light = not LIGHT_PASSES.isdisjoint(settings.passes)
    tables = make_surface_tables(
        scene,
        caster.geometry,
        features.smooth_normals,
        uvs=features.uvs and "UV" in settings.passes,
        barycentric=features.programs,
        roundoff=caster.roundoff,
    )
    sites = make_site_tables(scene, tables, list_scene_attributes(scene), frame) if features.programs else None
    materials = make_material_table(scene, sites)
    background = None
    if features.world and needs_light and scene.world is not None:
        background = make_environment(scene.world, scene.camera, frame)
    compose = partial(_compose, scene, settings, features, tables, materials, background)
    whole = compose(caster)
    if not catches_shadows(features, settings):
        return whole
    is_catcher = _gather_records(scene, "shadow_catcher", np.bool_)
    part = take_part(is_catcher) if take_part else PartCaster(caster, is_catcher)
    return replace(whole, is_catcher=is_catcher, alone=compose(part, is_catcher))


def catches_shadows(features: Features, settings: Settings) -> bool:
    """True where shadow catchers change the picture."""
    return features.shadow_catchers and "Combined" in settings.passes


def _compose(
    scene: Scene,
    settings: Settings,
    features: Features,
    tables: SurfaceTables,
    materials: MaterialTable,
    background: Environment | None,
    caster: RayCaster,
    present: Booleans | None = None,
) -> Integrator:
    """Return the stages of a scene, or of its shadow catchers alone, with what lights them.

    caster : of what is present
    present : (instances + groups,) bool, which are shadow catchers; None for the whole scene
    """
    needs_light = not LIGHT_PASSES.isdisjoint(settings.passes)
    interreflects = settings.integrator == "path" and features.diffuse and needs_light
    emitters = None
    if features.emission and needs_light:
        emitters = make_emitters(tables, materials.radiance, partial(find_radiance, materials), present)
    lights = [light for light in scene.lights if light_is_on(light)] if needs_light else []
    links = None
    if features.light_linking:
        links = LightLinks(*(_gather_records(scene, name, np.int64) for name in ("light_set", "receivers")))
    sources = [light_source(light, features.rough or interreflects, links) for light in lights]
    shines = [present is None or light.shadow_catcher for light in lights]
    lights = list(compress(lights, shines))
    if emitters is not None:
        sources.append(emitter_source(emitters, links))
        shines.append(not emitters.is_empty)
    if background is not None:
        ways = world_sources(background)
        sources += ways
        shines += [True] * len(ways)
    reflects = features.mirrors or interreflects
    meeting = SEEN_BY_ALL - SEEN_BY["shadow"] if reflects else SEEN_BY["camera"]
    visible_lights = tuple(light for light in lights if has_extent(light) and light.seen_by & meeting)
    seen_by = _gather_records(scene, "seen_by", np.int32).astype(np.uint8) if features.ray_visibility else None
    cast = make_cast(caster, seen_by)
    if features.transparency:
        assert settings.shadow_passages is not None  # as Settings fills it in
        visibility = transparent_visibility(cast, tables, materials, settings.shadow_passages)
    else:
        visibility = opaque_visibility(caster, None if seen_by is None else cast)
    return Integrator(
        cast=cast,
        settings=settings if present is None else replace(settings, passes=("Combined",)),
        tables=tables,
        materials=materials,
        sources=set_chances(leave_out(sources, shines)),
        visible_lights=visible_lights,
        emitters=emitters,
        background=background,
        visibility=visibility,
        block=make_block(caster, cast, tables) if features.occlusion else None,
        holdout=_gather_records(scene, "holdout", np.bool_) if features.holdout else None,
        pass_index=_gather_records(scene, "pass_index", np.int32),
        needs_light=needs_light,
        goes_on=features.mirrors or features.transparency or interreflects,
        interreflects=interreflects,
        shines=bool(visible_lights) or emitters is not None or background is not None,
        links=links,
        dimensions=FIRST_SOURCE + sum(source.dimensions for source in sources) + features.occlusion + interreflects,
    )


def light_is_on(light: Light) -> bool:
    """True where a light sends any light."""
    power = light.strength if hasattr(light, "strength") else light.power
    return bool(power.max() > 0)


def _gather_records(scene: Scene, name: str, dtype: type) -> NDArray[Any]:
    """Return a property of all instances, then of all groups of spheres."""
    instances = None if scene.instances is None else getattr(scene.instances, name)
    if instances is None:
        default = {"seen_by": SEEN_BY_ALL, "receivers": ALL_SETS}.get(name, 0)
        instances = np.full(scene.instance_count, default, dtype)
    return np.concatenate([instances, np.array([getattr(group, name) for group in scene.spheres], dtype=dtype)])
