"""Passes that are made when they are asked for: all of a large film's at once would take half of what its sums do."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


class PassesOnDemand(Mapping[str, NDArray[Any]]):
    """Passes by name, each made anew by `read`."""

    def __init__(self, names: tuple[str, ...], read: Callable[[str], NDArray[np.float32]]) -> None:
        self._names, self._read = names, read

    def __getitem__(self, name: str) -> NDArray[np.float32]:
        return self._read(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)
