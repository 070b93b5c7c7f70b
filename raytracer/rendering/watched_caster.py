"""A caster that counts the rays it is asked for and asks in between whether the user has had enough."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from raytracer.arrays.types import Booleans
from raytracer.casting.caster import Caster
from raytracer.casting.rays import Hits
from raytracer.casting.subset_caster import SubsetCaster


class CancelledError(Exception):
    """The user stopped the render in the middle of a block."""


@dataclass
class RayCount:
    """Rays that casters were asked for together."""

    rays: int = 0


class WatchedCaster:
    """A caster that counts its rays, and raises CancelledError once `is_cancelled()`."""

    def __init__(
        self, caster: Caster | SubsetCaster, is_cancelled: Callable[[], bool], count: RayCount | None = None
    ) -> None:
        self._caster = caster
        self._is_cancelled = is_cancelled
        self._count = count or RayCount()

    @property
    def rays(self) -> int:
        """Rays of this caster and its parts."""
        return self._count.rays

    def take_part(self, present: Booleans) -> WatchedCaster:
        """Return a SubsetCaster that is watched and counted together with this one."""
        return WatchedCaster(SubsetCaster(self._caster, present), self._is_cancelled, self._count)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._caster, name)

    def closest_hit(self, *arguments: Any, **keywords: Any) -> Hits:
        """Watch and pass on."""
        return self._watch(self._caster.closest_hit, arguments, keywords)

    def any_hit(self, *arguments: Any, **keywords: Any) -> Booleans:
        """Watch and pass on."""
        return self._watch(self._caster.any_hit, arguments, keywords)

    def _watch(self, method: Callable[..., Any], arguments: Any, keywords: Any) -> Any:
        if self._is_cancelled():
            raise CancelledError
        found = method(*arguments, **keywords)
        self._count.rays += len(found)
        return found
