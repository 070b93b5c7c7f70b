"""Scenes and rays of the speed benchmark: 34 to 100 million triangles, and the rays a renderer casts at them.

All coordinates are float32 numbers. Blender makes Suzanne; without it her scenes are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import raytracer
from raytracer.casting.geometry import world_corners
from tests import meshes
from tests.benchmarks.ray_sets import Target, snap

# Origins of shadow and bounce rays leave the surface by this share of the scene's size, for every peer alike.
LIFT = 1e-4
SUZANNE_LEVELS = (2, 4, 5)


@dataclass(frozen=True, eq=False)
class SpeedScene:
    """A mesh with a place to look from, a place to look at, and a point light.

    matrices : (i, 4, 4) world_from_object of instances of the mesh; None: the mesh itself, once
    """

    name: str
    positions: np.ndarray
    triangles: np.ndarray
    eye: np.ndarray
    centre: np.ndarray
    light: np.ndarray
    matrices: np.ndarray | None = None

    @property
    def bounds(self):
        """(2, 3) a box around everything."""
        points = self.positions
        if self.matrices is not None:
            box = np.array(np.meshgrid(*np.stack([points.min(axis=0), points.max(axis=0)], axis=1))).reshape(3, 8).T
            points = (box @ self.matrices[:, :3, :3].transpose(0, 2, 1) + self.matrices[:, None, :3, 3]).reshape(-1, 3)
        return np.stack([points.min(axis=0), points.max(axis=0)])

    @property
    def size(self):
        """Half the diagonal of the bounding box."""
        return float(np.linalg.norm(np.ptp(self.bounds, axis=0))) / 2

    @property
    def count(self):
        """The number of triangles that rays can meet."""
        return len(self.triangles) * (1 if self.matrices is None else len(self.matrices))

    def flatten(self):
        """(positions, triangles) of all instances as one mesh."""
        if self.matrices is None:
            return self.positions, self.triangles
        placed = self.positions @ self.matrices[:, :3, :3].transpose(0, 2, 1) + self.matrices[:, None, :3, 3]
        return meshes.join_meshes([(to_float32(positions), self.triangles) for positions in placed])

    def describe(self):
        """The scene as the ray tracer takes it."""
        instances = None
        if self.matrices is not None:
            instances = raytracer.Instances(np.zeros(len(self.matrices), np.int32), self.matrices)
        return raytracer.Scene(meshes=[raytracer.Mesh(self.positions, self.triangles)], instances=instances)


@dataclass(frozen=True, eq=False)
class SpeedRays:
    """Rays (n, 3) of one kind; shadow rays ask for any hit up to t = reach, the others for the closest."""

    kind: str
    origins: np.ndarray
    directions: np.ndarray
    reach: float = np.inf
    any_hit: bool = False


def to_float32(values):
    """Round to float32, kept as float64."""
    return np.asarray(values, dtype=np.float64).astype(np.float32).astype(np.float64)


def make_scene(name, mesh, eye, centre, light, matrices=None):
    """Round a mesh to float32 and put it on show."""
    eye, centre, light = (to_float32(point) for point in (eye, centre, light))
    return SpeedScene(name, to_float32(mesh[0]), mesh[1], eye, centre, light, matrices)


def make_suzanne(level):
    """Blender's monkey, subdivided, as a triangle mesh.

    Raises
    ------
    ImportError
        Without Blender.
    """
    import bpy

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.mesh.primitive_monkey_add()
    suzanne = bpy.context.object
    suzanne.modifiers.new("subdivision", "SUBSURF").levels = level
    evaluated = suzanne.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    mesh.calc_loop_triangles()
    positions = np.empty(3 * len(mesh.vertices), np.float32)
    triangles = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.vertices.foreach_get("co", positions)
    mesh.loop_triangles.foreach_get("vertices", triangles)
    evaluated.to_mesh_clear()
    return positions.reshape(-1, 3).astype(np.float64), triangles.reshape(-1, 3)


def show_suzanne(level):
    """Suzanne, seen and lit from the front."""
    mesh = make_suzanne(level)
    return make_scene(f"Suzanne {name_count(len(mesh[1]))}", mesh, (1.2, -3.2, 0.9), (0, 0, 0), (3, -4, 5))


def show_terrain(count=500):
    """Hills of count x count quads."""
    rng = np.random.default_rng(0)
    waves = [(2.0**k, *rng.uniform(0, 2 * np.pi, 3)) for k in range(7)]

    def height(x, y):
        octaves = (np.sin(f * (np.cos(a) * x + np.sin(a) * y) + p) * np.cos(f * y + q) / f**1.2 for f, a, p, q in waves)
        return 0.3 * sum(octaves)

    mesh = meshes.make_grid(count, 8.0, height)
    return make_scene(f"terrain {name_count(len(mesh[1]))}", mesh, (-4.5, -4.5, 2.2), (0, 0, 0), (3, -3, 4))


def place_at_random(rng, count, size, low, high):
    """(count, 4, 4) matrices: turned, scaled to `size`, anywhere between two corners."""
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3] = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0].transpose(0, 2, 1) * size
    matrices[:, :3, 3] = rng.uniform(low, high, (count, 3))
    return matrices


def show_objects(count=1000):
    """Tori all over a cube, in one mesh."""
    instances = show_instances(count)
    name = f"{count} objects {name_count(instances.count)}"
    return make_scene(name, instances.flatten(), instances.eye, instances.centre, instances.light)


def show_instances(count=1000):
    """The same tori as instances of one mesh."""
    torus = meshes.make_torus(12, 8)
    matrices = place_at_random(np.random.default_rng(1), count, 0.25, -4, 4)
    name = f"{count} instances {name_count(count * len(torus[1]))}"
    return make_scene(name, torus, (2, -12, 5), (0, 0, 0), (6, -8, 9), matrices)


def show_forest(count=10000):
    """A hundred million triangles: instances of a bumpy mesh of ten thousand, on a plain seen from above its edge."""
    rng = np.random.default_rng(3)
    positions, triangles = meshes.make_torus(100, 50, 0.6, 0.35)
    positions = positions * (1 + 0.1 * np.sin(9 * positions.sum(axis=1, keepdims=True)))
    matrices = place_at_random(rng, count, 0.5, (-60, -60, 0), (60, 60, 1))
    name = f"forest of {count} instances {name_count(count * len(triangles))}"
    return make_scene(name, (positions, triangles), (0, -75, 12), (0, 0, 0), (30, -60, 50), matrices)


def show_interior():
    """A closed room full of tori, seen from within, the light among them."""
    matrices = place_at_random(np.random.default_rng(4), 60, 0.35, -1.8, 1.8)
    tori = make_scene("tori", meshes.make_torus(36, 24), (0, 0, 0), (0, 0, 0), (0, 0, 0), matrices).flatten()
    mesh = meshes.join_meshes([meshes.make_cube(2.2), tori])
    name = f"interior {name_count(len(mesh[1]))}"
    return make_scene(name, mesh, (-2.0, -2.0, 1.9), (0.2, 0.3, -0.4), (0.1, 0.1, 0.2))


def show_cornell_box():
    """Five walls and two boxes: 34 triangles."""
    walls, quads = meshes.make_cube(1.0)
    room = walls, np.concatenate([quads[:4], quads[6:]])  # open towards -y
    tall = meshes.make_cube(0.3, (-0.35, 0.35, 0.0))
    tall[0][:, 2] = np.where(tall[0][:, 2] > 0, 0.2, -1.0)
    small = meshes.make_cube(0.29, (0.35, -0.3, -0.71))
    return make_scene("Cornell box 34", meshes.join_meshes([room, tall, small]), (0, -3.8, 0), (0, 0, 0), (0, 0, 0.95))


def name_count(triangles):
    """7872 -> '7.9k'."""
    return f"{triangles / 1e6:.1f}M" if triangles >= 1e6 else f"{triangles / 1e3:.3g}k"


def list_scenes(large=True) -> dict[str, Callable]:
    """Return name -> function that makes the scene; without `large` those of at most half a million triangles."""
    levels = SUZANNE_LEVELS if large else SUZANNE_LEVELS[:-1]
    suzannes = {f"Suzanne, {level} subdivisions": (lambda k: lambda: show_suzanne(k))(level) for level in levels}
    return {
        "Cornell box": show_cornell_box,
        **suzannes,
        "objects": show_objects,
        "instances": show_instances,
        "interior": show_interior,
        "terrain": show_terrain,
        "forest": show_forest,
    }


def make_target(scene):
    """Return the scene as a Target of `ray_sets`, on a lattice, so that rays go exactly through its vertices."""
    lattice = 2.0 ** (np.ceil(np.log2(scene.size)) - 17)

    def start(generator, count):
        away = generator.normal(size=(count, 3))
        return scene.centre + 1.5 * scene.size * away / np.linalg.norm(away, axis=1, keepdims=True)

    positions = snap(scene.positions, lattice)
    families = ("camera", "random", "vertex")
    return Target(scene.name, positions, scene.triangles, lattice, scene.centre, scene.size / 1.5, start, families)


# Rays ---------------------------------------------------------------------------------------------------------------


def make_camera_rays(scene, count):
    """Pinhole rays, row by row, of about `count` pixels."""
    side = max(2, round(np.sqrt(count)))
    forward = (scene.centre - scene.eye) / np.linalg.norm(scene.centre - scene.eye)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    line = (np.arange(side) + 0.5) / side * 0.8 - 0.4
    x, y = (axis.ravel()[:, None] for axis in np.meshgrid(line, -line))
    directions = to_float32(forward + x * right + y * np.cross(right, forward))
    return SpeedRays("camera", np.tile(scene.eye, (len(directions), 1)), directions)


def find_surface(scene, caster, rays):
    """Return points and normals, (k, 3) each, where a raytracer.Caster's rays hit, lifted off on the seen side."""
    hits = caster.closest_hit(rays.origins, rays.directions)
    hit = np.flatnonzero(hits.hit)
    a, b, c = world_corners(caster.geometry, hits.instance[hit], hits.primitive[hit])
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
    normals *= -np.sign((normals * rays.directions[hit]).sum(axis=1, keepdims=True))
    points = rays.origins[hit] + hits.distance[hit, None] * rays.directions[hit]
    return to_float32(points + LIFT * scene.size * normals), normals


def make_shadow_rays(scene, points):
    """From surface points to the light, which is at t = 1 (to float64; peers that take float32 miss it a little)."""
    return SpeedRays("shadow", points, scene.light - points, reach=1.0, any_hit=True)


def make_bounce_rays(points, normals, generator):
    """Cosine-weighted directions: the normal plus a random unit vector."""
    sphere = generator.normal(size=points.shape)
    return SpeedRays("bounce", points, to_float32(normals + sphere / np.linalg.norm(sphere, axis=1, keepdims=True)))


def make_random_rays(scene, generator, count):
    """Between random points of the sphere around the bounding box."""
    low, high = scene.bounds
    ends = generator.normal(size=(2, count, 3))
    ends = to_float32((low + high) / 2 + scene.size * ends / np.linalg.norm(ends, axis=2, keepdims=True))
    return SpeedRays("random", ends[0], to_float32(ends[1] - ends[0]))


def make_all_rays(scene, caster, seed, count):
    """Return the four kinds of rays of a scene; `caster` finds the surfaces that shadow and bounce rays start from."""
    generator = np.random.default_rng(seed)
    camera = make_camera_rays(scene, count)
    points, normals = find_surface(scene, caster, camera)
    return [
        camera,
        make_shadow_rays(scene, points),
        make_bounce_rays(points, normals, generator),
        make_random_rays(scene, generator, count),
    ]
