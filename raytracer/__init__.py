"""A reference ray tracer in pure NumPy.

scene = raytracer.Scene(meshes=[raytracer.Mesh(positions, triangles)])
caster = raytracer.build(scene)
hits = caster.closest_hit(origins, directions)
film = raytracer.render(scene, width, height, samples)
"""

from raytracer.casting.caster import Caster, build
from raytracer.casting.rays import Hits, Rays
from raytracer.film.film import Film
from raytracer.film.film_file import load_film, save_film
from raytracer.film.parts import cut, merge
from raytracer.film.picture_key import VERSION
from raytracer.integrator.settings import Settings
from raytracer.processes.dask_pool import DaskPool
from raytracer.processes.workers import WorkerError, Workers
from raytracer.rendering.clusters import cast_blocks, render_on
from raytracer.rendering.render import render
from raytracer.scene.camera import Camera, Panorama
from raytracer.scene.curves import Curves
from raytracer.scene.light_groups import LightGroups
from raytracer.scene.lights import AreaLight, PointLight, SpotLight, SunLight, World
from raytracer.scene.materials import Closure, Material
from raytracer.scene.media import Grid, Volume, VolumeClosure
from raytracer.scene.motion import CameraMotion, CurvesMotion, InstanceMotion, MeshMotion, Motion, SpheresMotion
from raytracer.scene.programs import Aovs, Image, Program, Register, Step, TiledImage
from raytracer.scene.scene import Scene
from raytracer.scene.scene_file import load, save
from raytracer.scene.shapes import Instances, Mesh, Spheres

__all__ = [
    "VERSION",
    "Aovs",
    "AreaLight",
    "Camera",
    "CameraMotion",
    "Caster",
    "Closure",
    "Curves",
    "CurvesMotion",
    "DaskPool",
    "Film",
    "Grid",
    "Hits",
    "Image",
    "InstanceMotion",
    "Instances",
    "LightGroups",
    "Material",
    "Mesh",
    "MeshMotion",
    "Motion",
    "Panorama",
    "PointLight",
    "Program",
    "Rays",
    "Register",
    "Scene",
    "Settings",
    "Spheres",
    "SpheresMotion",
    "SpotLight",
    "Step",
    "SunLight",
    "TiledImage",
    "Volume",
    "VolumeClosure",
    "WorkerError",
    "Workers",
    "World",
    "build",
    "cast_blocks",
    "cut",
    "load",
    "load_film",
    "merge",
    "render",
    "render_on",
    "save",
    "save_film",
]
