"""When the dense tree is used and when it is built: by the first large batch.

Batches too small for that take the four-wide tree unless the dense one is there already: it is slower, whatever the
batch, but with many triangles it is built in half the time. It also serves what no hit narrows (`crossings`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.casting.bvh.hierarchy import bound_spheres, bound_world
from raytracer.casting.bvh.tree import Frame, make_frame
from raytracer.casting.dense.instances import Instances, build_instances
from raytracer.casting.dense.lines import prepare_rays, to_bounds
from raytracer.casting.dense.spheres import SphereBlocks, SphereRays, build_spheres, walk_spheres
from raytracer.casting.dense.tree import MOST_TRIANGLES, DenseTree, build_dense_tree, pack_dense_tree
from raytracer.casting.dense.walk import walk_world
from raytracer.casting.dense.walk_instances import InstanceWalk
from raytracer.casting.planes import PLANE_COLUMNS, PlaneDecisions
from raytracer.casting.primitives import Primitives
from raytracer.casting.query import Query

NO_PLANES = np.zeros((0, PLANE_COLUMNS))
# Rays for which the dense tree is built, and triangles among which it is for any: of so many the other takes as long.
SMALLEST_BATCH, FEW_TRIANGLES = 4096, 1 << 14
# How much more surface the blocks of moved triangles may have, as a share of the scene's, before they are chosen anew.
MOST_GROWTH = 1.25


def suits_dense(primitives: Primitives) -> bool:
    """True where there are triangles or spheres, not too many of them, and rays that are decided exactly."""
    geometry = primitives.geometry
    shared = np.unique(geometry.instance_mesh[~primitives.flattened])
    return (
        primitives.precision == "certified"
        and geometry.sphere_id + len(geometry.radii) > 0
        and max(len(primitives.corners), len(geometry.radii)) <= MOST_TRIANGLES
        and int(geometry.mesh_count[shared].sum()) <= MOST_TRIANGLES
    )


@dataclass(frozen=True, eq=False)
class DenseScene:
    """Triangles that are flattened, and instances of what is not; None where there is none. Spheres, in up to two
    trees."""

    frame: Frame
    tree: DenseTree | None
    instances: Instances | None
    spheres: list[SphereBlocks]


@np.errstate(all="ignore")
def offer_dense(scene: DenseScene, query: Query) -> None:
    """Offer a query all primitives that its rays may hit, or settle them."""
    if not len(query.rays):
        return
    decisions = PlaneDecisions(query, NO_PLANES if scene.tree is None else scene.tree.planes)
    quadrics = SphereRays(len(query.rays)) if scene.spheres else None
    rays = prepare_rays(scene.frame, decisions, None if quadrics is None else quadrics.fill)
    best = to_bounds(decisions.best, rays.way)
    if quadrics is not None:
        for tree in scene.spheres:
            walk_spheres(tree, quadrics, rays, best, decisions)
    if scene.tree is not None:
        walk_world(scene.tree, rays, best, decisions)
    if scene.instances is not None:
        InstanceWalk(scene.instances, rays, best, decisions).run()
    decisions.finish()


class DenseOffer:
    """Offers candidates found by dense trees, or by `other` where that is better.

    built : the trees once they are built, or the last ones if nothing has moved since
    last : a tree of as many flattened triangles before they moved, whose blocks are tried first
    """

    def __init__(self, primitives: Primitives, other: Callable[[Query], None], last: DenseOffer | None = None) -> None:
        self.primitives, self.other = primitives, other
        self.built: DenseScene | None = None
        count = primitives.geometry.sphere_id + len(primitives.geometry.radii)
        self.smallest_batch = 0 if count <= FEW_TRIANGLES else SMALLEST_BATCH
        self.last: DenseTree | None = None
        if last is not None:
            self._take_last(last)

    def _take_last(self, last: DenseOffer) -> None:
        corners, tree = self.primitives.corners, last.last if last.built is None else last.built.tree
        spheres, old = self.primitives.geometry, last.primitives.geometry
        same = np.array_equal(last.primitives.corners, corners)
        same = same and np.array_equal(old.centres, spheres.centres) and np.array_equal(old.radii, spheres.radii)
        if same and self.primitives.flattened.all() and last.primitives.flattened.all():
            self.built = last.built
        if self.built is None and len(last.primitives.corners) == len(corners):
            self.last = tree

    def __call__(self, query: Query) -> None:
        """Offer a query all primitives that its rays may hit."""
        if not query.narrows or (self.built is None and len(query.rays) < self.smallest_batch):
            self.other(query)
            return
        if self.built is None:
            self.built, self.last = build_scene(self.primitives, self.last), None
        offer_dense(self.built, query)


def build_scene(primitives: Primitives, last: DenseTree | None = None) -> DenseScene:
    """Build what the dense form of a scene needs."""
    bounds = bound_world(primitives, bound_spheres(primitives.geometry))
    frame = make_frame(*bounds)
    tree = _build_flattened(primitives.corners, bounds, last) if len(primitives.corners) else None
    instances = None if primitives.flattened.all() else build_instances(primitives, frame)
    spheres = build_spheres(primitives.geometry, frame) if len(primitives.geometry.radii) else []
    return DenseScene(frame, tree, instances, spheres)


def _build_flattened(corners: NDArray, bounds: Floats, last: DenseTree | None) -> DenseTree:
    """The tree of triangles (f, 9) in the world's box `bounds` (2, 3)."""
    if last is not None:
        moved = pack_dense_tree(bounds, corners, last.items, last.count, last.large)
        if moved.surface <= MOST_GROWTH * last.surface:
            return moved
    return build_dense_tree(corners, bounds)
