"""Paths of small waves wait for others that come as far, for a wave takes its time however few paths it has."""

from __future__ import annotations

from dataclasses import dataclass, field

from raytracer.integrator.paths import Paths, join_paths
from raytracer.sampling.sampler import Sampler


@dataclass(eq=False)
class WaitingPaths:
    """Paths of one wave that wait until they go on together.

    sampler : their wave's, for all rows of the batch
    parts : those that came together
    """

    sampler: Sampler
    parts: list[Paths] = field(default_factory=list)

    def __len__(self) -> int:
        return sum(map(len, self.parts))

    def add(self, paths: Paths) -> None:
        """Let some more wait."""
        if len(paths):
            self.parts.append(paths)

    def take(self) -> Paths:
        """Return all, in the order in which they came; none waits any longer."""
        parts, self.parts = self.parts, []
        return join_paths(parts)
