"""All rays that one camera ray leads to, written down one by one: the lecture's "Recursive ray tracing" to look at.

A picture needs sums only; who learns, or looks for a mistake, wants the terms. Every surface sends one shadow ray to
the middle of each light, and one ray each the way it reflects, refracts and lets pass. Nothing is left to chance: of
perfect mirrors, clear glass and lights without extent the colors are the picture's own, of all else its simplest
estimate, without diffuse interreflection. The stages are the integrator's.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import reflect
from raytracer.bsdfs.bounce_kinds import GLOSSY, SINGULAR, STRAIGHT, TRANSMITTED
from raytracer.bsdfs.bsdf_samples import BsdfSample
from raytracer.bsdfs.closures import Shading
from raytracer.bsdfs.fresnel import refract
from raytracer.bsdfs.microfacet import Microfacets, evaluate_fresnel
from raytracer.casting.caster import Caster
from raytracer.casting.rays import Rays, make_rays
from raytracer.film.camera import primary_rays
from raytracer.integrator.bounces import classify_rays, find_closed, find_ended
from raytracer.integrator.contributions import add_background, add_emission, add_visible_lights
from raytracer.integrator.described_hits import describe_hit, find_start
from raytracer.integrator.direct_light import sample_lights
from raytracer.integrator.integrator import Integrator, find_lift
from raytracer.integrator.light_sources import GEOMETRY, LIGHT, ShadingPoints
from raytracer.integrator.path_passes import start_passes
from raytracer.integrator.paths import Paths, Wave, advance, start_paths
from raytracer.integrator.prepare import DEFAULT_RESOLUTION, light_is_on, prepare
from raytracer.integrator.ray_descriptions import describe_path
from raytracer.integrator.scattering import count_all
from raytracer.integrator.settings import Settings
from raytracer.integrator.shadow_rays import ShadowRays, cast_shadows, join_shadows
from raytracer.integrator.traced_rays import (
    CAMERA,
    EMITTERS,
    PASSED,
    REFLECTED,
    REFRACTED,
    WORLD,
    Shadow,
    TracedRay,
)
from raytracer.lecture import dot
from raytracer.lights.emitter_table import locate_emitters
from raytracer.lights.emitters import pick_emitters
from raytracer.sampling.sampler import Sampler
from raytracer.sampling.sobol import SobolSamples
from raytracer.scene.scene import Scene
from raytracer.shading.light_path import Depths
from raytracer.shading.materials import find_transparency, make_shading
from raytracer.surfaces.surface import make_surface

# A tree has so many rays at most, and none that counts less in the picture: more, the eye could not tell apart.
MOST_RAYS = 64
SMALLEST_SHARE = 1 / 64


class MiddleSamples(SobolSamples):
    """Sample numbers that are all 1/2, which aims at the middle of lights."""

    def select(self, index: Any) -> MiddleSamples:
        """Return the samples of some of the points."""
        return MiddleSamples(self.pixel[index], 0, 0)

    def uniform(self, dimension: int) -> Floats:
        """Return (n,) 1/2."""
        return np.full(len(self), 0.5)

    def uniform_pair(self, dimension: int, joined: int | None = None) -> Floats:
        """Return (n, 2) 1/2."""
        return np.full((len(self), 2), 0.5)


@dataclass(frozen=True, eq=False)
class Inspector:
    """A scene whose rays can be looked at; lights : the numbers of the scene's lights that are on."""

    scene: Scene
    caster: Caster
    integrator: Integrator
    lights: tuple[int, ...]

    def inspect_pixel(self, width: int, height: int, x: float, y: float) -> list[TracedRay]:
        """Return the rays that the camera's through a point of its picture leads to, the camera's first.

        width, height : of the full picture, pixels
        x, y : pixels from the lower left corner, y up; the centre of pixel (i, j) is (i + 0.5, j + 0.5)

        Raises
        ------
        ValueError
            If the scene has no camera.
        """
        if self.scene.camera is None:
            raise ValueError("Scene: camera: expected a Camera to look through, got None")
        return trace_tree(self, primary_rays(self.scene.camera, width, height, np.array([x]), np.array([y])))

    def inspect_ray(self, origin: Any, direction: Any, t_min: float = 0.0, t_max: float = np.inf) -> list[TracedRay]:
        """Return the rays that o + t d leads to, that first; arguments as those of `Caster.closest_hit`."""
        return trace_tree(self, make_rays(origin, direction, t_min, t_max))


def make_inspector(
    scene: Scene, caster: Caster, settings: Settings, resolution: tuple[int, int] | None = None
) -> Inspector:
    """Return what looks at the rays of `scene`.

    caster : of that scene
    settings : their limits of bounces are followed
    resolution : of the full picture, pixels, for materials that ask
    """
    settings = replace(settings, integrator="direct", passes=("Combined",), transparent=False)
    integrator = prepare(scene, caster, settings, resolution or DEFAULT_RESOLUTION, aims_at_all=True)
    lights = tuple(number for number, light in enumerate(scene.lights) if light_is_on(light))
    return Inspector(scene, caster, integrator, lights)


class Step(NamedTuple):
    """A ray that waits to be cast; its color counts `weight` (3,) in its parent's and `share` (3,) in the camera's."""

    kind: str
    parent: int
    path: Paths
    weight: Floats
    share: Floats


def trace_tree(inspector: Inspector, rays: Rays) -> list[TracedRay]:
    """Return the tree of one ray, each generation after the one before."""
    tree: list[TracedRay] = []
    waiting = deque([Step(CAMERA, -1, start_paths(rays), np.ones(3), np.ones(3))])
    while waiting:
        step = waiting.popleft()
        ray = start_ray(step)
        tree.append(ray)
        for kind, path, weight in trace_ray(inspector, ray, step.path):
            share = step.share * weight
            if share.max() < SMALLEST_SHARE or len(tree) + len(waiting) >= MOST_RAYS:
                ray.is_cut = True
            else:
                waiting.append(Step(kind, len(tree) - 1, path, weight, share))
    for ray in reversed(tree):
        if ray.parent >= 0:
            tree[ray.parent].color += ray.weight * ray.color
    return tree


def start_ray(step: Step) -> TracedRay:
    """Return the record of a ray that has seen nothing."""
    rays = step.path.rays
    origin = rays.origins[0] + find_start(rays) * rays.directions[0]
    return TracedRay(step.kind, step.parent, origin, rays.directions[0], step.weight, np.zeros(3))


Branch = tuple[str, Paths, Floats]  # kind, the path that goes on, its weight (3,)


def trace_ray(inspector: Inspector, ray: TracedRay, path: Paths) -> list[Branch]:
    """Cast one ray, write down what it finds and the light from there; return the branches on."""
    integrator = inspector.integrator
    hits = integrator.cast(path.rays, classify_rays(path.kind))
    passes = start_passes(integrator.settings, path.rays)
    add_background(integrator, passes, path, hits)
    add_visible_lights(integrator, passes, path, hits)
    branches: list[Branch] = []
    if hits.hit[0]:
        surface = make_surface(integrator.tables, path.rays, hits)
        own = Sampler(SobolSamples(np.zeros(1, np.uint32), 0, 0), None, 0)
        shading = make_shading(integrator.materials, surface, describe_path(integrator, path, hits, surface, own))
        wave = Wave(path, hits, surface, shading.lay_open())
        add_emission(integrator, passes, wave)
        ray.hit = describe_hit(inspector.caster, path.rays, hits, surface, shading)
        if not find_ended(path.bounces, integrator.settings)[0]:
            ray.shadows = list(trace_shadows(inspector, wave))
            ray.dark = sorted(set(inspector.lights) - {shadow.source for shadow in ray.shadows})
        branches = list(find_branches(integrator, wave))
    ray.color += passes.values["Combined"][0, :3] + sum(shadow.light * shadow.share for shadow in ray.shadows)
    return branches


# Light ----------------------------------------------------------------------------------------------------------------


def trace_shadows(inspector: Inspector, wave: Wave) -> Iterator[Shadow]:
    """Yield a shadow ray to each source of light of which the surface sends anything back."""
    integrator = inspector.integrator
    sampler = Sampler(MiddleSamples(np.zeros(1, np.uint32), 0, 0), None, 0)
    depths, bounces = Depths(wave.paths.passages, wave.paths.bounces), count_all(integrator, wave.paths)
    points = ShadingPoints(wave.surface, wave.shading, depths, sampler, find_lift(integrator), bounces)
    # Nothing but light sampling brings this light: no other way to its directions has a probability.
    probabilities = np.zeros((1, 1 + len(wave.shading.lobes)))
    row = np.zeros(1, np.intp)
    shadow_rays = sample_lights(integrator.sources, points, probabilities, np.ones((1, 3)), row, all_rays=True)
    names = name_sources(inspector)
    for source, name, rays in zip(integrator.sources, names, shadow_rays, strict=True):
        if len(rays.row):
            yield trace_shadow(integrator, name, rays, source.cast_shadow)


def name_sources(inspector: Inspector) -> list[int | str]:
    """Return what each of the integrator's sources is, as in `Shadow.source`; the world may have two."""
    lights = iter(inspector.lights)
    names = {GEOMETRY: EMITTERS}
    sources = inspector.integrator.sources
    return [next(lights) if source.kind == LIGHT else names.get(source.kind, WORLD) for source in sources]


def trace_shadow(integrator: Integrator, source: int | str, aimed: ShadowRays, casts: bool) -> Shadow:
    """Cast one shadow ray; casts : False for a light that throws no shadows."""
    rays, share, blocker, target = aimed.rays, np.ones(3), None, -1
    assert rays is not None
    if casts:
        share = np.broadcast_to(cast_shadows(integrator.visibility, [aimed])[0][0], 3)
        blocker = None if share.any() else find_blocker(integrator, aimed)
    if source == EMITTERS and integrator.emitters is not None:
        picked = pick_emitters(integrator.emitters, np.array([0.5]))
        target = int(locate_emitters(integrator.emitters, picked)[0][0])
    reach = float(rays.t_max[0])
    return Shadow(
        source=source,
        origin=rays.origins[0],
        direction=rays.directions[0],
        reach=reach,
        light=aimed.light[0],
        share=share,
        blocker=-1 if blocker is None else blocker.instance,
        primitive=-1 if blocker is None else blocker.primitive,
        end=reach if blocker is None else blocker.distance,
        target=target,
    )


class Blocker(NamedTuple):
    """What stops a shadow ray, at t = distance."""

    instance: int
    primitive: int
    distance: float


def find_blocker(integrator: Integrator, aimed: ShadowRays) -> Blocker | None:
    """Return the first surface on a shadow ray that lets nothing through, or the last there is; None where none is."""
    blocker, shadows = None, join_shadows([aimed])
    while True:
        hits = integrator.cast_shadow(shadows)
        if not hits.hit[0]:
            return blocker
        blocker = Blocker(int(hits.instance[0]), int(hits.primitive[0]), float(hits.distance[0]))
        surface = make_surface(integrator.tables, shadows.rays, hits)
        if not find_transparency(integrator.materials, surface).any():
            return blocker
        shadows = replace(shadows, rays=replace(shadows.rays, after=hits))


# Branches -------------------------------------------------------------------------------------------------------------


def find_branches(integrator: Integrator, wave: Wave) -> Iterator[Branch]:
    """Yield the ways on that carry light; those of several lobes in one direction count together."""
    if find_ended(wave.paths.bounces, integrator.settings)[0] or find_closed(integrator, wave.paths)[0]:
        return
    found: dict[tuple[str, bytes], tuple[Floats, Floats, int]] = {}
    for kind, direction, weight, bounce in list_directions(wave.shading):
        key = kind, direction.tobytes()
        total = weight + (found[key][1] if key in found else 0.0)
        found[key] = direction, total, bounce
    for (kind, _), (direction, weight, bounce) in found.items():
        if weight.any():
            sample = BsdfSample(
                direction[np.newaxis], np.ones((1, 3)), np.array([np.inf]), np.array([bounce], np.uint8)
            )
            yield kind, advance(wave, sample), weight
    for portals in wave.shading.portals:
        straight = np.full(1, STRAIGHT, np.uint8)
        sample = BsdfSample(portals.direction, np.ones((1, 3)), np.array([np.inf]), straight, portals)
        yield PASSED, advance(wave, sample), portals.weight[0]


def list_directions(shading: Shading) -> Iterator[tuple[str, Floats, Floats, int]]:
    """Yield kind, unit direction (3,), weight (3,) and kind of bounce of every way on from one point."""
    yield PASSED, -shading.outgoing[0], shading.transparency[0], STRAIGHT
    for lobes in shading.lobes:
        if not len(lobes) or not isinstance(lobes, Microfacets):  # hair has no directions of its own
            continue
        outgoing, normal, geometric = shading.outgoing, lobes.normal, shading.geometric_normal
        if not dot(normal, outgoing)[0] > 0:
            continue
        reflectance, transmittance = evaluate_fresnel(lobes, np.clip(dot(normal, outgoing), 0.0, 1.0))
        singular = SINGULAR if lobes.is_perfect[0] else 0
        mirrored, bent = reflect(outgoing, normal), refract(outgoing, normal, lobes.eta)
        if is_on_side(mirrored, normal, geometric, 1):
            yield REFLECTED, mirrored[0], (lobes.weight * reflectance)[0], GLOSSY | singular
        if transmittance is not None and is_on_side(bent, normal, geometric, -1):
            yield REFRACTED, bent[0], (lobes.weight * transmittance)[0], GLOSSY | singular | TRANSMITTED


def is_on_side(direction: Floats, normal: Floats, geometric_normal: Floats, side: int) -> bool:
    """True where one direction leaves to the side, 1 or -1, of both normals."""
    return bool((side * dot(normal, direction) > 0)[0] and (side * dot(geometric_normal, direction) > 0)[0])
