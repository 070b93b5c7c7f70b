"""Which accelerator finds candidates, by what a scene holds; no result depends on the choice.

A few dozen triangles are all looked at (`matrix_form`). Rays of a pencil are drawn or projected (`pencil`) where there
are enough of them and that is quicker: of rays that end at a point, if any hit will do. Other rays take the dense tree
(`dense`), the tree of boxes (`bvh`) in plain precisions, or where there are too many primitives.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from raytracer.casting.bvh.offer import TreeOffer
from raytracer.casting.dense.offer import DenseOffer, suits_dense
from raytracer.casting.matrix_form import MatrixForm
from raytracer.casting.pencil.offer import DrawnOffer
from raytracer.casting.primitives import Primitives
from raytracer.casting.query import Query

# Up to this many triangles and spheres, looking at all of them is quicker than a tree.
MATRIX_TRIANGLES, MATRIX_SPHERES = 128, 8
# With fewer rays than this share of the triangles, or than this many, a tree is quicker than projection; a matrix form
# is quicker still.
PENCIL_SHARE, SMALLEST_PENCIL, SMALLEST_PENCIL_OF_FEW = 0.25, 4096, 8192


class Offer(Protocol):
    """An accelerator: offers a query all candidates that its rays may hit, and decides nothing."""

    def __call__(self, query: Query) -> None: ...


@dataclass(frozen=True, eq=False)
class Accelerators:
    """What finds candidates in a scene.

    offer : for any rays
    smallest_pencil : least number of rays with a common point or direction, for each view of theirs, that are
        projected; None: never
    drawn : for rays that leave one point; None where not all is triangles of flattened instances
    """

    offer: Offer
    smallest_pencil: int | None = None
    drawn: DrawnOffer | None = None


def choose_accelerators(primitives: Primitives, last: Offer | None = None) -> Accelerators:
    """Return what finds candidates among `primitives`.

    last : of the scene as it was before; what did not move is taken from it
    """
    triangle_count, sphere_count = primitives.geometry.sphere_id, len(primitives.geometry.radii)
    drawable = primitives.flattened.all() and not sphere_count and len(primitives.corners)
    drawn = DrawnOffer(primitives) if drawable else None
    if sphere_count <= MATRIX_SPHERES and triangle_count <= MATRIX_TRIANGLES:
        return Accelerators(MatrixForm(primitives), SMALLEST_PENCIL_OF_FEW, drawn)
    smallest_pencil = None
    if primitives.flattened.all():
        smallest_pencil = max(SMALLEST_PENCIL, int(PENCIL_SHARE * len(primitives.corners)))
    return Accelerators(_choose_tree(primitives, last), smallest_pencil, drawn)


def _choose_tree(primitives: Primitives, last: Offer | None) -> Offer:
    """Return the accelerator for more than a few triangles or spheres."""
    dense = last if isinstance(last, DenseOffer) else None
    tree = dense.other if dense is not None else last
    other = TreeOffer(primitives, tree.latest if isinstance(tree, TreeOffer) else None)
    return DenseOffer(primitives, other, dense) if suits_dense(primitives) else other
