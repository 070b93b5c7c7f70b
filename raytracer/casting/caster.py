"""The public caster: arrays of rays in, closest hits or occlusion out.

`build` packs a scene's geometry once; a Caster answers any number of batches. `choose` says how candidates are found,
which changes no result; decisions are made in `query`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytracer.arrays.checks import require_choice
from raytracer.arrays.memory import keep_freed_memory
from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.casting.bvh.hierarchy import bound_spheres, bound_world, choose_flattened
from raytracer.casting.choose import Offer, choose_accelerators
from raytracer.casting.crossings import CrossingQuery
from raytracer.casting.curves.caster import CurveCaster
from raytracer.casting.dense.offer import DenseOffer
from raytracer.casting.geometry import Geometry, pack_geometry
from raytracer.casting.matrix_form import MatrixForm
from raytracer.casting.order import Departure, Order
from raytracer.casting.passing import find_meeting
from raytracer.casting.pencil.arriving_grid import ArrivingGrid, come_near
from raytracer.casting.pencil.offer import DrawnOffer
from raytracer.casting.pencil.pencil import Pencil, Rows, View, find_pencil, make_views
from raytracer.casting.pencil.pixel_grid import find_pixel_grid
from raytracer.casting.pencil.projection import Projection, project
from raytracer.casting.pencil.rasterize import offer_projected
from raytracer.casting.pencil.strip_grid import StripGrid
from raytracer.casting.planes import LARGEST_SIZE
from raytracer.casting.primitives import Primitives, make_primitives
from raytracer.casting.query import Query
from raytracer.casting.questions import Questions
from raytracer.casting.rays import Hits, Rays, check_after, make_misses, make_rays
from raytracer.predicates.rounding import PRECISIONS
from raytracer.scene.scene import Scene, require_scene

# Rays per batch: their state and the candidates they bring stay within a few tens of megabytes.
BATCH_RAYS = 1 << 16
# The dense tree shares what a block of triangles costs between the rays of a batch.
DENSE_RAYS = 3 << 16
# Rays of a pencil are cast in larger batches where there are more triangles, each of which costs something per batch.
PENCIL_RAYS = 1 << 18
# So many rays that arrive at a point, and for a triangle, are drawn: with fewer the dense tree is quicker, as with
# parallel ones.
ARRIVING_RAYS, ARRIVING_SHARE = 1 << 15, 0.35
# Of fewer rays those that pass the scene's box are not looked for.
SMALLEST_BATCH = 4096
# Rays of a call that are looked at together.
CALL_RAYS = 1 << 20

# Once per process, workers included.
keep_freed_memory()


@dataclass(frozen=True, eq=False)
class Caster(Questions):
    """A scene ready to be cast into.

    offer : the accelerator for any rays, a function that offers a Query all candidates its rays can hit
    smallest_pencil : least number of rays with a common point or direction, for each view of theirs, that are
        projected; None: never
    drawn : offers a query, whose rays leave one point, what is drawn on their grid; None where not all is triangles
        of flattened instances
    curves : casts into the curves; None where there are none
    """

    scene: Scene
    primitives: Primitives
    offer: Offer
    smallest_pencil: int | None = None
    drawn: DrawnOffer | None = None
    curves: CurveCaster | None = None

    @property
    def geometry(self) -> Geometry:
        return self.primitives.geometry

    @property
    def roundoff(self) -> float:
        """Unit roundoff of the precision over that of float64."""
        return float(np.finfo(self.primitives.dtype).eps / np.finfo(np.float64).eps)

    def closest_hit(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        *,
        after: Hits | None = None,
        order: Order | None = None,
        departure: Departure | None = None,
    ) -> Hits:
        """Return the closest hit of each ray o + t d with t_min <= t <= t_max.

        Parameters
        ----------
        origins, directions : (n, 3) or (3,) float64, metres, world; directions of any length
        t_min, t_max : scalar or (n,), inclusive, in units of the direction's length; t_min below 0 counts as 0
        after : hits of these rays, as they came: the rays go on behind them, in the exact order of
            (t, instance, primitive). Called again with what it returns, until all miss, it lists all that a ray meets,
            each triangle once and each sphere twice. Misses start afresh
        order : the order of surfaces at one t instead of (instance, primitive) (`order`); hits then tell whether
            they may be `tied`
        departure : the places that the rays start from

        Returns
        -------
        Hits of n rays. NaN, infinite or zero-direction rays miss and are flagged in `Hits.valid`.

        Raises
        ------
        ValueError
            If shapes do not fit.

        Notes
        -----
        Closed sets: a ray through an edge or vertex hits every triangle there; among equal distances the lowest
        (instance, primitive) is returned. A triangle without area, or seen exactly edge-on, is never hit. A hit beyond
        the largest float64 has an infinite distance and error.

        Examples
        --------
        >>> import raytracer
        >>> mesh = raytracer.Mesh(positions=[(0, 0, 0), (1, 0, 0), (0, 1, 0)], triangles=[(0, 1, 2)])
        >>> caster = raytracer.build(raytracer.Scene(meshes=[mesh]))
        >>> hits = caster.closest_hit([(0.25, 0.5, 2), (9, 9, 2)], (0, 0, -1))
        >>> hits.distance.tolist(), hits.primitive.tolist()
        ([2.0, inf], [0, -1])
        >>> hits.barycentric[0].tolist(), bool(hits.distance_error[0] < 1e-14)
        ([0.25, 0.5], True)
        """
        rays = make_rays(origins, directions, t_min, t_max)
        rays = replace(rays, after=check_after(after, len(rays)), departure=departure)
        valid = rays.valid()
        hits = make_misses(valid, tied=order is not None)
        others = rays if self.curves is None else self.curves.leave_curves(rays)
        for index, query in self._run_queries(others, valid, False, order):
            hits.put(index, query.closest())
        if self.curves is not None:
            self.curves.put_closest(rays, hits)
        return hits

    def any_hit(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        *,
        order: Order | None = None,
        departure: Departure | None = None,
    ) -> Booleans:
        """Return (n,) bool: does anything lie on the ray with t_min <= t <= t_max? Parameters as `closest_hit`.

        Examples
        --------
        >>> import raytracer
        >>> mesh = raytracer.Mesh(positions=[(0, 0, 0), (1, 0, 0), (0, 1, 0)], triangles=[(0, 1, 2)])
        >>> caster = raytracer.build(raytracer.Scene(meshes=[mesh]))
        >>> caster.any_hit((0.25, 0.25, 1), [(0, 0, -1), (0, 0, 1)]).tolist()
        [True, False]
        >>> caster.any_hit((0.25, 0.25, 1), (0, 0, -1), t_max=0.5).tolist()
        [False]
        """
        rays = replace(make_rays(origins, directions, t_min, t_max), departure=departure)
        found, valid = np.zeros(len(rays), dtype=bool), rays.valid()
        for index, query in self._run_queries(rays, valid, True, order):
            found[index] = query.found_any()
        if self.curves is not None:
            self.curves.put_any(rays, valid, found)
        return found

    def _run_queries(
        self, rays: Rays, valid: Booleans, any_hit: bool, order: Order | None
    ) -> Iterator[tuple[Rows, Query]]:
        """Yield the finished queries of the valid rays, in batches, with the rays' places."""
        if not valid.all():
            place = np.flatnonzero(valid)
            rays = rays.select(place)
            for rows, query in self._run_queries(rays, np.ones(len(rays), bool), any_hit, order):
                yield place[rows], query
            return
        fresh = rays.find_fresh()
        if fresh.any() and not fresh.all():
            for place in (np.flatnonzero(fresh), np.flatnonzero(~fresh)):
                some = rays.select(place)
                for rows, query in self._run_queries(some, np.ones(len(some), bool), any_hit, order):
                    yield place[rows], query
            return
        if rays.after is not None or rays.departure is not None:
            rays = replace(rays, after=None, departure=None) if fresh.all() else rays
        for start in range(0, len(rays), CALL_RAYS):
            some = rays.select(slice(start, start + CALL_RAYS))
            for rows, offer in self._plan(some, any_hit):
                query = Query(self.primitives, some.select(rows), any_hit, order)
                offer(query)
                yield slice(start + rows.start, start + rows.stop) if isinstance(rows, slice) else start + rows, query

    def _plan(self, rays: Rays, any_hit: bool) -> Iterator[tuple[Rows, Offer]]:
        """Yield batches of rays and what offers a query of theirs all candidates."""
        pencil = self._find_pencil(rays, any_hit)
        exponent = 0 if pencil is None else self._find_reach(pencil)
        if pencil is not None and abs(exponent) < LARGEST_SIZE:
            # A power of two by which the scene and the pencil come to a size of about one.
            scale = float(np.ldexp(1.0, -exponent))
            if self.drawn is not None and pencil.leaving:
                grid = find_pixel_grid(rays, scale)
                if grid is not None:
                    yield slice(0, len(rays)), partial(self.drawn, grid)
                    return
            views = list(make_views(pencil, rays, scale))
            if self.smallest_pencil is not None and len(rays) >= self.smallest_pencil * len(views):
                for view in views:
                    yield from self._plan_view(view, any_hit and bool((rays.t_min <= 0).all()))
                return
        size = DENSE_RAYS if isinstance(self.offer, DenseOffer) else BATCH_RAYS
        meeting = self._find_meeting(rays)
        for start in range(0, len(rays) if meeting is None else len(meeting), size):
            part = slice(start, min(start + size, len(rays)))
            yield part if meeting is None else meeting[part], self.offer

    def _find_meeting(self, rays: Rays) -> Indices | None:
        """Rays that may meet the scene's box, if many pass it."""
        if len(rays) < SMALLEST_BATCH or self.primitives.precision != "certified":
            return None
        return find_meeting(self._box, rays.origins, rays.directions)

    @cached_property
    def _box(self) -> Floats:
        return bound_world(self.primitives, bound_spheres(self.geometry))

    def _find_pencil(self, rays: Rays, any_hit: bool) -> Pencil | None:
        """The pencil that rays form, if there are enough of them."""
        if self.smallest_pencil is None or len(rays) < self.smallest_pencil:
            return None
        if rays.after is not None or rays.departure is not None:
            # What is drawn is settled without a look at what the rays have left behind.
            return None
        if not isinstance(self.offer, MatrixForm | DenseOffer) or self._has_many_spheres():
            return find_pencil(rays)
        if not any_hit:
            return find_pencil(rays, parallel=isinstance(self.offer, DenseOffer), arriving=False)
        if isinstance(self.offer, MatrixForm):
            return None
        least = max(ARRIVING_RAYS, int(ARRIVING_SHARE * len(self.primitives.corners)))
        return find_pencil(rays, parallel=False, arriving=len(rays) >= least)

    def _has_many_spheres(self) -> bool:
        """Whether projecting all pencils pays: spheres among as many triangles at most. Of 500 to 30,000 spheres alone
        rays of the camera take .4 to .5 times as long as through the dense tree, those to a light .5 to .8, to a sun
        .7 to .9; few spheres among triangles are as quick there, or up to 1.6 times."""
        geometry = self.geometry
        return isinstance(self.offer, DenseOffer) and len(geometry.radii) >= max(1, geometry.sphere_id)

    def _find_reach(self, pencil: Pencil) -> int:
        """How far the scene reaches from the pencil's center, as a power of two."""
        return int(np.frexp(np.abs(self.primitives.bounds - pencil.centre).max())[1])

    def _plan_view(self, view: View, arriving: bool) -> Iterator[tuple[Rows, Offer]]:
        """arriving : may rays be drawn that arrive at a point"""
        if self.drawn is not None and view.pencil.leaving:
            yield view.pick(0, len(view)), partial(self.drawn, StripGrid(view))
            return
        arriving = arriving and view.pencil.arriving
        if self.drawn is not None and arriving and not come_near(self.drawn.find_clusters(), view):
            yield view.pick(0, len(view)), partial(self.drawn, ArrivingGrid(view))
            return
        size = min(max(BATCH_RAYS, len(self.primitives.corners) // 2), PENCIL_RAYS)
        projection = project(view, self.primitives)
        for start in range(0, len(view), size):
            part = slice(start, min(start + size, len(view)))
            yield view.pick(part.start, part.stop), partial(_offer_part, view, projection, part)

    def crossings(self, origins: ArrayLike, directions: ArrayLike) -> NDArray[np.int32]:
        """Return how many triangles each ray crosses, (n,) int32; odd means inside a closed mesh.

        Exact parity also where a ray passes through edges and vertices or starts on a face (`crossings`). Spheres and
        curves are not counted; invalid rays cross nothing.

        Raises
        ------
        ValueError
            If the caster's precision is not 'certified'.

        Examples
        --------
        A tetrahedron, from inside through a corner, and from outside:

        >>> import raytracer
        >>> corners, faces = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
        >>> caster = raytracer.build(raytracer.Scene(meshes=[raytracer.Mesh(corners, faces)]))
        >>> (caster.crossings([(0.25, 0.25, 0.25), (2, 2, 2)], (-1, -1, -1)) % 2 == 1).tolist()
        [True, False]
        """
        if self.primitives.precision != "certified":
            raise ValueError(f"crossings: precision: expected 'certified', got {self.primitives.precision!r}")
        rays = make_rays(origins, directions)
        count = np.zeros(len(rays), np.int32)
        valid = np.flatnonzero(rays.valid())
        for start in range(0, len(valid), BATCH_RAYS):
            index = valid[start : start + BATCH_RAYS]
            query = CrossingQuery(self.primitives, rays.select(index))
            self.offer(query)
            count[index] = query.counts()
        return count


def build(scene: Scene, precision: str = "certified", last: Caster | None = None) -> Caster:
    """Return a Caster for `scene`.

    precision : 'certified' (every decision as exact arithmetic would make it, but among curves), 'float64' or 'float32'
    last : the caster of the scene as it was before, for instance a frame ago; trees of what did not move are taken from
        it. No result depends on it.

    Raises
    ------
    ValueError
        If that is no Scene, or the precision is unknown.

    Examples
    --------
    >>> import raytracer
    >>> mesh = raytracer.Mesh(positions=[(0, 0, 0), (1, 0, 0), (0, 1, 0)], triangles=[(0, 1, 2)])
    >>> caster = raytracer.build(raytracer.Scene(meshes=[mesh]))
    >>> caster.any_hit((0.25, 0.25, 1), (0, 0, -1)).tolist()
    [True]
    """
    require_scene(scene, "build: scene")
    require_choice(precision, PRECISIONS, "build: precision")
    geometry = pack_geometry(scene)
    primitives = make_primitives(geometry, precision, choose_flattened(geometry))
    chosen = choose_accelerators(primitives, None if last is None else last.offer)
    curves = None if geometry.strands is None else CurveCaster(primitives, geometry.strands)
    return Caster(scene, primitives, chosen.offer, chosen.smallest_pencil, chosen.drawn, curves)


def _offer_part(view: View, projection: Projection, rows: slice, query: Query) -> None:
    offer_projected(view, projection, query, rows)
