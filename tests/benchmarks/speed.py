"""Section "speed": million rays per second, peers taking turns on one core; section "cost": what certainty costs."""

from __future__ import annotations

from functools import partial

import numpy as np

import raytracer
from tests.benchmarks import speed_scenes
from tests.benchmarks.accuracy import Effort
from tests.benchmarks.peers_blender import BVH_TREE, SCENE
from tests.benchmarks.peers_libraries import OPEN3D
from tests.benchmarks.peers_nodes import RAYCAST
from tests.benchmarks.peers_ours import CERTIFIED, FLOAT32, FLOAT64, build_scene
from tests.benchmarks.ray_sets import make_rays, make_targets
from tests.benchmarks.timing import measure, one_core, take_turns

SPEED_PEERS = (CERTIFIED, FLOAT64, FLOAT32, OPEN3D, BVH_TREE, SCENE, RAYCAST)
# Peers that take one ray a call get at most this many, evenly spread.
LOOP_RAYS = 1 << 14
# Meshes of more triangles are not made of instances.
MOST_FLAT = 5_000_000
# How much longer than float64 the certified mode may take, by family: what the project promises.
PROMISED = {"camera": 1.25, "random": 1.25, "vertex": 30.0}


def measure_speed(peers, effort: Effort, large, progress):
    """Return (rows, build rows, skipped scenes) of all scenes, kinds of rays and those of `peers` in SPEED_PEERS."""
    chosen = [peer for peer in peers if peer.name in SPEED_PEERS]
    rows, builds, skipped = [], [], {}
    for name, make in progress(speed_scenes.list_scenes(large).items(), "speed"):
        try:
            scene = make()
        except ImportError as error:
            skipped[f"scene {name}"] = f"not installed: {error}"
            continue
        built, seconds = build_all(chosen, scene)
        builds += [
            {"scene": scene.name, "triangles": scene.count, "peer": peer, "seconds": value}
            for peer, value in seconds.items()
        ]
        caster = raytracer.build(scene.describe())
        for rays in speed_scenes.make_all_rays(scene, caster, effort.seed, effort.batch):
            rows += time_rays(chosen, built, scene, rays, effort.rounds)
    return rows, builds, skipped


def build_all(peers, scene):
    """Return name -> Built, and name -> seconds from arrays to the first answer: some build when first asked.

    Instances are ours only; the others get one mesh of all of them, or stay out where that is too large.
    """
    ours = (CERTIFIED, FLOAT64, FLOAT32)
    peers = [peer for peer in peers if peer.name in ours or scene.count <= MOST_FLAT]
    flat = scene.flatten() if any(peer.name not in ours for peer in peers) else None

    def build(peer):
        built = build_scene(peer.name, scene.describe()) if peer.name in ours else peer.build(*flat)
        built.cast(built.prepare(scene.eye[None], (scene.centre - scene.eye)[None], np.inf))
        return built

    with one_core():
        results = {peer.name: measure(partial(build, peer)) for peer in peers}
    return {name: built for name, (built, _) in results.items()}, {name: took for name, (_, took) in results.items()}


def time_rays(peers, built, scene, rays, rounds):
    """Return one row per peer: million rays per second."""
    casts, counts = {}, {}
    for peer in peers:
        caster = built.get(peer.name)
        if caster is None:
            continue
        step = 1 if peer.ray_limit is None else max(1, -(-len(rays.origins) // LOOP_RAYS))
        prepared = caster.prepare(rays.origins[::step], rays.directions[::step], rays.reach)
        casts[peer.name] = partial(caster.occlude if rays.any_hit else caster.cast, prepared)
        counts[peer.name] = len(rays.origins[::step])
    with one_core():
        seconds = take_turns(casts, rounds)
    return [
        {
            "scene": scene.name,
            "triangles": scene.count,
            "family": rays.kind,
            "peer": name,
            "rays": counts[name],
            "mrays_per_second": counts[name] / seconds[name] / 1e6,
        }
        for name in casts
    ]


def measure_cost(peers, effort: Effort, progress):
    """Return rows: certified mode's time over float64's, on camera, random and exactly vertex-aimed rays."""
    pair = [peer for peer in peers if peer.name in (CERTIFIED, FLOAT64)]
    generator = np.random.default_rng(effort.seed)
    targets = [target for target in make_targets(generator) if target.name in ("icosphere", "torus")]
    targets.append(speed_scenes.make_target(speed_scenes.show_objects()))
    rows = []
    for target in progress(targets, "cost"):
        built = {peer.name: peer.build(target.positions, target.triangles) for peer in pair}
        for family in PROMISED:
            rays = make_rays(target, family, generator, effort.batch)
            rows.append(compare_cost(built, rays, effort.rounds))
    return rows


def compare_cost(built, rays, rounds):
    """Return the row of one RaySet."""
    prepared = rays.origins, rays.directions
    casts = {name: partial(caster.cast, caster.prepare(*prepared, np.inf)) for name, caster in built.items()}
    with one_core():
        seconds = take_turns(casts, rounds)
    count = len(rays.origins)
    return {
        "scene": rays.target.name,
        "family": rays.family,
        "rays": count,
        "certified_ns": 1e9 * seconds[CERTIFIED] / count,
        "float64_ns": 1e9 * seconds[FLOAT64] / count,
        "ratio": seconds[CERTIFIED] / seconds[FLOAT64],
        "promised": PROMISED[rays.family],
        "exact_share": built[CERTIFIED].count_exact(*prepared) / count,
    }
