"""This engine's picture against Cycles' of the same .blend: is every difference noise, and if not, how large is it?

Combined is rendered in several independent batches by both engines and put to the tests of `verdict`; `compare_until`
adds samples until a given difference would be found. The other passes are rendered through the centres of the pixels,
where both engines should see the same point.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans
from raytracer.film.passes import PASSES

from ...properties import BOUNCE_LIMITS
from ..picture import save_png, show_heat, show_linear
from ..verdicts import UNDECIDED
from . import metrics, verdict
from .chance import BACKGROUND_DEPTH, Answer, ask_again, find_doubtful, find_seen, take_first
from .flip import flip, mean_flip
from .rendering import Rendering, Request, render_both
from .sequential import LOOK_SIGNIFICANCE, LOOKS, Plan, join_renderings, plan_batches

# Passes that hold one value per surface point, and those that hold one whole number.
POINT_PASSES = ("Depth", "Position", "Normal", "UV", "Diffuse Color", "Emission")
INDEX_PASSES = tuple(name for name, kind in PASSES.items() if kind.is_index)
# Those that Cycles takes from one path of a pixel.
PATH_PASSES = ("Depth", "Position", *INDEX_PASSES)
# The narrowest filter that both engines know, pixels.
CENTRE_WIDTH = 0.01
CENTRE_BATCHES = 8
# Points of a surface count as the same if they are no farther apart than this share of a pixel.
SAME_POINT = 0.01
BATCHES = 8
# Renders of a first look, of both engines: of the picture, and of the passes.
FIRST_RENDERS = 2 * (BATCHES + CENTRE_BATCHES)


@dataclass(frozen=True, eq=False)
class PassDifference:
    """How a pass of ours differs from Cycles'.

    differing : (h, w) bool, pixels whose difference float32 does not explain
    largest_elsewhere : the largest difference in the other pixels, in the pass's own unit
    ours, cycles : (h, w, c) float32, one render of each
    """

    differing: NDArray[np.bool_]
    largest_elsewhere: float
    ours: NDArray[np.floating]
    cycles: NDArray[np.floating]

    @property
    def share(self) -> float:
        return float(self.differing.mean())


@dataclass(frozen=True, eq=False)
class CyclesComparison:
    """Combined of both engines in batches (k, h, w, 4) of `samples` each, and the differences of the passes by name.

    to : the difference that shall be found, share of the level; significance : probability of a false alarm
    """

    samples: int
    ours: Rendering
    cycles: Rendering
    passes: dict[str, PassDifference]
    to: float = verdict.TO
    significance: float = metrics.SIGNIFICANCE

    @property
    def batches(self) -> int:
        return len(self.ours.passes["Combined"])

    @property
    def shares(self) -> dict[str, float]:
        """The share of differing pixels of each pass."""
        return {name: difference.share for name, difference in self.passes.items()}

    @cached_property
    def judgement(self) -> verdict.Judgement:
        """Pixels, tiles and the whole picture."""
        ours, cycles = (side.passes["Combined"][..., :3] for side in (self.ours, self.cycles))
        return verdict.judge_pictures(ours, cycles, self.to, self.samples, self.significance)

    def decide(self) -> tuple[str, str]:
        """Return the verdict, one of `verdicts.AGREES`, `DIFFERS` and `UNDECIDED`, and the reason in words."""
        return verdict.decide(self.judgement, self.shares, self.samples * self.batches)

    def summarise(self) -> dict[str, Any]:
        """Return the numbers that the command line prints, one JSON object."""
        ours, cycles = self.ours.passes["Combined"][..., :3], self.cycles.passes["Combined"][..., :3]
        mean_ours, mean_cycles = ours.mean(axis=0, dtype=np.float64), cycles.mean(axis=0, dtype=np.float64)
        tiles, judged, (word, reason) = metrics.measure_tiles(ours, cycles), self.judgement, self.decide()
        return {
            "rmse": metrics.root_mean_square_error(mean_ours, mean_cycles),
            "rel_mse": metrics.relative_mean_square_error(mean_ours, mean_cycles),
            "flip": mean_flip(mean_ours, mean_cycles),
            "z_fail_share": metrics.share_failing_pixels(ours, cycles, self.samples),
            "tile_error": tiles.error,
            "tile_noise": tiles.noise,
            "tile_bias": tiles.bias,
            "passes": self.shares,
            "ours_seconds": self.ours.seconds,
            "cycles_seconds": self.cycles.seconds,
            "samples": self.samples * self.batches,
            "picture_error": judged.picture.error,
            "picture_noise": judged.picture.noise,
            "picture_bias": judged.picture.bias,
            "pixel_detectable": judged.pixel_detectable,
            "tile_detectable": judged.tile.detectable,
            "picture_detectable": judged.picture.detectable,
            "to": self.to,
            "verdict": word,
            "reason": reason,
        }

    def save_picture(self, path: str | Path) -> None:
        """Write a PNG of ours, Cycles' and the FLIP error between them, side by side."""
        means = [side.passes["Combined"][..., :3].mean(axis=0) for side in (self.ours, self.cycles)]
        panels = [*(show_linear(mean) for mean in means), show_heat(flip(*means))]
        save_png(path, np.concatenate(panels, axis=1))


def compare_with_cycles(
    scene: Any, view_layer: Any, width: int, height: int, samples: int, batches: int = BATCHES
) -> CyclesComparison:
    """Render a scene with both engines and compare.

    Parameters
    ----------
    scene, view_layer : bpy.types.Scene and one of its view layers; their settings are put back afterwards
    samples : per pixel, shared out among `batches`, at least one each
    """
    picture = request_picture(scene, width, height, max(1, samples // batches), batches)
    ours, cycles = render_both(scene, view_layer, picture)
    return CyclesComparison(picture.samples, ours, cycles, compare_passes(scene, view_layer, width, height))


def compare_until(
    scene: Any,
    view_layer: Any,
    width: int,
    height: int,
    to: float,
    first: int,
    most: int,
    on_look: Callable[[str, int], None] | None = None,
) -> CyclesComparison:
    """Compare a scene with samples enough to find a difference.

    Parameters
    ----------
    scene, view_layer : as in `compare_with_cycles`
    to : the difference that shall be found, share of the level
    first, most : samples per pixel to begin with, and at which this gives up: the verdict is then undecided
    on_look : called before samples are added with what the last look said, in words, and with how many renders follow
    """
    comparison = compare_with_cycles(scene, view_layer, width, height, min(first, most))
    comparison = replace(comparison, to=to, significance=LOOK_SIGNIFICANCE)
    seed = comparison.batches
    for _ in range(LOOKS - 1):
        shortage = verdict.measure_shortage(comparison.judgement)
        plan = plan_batches(comparison.samples, comparison.batches, shortage, most)
        if comparison.decide()[0] != UNDECIDED or plan is None:
            break
        if on_look is not None:
            on_look(describe_look(comparison, plan), 2 * plan.batches)
        picture = request_picture(scene, width, height, plan.samples, plan.batches)
        more = render_both(scene, view_layer, replace(picture, seed=seed))
        seed += plan.batches
        sides = (comparison.ours, comparison.cycles)
        ours, cycles = (join_renderings(*pair, plan.merged) for pair in zip(sides, more, strict=True))
        comparison = replace(comparison, samples=plan.samples, ours=ours, cycles=cycles)
    return comparison


def describe_look(comparison: CyclesComparison, plan: Plan) -> str:
    """Return in words how large a difference a comparison hides, and what is added to it."""
    largest = max(comparison.judgement.tile.detectable, comparison.judgement.picture.detectable)
    return (
        f"{comparison.samples * comparison.batches} samples: noise would hide differences up to "
        f"{verdict.show_share(largest)}; {plan.samples * plan.batches} more are taken to find "
        f"{verdict.show_share(comparison.to)}"
    )


def request_picture(scene: Any, width: int, height: int, samples: int, batches: int) -> Request:
    """Return what both engines shall render: Combined, with the integrator and the limits of the scene."""
    chosen = scene.reference_raytracer
    return Request(
        *(width, height, samples, chosen.max_bounces, batches),
        integrator=chosen.integrator,
        limits={name: getattr(chosen, name) for name in BOUNCE_LIMITS},
    )


def compare_passes(scene: Any, view_layer: Any, width: int, height: int) -> dict[str, PassDifference]:
    """Render the passes through the pixel centres with both engines, and return their differences by name.

    Cycles takes the first sample of a pixel through its centre, and reads its offset, nought, from a table of its pixel
    filter; half a step of the table is left of it, which the narrowest filter makes smallest. So does this engine for
    Depth, Position and the indices; its Normal comes from a sample within `CENTRE_WIDTH`, a few of which are taken.
    """
    names = ("Combined", *POINT_PASSES, *INDEX_PASSES)
    centres = Request(
        width,
        height,
        samples=1,
        max_bounces=0,
        batches=CENTRE_BATCHES,
        pixel_filter="BLACKMAN_HARRIS",
        filter_width=CENTRE_WIDTH,
        through_centre=True,
        passes=names,
    )
    ours, cycles = render_both(scene, view_layer, centres)
    pairs = {name: (ours.passes[name], cycles.passes[name]) for name in names[1:]}
    pairs["Alpha"] = ours.passes["Combined"][..., 3:], cycles.passes["Combined"][..., 3:]
    seen = find_seen(ours.passes["Depth"]), find_seen(cycles.passes["Depth"])
    found = {name: compare_pass(name, *pair, seen if name in PATH_PASSES else None) for name, pair in pairs.items()}
    doubtful = find_doubtful(*seen)
    if doubtful.any() and max(found[name].share for name in PATH_PASSES) > verdict.PASSES_BAR:
        asked = replace(centres, seed=CENTRE_BATCHES, passes=PATH_PASSES)
        answer = ask_again(scene, view_layer, asked, doubtful, verdict.PASSES_BAR)
        found |= {name: join_answer(name, *pairs[name], *seen, answer) for name in PATH_PASSES}
    return found


def join_answer(
    name: str,
    ours: NDArray[np.floating],
    cycles: NDArray[np.floating],
    seen_ours: Booleans,
    seen_cycles: Booleans,
    answer: Answer,
) -> PassDifference:
    """Return how a pass differs with what Cycles answered: no chance excuses a surface that it has not shown now."""
    seen = np.concatenate([seen_cycles, answer.seen])
    difference = compare_pass(name, ours, np.concatenate([cycles, answer.passes[name]]), (seen_ours, seen))
    if name in INDEX_PASSES:  # the background's is that of most objects
        return difference
    return replace(difference, differing=difference.differing | (seen_ours.all(axis=0) & ~seen.any(axis=0)))


def compare_pass(
    name: str, ours: NDArray[np.floating], cycles: NDArray[np.floating], seen: tuple[Booleans, Booleans] | None = None
) -> PassDifference:
    """Return where and by how much a pass of both engines, (k, h, w, c) each, differs: the gap between their ranges.

    Cycles' values have a range where chance decides, on what a transparent surface lets through; ours also where they
    are seen beside the pixel's centre. Ranges of indices have to overlap. Where chance decides nearly always alike, it
    is the neighbours that show it: such a pixel has to fail the test of means as well.

    seen : (k, h, w) of both, where a surface is seen: only that is compared, where both engines show one at all
    """
    ours, cycles = ours.astype(np.float64), cycles.astype(np.float64)
    filled, shown = (ours, cycles), np.ones(ours.shape[1:3], np.bool_)
    if seen is not None:
        shown = seen[0].any(axis=0) & seen[1].any(axis=0)
        filled = fill_missed(ours, seen[0] | ~shown), fill_missed(cycles, seen[1] | ~shown)
    (lowest, highest), (lowest_cycles, highest_cycles) = ((side.min(axis=0), side.max(axis=0)) for side in filled)
    gap = np.maximum(np.maximum(lowest - highest_cycles, lowest_cycles - highest), 0).max(axis=-1)
    width = (highest - lowest).max(axis=-1)
    allowed = np.zeros_like(gap) if name in INDEX_PASSES else allow_difference(name, filled[1][0], width)
    failing = metrics.find_failing(*filled, pool=metrics.POOL)
    if not shown.all():  # it is the background that is seen elsewhere which tells of chance
        failing = np.where(shown, failing, metrics.find_failing(ours, cycles, pool=metrics.POOL))
    differing = ~(gap <= allowed) & failing
    return PassDifference(differing, float(gap[~differing].max(initial=0.0)), ours[0], cycles[0])


def fill_missed(values: NDArray[np.floating], seen: Booleans) -> NDArray[np.floating]:
    """Return batches (k, h, w, c) with the first values of a surface where none is seen (k, h, w)."""
    return np.where(seen[..., np.newaxis], values, take_first(values, seen))


def allow_difference(name: str, cycles: NDArray[np.floating], width: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return (h, w) by how much values of a pass (h, w, c) may lie outside their ranges, of a `width` (h, w).

    By the width of the range (the limb of a sphere), by `SAME_POINT` of the step to the farthest neighbour (Cycles
    interpolates by float32 barycentric coordinates), by the steps in which Cycles stores normals, by what tables of
    albedo are right to, and by float32 rounding of the largest value in the picture (a coordinate is the rounded
    difference of larger ones).
    """
    surface = cycles[np.abs(cycles) < BACKGROUND_DEPTH]
    rounding = metrics.float32_slack(metrics.FLOAT32_OPERATIONS) * np.abs(surface).max(initial=0.0)
    allowed = np.maximum(width, SAME_POINT * measure_largest_step(cycles)) + rounding
    if name == "Normal":
        allowed += NORMAL_STORAGE
    if name == "Diffuse Color":
        allowed += ALBEDO_TABLES * np.abs(cycles).max(axis=-1)
    return allowed


# Cycles 5.2 stores a vertex normal in two words of 16 bits, on an octahedron: each is off by up to 1 / 65535, which
# the way back to the sphere magnifies by up to the square root of 3.
NORMAL_STORAGE = 2 * 3**0.5 / 65535
# What a glossy layer leaves to the diffuse one under it is read from tables; ours are right to this share
# (`raytracer.bsdfs.microfacet_albedo`), Cycles' are means of random samples, printed with six decimals.
ALBEDO_TABLES = 1e-3


def measure_largest_step(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return (h, w): the largest difference of any channel between a pixel of (h, w, c) and its eight neighbours."""
    padded = np.pad(values, ((1, 1), (1, 1), (0, 0)), mode="edge")
    height, width = values.shape[:2]
    steps = [
        np.abs(padded[row : row + height, column : column + width] - values).max(axis=-1)
        for row in range(3)
        for column in range(3)
    ]
    return np.max(steps, axis=0)
