"""Which stages a scene needs: composed once, from its content and the passes asked for.

What a scene lacks has no stage, no table and costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Masks
from raytracer.casting.ray_visibility import (
    RayCaster,
    SceneCaster,
    make_cast,
    make_inside_cast,
    make_linked_cast,
)
from raytracer.casting.subset_caster import SubsetCaster
from raytracer.film.passes import find_pass, list_aovs, select_mattes, select_passes
from raytracer.integrator.caustics import make_caustics
from raytracer.integrator.emissive_source import EmissiveGeometry, make_geometry_source
from raytracer.integrator.features import Features, derive_features
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.light_sources import (
    LightSource,
    SampledLight,
    make_light_source,
    make_world_sources,
    set_chances,
)
from raytracer.integrator.media.scene_media import SceneMedia, keep_media, make_scene_media
from raytracer.integrator.media.shadow_media import media_visibility
from raytracer.integrator.passes.light_groups import group_light, group_source
from raytracer.integrator.picked_geometry import PickedGeometry, pick_geometry
from raytracer.integrator.picked_lights import LightGroup, PickedLight, make_picked_sources, split_lights
from raytracer.integrator.scene_records import (
    find_camera_axes,
    find_depth_measure,
    find_eye,
    find_identities,
    gather_records,
)
from raytracer.integrator.settings import Settings
from raytracer.integrator.shadow_rays import (
    make_shadow_cast,
    opaque_visibility,
    transparent_visibility,
)
from raytracer.integrator.subsurface.random_walk import count_numbers
from raytracer.integrator.told_apart import ToldApart, find_told_apart, is_seen_by_some, list_told_apart
from raytracer.lights.emitter_table import Emitters, make_emitters
from raytracer.lights.environment import Environment, make_environment, turn_environment
from raytracer.lights.glints import list_glints
from raytracer.lights.light_linking import LightLinks, ShadowLinks
from raytracer.lights.light_nodes import ComputedLight, make_computed_lights
from raytracer.lights.lights import has_extent
from raytracer.lights.sky_aovs import make_sky_aovs
from raytracer.media.majorants import Majorants
from raytracer.sampling.dimensions import allocate_dimensions
from raytracer.scene.fields import ALL_SETS, SEEN_BY, SEEN_BY_ALL
from raytracer.scene.lights import Light
from raytracer.scene.scene import Scene
from raytracer.shading.aovs import computes_aovs, make_material_aovs
from raytracer.shading.computed import list_scene_attributes
from raytracer.shading.evaluate import reads_light_path
from raytracer.shading.materials import MaterialTable, find_radiance, make_material_table
from raytracer.shading.probes import make_program_caster
from raytracer.shading.site_tables import make_site_tables
from raytracer.surfaces.places import make_order
from raytracer.surfaces.screen_motion import make_screen_motion
from raytracer.surfaces.surface_tables import SurfaceTables, make_surface_tables
from raytracer.surfaces.terminator import Terminator, make_terminator

# What programs of materials that ask for the picture's size get where there is none.
DEFAULT_RESOLUTION = (1000, 1000)
# The classes of rays that look for an even world.
LOOKING = SEEN_BY["diffuse"] | SEEN_BY["glossy"] | SEEN_BY["shadow"]


def prepare(
    scene: Scene,
    caster: SceneCaster,
    settings: Settings,
    resolution: tuple[int, int] = DEFAULT_RESOLUTION,
    take_part: Callable[[Booleans], RayCaster] | None = None,
    aims_at_all: bool = False,
    background: Environment | None = None,
    majorants: Majorants | None = None,
) -> Integrator:
    """Compose the stages that `scene` needs for the passes in `settings`.

    resolution : of the full picture, pixels
    take_part : returns the caster of some instances and groups of spheres; None: a SubsetCaster
    aims_at_all : True for a source for each light, however many there are
    background : the same world's at another moment, whose map of brightness is taken; None makes one
    majorants : of the media at another moment; None looks at them
    """
    features = derive_features(scene)
    needs_light = asks_for_light(settings)
    written = list_aovs(settings.passes)
    programs = features.programs or computes_aovs(scene, written)
    terminator = make_terminator(scene) if needs_light and features.smooth_normals else None
    tables = make_surface_tables(
        scene,
        caster.geometry,
        features.smooth_normals,
        uvs=features.uvs and "UV" in settings.passes,
        barycentric=programs or terminator is not None,
        roundoff=caster.roundoff,
    )
    sites = make_site_tables(scene, tables, list_scene_attributes(scene), resolution) if programs else None
    materials = make_material_table(scene, sites if features.programs else None)
    seen_by = gather_records(scene, "seen_by", np.int32).astype(np.uint8) if features.ray_visibility else None
    apart = find_told_apart(scene, seen_by) if needs_light else ToldApart()
    if background is not None:
        background = turn_environment(background, scene.camera, resolution)
    elif features.world and needs_light and scene.world is not None:
        background = make_environment(scene.world, scene.camera, resolution, apart.blockers or apart.world)
    computed: dict[Light, ComputedLight] = {}
    if features.light_nodes and needs_light:
        computed = make_computed_lights(scene.lights, scene.camera, resolution)
    told_apart = list_told_apart(apart, features, background, scene.lights)
    media = make_scene_media(scene, caster, tables, resolution, majorants) if features.media else None
    given = (scene, settings, features, tables, materials, background, terminator, computed, seen_by, told_apart, media)
    compose = partial(_compose, *given, aims_at_all)
    whole = compose(caster)
    if features.narrow and "Combined" in select_passes(settings.passes, from_centre=False):
        glints = list_glints(whole.visible_lights, whole.emitters, whole.background)
        whole = replace(whole, glints=tuple(glints))
    if "Vector" in settings.passes:
        whole = replace(whole, screen_motion=make_screen_motion(scene, caster.geometry, resolution))
    if written:
        aovs = make_material_aovs(scene, written, sites)
        whole = replace(whole, aovs=aovs, sky_aovs=make_sky_aovs(scene.world, written, scene.camera, resolution))
        if aovs is not None and aovs.casts_rays and whole.program_caster is None:
            whole = replace(whole, program_caster=make_program_caster(caster, whole.cast, make_order(tables)))
    if not catches_shadows(features, settings):
        return whole
    is_catcher = gather_records(scene, "shadow_catcher", np.bool_)
    part: RayCaster = take_part(is_catcher) if take_part else SubsetCaster(caster, is_catcher)
    return replace(whole, is_catcher=is_catcher, catchers_only=compose(part, is_catcher))


def asks_for_light(settings: Settings) -> bool:
    """True where a pass needs light; the others are known at the first surface."""
    return any(find_pass(name).needs_light for name in settings.passes)


def catches_shadows(features: Features, settings: Settings) -> bool:
    """True where shadow catchers change the picture."""
    return features.shadow_catchers and "Combined" in select_passes(settings.passes, from_centre=False)


def _compose(
    scene: Scene,
    settings: Settings,
    features: Features,
    tables: SurfaceTables,
    materials: MaterialTable,
    background: Environment | None,
    terminator: Terminator | None,
    computed: Mapping[Light, ComputedLight],
    seen_by: Masks | None,
    told_apart: frozenset[int],
    media: SceneMedia | None,
    aims_at_all: bool,
    caster: RayCaster,
    present: Booleans | None = None,
) -> Integrator:
    """Return the stages of a scene, or of its shadow catchers alone, with what lights them.

    computed : what evaluates the nodes of lights that have any
    seen_by : (instances + groups,) uint8, the classes of rays that see each; None where all see all
    media : what fills space; None where nothing does
    told_apart : as of Integrator
    aims_at_all : as of `prepare`
    caster : of what is present
    present : (instances + groups,) bool, which are shadow catchers; None for the whole scene
    """
    needs_light, order = asks_for_light(settings), make_order(tables)
    shines = media is not None and media.emits
    interreflects = settings.integrator == "path" or bool(told_apart) or shines or features.translucent
    interreflects = interreflects and features.diffuse and needs_light
    scatters = media is not None and settings.integrator == "path"
    emitters = None
    if features.emission and needs_light:
        emitters = make_emitters(tables, materials.radiance, partial(find_radiance, materials), present)
    lights = [light for light in scene.lights if light_is_on(light)] if needs_light else []
    links = _link_lights(scene, media is not None) if features.light_linking else None
    shadow_links = ShadowLinks(*_gather_links(scene, "shadow_set", "blockers")) if features.shadow_linking else None
    groups: list[LightGroup]
    cast = make_cast(caster, seen_by, order)
    caustics = None
    if features.caustics and needs_light and media is None and present is None:
        caustics = make_caustics(scene, cast, tables, materials, settings)
    bent = frozenset() if caustics is None else caustics.lights
    aimed_at, groups = (lights, []) if aims_at_all else split_lights(lights, links, computed, bent)
    sources: list[LightSource] = [
        make_light_source(light, features.rough or interreflects or scatters, links, computed.get(light))
        for light in aimed_at
    ]
    sources += [source for group in groups for source in make_picked_sources(group)]
    if emitters is not None:
        by_object = seen_by if seen_by is not None and _hides_emitters(emitters, seen_by, media is not None) else None
        of_geometry = make_geometry_source(emitters, links, by_object, by_pair=not aims_at_all)
        if shadow_links is not None:
            of_geometry = replace(of_geometry, blockers_by_object=shadow_links.blockers)
        # What catchers show is a quotient of two pictures, whose sources take the same numbers.
        by_power = aims_at_all or catches_shadows(features, settings)
        sources += [of_geometry] if by_power else pick_geometry(of_geometry)
    if background is not None:
        sources += make_world_sources(background, features.light_path or is_seen_by_some(seen_by, LOOKING))
    dimensions = allocate_dimensions(
        [source.dimension_count for source in sources],
        programs=features.program_rays + features.bevels,
        roulette=interreflects or scatters,
        walk_count=count_numbers() if features.subsurface else 0,
        media=media is not None,
    )
    sources = [replace(source, dimension=first) for source, first in zip(sources, dimensions.sources, strict=True)]
    # What is left out keeps its dimensions, so that the others are sampled alike with it and without.
    sources = [source for source in sources if _is_present(source, catchers_only=present is not None)]
    grouped = group_light(scene, settings.passes)
    if grouped is not None:
        sources = [group_source(source, grouped) for source in sources]
    if present is not None:
        grouped = None
        aimed_at = [light for light in aimed_at if light.shadow_catcher]
        groups = [group for group in groups if group.example.shadow_catcher]
        settings = replace(settings, passes=("Combined",))
    looks = features.specular or interreflects or scatters
    visible_lights = tuple(light for light in aimed_at if has_extent(light) and _is_met(light, looks))
    visible_groups = tuple(group for group in groups if group.has_extent and _is_met(group.example, looks))
    emission_ahead = bool(visible_lights or visible_groups) or emitters is not None or background is not None or shines
    aimed = set_chances(sources, told_apart)
    cast_shadow = make_shadow_cast(
        cast, None if shadow_links is None else make_linked_cast(cast, shadow_links.shadow_set)
    )
    within = media if media is None or present is None else keep_media(media, present)
    if within is not None:
        assert settings.shadow_passages is not None  # as Settings fills it in
        visibility = media_visibility(cast_shadow, tables, materials, settings.shadow_passages, within)
    elif features.transparency:
        assert settings.shadow_passages is not None  # as Settings fills it in
        visibility = transparent_visibility(cast_shadow, tables, materials, settings.shadow_passages)
    else:
        all_block_all = seen_by is None and shadow_links is None
        visibility = opaque_visibility(caster, None if all_block_all else cast_shadow, order)
    return Integrator(
        cast=cast,
        settings=settings,
        tables=tables,
        materials=materials,
        sources=aimed,
        visible_lights=visible_lights,
        light_nodes=computed,
        counts_bounces=features.light_bounces,
        eye=find_eye(scene),
        camera_axes=find_camera_axes(scene) if "Denoising Normal" in settings.passes else None,
        mattes={kind: find_identities(scene, kind) for kind in select_mattes(settings.passes)},
        emitters=emitters,
        emitter_group=next((source.group for source in sources if isinstance(source, PickedGeometry)), None),
        grouped=grouped,
        background=background,
        visibility=visibility,
        cast_shadow=cast_shadow,
        program_caster=make_program_caster(caster, cast, order) if features.program_rays else None,
        holdout=gather_records(scene, "holdout", np.bool_) if features.holdout else None,
        pass_index=gather_records(scene, "pass_index", np.int32),
        needs_light=needs_light,
        goes_on=features.specular or features.transparency or features.portals or features.subsurface or interreflects,
        interreflects=interreflects,
        visible_groups=visible_groups,
        emission_ahead=emission_ahead,
        # Media scatter and shine on the way to what is met next.
        late_roulette=features.narrow and emission_ahead and media is None,
        dimensions=dimensions,
        links=links,
        shadow_links=shadow_links,
        told_apart=told_apart,
        shares={source.kind: source.share for source in aimed if source.kind in told_apart},
        tells_paths=features.light_path
        or (background is not None and background.program is not None)
        or any(reads_light_path(light.nodes.program) for light in computed.values()),
        terminator=terminator,
        cast_inside=make_inside_cast(caster, order) if features.subsurface and needs_light else None,
        media=within,
        measure_depth=find_depth_measure(scene) if features.portals else None,
        caustics=caustics,
    )


def _gather_links(scene: Scene, *names: str) -> list[NDArray[np.int64]]:
    """Return the sets that objects belong to, and those that each shines on or is shadowed by."""
    return [gather_records(scene, name, np.int64) for name in names]


def _link_lights(scene: Scene, with_world: bool) -> LightLinks:
    """Return which objects are lit by what; with_world : the last row, which is number -1, stands for what fills the
    world: it is of the first set."""
    sets, receivers = _gather_links(scene, "light_set", "receivers")
    if with_world:
        sets, receivers = np.append(sets, 0), np.append(receivers, ALL_SETS)
    return LightLinks(sets, receivers)


def _hides_emitters(emitters: Emitters, seen_by: Masks, has_media: bool) -> bool:
    """True where emissive geometry is hidden from reflected rays of some kind, or from scattered ones."""
    reflected = SEEN_BY["diffuse"] | SEEN_BY["glossy"] | SEEN_BY["transmission"]
    reflected |= SEEN_BY["volume"] if has_media else 0
    return bool(((seen_by[emitters.records] & reflected) != reflected).any())


def _is_present(source: LightSource, catchers_only: bool) -> bool:
    """True for a source of the scene; or, without all but shadow catchers, one that lights those."""
    if isinstance(source, SampledLight):
        return source.light.shadow_catcher or not catchers_only
    if isinstance(source, PickedLight):
        return source.group.example.shadow_catcher or not catchers_only
    return not (isinstance(source, EmissiveGeometry) and source.emitters.is_empty)


def _is_met(light: Light, reflects: bool) -> bool:
    """True where rays see a light that they meet.

    reflects : True where reflected rays look for light, and not the camera's alone
    """
    meeting = SEEN_BY_ALL - SEEN_BY["shadow"] if reflects else SEEN_BY["camera"]
    return bool(light.seen_by & meeting)


def light_is_on(light: Light) -> bool:
    """True where a light sends any light, or takes any away."""
    power = light.strength if hasattr(light, "strength") else light.power
    return bool(power.any())
