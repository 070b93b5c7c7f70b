"""A reference ray tracer in pure NumPy.

scene = raytracer.Scene(meshes=[raytracer.Mesh(positions, triangles)])
caster = raytracer.build(scene)
hits = caster.closest_hit(origins, directions)
film = raytracer.render(scene, width, height, samples)
"""

from raytracer.accelerate.caster import Caster, build
from raytracer.camera_record import Camera
from raytracer.film import Film
from raytracer.light_records import AreaLight, PointLight, SpotLight, SunLight, World
from raytracer.material_records import Closure, Material
from raytracer.programs import Image, Program, Register, Step
from raytracer.rays import Hits, Rays
from raytracer.render import render
from raytracer.scene import Scene
from raytracer.scene_file import load, save
from raytracer.settings import Settings
from raytracer.shapes import Instances, Mesh, Spheres
from raytracer.workers import WorkerError, Workers

__all__ = [
    "AreaLight",
    "Camera",
    "Caster",
    "Closure",
    "Film",
    "Hits",
    "Image",
    "Instances",
    "Material",
    "Mesh",
    "PointLight",
    "Program",
    "Rays",
    "Register",
    "Scene",
    "Settings",
    "Spheres",
    "SpotLight",
    "Step",
    "SunLight",
    "WorkerError",
    "Workers",
    "World",
    "build",
    "load",
    "render",
    "save",
]
