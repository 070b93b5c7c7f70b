"""The ray tracer's three precisions as peers."""

from __future__ import annotations

from functools import partial

import numpy as np

import raytracer
from raytracer.casting.caster import BATCH_RAYS
from raytracer.casting.query import Query
from raytracer.casting.rays import make_rays
from tests.benchmarks.peers import Answer, Built, Peer

PREFIX = "raytracer, "
CERTIFIED, FLOAT64, FLOAT32 = (PREFIX + precision for precision in ("certified", "float64", "float32"))


def make_peer(name):
    """Return the Peer of a precision, the word after PREFIX."""
    precision = name.removeprefix(PREFIX)
    return Peer(name, f"NumPy {np.__version__}", partial(build, precision), lowest_index=precision == "certified")


def build(precision, positions, triangles):
    """Build a caster over a mesh."""
    return build_scene(PREFIX + precision, raytracer.Scene(meshes=[raytracer.Mesh(positions, triangles)]))


def build_scene(name, scene):
    """Build the caster of the peer called `name` over a Scene."""
    precision = name.removeprefix(PREFIX)
    caster = raytracer.build(scene, precision=precision)
    return Built(
        prepare=lambda origins, directions, reach: (origins, directions, 0.0, reach),
        cast=lambda rays: caster.closest_hit(*rays),
        read=read,
        occlude=lambda rays: caster.any_hit(*rays),
        count_exact=partial(count_exact, caster) if precision == "certified" else None,
    )


def read(hits):
    """Translate Hits; a bound that is NaN promises nothing."""
    certified = not np.isnan(hits.distance_error).any()
    return Answer(hits.distance, hits.primitive.astype(np.int64), hits.distance_error if certified else None)


def count_exact(caster, origins, directions):
    """Return how many of the rays a certified caster decides in integers."""
    total = 0
    for start in range(0, len(origins), BATCH_RAYS):
        block = slice(start, start + BATCH_RAYS)
        query = Query(caster.primitives, make_rays(origins[block], directions[block]), any_hit=False)
        caster.offer(query)
        query.closest()
        total += query.exact_count
    return total


PEERS = dict.fromkeys((CERTIFIED, FLOAT64, FLOAT32), make_peer)
