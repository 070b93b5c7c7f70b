"""The rays of a tree as colored lines."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.integrator.traced_rays import CAMERA, PASSED, REFLECTED, REFRACTED, Hit, TracedRay

Color = tuple[float, float, float, float]

# Linear RGBA of the lines, by what they show; the same as the icons of the list.
LINE_COLORS: dict[str, Color] = {
    CAMERA: (0.95, 0.95, 0.95, 1.0),
    REFLECTED: (0.10, 0.45, 1.00, 1.0),
    REFRACTED: (0.10, 0.80, 0.30, 1.0),
    PASSED: (0.60, 0.60, 0.60, 1.0),
    "lit": (1.00, 0.80, 0.05, 1.0),
    "blocked": (0.95, 0.10, 0.08, 1.0),
    "normal": (0.80, 0.20, 0.90, 1.0),
}
# Rays that end nowhere are drawn as long as the camera's ray, faded; with nothing to go by, as long as this.
FADED = 0.35
LONELY_LENGTH = 10.0
# Normals, as a share of the camera ray's length.
NORMAL_SHARE = 0.06


@dataclass(frozen=True, eq=False)
class Segments:
    """k lines: ends (k, 2, 3) float32, metres, world, their colors (k, 2, 4) float32, and the number (k,) of the ray
    that each belongs to."""

    ends: NDArray[np.float32]
    colors: NDArray[np.float32]
    ray: NDArray[np.int32]

    def select(self, rows: NDArray[np.bool_]) -> Segments:
        """Return some of the lines."""
        return Segments(self.ends[rows], self.colors[rows], self.ray[rows])


Piece = tuple[NDArray[np.float64], NDArray[np.float64], Color, Color]  # two ends, two colors


def make_segments(tree: Sequence[TracedRay]) -> Segments:
    """Return all lines that show a tree."""
    length = measure_length(tree)
    numbered = [(number, piece) for number, ray in enumerate(tree) for piece in list_pieces(ray, length)]
    return Segments(
        ends=np.array([piece[:2] for _, piece in numbered], dtype=np.float32).reshape(-1, 2, 3),
        colors=np.array([piece[2:] for _, piece in numbered], dtype=np.float32).reshape(-1, 2, 4),
        ray=np.array([number for number, _ in numbered], dtype=np.int32),
    )


def measure_length(tree: Sequence[TracedRay]) -> float:
    """Return the length in metres of the first ray that hits anything."""
    for ray in tree:
        if ray.hit:
            return ray.hit.distance * float(np.linalg.norm(ray.direction))
    return LONELY_LENGTH


def list_pieces(ray: TracedRay, length: float) -> Iterator[Piece]:
    """Yield the lines of a ray, its normal and its shadow rays."""
    color = LINE_COLORS[ray.kind]
    if ray.hit is None:
        yield ray.origin, reach(ray.origin, ray.direction, length), color, fade(color)
        return
    yield ray.origin, ray.hit.position, color, color
    yield ray.hit.position, find_normal_tip(ray.hit, length), LINE_COLORS["normal"], LINE_COLORS["normal"]
    for shadow in ray.shadows:
        color = LINE_COLORS["blocked" if shadow.is_blocked else "lit"]
        if np.isfinite(shadow.end):
            yield shadow.origin, shadow.origin + shadow.end * shadow.direction, color, color
        else:
            yield shadow.origin, reach(shadow.origin, shadow.direction, length), color, fade(color)


def find_normal_tip(hit: Hit, length: float) -> NDArray[np.float64]:
    """Return where the line of a shading normal ends, on the side that the ray came from."""
    side = 1.0 if hit.front else -1.0
    return hit.position + side * NORMAL_SHARE * length * hit.shading_normal


def reach(origin: NDArray[np.float64], direction: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """Return the point so many metres along a direction of any length."""
    return origin + direction * (length / float(np.linalg.norm(direction)))


def fade(color: Color) -> Color:
    """Return a color that is hardly there."""
    return (*color[:3], FADED * color[3])
