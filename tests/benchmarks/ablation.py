"""What each feature costs where a scene has it, and that it costs nothing where it has not: calls of its stage.

A floor with boxes under a point lamp is the plain scene; every row adds one feature to it. Memory and workers, too:
what a render takes of the machine.
"""

from __future__ import annotations

import cProfile
import json
import pstats
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import raytracer
from tests.benchmarks.timing import take_turns
from tests.folders import ROOT

WIDTH, HEIGHT, SAMPLES = 240, 160, 1
GRID = 24  # boxes along each side of the plain scene
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float64)
FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)
CAMERA = raytracer.Camera(np.array([[1, 0, 0, 0], [0, 0.5, -0.866, -14], [0, 0.866, 0.5, 9], [0, 0, 0, 1]], float))
MOVED_CAMERA = CAMERA.world_from_camera + np.array([[0, 0, 0, 0.5], [0] * 4, [0] * 4, [0] * 4])
GREY = raytracer.Closure("diffuse", color=0.6)
FOG = raytracer.VolumeClosure("scatter", color=0.9, density=0.01)
LIGHT = {"position": (3.0, -4.0, 9.0), "power": 900.0}


def make_scene(closure=GREY, normals=False, lamp=None, spheres=False, **fields):
    """Return the plain scene, or one with a feature."""
    rng = np.random.default_rng(0)
    places = (np.indices((GRID, GRID)).reshape(2, -1).T - GRID / 2) * 0.6
    size = np.column_stack([np.full((len(places), 2), 0.4), rng.uniform(0.2, 1.5, len(places))])
    positions = (np.column_stack([places, np.zeros(len(places))])[:, None] + CORNERS * size[:, None]).reshape(-1, 3)
    triangles = (FACES + 8 * np.arange(len(places))[:, None, None]).reshape(-1, 3)
    corner_normals = np.tile((CORNERS - 0.5) / np.sqrt(0.75), (len(places), 1)) if normals else None
    boxes = raytracer.Mesh(positions, triangles, normals=corner_normals)
    floor = raytracer.Mesh([[-20, -20, 0], [20, -20, 0], [20, 20, 0], [-20, 20, 0]], [[0, 1, 2], [0, 2, 3]])
    balls = [raytracer.Spheres(rng.uniform((-6, -6, 1.5), (6, 6, 3), (40, 3)), np.full(40, 0.3))] if spheres else []
    return raytracer.Scene(
        meshes=[floor, boxes],
        spheres=balls,
        materials=[raytracer.Material((closure,))],
        lights=[lamp or raytracer.PointLight(**LIGHT)],
        camera=CAMERA,
        **fields,
    )


def make_pane_scene():
    """Return the plain scene under a pane of clear glass that casts caustics, under the lamp."""
    corners = np.array([(-20, -20), (20, -20), (20, 20), (-20, 20)], dtype=np.float64)
    positions = np.vstack([np.column_stack([corners, np.full(4, height)]) for height in (4.2, 4.0)])
    triangles = [(0, 1, 2), (0, 2, 3), (4, 6, 5), (4, 7, 6)]
    pane = raytracer.Mesh(positions, triangles, np.repeat([(0, 0, 1.0), (0, 0, -1.0)], 4, axis=0), material=1)
    plain = make_scene(lamp=raytracer.PointLight(**LIGHT, caustics=True))
    flags = {"caustics_caster": [False, False, True], "caustics_receiver": [True, True, False]}
    return replace(
        plain,
        meshes=[*plain.meshes, pane],
        materials=[*plain.materials, raytracer.Material([raytracer.Closure("glass", roughness=0.0)])],
        instances=raytracer.Instances([0, 1, 2], [np.eye(4)] * 3, **flags),
    )


def make_fur():
    """Return strands that stand on the floor."""
    rng = np.random.default_rng(1)
    steps = rng.normal(size=(2000, 6, 3)) * 0.05 + (0, 0, 0.3)
    steps[:, 0] = rng.uniform((-7, -7, 0), (7, 7, 0), (2000, 3))
    return raytracer.Curves(np.cumsum(steps, axis=1).reshape(-1, 3), np.full(12000, 0.02), 6 * np.arange(2001))


# Feature: (the scene with it, settings, module and function of its stage).
FEATURES = {
    "soft light": (
        lambda: make_scene(lamp=raytracer.AreaLight((3, -4, 9), (3, 0, 0), (0, 3, 0), 900.0)),
        {},
        ("area_lights.py", "sample_area"),
    ),
    "world": (lambda: make_scene(world=raytracer.World(0.3)), {}, ("environment.py", "environment_density")),
    "mirror": (lambda: make_scene(raytracer.Closure("glossy")), {}, ("bsdf_samples.py", "sample_bsdf")),
    "rough reflection": (
        lambda: make_scene(raytracer.Closure("glossy", roughness=0.3)),
        {},
        ("distributions.py", "sample_visible_normals"),
    ),
    "transparency": (
        lambda: make_scene(raytracer.Closure("principled", alpha=0.7, roughness=1.0)),
        {},
        ("shadow_rays.py", "_see_through"),
    ),
    "subsurface": (
        lambda: make_scene(raytracer.Closure("subsurface", color=0.6, radius=0.5)),
        {},
        ("random_walk.py", "take_step"),
    ),
    "shadow caustics": (
        make_pane_scene,
        {"max_bounces": 4},
        ("walk.py", "find_paths"),
    ),
    "ray portals": (
        lambda: make_scene(raytracer.Closure("portal", weight=0.2, position=np.array([0.0, 0.0, 4.0]))),
        {},
        ("bsdf_samples.py", "enter_portals"),
    ),
    "thin film": (
        lambda: make_scene(raytracer.Closure("principled", film_thickness=400.0)),
        {},
        ("thin_film.py", "interfere"),
    ),
    "media": (
        lambda: make_scene(world=raytracer.World(volume=raytracer.Volume(FOG))),
        {},
        ("travel.py", "cross_media"),
    ),
    "hair": (
        lambda: make_scene(raytracer.Closure("hair", absorption=0.5, tangent=(1.0, 0.0, 0.0))),
        {},
        ("hair_chiang.py", "describe_lobes"),
    ),
    "hair by facets": (
        lambda: make_scene(raytracer.Closure("hair_huang", absorption=0.5, tangent=(1.0, 0.0, 0.0))),
        {},
        ("hair_ways.py", "follow_light"),
    ),
    "emission": (
        lambda: make_scene(raytracer.Closure("emission", color=0.5)),
        {},
        ("emitters.py", "emitter_density"),
    ),
    "shadow linking": (
        lambda: make_scene(lamp=raytracer.PointLight(**LIGHT, blockers=1)),
        {},
        ("ray_visibility.py", "cast_linked"),
    ),
    "motion": (
        lambda: make_scene(motion=raytracer.Motion(raytracer.CameraMotion([CAMERA.world_from_camera, MOVED_CAMERA]))),
        {},
        ("moments.py", "find_moment"),
    ),
    "smooth normals": (lambda: make_scene(normals=True), {}, ("surface_tables.py", "gather_corners")),
    "spheres": (lambda: make_scene(spheres=True), {}, ("surface.py", "_sphere_points")),
    "curves": (lambda: make_scene(curves=make_fur()), {}, ("roots.py", "refine_roots")),
    "passes from the centre": (
        make_scene,
        {"passes": ("Combined", "Depth", "Position", "Object Index")},
        ("film.py", "set_centre"),
    ),
    "passes of every sample": (
        make_scene,
        {"passes": ("Combined", "Normal", "Diffuse Color", "Shadow")},
        ("first_surface.py", "divide_shadow"),
    ),
}


def measure_ablation(rounds, progress):
    """Return a row for every feature: nanoseconds a camera ray without and with it, calls of its stage in both."""
    rows = []
    for name, (make, settings, stage) in progress(FEATURES.items(), "ablation"):
        plain, scene = make_scene(), make()
        casters = {False: raytracer.build(plain), True: raytracer.build(scene)}
        renders = {
            False: lambda plain=plain, casters=casters: render(plain, casters[False], {}),
            True: lambda scene=scene, casters=casters, settings=settings: render(scene, casters[True], settings),
        }
        seconds = take_turns(renders, rounds)
        calls = {present: count_calls(function, stage) for present, function in renders.items()}
        rays = WIDTH * HEIGHT * SAMPLES
        rows.append(
            {
                "feature": name,
                "stage": f"{Path(stage[0]).stem}.{stage[1]}",
                "ns_without": seconds[False] / rays * 1e9,
                "ns_with": seconds[True] / rays * 1e9,
                "calls_without": calls[False],
                "calls_with": calls[True],
            }
        )
    return rows


def render(scene, caster, settings):
    """Render one small picture."""
    return raytracer.render(scene, WIDTH, HEIGHT, SAMPLES, caster=caster, **settings)


def count_calls(function, stage):
    """Return how often a function (module file, name) is called while `function` runs."""
    profile = cProfile.Profile()
    profile.runcall(function)
    statistics = pstats.Stats(profile).stats
    return sum(values[1] for (path, _, name), values in statistics.items() if (Path(path).name, name) == stage)


# Memory --------------------------------------------------------------------------------------------------------------

MEMORY_SCRIPT = """
import json, sys
import numpy as np
import raytracer
from tests.benchmarks.ablation import make_million, make_scene
from tests.portable import read_memory
def peak():
    return read_memory()[1] * 1e6 / 2**20
start = peak()
if sys.argv[1] == "build":
    scene = make_million()
    before = peak()
    raytracer.build(scene)
    print(json.dumps({"start_mb": before, "peak_mb": peak()}))
else:
    scene = make_scene(world=raytracer.World(0.3))
    film = raytracer.render(scene, 4096, 4096, int(sys.argv[1]))
    film.measure_error(), film["Combined"]
    print(json.dumps({"start_mb": start, "peak_mb": peak()}))
"""


def make_million():
    """Return a scene of one wavy grid of a million triangles."""
    count = 708
    x, y = np.meshgrid(np.linspace(-1, 1, count), np.linspace(-1, 1, count), indexing="ij")
    positions = np.stack([x, y, 0.1 * np.sin(9 * x) * np.cos(7 * y)], axis=-1).reshape(-1, 3)
    first = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).reshape(-1)
    quads = np.stack([first, first + count, first + count + 1, first + 1], axis=1).astype(np.int32)
    return raytracer.Scene(meshes=[raytracer.Mesh(positions, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]))])


def measure_memory(progress):
    """Return rows: peak of the resident memory, MB, of a process that builds, and of one that renders."""
    tasks = {
        "build": "building a million triangles",
        "1": "rendering 4096 x 4096, one sample",
        "3": "rendering 4096 x 4096, three samples and their error",
    }
    rows = []
    for task, label in progress(tasks.items(), "memory"):
        command = [sys.executable, "-c", MEMORY_SCRIPT, task]
        done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
        rows.append({"task": label, **json.loads(done.stdout)})
    return rows


# Workers -------------------------------------------------------------------------------------------------------------


def measure_workers(rounds, progress):
    """Return rows: seconds by the clock with one and with two workers that are running already, best of `rounds`."""
    scene = make_scene(raytracer.Closure("principled", roughness=0.4), world=raytracer.World(0.3))
    caster = raytracer.build(scene)
    rows = []
    with raytracer.Workers(2) as workers:
        for samples in progress((2, 8), "workers"):
            seconds = {1: [], 2: []}
            for _ in range(rounds):
                for count, used in ((1, 1), (2, workers)):
                    started = time.perf_counter()
                    raytracer.render(scene, 480, 320, samples, caster=caster, workers=used)
                    seconds[count].append(time.perf_counter() - started)
            best = {count: min(values) for count, values in seconds.items()}
            rows.append({"samples": samples, "one": best[1], "two": best[2], "ratio": best[1] / best[2]})
    return rows
