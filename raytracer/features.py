"""What this scene needs, derived from its content; never a user option.

Every stage that a scene may lack is asked for here once, when a render is composed: a feature that is absent is not
extracted, not allocated and not called. Imports `scene` only.
"""

from __future__ import annotations

from dataclasses import dataclass

from raytracer.scene import AreaLight, Closure, PointLight, Scene, SpotLight, SunLight


@dataclass(frozen=True)
class Features:
    """One flag for each thing a scene may lack.

    smooth_normals : a mesh has normals
    emission : a used material emits (visible light sources; sampled as lights)
    world : the world is not black
    mirrors : a material reflects or transmits, so that rays go on after the first hit
    rough : a reflecting or transmitting material has roughness above 0
    transparency : a material lets light straight through (Transparent BSDF, alpha below 1)
    holdout : an object punches a hole into the alpha channel
    """

    meshes: bool
    spheres: bool
    smooth_normals: bool
    uvs: bool
    point_lights: bool
    spot_lights: bool
    sun_lights: bool
    area_lights: bool
    emission: bool
    world: bool
    mirrors: bool
    rough: bool
    transparency: bool
    holdout: bool


def _emits(closure: Closure) -> bool:
    color = closure.color if closure.kind == "emission" else closure.emission
    return bool(closure.weight > 0 and color.max() > 0 and closure.kind in ("emission", "principled"))


def _scatters_on(closure: Closure) -> bool:
    """True where a ray goes on after this closure: every kind with a specular part."""
    return closure.weight > 0 and closure.kind in ("glossy", "glass", "refraction", "principled")


def derive_features(scene: Scene) -> Features:
    """Return the Features of `scene`."""
    closures = [closure for material in scene.materials for closure in material.closures]
    # SpotLight is a PointLight by inheritance; the exact type tells them apart.
    kinds = {type(light) for light in scene.lights}
    holdouts = [group.holdout for group in scene.spheres]
    if scene.instances is not None:
        holdouts.extend(scene.instances.holdout.tolist())
    return Features(
        meshes=any(len(mesh.triangles) for mesh in scene.meshes),
        spheres=any(len(group.radii) for group in scene.spheres),
        smooth_normals=any(mesh.normals is not None for mesh in scene.meshes),
        uvs=any(mesh.uvs is not None for mesh in scene.meshes),
        point_lights=PointLight in kinds,
        spot_lights=SpotLight in kinds,
        sun_lights=SunLight in kinds,
        area_lights=AreaLight in kinds,
        emission=any(_emits(closure) for closure in closures),
        world=scene.world is not None and bool(scene.world.color.max() > 0),
        mirrors=any(_scatters_on(closure) for closure in closures),
        rough=any(_scatters_on(closure) and closure.roughness > 0 for closure in closures),
        transparency=any(
            closure.weight > 0
            and (closure.kind == "transparent" or (closure.kind == "principled" and closure.alpha < 1))
            for closure in closures
        ),
        holdout=any(holdouts),
    )
