"""A caster that counts the rays it is asked for and asks in between whether the user has had enough."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from raytracer.arrays.types import Booleans
from raytracer.casting.geometry import Geometry
from raytracer.casting.primitives import Primitives
from raytracer.casting.ray_visibility import RayCaster
from raytracer.casting.rays import Hits
from raytracer.casting.subset_caster import SubsetCaster
from raytracer.processes.dropping import DroppedError
from raytracer.scene.scene import Scene


class CancelledError(DroppedError):
    """The user stopped the render in the middle of a block."""


@dataclass
class RayCount:
    """Rays that casters were asked for together."""

    rays: int = 0


class WatchedCaster:
    """A caster that counts its rays, and raises CancelledError once `is_cancelled()`."""

    def __init__(self, caster: RayCaster, is_cancelled: Callable[[], bool], count: RayCount | None = None) -> None:
        # A whole scene's caster, or the caster of a part, of which nobody asks for the geometry.
        self._caster: Any = caster
        self._is_cancelled = is_cancelled
        self._count = count or RayCount()

    @property
    def rays(self) -> int:
        """Rays of this caster and its parts."""
        return self._count.rays

    def take_part(self, present: Booleans) -> WatchedCaster:
        """Return a SubsetCaster that is watched and counted together with this one."""
        return WatchedCaster(SubsetCaster(self._caster, present), self._is_cancelled, self._count)

    @property
    def geometry(self) -> Geometry:
        """That of the caster."""
        return self._caster.geometry

    @property
    def roundoff(self) -> float:
        """That of the caster."""
        return self._caster.roundoff

    @property
    def scene(self) -> Scene:
        """That of the caster."""
        return self._caster.scene

    @property
    def primitives(self) -> Primitives:
        """Those of the caster."""
        return self._caster.primitives

    def closest_hit(self, *arguments: Any, **keywords: Any) -> Hits:
        """As `Caster.closest_hit`; raises CancelledError."""
        return self._watch(self._caster.closest_hit, arguments, keywords)

    def any_hit(self, *arguments: Any, **keywords: Any) -> Booleans:
        """As `Caster.any_hit`; raises CancelledError."""
        return self._watch(self._caster.any_hit, arguments, keywords)

    def _watch(self, method: Callable[..., Any], arguments: Any, keywords: Any) -> Any:
        if self._is_cancelled():
            raise CancelledError
        found = method(*arguments, **keywords)
        self._count.rays += len(found)
        return found
