"""The stages that a scene is seen by: what `prepare` composes, and `loop` runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Numbers, Vectors
from raytracer.casting.ray_visibility import (
    CastInside,
    CastRays,
)
from raytracer.integrator.caustics import Caustics
from raytracer.integrator.light_sources import (
    LightSource,
)
from raytracer.integrator.media.scene_media import SceneMedia
from raytracer.integrator.passes.light_groups import GroupedLight
from raytracer.integrator.picked_lights import LightGroup
from raytracer.integrator.scene_records import MeasureDepth
from raytracer.integrator.settings import Settings
from raytracer.integrator.shadow_rays import (
    CastShadows,
    Visibility,
)
from raytracer.lights.emitter_groups import EmitterGroup
from raytracer.lights.emitter_table import Emitters
from raytracer.lights.environment import Environment
from raytracer.lights.glints import Glint
from raytracer.lights.light_linking import LightLinks, ShadowLinks
from raytracer.lights.light_nodes import ComputedLight
from raytracer.lights.sky_aovs import SkyAovs
from raytracer.sampling.dimensions import WaveDimensions
from raytracer.scene.light_groups import NO_GROUP
from raytracer.scene.lights import Light
from raytracer.shading.aovs import MaterialAovs
from raytracer.shading.materials import MaterialTable
from raytracer.shading.probes import ProgramCaster
from raytracer.surfaces.screen_motion import ScreenMotion
from raytracer.surfaces.surface_tables import SurfaceTables
from raytracer.surfaces.terminator import Lift, Terminator, lift_points


@dataclass(frozen=True, eq=False)
class Integrator:
    """The stages that a scene and its settings need.

    cast : finds what rays hit of what they see
    sources : one for each source of light that surfaces are lit by
    visible_lights : lights that a reflected ray can meet
    light_nodes : what evaluates the nodes of lights that have any
    mattes : by kind of Cryptomatte that is asked for, the hashes that materials, or instances and groups, are known by
    eye : (3,) where the camera's rays come from; None without a camera, or of an orthographic one
    screen_motion : tells of motion over the picture; None where no pass asks, or nothing is known of other frames
    camera_axes : (3, 3) world directions of camera space; None where nobody asks, or there is no camera
    counts_bounces : True where a light asks how many bounces led to what it lights
    visible_groups : many lights likewise
    emitters : None where nothing is emissive
    emitter_group : of objects that shine, where a few of many are aimed at; None where all are sampled by power
    background : the world, or None where it is black
    visibility : how shadow rays fare
    program_caster : casts rays for programs; None where no program casts any
    holdout : (instances + groups,) bool, or None where nothing punches holes
    pass_index : (instances + groups,) int32
    needs_light : False where all passes are known at the first surface
    goes_on : True where rays can go on from a surface
    interreflects : True where diffuse reflection is followed, or light that comes through diffusely
    told_apart : the kinds of sources of which reflected rays find other light than samples do; where there are any, or
        media shine, diffuse reflection is followed, if only to what shines
    shares : of the sources that are told apart by their kinds, as of LightSource
    emission_ahead : True where a ray that goes on can meet a light, emissive geometry or the world
    late_roulette : True where paths that leave narrow lobes are ended by chance after what they meet next
    dimensions : numbered dimensions of a wave
    links : which objects are lit by what, or None where all are by all
    shadow_links : which objects shadow the light of what, or None where all shadow all
    cast_shadow : finds what shadow rays hit of what they see
    tells_paths : True where a program asks how rays came
    aovs, sky_aovs : what surfaces and the world write to passes of their own; None where nothing is written
    grouped : which groups of lights what shines belongs to; None where no pass asks
    terminator : offsets of the shadow terminator; None where no smooth mesh has any
    cast_inside : finds what rays below a surface hit of their own object; None where no light goes there
    measure_depth : tells how far points are before the camera; None without portals, whose rays do not tell
    glints : what narrow lobes meet by chance alone; none where there are no such lobes, or no pass has an error
    media : what fills space; None where nothing does
    caustics : bends light through glass; None where nothing does
    is_catcher : (instances + groups,) bool, or None where nothing catches shadows
    catchers_only : the stages of the scene without all but its shadow catchers, or None
    """

    cast: CastRays
    settings: Settings
    tables: SurfaceTables
    materials: MaterialTable
    sources: tuple[LightSource, ...]
    visible_lights: tuple[Light, ...]
    emitters: Emitters | None
    background: Environment | None
    visibility: Visibility
    cast_shadow: CastShadows
    program_caster: ProgramCaster | None
    holdout: Booleans | None
    pass_index: NDArray[np.int32]
    needs_light: bool
    goes_on: bool
    interreflects: bool
    emission_ahead: bool
    dimensions: WaveDimensions
    links: LightLinks | None = None
    shadow_links: ShadowLinks | None = None
    told_apart: frozenset[int] = frozenset()
    shares: Mapping[int, float] = field(default_factory=dict)
    late_roulette: bool = False
    tells_paths: bool = False
    terminator: Terminator | None = None
    is_catcher: Booleans | None = None
    catchers_only: Integrator | None = None
    light_nodes: Mapping[Light, ComputedLight] = field(default_factory=dict)
    counts_bounces: bool = False
    visible_groups: tuple[LightGroup, ...] = ()
    emitter_group: EmitterGroup | None = None
    eye: Vectors | None = None
    screen_motion: ScreenMotion | None = None
    camera_axes: Vectors | None = None
    mattes: Mapping[str, Numbers] = field(default_factory=dict)
    aovs: MaterialAovs | None = None
    sky_aovs: SkyAovs | None = None
    grouped: GroupedLight | None = None
    cast_inside: CastInside | None = None
    glints: tuple[Glint, ...] = ()
    media: SceneMedia | None = None
    measure_depth: MeasureDepth | None = None
    caustics: Caustics | None = None

    @property
    def looks_around(self) -> bool:
        """True where rays that are reflected diffusely, or scattered, see light that no sample finds: of sources that
        are told apart, and of media."""
        return bool(self.told_apart) or (self.media is not None and self.media.emits)

    @property
    def reflects_no_light(self) -> bool:
        """True where diffuse surfaces reflect none of what other surfaces send them: light only comes through them."""
        return self.settings.integrator == "direct" and not self.looks_around

    @property
    def world_group(self) -> int:
        """The number of the world's group of lights; -1 for none."""
        return NO_GROUP if self.grouped is None else self.grouped.of_world

    def find_group(self, light: Light) -> int:
        """Return the number of a light's group; -1 for none."""
        return NO_GROUP if self.grouped is None else self.grouped.of_lights[light]

    def share_density(self, kind: int, density: Numbers) -> Numbers:
        """Return the density (n,) of samples of a kind of source in its share."""
        return density * self.shares[kind] if kind in self.shares else density


def find_lift(integrator: Integrator) -> Lift | None:
    """Return what tells which shadow rays start higher; None where none do."""
    terminator = integrator.terminator
    if terminator is None or not terminator.cutoff.any():
        return None
    return partial(lift_points, integrator.tables, terminator)
