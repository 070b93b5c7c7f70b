"""Section "accuracy": every peer on the same rays, against the exact oracle; section "spheres": the formulas.

A row tells, for one ray set and one peer, how often it was wrong and in which way, how far its distances are off, and
what a ray cost. Counts and times come from separate casts.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from tests.benchmarks.peers import Peer, ask
from tests.benchmarks.ray_sets import make_ray_sets
from tests.benchmarks.sphere_sets import SPHERE_PEERS, make_sphere_sets
from tests.benchmarks.timing import one_core, take_turns
from tests.benchmarks.truth import bound_rate, count_failures, find_truth, tally

# The batch is filled up with the same rays again, but to no more than this: slow peers would take too long.
TIMED_RAYS = 1 << 14
# Peers with a limit are slow ones: this share of it is enough to time them.
TIMED_SHARE = 8


@dataclass(frozen=True)
class Effort:
    """rays : per set, to be judged; batch : rays that are timed together; rounds : of timing; seed : of all rays"""

    rays: int
    batch: int
    rounds: int
    seed: int


def measure_accuracy(peers: list[Peer], effort: Effort, progress):
    """Return the rows of all ray sets and peers; `progress(iterable, label)` wraps what takes long."""
    rows = []
    for rays in progress(make_ray_sets(effort.seed, effort.rays), "accuracy"):
        truth = find_truth(rays.origins, rays.directions, rays.target.positions[rays.target.triangles])
        rows += compare_peers(peers, rays, truth, effort)
    return rows


def compare_peers(peers, rays, truth, effort):
    """Return one row per peer for a RaySet."""
    built = {peer.name: peer.build(rays.target.positions, rays.target.triangles) for peer in peers}
    nanoseconds = time_peers(peers, built, rays, effort)
    rows = []
    for peer in peers:
        caster, count = built[peer.name], peer.limit(len(truth))
        answer = ask(caster, rays.origins[:count], rays.directions[:count])
        row = {"scene": rays.target.name, "family": rays.family, "peer": peer.name}
        row |= judge_answer(truth, answer, peer.lowest_index)
        exact = caster.count_exact(rays.origins[:count], rays.directions[:count]) if caster.count_exact else None
        row |= {"exact_share": None if exact is None else exact / count, "ns_per_ray": nanoseconds[peer.name]}
        rows.append(row)
    return rows


def judge_answer(truth, answer, lowest_index):
    """Return the counts and errors of an answer, and its rate of failures."""
    numbers = tally(truth, answer, lowest_index)
    return numbers | bound_rate(count_failures(numbers), numbers["rays"])


def time_peers(peers, built, rays, effort):
    """Return name -> nanoseconds per ray of a RaySet."""
    batch = min(effort.batch, TIMED_RAYS)
    casts, counts = {}, {}
    for peer in peers:
        count = batch if peer.ray_limit is None else min(batch, max(1, peer.ray_limit // TIMED_SHARE))
        chosen = np.resize(np.arange(len(rays.origins)), count)
        prepared = built[peer.name].prepare(rays.origins[chosen], rays.directions[chosen], np.inf)
        casts[peer.name], counts[peer.name] = partial(built[peer.name].cast, prepared), count
    with one_core():
        seconds = take_turns(casts, effort.rounds)
    return {name: 1e9 * seconds[name] / counts[name] for name in casts}


def measure_spheres(effort: Effort, progress):
    """Return the rows of all sphere sets: the formulas and the ray tracer's precisions."""
    rows = []
    for rays in progress(make_sphere_sets(effort.seed, effort.rays), "spheres"):
        truth = find_truth(rays.origins, rays.directions, None, rays.centre[None], np.array([rays.radius]))
        casts = {name: partial(answer, rays) for name, answer in SPHERE_PEERS.items()}
        with one_core():
            seconds = take_turns(casts, effort.rounds)
        for name, cast in casts.items():
            row = {"scene": rays.name, "family": "sphere", "peer": name} | judge_answer(truth, cast(), False)
            rows.append(row | {"exact_share": None, "ns_per_ray": 1e9 * seconds[name] / len(truth)})
    return rows
