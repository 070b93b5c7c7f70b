"""What a user may choose about a render; everything else follows from the scene (`features`)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from raytracer.arrays.checks import as_array, require_choice, require_range
from raytracer.film.passes import NAMED, PASSES, is_pass, select_passes
from raytracer.predicates.rounding import PRECISIONS

Border = tuple[int, int, int, int]

# What is followed beyond the first surface: mirrors, glass and the like, or diffuse reflection as well.
INTEGRATORS = ("direct", "path")

# Blender's default widths, in pixels.
FILTER_WIDTHS = {"blackman_harris": 1.5, "box": 1.0}

# Sample numbers, pixel indices and seeds are 32-bit words in `sampling`.
WORD_LIMIT = 2**32

# Groups of pixels that take different points of lights are numbered in a byte.
LARGEST_INTERLEAVING = 16

# What decides how a render is done, or how much of it, and no bit of a sample.
FREE_SETTINGS = (
    "samples",
    "error",
    "min_samples",
    "seconds",
    "workers",
    "block_size",
    "border",
    "tile",
    "interleaving",
)


@dataclass(frozen=True)
class Settings:
    """The settings of a render.

    samples : rays per pixel, at most
    error : the error of the picture (`Film.error`) at which it is done, 0.01 for 1%; None takes all samples
    min_samples : before which the error does not end it; 0 chooses
    adaptive : True gives more samples to pixels that need them; all together cost as much as `samples` of each.
        A border or a tile spreads its own, so its pixels are not bit for bit those of the whole picture
    seconds : the time that tracing may take; it ends after the last sweep that fits in, but not before the first. None
        sets no limit
    integrator : 'direct' follows reflection and transmission but diffuse, or diffuse only to what shines, where that
        makes a difference (`Integrator.looks_around`); 'path' everything
    max_bounces : reflections and transmissions that a ray may go through; straight passages do not count
    diffuse_bounces, glossy_bounces, transmission_bounces, volume_bounces : how many of them may be diffuse reflections,
        other reflections, transmissions, and scattering by media; None takes max_bounces
    transparent_bounces : straight passages of a ray, after the last of which it only sees emission (0 as 1, as in
        Cycles)
    shadow_passages : the most straight passages of a ray together with a shadow ray from it; None takes
        transparent_bounces
    clamp_direct, clamp_indirect : the most that one sample of light may add to a pixel, as the mean of its channels,
        after no bounce, and after one or more; 0 sets no limit
    filter_glossy : the density of a bounce below which what follows is blurred; 0 blurs nothing. A picture is exact
        where all three are 0
    seed : another seed gives another, independent picture of the same noise
    passes : names from `passes.PASSES`, and such as `passes.NAMED` begins
    precision : 'certified', 'float64' or 'float32', see `raytracer.build`
    workers : processes that trace; 1 traces in this process
    mist : metres from the camera where the Mist pass starts, metres from there until it hides everything, and the power
        by which it thickens
    occlusion_distance : metres from a surface within which others count for the Ambient Occlusion pass
    exposure : factor of all light in the picture; clamping comes before it
    transparent : True leaves the background out of the picture, alpha 0
    pixel_filter : 'blackman_harris' or 'box'
    filter_width : pixels; the radius of Blackman-Harris (as Blender counts it), the whole side of the box; 0 samples
        the pixel's centre alone. None takes Blender's: 1.5 and 1
    block_size : most camera rays traced at a time; changes no result
    border : (x_min, y_min, x_max, y_max), pixels, y up, upper bounds exclusive; None renders the full picture
    tile : (i, n), the i-th part, from 1, of n that `cut` makes of the picture inside the border; None renders all
    interleaving : side of the squares of pixels that take different points of lights; 0 gives every pixel its own.
        None chooses by the size of picture and scene
    """

    samples: int = 64
    error: float | None = None
    min_samples: int = 0
    seconds: float | None = None
    adaptive: bool = False
    integrator: str = "direct"
    max_bounces: int = 8
    diffuse_bounces: int | None = None
    glossy_bounces: int | None = None
    transmission_bounces: int | None = None
    volume_bounces: int | None = None
    transparent_bounces: int = 128
    shadow_passages: int | None = None
    clamp_direct: float = 0.0
    clamp_indirect: float = 0.0
    filter_glossy: float = 0.0
    seed: int = 0
    passes: tuple[str, ...] = ("Combined",)
    precision: str = "certified"
    workers: int = 1
    mist: tuple[float, float, float] = (5.0, 25.0, 2.0)
    occlusion_distance: float = 10.0
    exposure: float = 1.0
    transparent: bool = False
    pixel_filter: str = "blackman_harris"
    filter_width: float | None = None
    block_size: int = 1 << 19
    border: Border | None = None
    tile: tuple[int, int] | None = None
    interleaving: int | None = None

    def __post_init__(self) -> None:
        for name in ("diffuse_bounces", "glossy_bounces", "transmission_bounces", "volume_bounces"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, self.max_bounces)
        if self.shadow_passages is None:
            object.__setattr__(self, "shadow_passages", self.transparent_bounces)
        for name, low, high in (
            ("samples", 1, WORD_LIMIT - 1),
            ("min_samples", 0, WORD_LIMIT - 1),
            ("max_bounces", 0, None),
            ("diffuse_bounces", 0, None),
            ("glossy_bounces", 0, None),
            ("transmission_bounces", 0, None),
            ("volume_bounces", 0, None),
            ("transparent_bounces", 0, None),
            ("shadow_passages", 0, None),
            ("seed", 0, WORD_LIMIT - 1),
            ("workers", 1, None),
            ("block_size", 1, None),
        ):
            object.__setattr__(self, name, check_integer(getattr(self, name), low, high, f"Settings: {name}"))
        for name in ("clamp_direct", "clamp_indirect", "filter_glossy", "occlusion_distance", "exposure"):
            object.__setattr__(self, name, _check_number(getattr(self, name), f"Settings: {name}"))
        for name in ("adaptive", "transparent"):
            object.__setattr__(self, name, _check_flag(getattr(self, name), f"Settings: {name}"))
        for name in ("error", "seconds"):
            object.__setattr__(self, name, _check_limit(getattr(self, name), f"Settings: {name}"))
        require_choice(self.integrator, INTEGRATORS, "Settings: integrator")
        require_choice(self.precision, PRECISIONS, "Settings: precision")
        require_choice(self.pixel_filter, tuple(FILTER_WIDTHS), "Settings: pixel_filter")
        object.__setattr__(self, "passes", _check_passes(self.passes))
        object.__setattr__(self, "mist", _check_mist(self.mist))
        if self.error is not None and "Combined" not in select_passes(self.passes, from_centre=False):
            raise ValueError(
                f"Settings: error: expected Combined, whose error it is, among the passes, got {self.passes}"
            )
        object.__setattr__(self, "filter_width", _check_filter_width(self.filter_width, self.pixel_filter))
        object.__setattr__(self, "border", _check_border(self.border))
        object.__setattr__(self, "tile", _check_tile(self.tile))
        if self.interleaving is not None:
            side = check_integer(self.interleaving, 0, LARGEST_INTERLEAVING, "Settings: interleaving")
            object.__setattr__(self, "interleaving", side)


def check_known(names: Iterable[str], file: str) -> None:
    """Raise ValueError, naming the file, where it gives a picture's size and settings other names than there are."""
    for name in names:
        if name not in ("width", "height", *Settings.__dataclass_fields__):
            raise ValueError(f"{file}: a setting {name!r}, which this version does not know")


def check_integer(value: Any, low: int, high: int | None, field: str) -> int:
    """Return a whole number from low to high (None: no upper limit), NumPy's integers included, as int.

    Raises
    ------
    ValueError
        If it is anything else.
    """
    if isinstance(value, bool) or not hasattr(value, "__index__"):
        raise ValueError(f"{field}: expected a whole number, got {value!r}")
    number = int(value)
    if number < low or (high is not None and number > high):
        limits = f"of {low} or more" if high is None else f"from {low} to {high}"
        raise ValueError(f"{field}: expected a whole number {limits}, got {number}")
    return number


def _check_mist(mist: Any) -> tuple[float, float, float]:
    values = as_array(mist, np.float64, (3,), "Settings: mist")
    require_range(values, 0.0, float(np.finfo(np.float32).max), "Settings: mist")
    start, depth, power = values.tolist()
    return start, depth, power


def _check_flag(value: Any, field: str) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{field}: expected True or False, got {value!r}")
    return bool(value)


def _check_passes(passes: Any) -> tuple[str, ...]:
    names = (passes,) if isinstance(passes, str) else tuple(passes) if isinstance(passes, Iterable) else ()
    for name in names:
        if not is_pass(name):
            require_choice(name, (*PASSES, *(start + "..." for start in NAMED)), "Settings: passes")
    if not names or len(set(names)) < len(names):
        raise ValueError(f"Settings: passes: expected one or more different names, got {names or passes}")
    return names


def _check_filter_width(width: Any, pixel_filter: str) -> float:
    if width is None:
        return FILTER_WIDTHS[pixel_filter]
    return _check_number(width, "Settings: filter_width")


def _check_limit(value: Any, field: str) -> float | None:
    """Return a number above 0, or None for no limit."""
    if value is None:
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = 0.0
    if not 0.0 < number < float("inf"):
        example = ", such as 0.01 for 1%" if field.endswith("error") else ""
        raise ValueError(f"{field}: expected a finite number above 0{example}, or None for no limit, got {value!r}")
    return number


def _check_number(value: Any, field: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{field}: expected a number, got {value!r}") from None
    if not 0.0 <= number < float("inf"):
        raise ValueError(f"{field}: expected a finite number of 0 or more, got {number}")
    return number


def _check_border(border: Any) -> Border | None:
    if border is None:
        return None
    bounds = tuple(border) if isinstance(border, Iterable) else ()
    if len(bounds) != 4:
        raise ValueError(f"Settings: border: expected (x_min, y_min, x_max, y_max), got {border}")
    x_min, y_min, x_max, y_max = (check_integer(bound, 0, None, "Settings: border") for bound in bounds)
    if x_min >= x_max or y_min >= y_max:
        raise ValueError(f"Settings: border: expected x_min < x_max and y_min < y_max, got {bounds}")
    return x_min, y_min, x_max, y_max


def _check_tile(tile: Any) -> tuple[int, int] | None:
    if tile is None:
        return None
    numbers = tuple(tile) if isinstance(tile, Iterable) else ()
    if len(numbers) != 2:
        raise ValueError(f"Settings: tile: expected (i, n), the i-th of n parts, got {tile}")
    count = check_integer(numbers[1], 1, None, "Settings: tile: n")
    return check_integer(numbers[0], 1, count, "Settings: tile: i"), count
