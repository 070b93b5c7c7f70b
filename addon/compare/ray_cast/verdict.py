"""One ray: what this caster and Scene.ray_cast say of it, and for both what exact arithmetic says.

Scene.ray_cast takes rays in float32, so it is judged by the ray that it got. Spheres of point clouds, which it does not
know, are left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.casting.geometry import world_corners
from raytracer.predicates import exact

from .comparison import make_sides
from .judge import Judge
from .rays import Aimed
from .sides import Answers, Sides, cast_blender, cast_ours

Surfaces = frozenset[tuple[str, int]]  # (object, polygon); several where the ray meets an edge, none where it misses


@dataclass(frozen=True, eq=False)
class Verdict:
    """What one side says of a ray, and the truth.

    origin, direction : (3,) float64, the ray as this side got it
    answer : the object and polygon that it says is hit; None = it says the ray misses
    location : (3,) where it says; None for a miss
    distance_error : bound that it proves on the error of its t; None where it proves nothing
    distance : t as it says; NaN for a miss
    exact_surfaces : all that the ray hits at its smallest t
    exact_distance : that t, as a fraction; None = the ray misses
    """

    origin: Floats
    direction: Floats
    answer: tuple[str, int] | None
    location: Floats | None
    distance: float
    distance_error: float | None
    exact_surfaces: Surfaces
    exact_distance: Fraction | None

    @property
    def is_right(self) -> bool:
        """True where the answer is one of those that exact arithmetic allows."""
        return self.answer in self.exact_surfaces if self.answer else not self.exact_surfaces

    @property
    def location_error(self) -> float:
        """Metres from the exact point of the ray; NaN where a side or the truth is a miss."""
        if self.location is None or self.exact_distance is None:
            return float("nan")
        exactly = [
            Fraction(float(place)) - Fraction(float(start)) - self.exact_distance * Fraction(float(step))
            for place, start, step in zip(self.location, self.origin, self.direction, strict=True)
        ]
        return float(sum(offset * offset for offset in exactly)) ** 0.5

    @property
    def t_error(self) -> float:
        """|t - exact t|, rounded once; NaN as above."""
        if self.exact_distance is None or np.isnan(self.distance):
            return float("nan")
        return float(abs(Fraction(self.distance) - self.exact_distance))


def judge_ray(scene: Any, depsgraph: Any, origin: Any, direction: Any) -> tuple[Verdict, Verdict]:
    """Return the verdicts on this caster and on Scene.ray_cast for the ray o + t d, t >= 0; world space, metres."""
    sides = make_sides(scene, depsgraph)
    names = sides.list_names()
    judge = Judge(sides.caster.geometry)
    ray = make_ray(origin, direction)
    rounded = make_ray(*(np.float32(vector).astype(np.float64) for vector in (origin, direction)))
    ours, hits = cast_ours(sides, ray)
    error = float(hits.distance_error[0])
    blender = cast_blender(sides, rounded)
    return (
        make_verdict(sides, judge, names, ray, ours, float(hits.distance[0]), error),
        make_verdict(sides, judge, names, rounded, blender, measure_distance(rounded, blender), None),
    )


def make_ray(origin: Any, direction: Any) -> Aimed:
    """Return one ray as a batch."""
    origins, directions = (np.asarray(vector, dtype=np.float64).reshape(1, 3) for vector in (origin, direction))
    return Aimed(origins, directions, np.array(["one"]))


def measure_distance(ray: Aimed, answers: Answers) -> float:
    """Return the t of the point of the ray closest to an answer's location; NaN for a miss."""
    offset, direction = answers.location[0] - ray.origins[0], ray.directions[0]
    return float(offset @ direction / (direction @ direction))


def make_verdict(
    sides: Sides,
    judge: Judge,
    names: Mapping[int, str],
    ray: Aimed,
    answers: Answers,
    distance: float,
    error: float | None,
) -> Verdict:
    """Return the verdict on one side."""
    origin, direction = ray.origins[0], ray.directions[0]
    first = sorted(judge.find_first(origin, direction))
    surfaces: Surfaces = frozenset()
    exact_distance = None
    if first:
        targets, polygons = sides.translate(*np.array(first).T)
        surfaces = frozenset(
            (names[int(target)], int(polygon)) for target, polygon in zip(targets, polygons, strict=True)
        )
        corners = np.stack(world_corners(judge.geometry, *(np.array([part]) for part in first[0])), axis=1)[0]
        exact_distance = find_exact_distance(origin, direction, corners)
    is_hit = answers.target[0] >= 0
    return Verdict(
        origin=origin,
        direction=direction,
        answer=(names[int(answers.target[0])], int(answers.polygon[0])) if is_hit else None,
        location=answers.location[0] if is_hit else None,
        distance=distance if is_hit else float("nan"),
        distance_error=error,
        exact_surfaces=surfaces,
        exact_distance=exact_distance,
    )


def find_exact_distance(origin: Floats, direction: Floats, corners: Floats) -> Fraction | None:
    """Return the t at which o + t d meets a triangle (3 corners, 3), as a fraction; None = it does not."""
    numbers, _ = exact.to_integers([*origin.tolist(), *direction.tolist(), *corners.ravel().tolist()])
    vectors = [(numbers[place], numbers[place + 1], numbers[place + 2]) for place in range(0, len(numbers), 3)]
    hit = exact.intersect_triangle(vectors[0], vectors[1], vectors[2:])
    return None if hit is None else Fraction(hit.t.rational, hit.t.scale)
