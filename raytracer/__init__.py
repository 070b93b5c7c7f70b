"""A reference ray tracer in pure NumPy.

scene = raytracer.Scene(meshes=[raytracer.Mesh(positions, triangles)])
caster = raytracer.build(scene)
hits = caster.closest_hit(origins, directions)
film = raytracer.render(scene, width, height, samples)
"""

from raytracer.accelerate import Caster, build
from raytracer.rays import Hits, Rays
from raytracer.scene import (
    AreaLight,
    Camera,
    Closure,
    Instances,
    Material,
    Mesh,
    PointLight,
    Scene,
    Spheres,
    SpotLight,
    SunLight,
    World,
    load,
    save,
)

__all__ = [
    "AreaLight",
    "Camera",
    "Caster",
    "Closure",
    "Hits",
    "Instances",
    "Material",
    "Mesh",
    "PointLight",
    "Rays",
    "Scene",
    "Spheres",
    "SpotLight",
    "SunLight",
    "World",
    "build",
    "load",
    "save",
]
