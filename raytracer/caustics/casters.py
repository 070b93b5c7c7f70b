"""What casts caustics: smooth meshes of clear glass, of which the rays' own surfaces are known at every point.

Left out is what the chains of `walk` would not find, or not as paths do: flat shading, whose normal jumps; rough glass;
bumps; and what lets light go straight through besides, or bends it in several ways.

References
----------
Blender, intern/cycles/kernel/integrator/mnee.h: Cycles too takes smooth meshes, and of each surface the first closure
that refracts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from raytracer.arrays.types import Booleans, Numbers
from raytracer.bsdfs.microfacet import SMALLEST_ALPHA
from raytracer.casting.rays import Hits, Rays
from raytracer.scene.materials import Closure, Material
from raytracer.scene.scene import Scene
from raytracer.surfaces.surface_tables import SurfaceTables

# Closest hits of rays with all that transmitted rays meet.
Cast = Callable[[Rays], Hits]


@dataclass(frozen=True, eq=False)
class Casters:
    """What bends light.

    is_caster : (instances + groups,) bool
    eta : (materials,) float64, index of refraction behind the surface over that before it
    """

    cast: Cast
    tables: SurfaceTables
    is_caster: Booleans
    eta: Numbers


def find_bending_eta(material: Material) -> float:
    """Return the index of refraction behind a surface that bends light by Snell's law alone; NaN for others."""
    bending = [closure for closure in material.closures if _refracts(closure)]
    if len(bending) != 1 or any(map(_lets_through, material.closures)) or material.normal is not None:
        return float("nan")
    (closure,) = bending
    if closure.vectors or {"roughness", "ior"} & set(closure.registers) or closure.roughness**2 > SMALLEST_ALPHA:
        return float("nan")
    return float(closure.ior)


def _refracts(closure: Closure) -> bool:
    if closure.kind == "principled":
        return "transmission" in closure.registers or closure.transmission > 0
    return closure.kind in ("glass", "refraction")


def _lets_through(closure: Closure) -> bool:
    see_through = closure.kind == "principled" and ("alpha" in closure.registers or closure.alpha < 1)
    return closure.kind in ("transparent", "portal") or see_through


def find_casters(scene: Scene) -> Booleans:
    """Return (instances,) True for those that are to cast caustics and can."""
    asked = None if scene.instances is None else scene.instances.caustics_caster
    if scene.instances is None or asked is None:
        return np.zeros(scene.instance_count, np.bool_)
    eta = np.array([find_bending_eta(material) for material in scene.materials])
    clear = [mesh.normals is not None and np.isfinite(eta[mesh.material]).all() for mesh in scene.meshes]
    found: Booleans = asked & np.array(clear, np.bool_)[scene.instances.mesh]
    return found
