"""What of a comparison is shown: a map of the error, and the worst pixels or rays as a list."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.casting.caster import build
from raytracer.film.camera import primary_rays

from ..extract.camera import extract_camera
from ..extract.scene import extract_scene
from ..extract.warnings import WarningList
from .cycles.flip import flip

Floats = NDArray[np.floating]

# Entries of the list; pixels closer than this to a worse one are left out, or one spot would fill it.
MOST_WORST = 32
APART = 3
# On the map of rays, what is brighter is a different surface.
LARGEST_HEAT = 0.5
# Errors of pictures are small: their map is brightened until no more than this share of the pixels is white.
WHITE_SHARE = 1e-3
# What is said of points that cannot be compared; JSON has no infinity.
FARTHEST = 1e30


@dataclass(frozen=True)
class Worst:
    """An entry of the list, in plain numbers, for JSON.

    error : its measure, by which the list is sorted; apart : the same in words
    place : the pixel, or the ray's family; object : what is seen there
    ours, theirs : what both sides say
    x, y : pixel from the lower left corner of the picture that was compared; -1 where the ray is none of the camera's
    origin, direction : of the ray; empty where only the pixel is known
    """

    error: float
    apart: str
    place: str
    object: str
    ours: str
    theirs: str
    x: int = -1
    y: int = -1
    origin: tuple[float, ...] = ()
    direction: tuple[float, ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """What a row of the list shows."""
        return self.apart, self.place, self.object, self.ours, self.theirs


@dataclass(frozen=True, eq=False)
class Outcome:
    """A comparison as the panel shows it.

    kind : 'cycles' or 'ray_cast'
    numbers : as the command line prints them
    heat : (h, w) float32, 0 (no error) to 1, row 0 at the top
    worst : worst first
    gain : factor that makes the map worth looking at
    """

    kind: str
    numbers: dict[str, Any]
    heat: NDArray[np.float32]
    worst: list[Worst]

    @property
    def gain(self) -> float:
        return choose_gain(self.heat) if self.kind == "cycles" else 1.0

    def as_plain(self) -> dict[str, Any]:
        """Return all but the map, for JSON."""
        return {"kind": self.kind, "numbers": self.numbers, "worst": [asdict(entry) for entry in self.worst]}


def choose_gain(heat: Floats) -> float:
    """Return the largest of 1, 2, 5, 10, 20, 50, ... that leaves all but WHITE_SHARE of the pixels at 1 or less."""
    level = float(np.quantile(heat, 1.0 - WHITE_SHARE))
    steps = [step * 10.0**power for power in range(4) for step in (1.0, 2.0, 5.0)]
    return max((step for step in steps if step * level <= 1.0), default=1.0)


def name_objects(depsgraph: Any, pixels: list[tuple[int, int]], width: int, height: int) -> list[str]:
    """Return what the camera sees through the centres of pixels, counted from the lower left corner."""
    camera = extract_camera(depsgraph.scene_eval, WarningList())
    if camera is None or not pixels:
        return ["" for _ in pixels]
    extraction = extract_scene(depsgraph, geometry_only=True)
    column, row = np.array(pixels, dtype=np.float64).T + 0.5
    rays = primary_rays(camera, width, height, column, row)
    hits = build(extraction.scene).closest_hit(rays.origins, rays.directions)
    return [extraction.objects[instance].name if instance >= 0 else "nothing" for instance in hits.instance.tolist()]


def make_cycles_outcome(comparison: Any, name: Callable[[list[tuple[int, int]]], list[str]]) -> Outcome:
    """Return the outcome of a `cycles.comparison.CyclesComparison`: the FLIP error of each pixel.

    name : gives the names of what is seen in pixels, as `name_objects`
    """
    ours, cycles = (
        side.passes["Combined"][..., :3].mean(axis=0, dtype=np.float64) for side in (comparison.ours, comparison.cycles)
    )
    heat = flip(ours, cycles).astype(np.float32)
    height = len(heat)
    found = find_worst(heat)
    pixels = [(column, height - 1 - row) for row, column, _ in found]
    worst = [
        Worst(
            error, f"{error:.3f}", f"{x}, {y}", seen,
            format_color(ours[row, column]), format_color(cycles[row, column]), x, y,
        )
        for (row, column, error), (x, y), seen in zip(found, pixels, name(pixels), strict=True)
    ]  # fmt: skip
    return Outcome("cycles", comparison.summarise(), heat, worst)


def format_color(color: Floats) -> str:
    """Return a color in a few letters."""
    return ", ".join(f"{channel:.2g}" for channel in color)


def find_worst(heat: Floats) -> list[tuple[int, int, float]]:
    """Return (row, column, error) of the worst pixels of (h, w), the worst first, none within APART of a worse one."""
    left = np.array(heat, dtype=np.float64)
    found: list[tuple[int, int, float]] = []
    while len(found) < MOST_WORST and left.max(initial=0.0) > 0:
        row, column = (int(place) for place in np.unravel_index(left.argmax(), left.shape))
        found.append((row, column, float(left[row, column])))
        rows, columns = (slice(max(place - APART, 0), place + APART + 1) for place in (row, column))
        left[rows, columns] = 0.0
    return found


def make_ray_cast_outcome(comparison: Any, width: int, height: int, names: Mapping[int, str]) -> Outcome:
    """Return the outcome of a `ray_cast.comparison.RayCastComparison`.

    The map has 1 where the two sides hit different things; elsewhere the distance of their points, as a share of
    the largest that a camera ray has, times LARGEST_HEAT.

    names : the objects, by the numbers that both sides give them
    """
    differs = ~comparison.agreeing & ((comparison.ours.target >= 0) | (comparison.blender.target >= 0))
    error = np.where(differs, np.inf, np.nan_to_num(comparison.position_error))
    camera = error[comparison.rays.family == "camera"]  # they come first
    largest = camera[np.isfinite(camera)].max(initial=0.0)
    heat = np.zeros(width * height, dtype=np.float32)
    heat[: len(camera)] = np.where(np.isinf(camera), 1.0, LARGEST_HEAT * camera / (largest or 1.0))
    order = np.argsort(-error, kind="stable")[:MOST_WORST]
    worst = [describe_ray(comparison, int(ray), float(error[ray]), width, names) for ray in order if error[ray] > 0]
    return Outcome("ray_cast", comparison.summarise(), heat.reshape(height, width)[::-1], worst)


def describe_ray(comparison: Any, ray: int, error: float, width: int, names: Mapping[int, str]) -> Worst:
    """Return the entry of one ray."""
    family = str(comparison.rays.family[ray])
    row, column = divmod(ray, width) if family == "camera" else (-1, -1)
    seen, other = (int(side.target[ray]) for side in (comparison.ours, comparison.blender))
    ours, theirs = (
        f"polygon {side.polygon[ray]}" if side.target[ray] >= 0 else "miss"
        for side in (comparison.ours, comparison.blender)
    )
    return Worst(
        min(error, FARTHEST),
        "surfaces" if np.isinf(error) else f"{error:.2e} m",
        f"{column}, {row}" if family == "camera" else family,
        names.get(seen, "nothing"),
        ours,
        theirs if other in (seen, -1) else f"{names[other]}, {theirs}",
        x=column,
        y=row,
        origin=tuple(comparison.rays.origins[ray].tolist()),
        direction=tuple(comparison.rays.directions[ray].tolist()),
    )
