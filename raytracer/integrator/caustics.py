"""Caustics in the light loop: which lights are bent onto which surfaces, and what paths then leave to that.

An artist says which lights make caustics, which objects cast them (smooth meshes of clear glass), which receive them.
Where the straight way from a receiver to a sample of such a light meets casters, `raytracer.caustics` looks for the
light that comes bent through them. Paths then leave it alone: one that a receiver has scattered, and a caster after
that, does not see these lights.

So what paths would have brought besides is missing: light that casters reflect, light whose straight way meets no
caster, chains that are not found, all but one where there are several, and what focuses beyond `chains.MOST_FOCUS`.
That bias is Cycles' own; the artist gets a picture without fireflies for it.

Notes
-----
Unlike Cycles' ours are the same at any scale of a scene; it limits J to 2 per square metre, loses light that comes
nearly straight through panes, and takes facets for rough glass that are the same at all points of a chain. Here rough
glass casts none, and is left to paths.

References
----------
Blender, intern/cycles/kernel/integrator/shade_surface.h: integrate_surface_direct_light; intersect_closest.h: which
paths leave lights alone; mnee.h: kernel_path_mnee_sample.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from raytracer.arrays.rows import any_column, make_zeros, sum_columns, take_rows
from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.bsdfs.bounce_kinds import COUNTED, DIFFUSE
from raytracer.bsdfs.closures import Shading
from raytracer.casting.ray_visibility import CastRays
from raytracer.casting.rays import Hits, Rays, join_rays
from raytracer.caustics.casters import Casters, find_bending_eta, find_casters
from raytracer.caustics.chains import BentWays, find_seeds, find_ways
from raytracer.caustics.constraints import Ends
from raytracer.integrator.light_sources import LightSource, SampledLight, ShadingPoints
from raytracer.integrator.paths import Paths
from raytracer.integrator.settings import Settings
from raytracer.lecture import dot
from raytracer.lights.bent_light import can_bend, weigh_bent
from raytracer.lights.light_shapes import LightSamples
from raytracer.scene.fields import SEEN_BY
from raytracer.scene.lights import Light, SunLight
from raytracer.scene.scene import Scene
from raytracer.shading.light_path import Depths, describe_reflected
from raytracer.shading.materials import MaterialTable, make_shading
from raytracer.surfaces.departing import depart
from raytracer.surfaces.surface import Surface
from raytracer.surfaces.surface_tables import SurfaceTables

# Bits of `Paths.received`: a receiver has scattered the path; one had before its last scattering.
RECEIVED, BEFORE = 1, 2


@dataclass(frozen=True, eq=False)
class Caustics:
    """What makes caustics in a scene.

    lights : those that are bent
    is_receiver : (instances + groups,) bool
    """

    casters: Casters
    materials: MaterialTable
    settings: Settings
    lights: frozenset[Light]
    is_receiver: Booleans

    def leaves(self, light: Light, paths: Paths) -> Booleans:
        """Return (k,) True for paths that leave a light to this."""
        if light not in self.lights or paths.received is None:
            return np.zeros(len(paths), np.bool_)
        return (paths.received & BEFORE != 0) & self.casters.is_caster[paths.scatterer]


def make_caustics(
    scene: Scene, cast: CastRays, tables: SurfaceTables, materials: MaterialTable, settings: Settings
) -> Caustics | None:
    """Return what makes caustics in a scene, or None where something is missing for that."""
    lights = frozenset(light for light in scene.lights if light.caustics and light.cast_shadow and can_bend(light))
    is_caster = find_casters(scene)
    receives = None if scene.instances is None else scene.instances.caustics_receiver
    if not lights or not is_caster.any() or receives is None or not receives.any():
        return None
    others = np.zeros(len(scene.groups), np.bool_)
    eta = np.array([find_bending_eta(material) for material in scene.materials])
    casters = Casters(partial(_cast_transmitted, cast), tables, np.concatenate([is_caster, others]), eta)
    return Caustics(casters, materials, settings, lights, np.concatenate([receives, others]))


def _cast_transmitted(cast: CastRays, rays: Rays) -> Hits:
    return cast(rays, np.full(len(rays), SEEN_BY["transmission"], np.uint8))


# Paths ----------------------------------------------------------------------------------------------------------------


def note_receivers(caustics: Caustics, paths: Paths, turned: Booleans) -> Paths:
    """Return paths that have just left a surface with what they know of receivers; turned : (k,) False for those that
    went straight through it."""
    before = paths.find_received()
    last = np.where(caustics.is_receiver[paths.scatterer], RECEIVED, 0)
    had = before & RECEIVED
    after = (last | had | np.where(had > 0, BEFORE, 0)).astype(np.uint8)
    return replace(paths, received=np.where(turned, after, before))


# Light ----------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, slots=True)
class BentLight:
    """What comes bent from samples of one light.

    light : n samples, of density inf where light comes, else 0
    rays : (m,) shadow rays from the last points of the ways of those, in order
    """

    light: LightSamples
    rays: Rays

    def aim(self, rows: Indices) -> Rays:
        """Return the shadow rays for some of the samples where light comes."""
        number = np.cumsum(self.light.density > 0) - 1
        return self.rays.select(number[rows])


@dataclass(frozen=True, eq=False)
class WaveCaustics:
    """Caustics as n points of a wave see them.

    paths : that led there
    throughput : (n, 3) float64, 0 for points that wait for no light
    """

    caustics: Caustics
    paths: Paths
    throughput: Floats

    def select(self, rows: Indices) -> WaveCaustics:
        """Return caustics as some of the points see them."""
        return WaveCaustics(self.caustics, self.paths.select(rows), take_rows(self.throughput, rows))

    def leave_out(self, source: LightSource, points: ShadingPoints, light: LightSamples) -> LightSamples:
        """Return samples of a source, of density 0 where chains find their light: behind casters whose glass is
        blurred, for paths that come from receivers."""
        if not self._is_bent(source) or self.paths.received is None:
            return light
        behind = dot(points.shading.geometric_normal, light.direction) < 0
        left = behind & self.caustics.casters.is_caster[points.surface.instance] & (self.paths.received != 0)
        return replace(light, density=np.where(left, 0.0, light.density)) if left.any() else light

    def bend(self, source: LightSource, points: ShadingPoints, light: LightSamples) -> BentLight | None:
        """Return what comes bent of samples of a source; None where nothing does."""
        if not isinstance(source, SampledLight) or not self._is_bent(source):
            return None
        rows = self._find_waiting(points, light)
        if not len(rows):
            return None
        ends = _find_ends(source.light, points.surface.select(rows), points.shading, light, rows)
        seeds = find_seeds(self.caustics.casters, ends)
        seeds.count[~self._may_bounce(rows, seeds.count)] = 0
        ways = find_ways(self.caustics.casters, ends, seeds, partial(self._shade, points.depths.select(rows)))
        return _join_ways(source.light, points, light, rows, ways)

    def _is_bent(self, source: LightSource) -> bool:
        return isinstance(source, SampledLight) and source.light in self.caustics.lights

    def _find_waiting(self, points: ShadingPoints, light: LightSamples) -> Indices:
        """Return the points (k,) that receive caustics and may get light from the side that they are seen from."""
        waiting = self.caustics.is_receiver[points.surface.instance] & any_column(self.throughput != 0)
        waiting &= (light.density > 0) & any_column(light.weight != 0)
        return np.flatnonzero(waiting & (dot(points.shading.geometric_normal, light.direction) > 0))

    def _may_bounce(self, rows: Indices, count: Indices) -> Booleans:
        """Return (k,) True for paths that may bounce diffusely and go through so many surfaces, as Cycles counts."""
        bounces, settings = take_rows(self.paths.bounces, rows), self.caustics.settings
        assert settings.diffuse_bounces is not None
        assert settings.transmission_bounces is not None
        diffuse, transmitted = (bounces[:, COUNTED.index(name)] for name in ("diffuse", "transmission"))
        allowed = (diffuse < settings.diffuse_bounces) & (transmitted + count <= settings.transmission_bounces + 1)
        return allowed & (sum_columns(bounces) + count <= settings.max_bounces)

    def _shade(self, depths: Depths, surface: Surface, rows: Indices) -> Shading:
        """Return what materials do at points of chains, which programs see as met by diffusely reflected rays."""
        path = None
        if self.caustics.materials.computed is not None:
            kind = np.full(len(rows), DIFFUSE, np.uint8)
            path = describe_reflected(kind, np.zeros(len(rows)), depths.select(rows))
        return make_shading(self.caustics.materials, surface, path)


def _find_ends(light: Light, surface: Surface, shading: Shading, samples: LightSamples, rows: Indices) -> Ends:
    """Return what chains from points (k,) join."""
    direction, distance = take_rows(samples.direction, rows), samples.distance[rows]
    distant = np.full(len(rows), float(isinstance(light, SunLight)))
    near = distant == 0
    aim = direction.copy("K")
    aim[near] = surface.position[near] + distance[near, np.newaxis] * direction[near]
    return Ends(surface.position, surface.position_error, take_rows(shading.geometric_normal, rows), aim, distant)


def _join_ways(
    light: Light, points: ShadingPoints, samples: LightSamples, rows: Indices, ways: list[BentWays]
) -> BentLight | None:
    """Return the light that comes along all ways; rows : (k,) of the points that the ways start from."""
    found = [way for way in ways if len(way.rows)]
    if not found:
        return None
    count = len(points.surface)
    bent = LightSamples(samples.direction.copy("K"), samples.distance, make_zeros(count), np.zeros(count))
    chosen, rays = [], []
    for way in found:
        at = rows[way.rows]
        sampled = LightSamples(
            take_rows(samples.direction, at), samples.distance[at], take_rows(samples.weight, at), samples.density[at]
        )
        position = take_rows(points.surface.position, at)
        bent.weight[at] = way.share * weigh_bent(light, position, sampled, way.last.position, way.towards, way.spread)
        bent.direction[at], bent.density[at] = way.direction, np.inf
        chosen.append(at)
        rays.append(depart(way.last, way.towards, way.distance))
    order = np.argsort(np.concatenate(chosen))
    return BentLight(bent, join_rays(rays).select(order))
