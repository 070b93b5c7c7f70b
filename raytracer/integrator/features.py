"""What this scene needs, derived from its content; never a user option.

Every stage that a scene may lack is asked for here once, when a render is composed: a feature that is absent is not
extracted, not allocated and not called.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from raytracer.scene.fields import ALL_SETS, SEEN_BY_ALL
from raytracer.scene.lights import World
from raytracer.scene.materials import HAIR_KINDS, Closure, Material
from raytracer.scene.programs import Register
from raytracer.scene.scene import Scene
from raytracer.shading.evaluate import BEVEL, casts_rays, reads_light_path

DIFFUSE_KINDS = ("diffuse", "translucent", "sheen", "velvet", "toon", "glossy_toon", "subsurface")
SPECULAR_KINDS = ("glossy", "glass", "refraction", "principled", "metal", "conductor", *HAIR_KINDS)
# A lobe of facets of the roughness alpha reflects with the density 1 / (4 pi alpha^2) in its middle. It is narrow above
# so much for each steradian: of wider ones, samples of lights bring what reflected rays would rarely meet.
NARROW_DENSITY = 100.0
NARROW_ALPHA = (4.0 * np.pi * NARROW_DENSITY) ** -0.5


@dataclass(frozen=True)
class Features:
    """One flag for each thing a scene may lack.

    smooth_normals : a mesh has normals
    uvs : a mesh has uvs
    emission : a used material emits (visible light sources; sampled as lights)
    world : the world is not black
    diffuse : a material reflects diffusely
    translucent : a material transmits diffusely
    specular : a material reflects or transmits otherwise
    rough : a reflecting or transmitting material has roughness above 0
    narrow : a reflecting or transmitting material may do so into little more than one direction
    subsurface : a material scatters light below its surface
    portals : a material sends rays on elsewhere
    transparency : a material lets light straight through (Transparent BSDF, alpha below 1)
    holdout : an object punches a hole into the alpha channel
    shadow_catchers : an object shows only how others change its light
    light_linking : a light, or an emissive object, lights some objects only
    shadow_linking : the light of a light, or an emissive object, is shadowed by some objects only
    ray_visibility : an object is hidden from some rays
    programs : a parameter of a material is computed at each point
    light_path : a program of a material asks how the ray came
    program_rays : a program casts rays
    bevels : a program rounds normals off
    light_nodes : a light has nodes that vary
    light_bounces : a light or the world has a limit of bounces
    media : a material or the world has a volume
    caustics : a light, an object that casts caustics of it, and one that receives them are named
    """

    smooth_normals: bool
    uvs: bool
    emission: bool
    world: bool
    diffuse: bool
    translucent: bool
    specular: bool
    rough: bool
    narrow: bool
    subsurface: bool
    portals: bool
    transparency: bool
    holdout: bool
    shadow_catchers: bool
    light_linking: bool
    shadow_linking: bool
    ray_visibility: bool
    programs: bool
    light_path: bool
    program_rays: bool
    bevels: bool
    light_nodes: bool
    light_bounces: bool
    media: bool = False
    caustics: bool = False


def _may(closure: Closure, name: str, predicate: Callable[[Any], Any]) -> bool:
    """True where a constant parameter fulfils `predicate`; what a program computes may."""
    return name in closure.registers or bool(predicate(getattr(closure, name)))


def _has_weight(closure: Closure) -> bool:
    return _may(closure, "weight", lambda weight: weight > 0)


def _emits(closure: Closure) -> bool:
    name = "color" if closure.kind == "emission" else "emission"
    kind = closure.kind in ("emission", "principled")
    return kind and _has_weight(closure) and _may(closure, name, np.any)


def _is_diffuse(closure: Closure) -> bool:
    metal = not _may(closure, "metallic", lambda metallic: metallic < 1)
    glass = not _may(closure, "transmission", lambda transmission: transmission < 1)
    base = closure.kind == "principled" and not metal and not glass
    if closure.kind == "principled" and _may(closure, "sheen_weight", lambda weight: weight > 0):
        return _has_weight(closure)
    return (
        (closure.kind in DIFFUSE_KINDS or base)
        and _has_weight(closure)
        and _may(closure, "color", lambda color: color.max() > 0)
    )


def _scatters_on(closure: Closure) -> bool:
    """True where a ray goes on after this closure: every kind with a specular part."""
    return closure.kind in SPECULAR_KINDS and _has_weight(closure)


def _is_rough(closure: Closure) -> bool:
    coated = closure.kind == "principled" and _may(closure, "coat_weight", lambda weight: weight > 0)
    if closure.kind in HAIR_KINDS:
        return _has_weight(closure)
    return _scatters_on(closure) and (coated or _may(closure, "roughness", lambda roughness: roughness > 0))


def _is_narrow(closure: Closure) -> bool:
    coated = closure.kind == "principled" and _may(closure, "coat_weight", lambda weight: weight > 0)
    lobes = ["roughness", "coat_roughness"] if coated else ["roughness"]
    return _scatters_on(closure) and any(_may(closure, lobe, lambda rough: rough**2 < NARROW_ALPHA) for lobe in lobes)


def _is_buried(closure: Closure) -> bool:
    if closure.kind == "principled" and not _may(closure, "subsurface", lambda share: share > 0):
        return False
    return closure.kind in ("principled", "subsurface") and _is_diffuse(closure)


def lets_through(closure: Closure) -> bool:
    """True where light may go straight through this closure."""
    see_through = closure.kind in ("principled", "hair_huang") and _may(closure, "alpha", lambda alpha: alpha < 1)
    return _has_weight(closure) and (closure.kind == "transparent" or see_through)


def _shines(world: World) -> bool:
    return isinstance(world.color, Register) or bool(world.color.any())


def has_medium(record: Material | World) -> bool:
    """True where something fills the space behind a material, or the world; a mere border is one, of whatever."""
    filled = record.volume is not None and bool(record.volume.closures)
    return filled or (isinstance(record, Material) and record.only_volume)


def _is_any(scene: Scene, name: str) -> bool:
    """True where an instance, or a group of spheres or curves, has a property."""
    placed = scene.instances is not None and bool(getattr(scene.instances, name).any())
    return placed or any(getattr(group, name) for group in scene.groups)


def _is_any_instance(scene: Scene, name: str) -> bool:
    """True where an instance has a property that all may lack."""
    values = None if scene.instances is None else getattr(scene.instances, name)
    return values is not None and bool(values.any())


def _links(scene: Scene, name: str) -> bool:
    """True where an emitter names some sets of objects, and not all."""
    records = any(getattr(record, name) != ALL_SETS for record in (*scene.lights, *scene.groups))
    return records or (scene.instances is not None and bool((getattr(scene.instances, name) != ALL_SETS).any()))


def derive_features(scene: Scene) -> Features:
    """Return the Features of `scene`."""
    closures = [closure for material in scene.materials for closure in material.closures]
    hides = any(group.seen_by != SEEN_BY_ALL for group in scene.groups)
    if scene.instances is not None and scene.instances.seen_by is not None:
        hides |= bool((scene.instances.seen_by != SEEN_BY_ALL).any())
    return Features(
        smooth_normals=any(mesh.normals is not None for mesh in scene.meshes),
        uvs=any(mesh.uvs is not None for mesh in scene.meshes),
        emission=has_emission(scene),
        world=scene.world is not None and _shines(scene.world),
        diffuse=any(_is_diffuse(closure) for closure in closures),
        translucent=any(closure.kind == "translucent" and _is_diffuse(closure) for closure in closures),
        specular=any(_scatters_on(closure) for closure in closures),
        rough=any(_is_rough(closure) for closure in closures),
        narrow=any(_is_narrow(closure) for closure in closures),
        subsurface=any(_is_buried(closure) for closure in closures),
        portals=any(closure.kind == "portal" and _has_weight(closure) for closure in closures),
        transparency=any(lets_through(closure) for closure in closures),
        holdout=_is_any(scene, "holdout"),
        shadow_catchers=_is_any(scene, "shadow_catcher"),
        light_linking=_links(scene, "receivers"),
        shadow_linking=_links(scene, "blockers"),
        ray_visibility=hides,
        programs=any(closure.registers or closure.vectors for closure in closures)
        or any(material.normal is not None for material in scene.materials),
        light_path=any(reads_light_path(material.program) for material in scene.materials),
        program_rays=any(casts_rays(material.program) for material in scene.materials),
        bevels=any(casts_rays(material.program, (BEVEL,)) for material in scene.materials),
        light_nodes=any(light.nodes is not None for light in scene.lights),
        light_bounces=any(light.max_bounces is not None for light in (*scene.lights, *filter(None, [scene.world]))),
        media=has_media(scene),
        caustics=any(light.caustics for light in scene.lights)
        and _is_any_instance(scene, "caustics_caster")
        and _is_any_instance(scene, "caustics_receiver"),
    )


def has_emission(scene: Scene) -> bool:
    """True where a material shines."""
    return any(_emits(closure) for material in scene.materials for closure in material.closures)


def has_media(scene: Scene) -> bool:
    """True where a material or the world has a volume."""
    return any(map(has_medium, scene.materials)) or (scene.world is not None and has_medium(scene.world))
