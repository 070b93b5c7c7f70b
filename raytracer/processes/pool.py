"""What a render needs of its workers: other pools than `Workers`, of a cluster for instance, are as good."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Protocol, runtime_checkable


@runtime_checkable
class Pool(Protocol):
    """A number of workers that hold a function and call it for jobs."""

    def __len__(self) -> int:
        """Return the number of workers."""
        ...

    def load(self, factory: Callable[..., Callable[[Any], Any]], *arguments: Any) -> None:
        """Let every worker call `factory(*arguments)`; what it returns will be called with each job."""
        ...

    def run(self, jobs: Iterable[Any], is_cancelled: Callable[[], bool]) -> Iterator[Any]:
        """Yield the result of every job, in order; stop early when `is_cancelled()`."""
        ...
