"""Names of the places where rays meet primitives: what has one name lies at exactly one distance, undivided.

A ray through a corner meets all of its triangles there, one through an edge both of that edge, and all that lies in one
axis plane is met at one distance; so does a triangle that is there twice. Such ties need no integers to be seen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats, Indices
from raytracer.casting.edges import name_axis_planes, name_meeting_points
from raytracer.casting.geometry import Ids, Kind
from raytracer.casting.measure import gather_lines, gather_turned
from raytracer.casting.primitives import Primitives
from raytracer.casting.rays import Rays


def name_places(
    primitives: Primitives, rays: Rays, axis: NDArray[np.int8], ray: Indices, primitive_id: Ids
) -> tuple[Floats, ...]:
    """Return names, (rows, k) each, of where k rays meet primitives: of a corner, edge or axis plane (`edges`),
    or of the whole triangle; NaN where there is none, and for spheres.

    axis : (n,) the main axis of all rays
    """
    points, planes, triangles = (np.full((rows, len(ray)), np.nan) for rows in (6, 2, 9))
    triangle = np.flatnonzero((primitive_id >= 0) & primitives.geometry.is_kind(primitive_id, Kind.TRIANGLE))
    axis_of_ray = axis.take(ray[triangle])
    for main in range(3):
        part = triangle[axis_of_ray == main]
        if len(part):
            corners = gather_turned(primitives, primitive_id[part], main)
            points[:, part] = name_meeting_points(gather_lines(primitives, rays, ray[part], main), corners)
            planes[:, part] = name_axis_planes(corners)
            triangles[:, part] = corners.reshape(9, -1)
    return points, planes, triangles
