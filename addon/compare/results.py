"""What of a comparison is shown: a map of the error, and the worst pixels or rays as a list."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .cycles.flip import flip

Floats = NDArray[np.floating]

# Entries of the list; pixels closer than this to a worse one are left out, or one spot would fill it.
MOST_WORST = 32
APART = 3
# On the map of rays, what is brighter is a different surface.
LARGEST_HEAT = 0.5
# What is said of points that cannot be compared; JSON has no infinity.
FARTHEST = 1e30


@dataclass(frozen=True)
class Worst:
    """An entry of the list, in plain numbers, for JSON.

    label : what is shown; error : its measure, by which the list is sorted
    x, y : pixel from the lower left corner of the picture that was compared; -1 where the ray is none of the camera's
    origin, direction : of the ray; empty where only the pixel is known
    """

    label: str
    error: float
    x: int = -1
    y: int = -1
    origin: tuple[float, ...] = ()
    direction: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Outcome:
    """A comparison as the panel shows it.

    kind : 'cycles' or 'ray_cast'
    numbers : as the command line prints them
    heat : (h, w) float32, 0 (no error) to 1, row 0 at the top
    worst : worst first
    """

    kind: str
    numbers: dict[str, Any]
    heat: NDArray[np.float32]
    worst: list[Worst]

    def as_plain(self) -> dict[str, Any]:
        """Return all but the map, for JSON."""
        return {"kind": self.kind, "numbers": self.numbers, "worst": [asdict(entry) for entry in self.worst]}


def make_cycles_outcome(comparison: Any) -> Outcome:
    """Return the outcome of a `cycles.comparison.CyclesComparison`: the FLIP error of each pixel."""
    ours, cycles = (
        side.passes["Combined"][..., :3].mean(axis=0, dtype=np.float64) for side in (comparison.ours, comparison.cycles)
    )
    heat = flip(ours, cycles).astype(np.float32)
    height = len(heat)
    worst = [
        Worst(
            f"{error:.3f}   {format_color(ours[row, column])} for {format_color(cycles[row, column])}",
            error, x=column, y=height - 1 - row,
        )
        for row, column, error in find_worst(heat)
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


def make_ray_cast_outcome(comparison: Any, width: int, height: int) -> Outcome:
    """Return the outcome of a `ray_cast.comparison.RayCastComparison`.

    The map has 1 where the two sides hit different things; elsewhere the distance of their points, as a share of
    the largest that a camera ray has, times LARGEST_HEAT.
    """
    differs = ~comparison.agreeing & ((comparison.ours.target >= 0) | (comparison.blender.target >= 0))
    error = np.where(differs, np.inf, np.nan_to_num(comparison.position_error))
    camera = error[comparison.rays.family == "camera"]  # they come first
    largest = camera[np.isfinite(camera)].max(initial=0.0)
    heat = np.zeros(width * height, dtype=np.float32)
    heat[: len(camera)] = np.where(np.isinf(camera), 1.0, LARGEST_HEAT * camera / (largest or 1.0))
    order = np.argsort(-error, kind="stable")[:MOST_WORST]
    worst = [describe_ray(comparison, int(ray), float(error[ray]), width) for ray in order if error[ray] > 0]
    return Outcome("ray_cast", comparison.summarise(), heat.reshape(height, width)[::-1], worst)


def describe_ray(comparison: Any, ray: int, error: float, width: int) -> Worst:
    """Return the entry of one ray."""
    family = str(comparison.rays.family[ray])
    what = "different surfaces" if np.isinf(error) else f"{error:.2e} m apart"
    row, column = divmod(ray, width) if family == "camera" else (-1, -1)
    return Worst(
        f"{what}   ({family})",
        min(error, FARTHEST),
        x=column,
        y=row,
        origin=tuple(comparison.rays.origins[ray].tolist()),
        direction=tuple(comparison.rays.directions[ray].tolist()),
    )
