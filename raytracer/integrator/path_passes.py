"""What paths fill: the passes of a batch of camera rays, and what is kept of each ray until its path has ended."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Integers
from raytracer.casting.rays import Rays
from raytracer.film.passes import (
    GUIDES,
    VOLUME_DIRECT,
    VOLUME_INDIRECT,
    find_pass,
    list_light_groups,
    matte_table,
    select_mattes,
)
from raytracer.integrator.clamping import is_clamped
from raytracer.integrator.parts import Parts, start_parts
from raytracer.integrator.passes.guides import Guides, start_guides
from raytracer.integrator.settings import Settings
from raytracer.lecture import length


@dataclass(eq=False)
class PathPasses:
    """What n rays have seen so far, pass by pass.

    depth_unit : (n,) float64, metres along the ray for a metre of depth
    values : by pass, (n, channels) float64
    found : (n,) bool, True where the first surface is known, which Depth, Normal and so on describe
    background : (n,) float64, share of the ray that reached a background which is not part of the picture
    unshadowed : (n, 3) float64, direct light if nothing were in the way, or None where the Shadow pass is not asked for
    limit : (n,) float64, the largest sum of channels that light aimed at by the ray's path may add; None without limits
    parts : in which shares the first scattering of each ray's path has split its light; None where no pass asks
    guides : how far they are from what guides a denoiser; None where no pass asks
    caught : what shadow catchers show, or None where there are none
    light_groups : the passes of groups of lights that are asked for, by number
    lengths : (n,) float64, casts along the ray's path; None where nobody asks
    near : (n,) float64, what each would have seen of light that its reflections came near to; None without any
    in_medium : (n,) bool, True where a medium has scattered the ray's path first; None where no pass asks, or there are
        no media
    backdrop : (n, 3) float64, the background that the camera sees where catchers are seen through; None where it is no
        part of the picture, or there are none
    """

    values: dict[str, Floats]
    depth_unit: Floats
    found: Booleans
    background: Floats
    unshadowed: Floats | None
    limit: Floats | None
    parts: Parts | None = None
    guides: Guides | None = None
    caught: Caught | None = None
    backdrop: Floats | None = None
    lengths: Floats | None = None
    near: Floats | None = None
    light_groups: tuple[str, ...] = ()
    in_medium: Booleans | None = None

    def add(self, name: str, row: NDArray[np.int64], values: Floats) -> None:
        """Add (k, 3), or (k, channels), to a pass, if it is asked for; each ray at most once a call."""
        if name in self.values:
            # One column at a time: rows of three take twice as long.
            for target, column in zip(self.values[name].T[:3], values.T, strict=True):
                target[row] = target.take(row) + column

    def add_grouped(self, row: NDArray[np.int64], light: Floats, group: Integers | int) -> None:
        """Add light (k, 3) to the passes of the groups, one for all or (k,), that it comes from."""
        for number, name in enumerate(self.light_groups):
            if isinstance(group, int):
                if group == number:
                    self.add(name, row, light)
            else:
                rows = np.flatnonzero(group == number)
                self.add(name, row[rows], light[rows])

    def set(self, name: str, row: NDArray[np.int64], values: Any) -> None:
        """Overwrite a pass, if it is asked for."""
        if name in self.values:
            self.values[name][row] = np.reshape(values, (len(row), find_pass(name).channels))


@dataclass(eq=False)
class Caught:
    """What n rays have seen of shadow catchers.

    met : (n,) bool, True where the ray's path met one
    matte : (n, 4) float64, what it had seen till then, premultiplied; alpha is what hides the catcher
    catchers_only : what the path sees from there where there is nothing but catchers
    """

    met: Booleans
    matte: Floats
    catchers_only: PathPasses


def start_passes(settings: Settings, rays: Rays) -> PathPasses:
    """Return the record of camera rays that have seen nothing."""
    count = len(rays)
    plain = [name for name in settings.passes if not find_pass(name).matte]
    values = {name: np.full((find_pass(name).channels, count), find_pass(name).miss).T for name in plain}
    mattes = select_mattes(settings.passes)
    values |= {matte_table(kind): np.zeros((count, 2 * slots)) for kind, slots in mattes.items()}
    unshadowed = np.zeros((count, 3)) if "Shadow" in values else None
    limit = np.full(count, np.inf) if is_clamped(settings) else None
    lengths = np.zeros(count) if settings.adaptive else None
    depth_unit, found = length(rays.directions), np.zeros(count, dtype=np.bool_)
    by_media = any(name in (VOLUME_DIRECT, VOLUME_INDIRECT) for name in plain)
    parts = start_parts(count) if by_media or any(find_pass(name).color for name in plain) else None
    guides = start_guides(count) if any(name in GUIDES for name in plain) else None
    passes = PathPasses(values, depth_unit, found, np.zeros(count), unshadowed, limit)
    groups = list_light_groups(plain)
    return replace(passes, lengths=lengths, parts=parts, guides=guides, light_groups=groups)
