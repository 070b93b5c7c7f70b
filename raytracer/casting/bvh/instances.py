"""Instances that share their mesh's tree: a ray enters one as a row in the frame of the mesh.

The true triangles are the rounded world triangles (`geometry.world_corners`); the tree holds the object's. The pad of
a row (`culling`) therefore covers, per axis of object space,

    the rounding of world corners, brought back:   |M^-1| gamma(4) (|M| |v| + |translation|)
    the inverse itself:                            2 ||M^-1 M - I|| per unit of the largest coordinate involved
    the rounding of M^-1 (o - translation):        gamma(5) |M^-1| (|o| + |translation|), plus the error of o
    the direction's error, over the way:           gamma(4) |M^-1| |d| t, t up to the far side of the mesh

Matrices that cannot be inverted well are not placed: their instances are flattened (`can_be_placed`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats
from raytracer.casting.bvh.culling import CullingRays, largest_component, make_rows
from raytracer.casting.bvh.tree import Frame
from raytracer.predicates.rounding import gamma

# ||M^-1 M - I|| beyond this, or scales beyond 2^EXPONENT_RANGE of the world's, make the pad useless.
WORST_RESIDUAL = 2.0**-20
EXPONENT_RANGE = 60


@dataclass(frozen=True, eq=False)
class PlacedTrees:
    """Per instance (i,), rows of instances that are not placed hold no meaning.

    root : (i,) int32, node where the mesh's tree begins
    first_id : (i,) int64, primitive id of the instance's first triangle
    inverse : (i, 3, 3), translation : (i, 3) float64
    centre, exponent : (i, 3), (i,) the mesh's frame
    residual : (i,) ||M^-1 M - I||
    corner_error : (i, 3) float64, object units, the rounding of world corners brought back
    """

    root: NDArray[np.int32]
    first_id: NDArray[np.int64]
    inverse: Floats
    translation: Floats
    centre: Floats
    exponent: NDArray[np.int32]
    residual: Floats
    corner_error: Floats


def invert(world_from_object: Floats) -> tuple[Floats, Floats]:
    """Inverses (i, 3, 3) of the linear parts and their residuals (i,); singular ones get an infinite residual."""
    linear = world_from_object[:, :3, :3]
    with np.errstate(all="ignore"):
        singular = ~(np.abs(np.linalg.det(linear)) > 0)
        inverse = np.linalg.inv(np.where(singular[:, None, None], np.eye(3), linear))
        product = np.einsum("kij,kjl->kil", inverse, linear)
        rounding = gamma(4) * np.einsum("kij,kjl->kil", np.abs(inverse), np.abs(linear))
        residual = (np.abs(product - np.eye(3)) + rounding).sum(axis=2).max(axis=1)
    return inverse, np.where(singular | ~np.isfinite(residual), np.inf, residual)


def can_be_placed(world_from_object: Floats, mesh_exponent: NDArray, world_exponent: int) -> Booleans:
    """(i,) True where an instance's matrix is well enough conditioned for rays to be brought into object space."""
    inverse, residual = invert(world_from_object)
    size = np.frexp(np.abs(inverse).max(axis=(1, 2)))[1] + mesh_exponent - world_exponent
    return np.asarray((residual < WORST_RESIDUAL) & (np.abs(size) < EXPONENT_RANGE))


def place_rays(
    placed: PlacedTrees, frame: Frame, rays: CullingRays, ray: NDArray, instance: NDArray
) -> NDArray[np.float32]:
    """Return the (14, k) rows of rays in the frames of the instances' meshes; t_row is the ray's own."""
    # World frame to world units relative to the instance: exact but for one rounding of each difference.
    origin = np.ldexp(rays.origin[ray], -frame.exponent) + (frame.centre - placed.translation[instance])
    direction = np.ldexp(rays.direction[ray], -frame.exponent)
    inverse, exponent = placed.inverse[instance], placed.exponent[instance][:, None]
    local = _apply(inverse, origin)
    slope = _apply(inverse, direction)
    size = np.abs(inverse)
    reach = np.abs(frame.centre) + np.abs(placed.translation[instance]) + np.abs(origin)
    error = _apply(size, np.ldexp(rays.error[ray], -frame.exponent)[:, None] + gamma(8) * reach)
    # The way to the far side of the mesh, in units of t_row.
    middle, half = placed.centre[instance], np.ldexp(1.0, -exponent)
    extent = largest_component(local - middle) + 2 * half
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        way = extent / largest_component(slope)
        error += gamma(8) * _apply(size, np.abs(direction)) * way
        largest = extent + largest_component(middle) + largest_component(local)
        error += 4 * placed.residual[instance][:, None] * largest + placed.corner_error[instance]
        return make_rows(
            np.ldexp(local - middle, exponent), np.ldexp(slope, exponent), np.ldexp(error, exponent) + gamma(4) * 2
        )


def _apply(matrix: Floats, vector: Floats) -> Floats:
    """(k, 3, 3) times (k, 3)."""
    columns = matrix * vector[:, None, :]
    return np.add(np.add(columns[:, :, 0], columns[:, :, 1]), columns[:, :, 2])
